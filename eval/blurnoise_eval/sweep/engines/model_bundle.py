"""Work on its way to another machine, with the files of its models: they need not stand there.

A model pickles as what opened it, by the names of its files. A bundle holds what stands under these names, and what a
model looks for beside its file: contract, external weights, dictionary.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from blurnoise_eval.detectors.model_files import external_files
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.files import inside, write_whole

_SUFFIXES = (".onnx", ".ort", ".json", ".yaml", ".yml", ".txt")


@dataclass(frozen=True)
class ModelBundle:
    """Pickled work, and the files that it names.

    files: for each of these its own name, and the bytes of what belongs to it, by names beside it. key: SHA-256 of
    all of it.
    """

    pickled: bytes
    files: tuple[tuple[str, Mapping[str, bytes]], ...]
    key: str

    @classmethod
    def of(cls, work: Work) -> ModelBundle:
        """Raises what pickling and reading raise."""
        packed = io.BytesIO()
        pickler = _Pickler(packed)
        pickler.dump(work)
        contracts = [getattr(model, "contract", None) for model in work.models]
        every = [*contracts, *(getattr(each, "text", None) for each in contracts)]
        dictionaries = [name for each in every if (name := getattr(each, "dictionary", None))]
        files = tuple((path.name, _contents(path, dictionaries)) for path in pickler.files)
        key = hashlib.sha256(pickle.dumps((packed.getvalue(), files))).hexdigest()
        return cls(packed.getvalue(), files, key)

    def open(self) -> Work:
        """The work, its models opened from copies of the files, which are removed again."""
        with TemporaryDirectory() as folder:
            paths = []
            for number, (name, contents) in enumerate(self.files):
                for beside, content in contents.items():
                    path = Path(folder, str(number), beside)
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(path, content)
                paths.append(Path(folder, str(number), name))
            opened: Work = _Unpickler(io.BytesIO(self.pickled), paths).load()
            return opened


class _Pickler(pickle.Pickler):
    """Puts numbers in place of the names of files, and notes these."""

    def __init__(self, into: io.BytesIO) -> None:
        super().__init__(into, protocol=5)
        self.files: list[Path] = []

    def persistent_id(self, value: Any) -> tuple[int, type] | None:
        if not isinstance(value, (str, Path)) or not str(value).endswith(_SUFFIXES):
            return None
        path = Path(value).absolute()
        if not path.is_file():
            return None
        self.files += [] if path in self.files else [path]
        return self.files.index(path), str if isinstance(value, str) else Path


class _Unpickler(pickle.Unpickler):
    def __init__(self, packed: io.BytesIO, paths: list[Path]) -> None:
        super().__init__(packed)
        self._paths = paths

    def persistent_load(self, file: tuple[int, type]) -> Any:
        number, kind = file
        return kind(self._paths[number])


def _contents(path: Path, dictionaries: Iterable[str]) -> dict[str, bytes]:
    """The file, and what a model may look for beside it."""
    contracts = [f"{path.stem}.contract.{end}" for end in ("json", "yaml", "yml")]
    found = {}
    for name in (path.name, *contracts, *external_files(path), *dictionaries):
        try:
            beside = path.parent / inside(name)
        except ValueError:  # leads elsewhere
            continue
        if beside.is_file():
            found[name] = beside.read_bytes()
    return found
