"""A run at a URL: worked on in a folder of this machine, fetched before and put back when the work ends or stops.

SQLite needs a local disk. The folder of a URL is always the same one, in the cache's ``runs``; what could not be put,
or belongs to a process that was killed, waits there for the next time.
"""

from __future__ import annotations

import fcntl
import hashlib
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from blurnoise_eval.system.files import RUN_FILE, write_whole
from blurnoise_eval.system.progress import ProgressBar
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

_READ = (RUN_FILE, "examples/", "coco/instances.json")  # what of a run is read again
_FETCHED = ".fetched"  # the version of the results at the URL that these go on from

Seen = dict[str, str]


@dataclass(frozen=True)
class WorkingFolder:
    """``path``, and the ``url`` that it stands for, if any."""

    path: Path
    url: UPath | None = None

    def told(self, text: object) -> str:
        """The text with the URL's name for what is here."""
        return str(text) if self.url is None else str(text).replace(str(self.path), str(self.url))


def working_folder(where: str | Path | WorkingFolder) -> WorkingFolder:
    """A folder of this machine. Raises ``ValueError`` for a URL, which is opened by the functions below."""
    if isinstance(where, WorkingFolder):
        return where
    if is_url(str(where)):
        raise ValueError(
            f"run = {without_secrets(str(where))!r}: at a URL; open it with written_run or read_run"
        )
    return WorkingFolder(Path(where))


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
        there, seen = _results(where), {}
        if there != _noted(path):
            seen = _fetch(where, path, _READ)
        folder = WorkingFolder(path, where)
        try:
            with _errors_name_the_url(folder):
                yield folder
        finally:
            if _results(where) != _noted(path):
                raise ValueError(
                    f"run = {str(where)!r}: another machine has put results there meanwhile; those of this one are "
                    f"in {path} until the next command goes on from what is there"
                )
            _put(folder, seen)
        shutil.rmtree(path)


@contextmanager
def read_run(where: Location) -> Iterator[WorkingFolder]:
    """The folder of a run that is read; what is written beside its results is put at the end."""
    with _copied(where, _READ) as folder:
        yield folder


@contextmanager
def output_folder(where: Location) -> Iterator[WorkingFolder]:
    """A folder to write to; all that is in it is put at the end."""
    with _copied(where, ()) as folder:
        yield folder


@contextmanager
def _copied(where: Location, names: Sequence[str]) -> Iterator[WorkingFolder]:
    if isinstance(where, Path):
        yield WorkingFolder(where)
        return
    runs = cache_folder() / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    folder = WorkingFolder(Path(mkdtemp(dir=runs)), where)
    try:
        seen = _fetch(where, folder.path, names)
        with _errors_name_the_url(folder):
            yield folder
        _put(folder, {**seen, RUN_FILE: _files(folder.path).get(RUN_FILE, "")})  # another may be writing it
    finally:
        shutil.rmtree(folder.path, ignore_errors=True)


def _results(url: UPath) -> str:
    """The version of a run's results; "" where there are none."""
    try:
        return version(url / RUN_FILE)
    except FileNotFoundError:
        return ""


def _noted(path: Path) -> str:
    """The version that the results here go on from; "" for a run that was begun here."""
    marker = path / _FETCHED
    return marker.read_text() if marker.is_file() else ""


def _fetch(url: UPath, path: Path, names: Sequence[str]) -> Seen:
    """Make the folder what of these names is at the URL. Raises ``OSError``."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    found = listing(url) if names else {}
    wanted = [name for name in found if name.startswith(tuple(names))]
    if wanted:
        with ProgressBar("fetch files", len(wanted)) as advance:
            for name in wanted:
                (path / name).parent.mkdir(parents=True, exist_ok=True)
                with explained(url / name):
                    url.fs.get_file((url / name).path, str(path / name))
                advance(1)
    if RUN_FILE in found:
        write_whole(path / _FETCHED, found[RUN_FILE].encode())
    return _files(path)


def _put(folder: WorkingFolder, seen: Seen) -> None:
    """Put the files that are new or have changed, the page last. Raises ``OSError``."""
    url, path, now = folder.url, folder.path, _files(folder.path)
    changed = sorted(
        (name for name in now if now[name] != seen.get(name)), key=lambda name: (name == "report.html", name)
    )
    if url is None or not changed:
        return
    with ProgressBar("put files", len(changed)) as advance:
        for name in changed:
            with explained(url / name):
                url.fs.put_file(str(path / name), (url / name).path)
            if name == RUN_FILE:
                write_whole(path / _FETCHED, _results(url).encode())
            advance(1)


def _files(folder: Path) -> Seen:
    """Versions of the files that people read, by name."""
    return {
        name: each
        for name, each in listing(folder).items()
        if not Path(name).name.startswith((".", f"{RUN_FILE}-"))
    }


@contextmanager
def _errors_name_the_url(folder: WorkingFolder) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        if len(error.args) == 1 and str(folder.path) in str(error):
            raise type(error)(folder.told(error)) from None
        raise
