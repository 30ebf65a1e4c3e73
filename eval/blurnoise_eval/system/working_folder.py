"""Working folder of a command: a folder of this machine that stands for one at a URL.

SQLite needs a local disk. So the files of a run at a URL are fetched when it is opened, worked on here, and put back
whole: what has changed at the end, and meanwhile, every five minutes, new pictures and then a copy of the results.
A run that is written has a lock beside it, renewed every minute: another machine's is respected for five minutes
after it was last renewed, and then taken over, unless it is renewed while one watches: clocks may be wrong. Who finds
that another has taken over puts nothing more. What could not be put stays here, in the cache's ``runs``, for the next
time.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import socket
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from blurnoise_eval.system.files import RUN_FILE, write_whole
from blurnoise_eval.system.node_cache import cache_folder
from blurnoise_eval.system.progress import Advance, ProgressBar
from blurnoise_eval.system.storage import Location, Url, get_file, is_url, listing, put_file
from blurnoise_eval.system.transport import without_secrets

LOCK = ".lock.json"
MIRROR_S, RENEW_S, RESPECTED_S, WATCHED_S = 300.0, 60.0, 300.0, 150.0
_READ = (RUN_FILE, "examples/", "coco/instances.json")  # what of a run is read again
_REMOTE = ".remote"  # which version of the results at the URL these go on from
_AT_ONCE = 8

Seen = dict[str, tuple[int, int]]


@dataclass
class WorkingFolder:
    """``path``, and the ``url`` that it stands for, if any."""

    path: Path
    url: Url | None = None
    owned: bool = False
    _seen: Seen = field(default_factory=dict, repr=False)
    _mirrored_s: float = field(default_factory=time.monotonic, repr=False)
    _check_lock: Callable[[], None] = field(default=lambda: None, repr=False)

    def told(self, text: object) -> str:
        """The text with the URL's name for what is here."""
        return str(text) if self.url is None else str(text).replace(str(self.path), str(self.url))

    def minded(
        self, advance: Callable[[int], None], copy_results: Callable[[Path], None]
    ) -> Callable[[int], None]:
        """``advance``, which from time to time puts what there is. copy_results: writes the results to a file."""

        def advanced(done: int) -> None:
            advance(done)
            if self.url is not None and time.monotonic() - self._mirrored_s > MIRROR_S:
                self._mirrored_s = time.monotonic()
                try:
                    self._mirror(copy_results)
                except OSError as error:
                    warnings.warn(f"{self.url}: not up to date ({error.strerror})", stacklevel=2)

        return advanced if self.url is not None else advance

    def _mirror(self, copy_results: Callable[[Path], None]) -> None:
        copy = self.path / f".{RUN_FILE}.copy"
        copy.unlink(missing_ok=True)
        try:
            copy_results(copy)
            self.put(leaving=(RUN_FILE,), shown=False)  # the work has a bar of its own
            self._put_results(copy)
        finally:
            copy.unlink(missing_ok=True)

    def put(self, leaving: Sequence[str] = (), *, shown: bool = True) -> None:
        """Put the files that are new or have changed, the page last. shown: say how far. Raises ``OSError``."""
        if self.url is None:
            return
        self._check_lock()
        now = _files(self.path)
        changed = sorted(
            (name for name in now if now[name] != self._seen.get(name) and name not in leaving),
            key=lambda name: (name == "report.html", name),
        )
        with (
            ProgressBar("put files", len(changed)) if shown and changed else nullcontext(Advance()) as advance
        ):
            for name in changed:
                if name == RUN_FILE:
                    self._put_results(self.path / name)
                else:
                    put_file(self.path / name, self.url / name)
                self._seen[name] = now[name]
                advance(1)

    def _put_results(self, file: Path) -> None:
        if self.url is not None:
            self._check_lock()
            put_file(file, self.url / RUN_FILE)
            self._goes_on_from((self.url / RUN_FILE).stamped().stamp or "")

    def _goes_on_from(self, stamp: str) -> None:
        write_whole(self.path / _REMOTE, stamp.encode())

    def look(self) -> None:
        """What is here now is there, too."""
        self._seen = _files(self.path)

    def fetch(self, names: Sequence[str]) -> None:
        """Make the folder what is at the URL of these names. Raises ``OSError``."""
        shutil.rmtree(self.path, ignore_errors=True)
        self.path.mkdir(parents=True)
        if self.url is None or not names:
            return
        url, found = self.url, listing(self.url)

        def get(name: str) -> None:
            (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            get_file(url / name, self.path / name)

        wanted = [name for name in found if name.startswith(tuple(names))]
        with ThreadPoolExecutor(_AT_ONCE) as pool, ProgressBar("fetch files", len(wanted)) as advance:
            for _ in pool.map(get, wanted):
                advance(1)
        if RUN_FILE in found:
            self._goes_on_from(found[RUN_FILE])


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
    """The folder of a run that goes on, or begins.

    Raises ``OSError``, and ``ValueError`` where another machine writes it, or has taken it over meanwhile.
    """
    if not isinstance(where, Url):
        yield WorkingFolder(Path(str(where)))
        return
    key = hashlib.blake2b(str(where).encode("utf-8", "surrogatepass"), digest_size=12).hexdigest()
    path = cache_folder() / "runs" / key
    with ExitStack() as held:
        held.enter_context(_alone_here(path.with_name(f"{key}.lock"), where))
        lock = held.enter_context(_alone_anywhere(where))
        folder = WorkingFolder(path, where, owned=True, _check_lock=lock.check)
        _bring_up(folder)
        try:
            with _explained(folder):
                yield folder
        finally:
            folder.put()
        shutil.rmtree(path, ignore_errors=True)


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
    if not isinstance(where, Url):
        yield WorkingFolder(Path(str(where)))
        return
    home = cache_folder() / "runs"
    home.mkdir(parents=True, exist_ok=True)
    folder = WorkingFolder(Path(mkdtemp(dir=home)), where)
    try:
        folder.fetch(names)
        folder.look()
        with _explained(folder):
            yield folder
            folder.put(leaving=(RUN_FILE,))  # another may be writing it
    finally:
        shutil.rmtree(folder.path, ignore_errors=True)


def _bring_up(folder: WorkingFolder) -> None:
    """Go on from what is here where nothing newer is at the URL."""
    if folder.url is None:
        return
    path, marker = folder.path, folder.path / _REMOTE
    try:
        there = (folder.url / RUN_FILE).stamped().stamp
    except FileNotFoundError:
        there = None
    known = marker.read_text() if marker.is_file() else None
    if there is None and known is None:
        path.mkdir(parents=True, exist_ok=True)  # begun here and never put, or not begun
    elif there != known:
        folder.fetch(_READ if there is not None else ())
        folder.look()


@contextmanager
def _explained(folder: WorkingFolder) -> Iterator[None]:
    """Errors that name files here name those at the URL."""
    try:
        yield
    except ValueError as error:
        if len(error.args) == 1 and str(folder.path) in str(error):
            raise type(error)(folder.told(error)) from None
        raise


@contextmanager
def _alone_here(lock: Path, url: Url) -> Iterator[None]:
    lock.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(lock, os.O_RDWR | os.O_CREAT)
    try:
        _only_holder(handle, url)
        yield
    finally:
        os.close(handle)


def _only_holder(handle: int, url: Url) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ValueError(f"run = {str(url)!r}: another process is using it") from None


class _Lock:
    """The lock of a run at a URL."""

    def __init__(self, url: Url) -> None:
        self._url, self._file, self._token = url, url / LOCK, uuid.uuid4().hex
        self._here = {"host": socket.gethostname(), "cache": str(cache_folder()), "process": os.getpid()}
        if not self._file.put_new(self._said()):
            held = _held(self._file)
            age_s = time.time() - held["time_s"]
            own = held["host"] == socket.gethostname() and held["cache"] == str(
                cache_folder()
            )  # and has ended
            if not own and held["host"] and (abs(age_s) < RESPECTED_S or self._is_renewed(held)):
                raise ValueError(
                    f"run = {str(url)!r}: {held['host']} is writing it, as of {max(age_s, 0):.0f} s ago; "
                    f"{RESPECTED_S:.0f} s after it stopped it can be taken over"
                )
            self._file.put(self._said())

    def _said(self) -> bytes:
        """What the lock says of this process."""
        return json.dumps({**self._here, "time_s": time.time(), "token": self._token}).encode()

    def _is_renewed(self, held: dict[str, Any]) -> bool:
        end = time.monotonic() + WATCHED_S
        while (now := _held(self._file)) == held and time.monotonic() < end:
            time.sleep(WATCHED_S / 20)
        return now != held

    def check(self) -> None:
        """Raise ``ValueError`` where the lock is another's by now."""
        if (held := _held(self._file))["token"] != self._token:
            other = held["host"] or "somebody"
            raise ValueError(
                f"run = {str(self._url)!r}: {other} has taken it over while this process stood still; repeat the "
                "command to go on from what is there"
            )

    def renew(self) -> None:
        """Say that this process lives."""
        with suppress(OSError, ValueError):
            self.check()
            self._file.put(self._said())

    def free(self) -> None:
        """Remove the lock if it is still this one."""
        with suppress(OSError, ValueError):
            self.check()
            self._file.unlink()


@contextmanager
def _alone_anywhere(url: Url) -> Iterator[_Lock]:
    """Nobody else's lock is at the URL meanwhile, as far as that can be seen."""
    lock, stop = _Lock(url), threading.Event()

    def renew() -> None:
        while not stop.wait(RENEW_S):
            lock.renew()

    renewer = threading.Thread(target=renew, daemon=True)
    renewer.start()
    try:
        yield lock
    finally:
        stop.set()
        renewer.join()
        lock.free()


def _held(lock: Url) -> dict[str, Any]:
    """What a lock says; one that says nothing, or is gone, is nobody's."""
    with suppress(FileNotFoundError, ValueError, AttributeError):
        found = json.loads(lock.read_fresh())
        said = {name: str(found.get(name, "")) for name in ("host", "cache", "token")}
        return {**said, "time_s": float(found.get("time_s", 0.0))}
    return {"host": "", "cache": "", "token": "", "time_s": 0.0}


def _files(folder: Path) -> Seen:
    """Size and time of every file that people read, by its name."""
    found = {}
    for file in folder.rglob("*"):
        name = file.relative_to(folder).as_posix()
        if file.is_file() and not file.name.startswith(".") and not file.name.startswith(f"{RUN_FILE}-"):
            stat = file.stat()
            found[name] = (stat.st_size, stat.st_mtime_ns)
    return found
