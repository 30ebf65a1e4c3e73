"""A parcel: work on its way to another machine, where its models' files may be missing, or others stand there.

A model pickles as what opened it, by the names of its files. A parcel knows the content of these, and of what a model
looks for beside them: contract, external weights, dictionary. Where anything of that differs, the files of this
machine are taken.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import onnx

from blurnoise_eval.detectors.detector import file_sha256
from blurnoise_eval.detectors.model_files import external_files
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.files import write_whole

Contents = Mapping[str, Mapping[str, bytes]]
"""By the name of a model's file: the bytes of what is beside it, by their names there, its own included."""


@dataclass(frozen=True)
class Parcel:
    """Work, pickled. digests: of each file that it names, and of what may stand beside it: SHA-256, None: nothing."""

    pickled: bytes
    digests: Mapping[str, Mapping[str, str | None]]

    @classmethod
    def of(cls, work: Work) -> Parcel:
        """Pack. Raises what pickling raises."""
        packed = io.BytesIO()
        packer = _Packer(packed)
        packer.dump(work)
        stated = [contract.dictionary for contract in _contracts(work) if contract.dictionary]
        return cls(
            packed.getvalue(), {name: _digests(Path(name), _beside(name, stated)) for name in packer.files}
        )

    def contents(self) -> Contents:
        """What the files hold on this machine."""
        return {
            name: {
                beside: (Path(name).parent / beside).read_bytes()
                for beside, digest in digests.items()
                if digest
            }
            for name, digests in self.digests.items()
        }

    @contextmanager
    def opened(self, contents: Callable[[], Contents]) -> Iterator[Work]:
        """The work, its models opened from the files that stand here under their names, or, where these are not the
        same, from ``contents()``, which lie here meanwhile."""
        with TemporaryDirectory() as folder:
            yield _Unpacker(io.BytesIO(self.pickled), self.digests, contents, Path(folder)).load()


@dataclass(frozen=True)
class _Named:
    """Stands for the name of a file."""

    name: str
    as_path: bool


class _Packer(pickle.Pickler):
    """Notes the files that whatever opens a model names."""

    def __init__(self, into: io.BytesIO) -> None:
        super().__init__(into, protocol=5)
        self.files: list[str] = []

    def reducer_override(self, value: Any) -> Any:
        if not isinstance(value, partial):
            return NotImplemented
        named = {name: self._named(each) for name, each in value.keywords.items()}
        return _partial, (value.func, tuple(map(self._named, value.args)), named)

    def _named(self, value: Any) -> Any:
        if not isinstance(value, (str, Path)) or not Path(value).is_file():
            return value
        name = str(Path(value).absolute())
        self.files += [] if name in self.files else [name]
        return _Named(name, isinstance(value, Path))

    def persistent_id(self, value: Any) -> Any:
        return (value.name, value.as_path) if isinstance(value, _Named) else None


class _Unpacker(pickle.Unpickler):
    def __init__(
        self,
        packed: io.BytesIO,
        digests: Mapping[str, Mapping[str, str | None]],
        contents: Callable[[], Contents],
        folder: Path,
    ) -> None:
        super().__init__(packed)
        self._digests, self._contents, self._folder = digests, contents, folder

    def persistent_load(self, named: tuple[str, bool]) -> str | Path:
        name, as_path = named
        path = self._here(name)
        return path if as_path else str(path)

    def _here(self, name: str) -> Path:
        here, wanted = Path(name), self._digests[name]
        if _digests(here, wanted) == wanted:
            return here
        folder = self._folder / hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()
        if not folder.exists():
            for beside, content in self._contents()[name].items():
                (folder / beside).parent.mkdir(parents=True, exist_ok=True)
                write_whole(folder / beside, content)
        return folder / here.name


def _partial(function: Callable[..., Any], values: tuple[Any, ...], named: Mapping[str, Any]) -> Any:
    return partial(function, *values, **named)


def _contracts(work: Work) -> Iterator[Any]:
    for model in work.models:
        contract = getattr(model, "contract", None)
        yield from (
            each for each in (contract, getattr(contract, "text", None)) if hasattr(each, "dictionary")
        )


def _beside(name: str, dictionaries: Iterable[str]) -> list[str]:
    """The file's own name, and those of what may be looked for beside it."""
    path = Path(name)
    try:
        weights = external_files(onnx.load(name, load_external_data=False))
    except Exception:  # protobuf's DecodeError: no model, but a contract or a dictionary
        weights = []
    contracts = [f"{path.stem}.contract.{end}" for end in ("json", "yaml", "yml")]
    names = dict.fromkeys([path.name, *contracts, *weights, *dictionaries])
    return [each for each in names if not PurePosixPath(each).is_absolute() and ".." not in Path(each).parts]


def _digests(path: Path, beside: Iterable[str]) -> dict[str, str | None]:
    files = {name: path.parent / name for name in beside}
    return {name: file_sha256(file) if file.is_file() else None for name, file in files.items()}
