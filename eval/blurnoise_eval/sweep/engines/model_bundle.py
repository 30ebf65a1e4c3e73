"""Work on its way to another machine, with the files of its models: they need not stand there.

A model pickles as what opened it, by the names of its files. A bundle holds what stands under these names, and what a
model looks for beside its file: contract, external weights, dictionary.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from blurnoise_eval.detectors.model_files import external_files
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.files import write_whole


@dataclass(frozen=True)
class ModelBundle:
    """Pickled work, and the files that it names.

    files: for each of these, by the number that stands for it in the pickle, its own name and the bytes of what
    belongs to it, by names beside it. key: SHA-256 of all of it.
    """

    pickled: bytes
    files: tuple[tuple[str, Mapping[str, bytes]], ...]

    @classmethod
    def of(cls, work: Work) -> ModelBundle:
        """Raises what pickling and reading raise."""
        packed = io.BytesIO()
        pickler = _Pickler(packed)
        pickler.dump(work)
        dictionaries = list(_dictionaries(work))
        return cls(
            packed.getvalue(), tuple((path.name, _contents(path, dictionaries)) for path in pickler.files)
        )

    @property
    def key(self) -> str:
        """SHA-256 of the pickle and of all files."""
        digest = hashlib.sha256(self.pickled)
        for _, contents in self.files:
            for beside, content in contents.items():
                digest.update(f"{beside} {len(content)} ".encode())
                digest.update(content)
        return digest.hexdigest()

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


@dataclass(frozen=True)
class _File:
    """Stands for the name of a file."""

    number: int
    as_path: bool


class _Pickler(pickle.Pickler):
    """Notes the files that are arguments of what opens a model."""

    def __init__(self, into: io.BytesIO) -> None:
        super().__init__(into, protocol=5)
        self.files: list[Path] = []

    def reducer_override(self, value: Any) -> Any:
        if not isinstance(value, partial):
            return NotImplemented
        keywords = {name: self._file(each) for name, each in value.keywords.items()}
        return _partial, (value.func, tuple(map(self._file, value.args)), keywords)

    def _file(self, value: Any) -> Any:
        if not isinstance(value, (str, Path)) or not Path(value).is_file():
            return value
        path = Path(value).absolute()
        self.files += [] if path in self.files else [path]
        return _File(self.files.index(path), isinstance(value, Path))

    def persistent_id(self, value: Any) -> Any:
        return (value.number, value.as_path) if isinstance(value, _File) else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, packed: io.BytesIO, paths: list[Path]) -> None:
        super().__init__(packed)
        self._paths = paths

    def persistent_load(self, file: tuple[int, bool]) -> str | Path:
        number, as_path = file
        return self._paths[number] if as_path else str(self._paths[number])


def _partial(function: Callable[..., Any], values: tuple[Any, ...], keywords: Mapping[str, Any]) -> Any:
    return partial(function, *values, **keywords)


def _dictionaries(work: Work) -> Iterator[str]:
    for model in work.models:
        contract = getattr(model, "contract", None)
        for each in (contract, getattr(contract, "text", None)):
            if name := getattr(each, "dictionary", None):
                yield name


def _contents(path: Path, dictionaries: Iterable[str]) -> dict[str, bytes]:
    """The file, and what a model may look for beside it."""
    contracts = [f"{path.stem}.contract.{end}" for end in ("json", "yaml", "yml")]
    names = dict.fromkeys([path.name, *contracts, *external_files(path), *dictionaries])
    return {
        name: (path.parent / name).read_bytes()
        for name in names
        if not PurePosixPath(name).is_absolute()
        and ".." not in Path(name).parts
        and (path.parent / name).is_file()
    }
