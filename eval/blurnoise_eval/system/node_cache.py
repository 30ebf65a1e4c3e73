"""Cache of a machine: copies of objects that came from elsewhere, in a folder of at most so many bytes.

Any number of processes share it. A copy appears whole or not at all; where there are too many bytes, those used
longest ago go first, but never a folder that a process holds. BLURNOISE_CACHE names the folder, by default
``blurnoise`` in XDG_CACHE_HOME or ~/.cache; BLURNOISE_CACHE_GB its limit, by default 5.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from blurnoise_eval.system.files import write_whole

FOLDER, LIMIT_GB = "BLURNOISE_CACHE", "BLURNOISE_CACHE_GB"
USUAL_GB = 5.0
_LOOK_AFTER = 0.02  # of the limit: bytes that a process writes before it adds up the folder again
_LEAVE = 0.9  # of the limit, once it is passed
_ABANDONED_S = 3600.0  # after which an unfinished copy is nobody's


class NodeCache:
    """Copies in ``folder``, of about ``most_bytes``: each process may be 2 % above before it notices.

    What cannot be kept (no room, a folder that cannot be written) is handed on without being kept.
    """

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self._home, self.most_bytes = folder / "objects", most_bytes
        self._lock = threading.Lock()
        self._unlooked: float = most_bytes  # the first copy looks
        self._held: dict[Path, int] = {}

    def read(self, key: str, fetch: Callable[[], bytes], size: int | None = None) -> bytes:
        """The bytes of that key: those kept, if they are ``size``, or fetched ones. Raises what ``fetch`` raises."""
        path = self._home / _name(key)
        with suppress(OSError):
            data = path.read_bytes()
            if size in (None, len(data)):  # a machine that went down leaves files that are cut short
                os.utime(path)
                return data
        data = fetch()
        with suppress(OSError):
            self._keep(path, data)
        return data

    def _keep(self, path: Path, data: bytes) -> None:
        if len(data) > self.most_bytes:
            return
        self._home.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
        self._wrote(len(data))

    def folder(self, key: str, fill: Callable[[Path], None]) -> Path:
        """The folder of that key, which ``fill`` has filled; it stays until this process ends.

        Raises ``OSError`` where it cannot be written, and what ``fill`` raises.
        """
        path = self._home / _name(f"folder of {key}")
        with self._lock:
            if path in self._held and path.is_dir():
                return path
        while True:
            if not path.is_dir():
                self._make(path, fill)
            with suppress(FileNotFoundError):  # taken away in between
                self.hold(path)
                os.utime(path)
                return path

    def hold(self, path: Path) -> None:
        """Keep a folder from being taken away until this process ends. Raises ``FileNotFoundError``."""
        held = os.open(path, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_SH)
        if not path.is_dir() or path.stat().st_ino != os.fstat(held).st_ino:
            os.close(held)
            raise FileNotFoundError(errno.ENOENT, "taken away", str(path))
        with self._lock:
            self._held[path] = held

    def _make(self, path: Path, fill: Callable[[Path], None]) -> None:
        try:
            self._home.mkdir(parents=True, exist_ok=True)
            unfinished = Path(mkdtemp(prefix=".", dir=self._home))
        except OSError as error:
            why = f"the cache cannot be written ({error.strerror}); {FOLDER} names another folder"
            raise OSError(error.errno, why, str(self._home.parent)) from None
        held = os.open(unfinished, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_SH)  # however long it takes
        try:
            fill(unfinished)
            try:
                unfinished.rename(path)
            except OSError:
                if not path.is_dir():  # else another process was faster
                    raise
        finally:
            os.close(held)
            shutil.rmtree(unfinished, ignore_errors=True)
        self._wrote(_size(path))

    def _wrote(self, size: int) -> None:
        with self._lock:
            self._unlooked += size
            if self._unlooked < _LOOK_AFTER * self.most_bytes:
                return
            self._unlooked = 0
            self._make_room()

    def _make_room(self) -> None:
        """Remove what was used longest ago, down to 90 % of the limit, if that is passed."""
        entries = []
        for entry in os.scandir(self._home):
            with suppress(OSError):
                used_s = entry.stat(follow_symlinks=False).st_mtime
                if not entry.name.startswith("."):
                    entries.append((used_s, Path(entry), _size(Path(entry))))
                elif time.time() - used_s > _ABANDONED_S:
                    _remove_unheld(Path(entry))
        kept = sum(size for *_, size in entries)
        if kept <= self.most_bytes:
            return
        for _, path, size in sorted(entries):
            if kept <= _LEAVE * self.most_bytes:
                return
            with suppress(OSError):
                _remove_unheld(path)
                kept -= size


def _remove_unheld(path: Path) -> None:
    """Raises ``OSError`` for a folder that a process holds."""
    if not path.is_dir():
        path.unlink()
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        gone = path.with_name(f".{path.name}")
        path.rename(gone)
        shutil.rmtree(gone, ignore_errors=True)
    finally:
        os.close(handle)


def _size(path: Path) -> int:
    if not path.is_dir():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def _name(key: str) -> str:
    return hashlib.blake2b(key.encode("utf-8", "surrogatepass"), digest_size=20).hexdigest()


def node_cache() -> NodeCache:
    """The cache that the environment names. Raises ``ValueError`` for a limit that is no number above 0."""
    return _node_cache(cache_folder(), os.environ.get(LIMIT_GB, str(USUAL_GB)))


def cache_folder() -> Path:
    """Where it is."""
    usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "blurnoise"
    return Path(os.environ.get(FOLDER) or usual)


def most_bytes(limit_gb: str) -> int:
    """The limit in bytes. Raises ``ValueError`` for what is no number above 0."""
    try:
        limit = float(limit_gb)
    except ValueError:
        limit = 0.0
    if not 0 < limit < 1e6:
        raise ValueError(f"cache-gb = {limit_gb!r}: must be a number > 0 and < 1e6")
    return round(limit * 1e9)


@cache
def _node_cache(folder: Path, limit_gb: str) -> NodeCache:
    return NodeCache(folder, most_bytes(limit_gb))
