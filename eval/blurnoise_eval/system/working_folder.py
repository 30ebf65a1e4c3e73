"""A run at a URL: fetched into a folder of this machine, and put back when the work ends or is interrupted.

SQLite needs a local disk. What a killed process has not put back is computed again.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import TYPE_CHECKING
from weakref import finalize

from blurnoise._core.manifest import MANIFEST
from blurnoise_eval.system import files
from blurnoise_eval.system.files import RUN_FILE, RUN_FILES, check_replaceable
from blurnoise_eval.system.urls import (
    Location,
    cache_folder,
    explained,
    is_url,
    listing,
    location,
    without_secrets,
)

if TYPE_CHECKING:
    from upath import UPath


_READ = (RUN_FILE, "examples/", "coco/instances.json")  # files of a run that are read again


@dataclass(frozen=True)
class WorkingFolder:
    """The folder of a run. url: where the run is, if it is not here; command: the origin that the run reports."""

    path: Path
    url: Location | None = None
    command: str = "blurnoise_eval.evaluate"

    def with_url(self, text: object) -> str:
        """The text with the URL in place of the folder's path."""
        return str(text) if self.url is None else str(text).replace(str(self.path), str(self.url))


def working_folder(where: str | Path | WorkingFolder) -> WorkingFolder:
    """A folder of this machine. Raises ``ValueError`` for a URL, which :func:`written_run` opens."""
    if is_url(where):
        shown = without_secrets(str(where))
        raise ValueError(f"run = {shown!r}: is a URL; open it with written_run")
    return where if isinstance(where, WorkingFolder) else WorkingFolder(Path(where))


def fetched(where: str | Path | WorkingFolder) -> WorkingFolder:
    """A folder of this machine to read a run in; one at a URL is copied to it, and deleted once nobody uses it."""
    if not is_url(where):
        return working_folder(where)
    url = location(str(where))
    if isinstance(url, Path):
        return WorkingFolder(url)
    runs = cache_folder() / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    folder = WorkingFolder(Path(mkdtemp(dir=runs)), url)
    finalize(folder, shutil.rmtree, folder.path, ignore_errors=True)
    _get(url, [name for name in _found(url) if name.startswith(_READ)], folder.path)
    return folder


def _get(where: UPath, names: Collection[str], folder: Path) -> None:
    with explained(where):
        where.fs.get([(where / name).path for name in names], [str(folder / name) for name in names])


@contextmanager
def written_run(where: Location, *, fetch: bool = True, results: bool = True) -> Iterator[WorkingFolder]:
    """The folder of a run that goes on, or begins; one at a URL is put there at the end, also of an error.

    Raises ``OSError``, also for an object that blurnoise did not put there, and ``ValueError`` where somebody else
    has put results meanwhile: then nothing is put, and the folder stays. fetch: first fetch what is there; results:
    put the results, too.
    """
    if isinstance(where, Path):
        yield WorkingFolder(where)
        return
    if results:
        check_outputs(where, *RUN_FILES)
    found = _found(where)
    runs = cache_folder() / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    path = Path(mkdtemp(dir=runs))
    read = [name for name in found if _is_list(name) or (fetch and name.startswith(_READ))]
    _get(where, read, path)
    folder, before = WorkingFolder(path, where), listing(path)
    try:
        yield folder
    except ValueError as error:
        # Errors of one text can be made again with the URL in it; others, such as of Unicode, cannot.
        if len(error.args) != 1:
            raise
        raise type(error)(folder.with_url(error)) from None
    finally:
        # Object stores have no locks: the listing says whether the file is still the one that was fetched.
        if results and _found(where).get(RUN_FILE) != found.get(RUN_FILE):
            conflict = (
                "another process has written results there meanwhile; the results of this process are in"
            )
            raise ValueError(f"run = {str(where)!r}: {conflict} {path}")
        changed = [name for name, held in listing(path).items() if held != before.get(name)]
        left_out = (".", f"{RUN_FILE}-", *([] if results else [RUN_FILE]))  # SQLite's own, unfinished files
        changed = [name for name in changed if _is_list(name) or not Path(name).name.startswith(left_out)]
        try:
            _check(where, set(changed) - {*read, RUN_FILE})
            with explained(where):
                where.fs.put(
                    [str(path / name) for name in changed], [(where / name).path for name in changed]
                )
        except OSError as error:
            why = f"{error.strerror}; files that were not uploaded are in {path}"
            raise type(error)(error.errno, why, error.filename) from None
        shutil.rmtree(path)


def read_run(where: Location) -> AbstractContextManager[WorkingFolder]:
    """The folder of a run that is read; new files beside its results are put at the end."""
    return written_run(where, results=False)


def output_folder(where: Location) -> AbstractContextManager[WorkingFolder]:
    """A folder to write to; all that is in it is put at the end."""
    return written_run(where, fetch=False, results=False)


def check_outputs(where: Location, *names: str) -> None:
    """As of :func:`blurnoise_eval.system.files.check_outputs`, also at a URL."""
    if isinstance(where, Path):
        files.check_outputs(where, *names)
    else:
        _check(where, [each for each in _found(where) if any(fnmatchcase(each, name) for name in names)])


def _check(url: UPath, names: Collection[str]) -> None:
    """Raise ``OSError`` where one of these objects is there and was not put by blurnoise, or has changed since."""
    found = _found(url) if names else {}
    held = [name for name in names if name in found]
    lists = [name for name in found if _is_list(name)] if held else []
    with TemporaryDirectory(prefix="blurnoise-") as folder:
        copies = {name: Path(folder, name) for name in (*lists, *held)}
        with explained(url):
            url.fs.get([(url / name).path for name in copies], [*map(str, copies.values())])
        for name in held:
            try:
                check_replaceable(copies[name])
            except OSError as error:
                raise type(error)(error.errno, error.strerror, str(url / name)) from None


def _is_list(name: str) -> bool:
    return Path(name).name == MANIFEST


def _found(url: Location) -> dict[str, str]:
    with suppress(FileNotFoundError):
        return listing(url)
    return {}
