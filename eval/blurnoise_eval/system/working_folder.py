"""A run at a URL: worked on in a folder of this machine, fetched before and put back when the work ends or stops.

SQLite needs a local disk. The folder of a URL is always the same one, in the cache's ``runs``; what could not be put,
or belongs to a process that was killed, waits there for the next time.
"""

from __future__ import annotations

import fcntl
import hashlib
import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from blurnoise_eval.system.files import RUN_FILE, write_whole
from blurnoise_eval.system.urls import (
    Location,
    cache_folder,
    explained,
    is_url,
    listing,
    version,
    without_secrets,
)

if TYPE_CHECKING:
    from upath import UPath

_READ = (RUN_FILE, "examples/", "coco/instances.json")  # files of a run that are read again
_FETCHED = ".fetched"  # the version of the results at the URL that these go on from


@dataclass(frozen=True)
class WorkingFolder:
    """``path``, and the ``url`` that it stands for, if any."""

    path: Path
    url: UPath | None = None

    def told(self, text: object) -> str:
        """The text with the URL in place of the folder's path."""
        return str(text) if self.url is None else str(text).replace(str(self.path), str(self.url))

    @contextmanager
    def _used(self) -> Iterator[WorkingFolder]:
        """The folder; errors name the URL in place of it."""
        try:
            yield self
        except ValueError as error:
            if len(error.args) == 1:
                raise type(error)(self.told(error)) from None
            raise


def working_folder(where: str | Path | WorkingFolder) -> WorkingFolder:
    """A folder of this machine. Raises ``ValueError`` for a URL, which is opened by the functions below."""
    if is_url(where):
        shown = without_secrets(str(where))
        raise ValueError(f"run = {shown!r}: at a URL; open it with written_run or read_run")
    return where if isinstance(where, WorkingFolder) else WorkingFolder(Path(where))


@contextmanager
def written_run(where: Location) -> Iterator[WorkingFolder]:
    """The folder of a run that goes on, or begins; one at a URL is put there at the end, also of an error.

    Raises ``OSError``, and ``ValueError`` where another process of this machine uses it, or another machine has put
    results meanwhile: then nothing is put.
    """
    if isinstance(where, Path):
        yield WorkingFolder(where)
        return
    path = cache_folder() / "runs" / hashlib.blake2b(str(where).encode(), digest_size=12).hexdigest()
    path.mkdir(parents=True, exist_ok=True)
    path.with_suffix(".lock").touch()
    with path.with_suffix(".lock").open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f"run = {str(where)!r}: another process is using it") from None
        before = _fetch(where, path) if _results(where) != _noted(path) else {}
        try:
            with WorkingFolder(path, where)._used() as folder:
                yield folder
        finally:
            if _results(where) != _noted(path):
                raise ValueError(
                    f"run = {str(where)!r}: another machine has put results there meanwhile; those of this one are "
                    f"in {path} until the next command goes on from what is there"
                )
            _put(where, path, before)
        shutil.rmtree(path)


@contextmanager
def read_run(where: Location, *, fetch: bool = True) -> Iterator[WorkingFolder]:
    """The folder of a run that is read; new files beside its results are put at the end."""
    if isinstance(where, Path):
        yield WorkingFolder(where)
        return
    (cache_folder() / "runs").mkdir(parents=True, exist_ok=True)
    path = Path(mkdtemp(dir=cache_folder() / "runs"))
    try:
        before = _fetch(where, path) if fetch else {}
        with WorkingFolder(path, where)._used() as folder:
            yield folder
        (path / RUN_FILE).unlink(missing_ok=True)  # another may be writing it
        _put(where, path, before)
    finally:
        shutil.rmtree(path, ignore_errors=True)


def output_folder(where: Location) -> AbstractContextManager[WorkingFolder]:
    """A folder to write to; all that is in it is put at the end."""
    return read_run(where, fetch=False)


def _results(url: UPath) -> str:
    """The version of a run's results; "" where there are none."""
    with suppress(FileNotFoundError):
        return version(url / RUN_FILE)
    return ""


def _noted(path: Path) -> str:
    """The version that the results here go on from; "" for a run that was begun here."""
    marker = path / _FETCHED
    return marker.read_text() if marker.is_file() else ""


def _fetch(url: UPath, path: Path) -> dict[str, str]:
    """Fill the folder with the files that are read of a run; returns their versions. Raises ``OSError``."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    found = listing(url)
    wanted = [name for name in found if name.startswith(_READ)]
    with explained(url):
        url.fs.get([(url / name).path for name in wanted], [str(path / name) for name in wanted])
    if RUN_FILE in found:
        write_whole(path / _FETCHED, found[RUN_FILE].encode())
    return _files(path)


def _put(url: UPath, path: Path, before: dict[str, str]) -> None:
    """Put the files that are new or have changed. Raises ``OSError``."""
    changed = [name for name, held in _files(path).items() if held != before.get(name)]
    with explained(url):
        url.fs.put([str(path / name) for name in changed], [(url / name).path for name in changed])
    if RUN_FILE in changed:
        write_whole(path / _FETCHED, _results(url).encode())


def _files(folder: Path) -> dict[str, str]:
    """Versions of the files that people read, by name."""
    every = listing(folder).items()
    return {name: held for name, held in every if not Path(name).name.startswith((".", f"{RUN_FILE}-"))}
