"""Files that are written: complete and on disk, or not there, and never in place of a file of the user's.

A folder that something was written to holds a list of it (:mod:`blurnoise._core.manifest`). A file is replaced where
the list has its content; anything else that stands there is the user's, such as a saved camera that was edited since.
What a command reads is never replaced.
"""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import re
import shutil
import stat
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from blurnoise._core.manifest import MANIFEST, add_line, digest_of, is_written, lines_of

# Machine, process and its start: who may delete the copy once that process is gone.
_PARTIAL = re.compile(r"\.blurnoise-([0-9a-f]{8})-(\d+)-([0-9a-f]{8})-[0-9a-f]{32}\.partial")
_TEXTS = ".csv", ".html", ".json", ".yaml", ".yml"
_STREAMS = stat.S_IFCHR, stat.S_IFIFO
Known = tuple[int, int]


@dataclass
class Writing:
    """What a command, or a call, may replace.

    overwrite: also plain files that blurnoise did not write. inputs: files that it reads. made: files that it wrote
    where none was, in order.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with writing() as command:
    ...     write_whole(path, b"one")
    >>> [made.name for made in command.made]
    ['a.txt']
    """

    overwrite: bool = False
    inputs: list[Iterable[Path]] = field(default_factory=list)
    made: list[Path] = field(default_factory=list)
    _read: set[Known] = field(default_factory=set)
    _swept: set[Path] = field(default_factory=set)

    def reads(self, asked: os.stat_result) -> bool:
        """Whether a file is an input, by whatever name."""
        while self.inputs:
            for path in self.inputs.pop():
                with suppress(OSError, ValueError):
                    facts = path.stat()
                    self._read.add((facts.st_dev, facts.st_ino))
        return (asked.st_dev, asked.st_ino) in self._read

    def sweep(self, folder: Path) -> None:
        """Delete the unfinished copies in a folder whose processes have ended; once."""
        if folder in self._swept:
            return
        self._swept.add(folder)
        with suppress(OSError):
            for entry in [*os.scandir(folder)]:
                owner = _PARTIAL.fullmatch(entry.name)
                if owner and owner[1] == _host() and _start(int(owner[2])) not in (owner[3], ""):
                    _delete(Path(entry.path))


_WRITING: ContextVar[Writing | None] = ContextVar("writing", default=None)


@contextmanager
def writing(*, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Iterator[Writing]:
    """Group writes as one command; calls may nest. inputs: files that are never replaced.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> path.write_text("mine") and None
    >>> with writing(overwrite=True):
    ...     write_whole(path, b"ours")
    >>> path.read_text()
    'ours'
    """
    outer = _WRITING.get()
    command = Writing(overwrite) if outer is None else outer
    before, command.overwrite = command.overwrite, command.overwrite or overwrite
    command.inputs.append(inputs)
    token = _WRITING.set(command)
    try:
        yield command
    finally:
        command.overwrite = before
        _WRITING.reset(token)


def note_inputs(paths: Iterable[Path]) -> None:
    """Register files that the command reads. They are examined only when a file is about to be replaced.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> path.write_text("mine") and None
    >>> with writing(overwrite=True):
    ...     note_inputs([path])
    ...     write_whole(path, b"ours")
    Traceback (most recent call last):
    FileExistsError: [Errno 17] is an input of this command, which is never replaced: ...
    """
    if (command := _WRITING.get()) is not None:
        command.inputs.append(paths)


def write_whole(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write ``data``, at once or piece by piece, as :func:`written_whole`. Raises ``OSError`` that names ``path``.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> write_whole(path, b"one")
    >>> write_whole(path, b"two")  # replaces what blurnoise wrote
    >>> path.write_text("mine") and write_whole(path, b"three")
    Traceback (most recent call last):
    FileExistsError: [Errno 17] is a file that blurnoise did not write, or that was changed since; ...
    """
    with written_whole(path) as unfinished, _naming(path), unfinished.open("xb") as file:
        file.writelines([data] if isinstance(data, bytes) else data)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path``; what is written there replaces ``path`` once it is on disk.

    A former file stays until then, or if :func:`check_replaceable` refuses to replace it; a folder replaces an empty
    one only. Devices and pipes are written to. If anything fails, nothing is left behind. Several writers of one path
    do not disturb each other: the last content stays. Raises ``OSError`` that names
    ``path``.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with written_whole(path) as unfinished:
    ...     _, before = unfinished.write_text("whole"), path.exists()
    >>> before, path.read_text()
    (False, 'whole')
    """
    target = Path(os.path.realpath(path)) if path.is_dir() else check_replaceable(path)
    unfinished = _beside(target or Path(tempfile.gettempdir()) / path.name)
    try:
        yield unfinished
        with _naming(path):
            if target is None:
                _write_to(path, unfinished)
                return
            # On disk before it takes the name: a crash leaves the old file or the new one, never half of one.
            for part in (*unfinished.rglob("*"), unfinished):
                _sync(part)
            if not unfinished.is_dir():
                _note(path, target, unfinished)
            unfinished.replace(target)
        with suppress(OSError):
            _sync(target.parent)
    finally:
        _delete(unfinished)


def check_writable(path: Path) -> None:
    """Raise ``OSError`` where ``path`` cannot be written, before anything is computed for it.

    >>> import tempfile
    >>> check_writable(Path(tempfile.mkdtemp()) / "a.txt")  # raises where it could not be written
    """
    with _naming(path):
        target = check_replaceable(path)
        if target is None:
            if not os.access(path, os.W_OK):
                raise OSError(errno.EACCES, os.strerror(errno.EACCES))
            return
        _probe(target.parent)


def check_writable_folder(folder: Path) -> None:
    """Raise ``OSError`` where no file can be written to the folder, or its nearest parent if it is not there yet.

    >>> import tempfile
    >>> check_writable_folder(Path(tempfile.mkdtemp()) / "new" / "folder")  # raises where it could not be made
    """
    with _naming(folder):
        _probe(next(each for each in (folder, *folder.absolute().parents) if each.exists()))


def check_replaceable(path: Path, new: Path | None = None) -> Path | None:
    """The file that ``path`` is, links followed; None for a device, a pipe, or what standard output goes to.

    Raises ``OSError`` for a folder, an input of the command, and a file that blurnoise did not write or that has
    changed since. A command that overwrites replaces this, too, by a file of the same kind. new: what replaces it.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> write_whole(path, b"one")
    >>> check_replaceable(path).name  # blurnoise wrote it, and nobody has changed it since
    'a.txt'
    """
    with _naming(path):
        command = _WRITING.get() or Writing()
        try:
            facts = path.stat()
        except FileNotFoundError:
            return _home(path, command)
        if stat.S_ISDIR(facts.st_mode):
            raise IsADirectoryError(errno.EISDIR, "is a folder; must be a file")
        if stat.S_IFMT(facts.st_mode) in _STREAMS or _standard(facts) is not None:
            return None
        if not stat.S_ISREG(facts.st_mode):
            raise OSError(errno.EINVAL, "is a disk or a socket; must be a file")
        if command.reads(facts):
            raise FileExistsError(errno.EEXIST, "is an input of this command, which is never replaced")
        target = _home(path, command)
        if is_written(target):
            return target
        if not command.overwrite:
            whose = "is a file that blurnoise did not write, or that was changed since"
            raise FileExistsError(errno.EEXIST, f"{whose}; overwrite=True replaces it")
        same_name = target.suffix.lower() == path.suffix.lower()
        if not same_name or (facts.st_size and _is_text(target) != _will_be_text(path, new, target)):
            kind = f"is a file of another kind ({target.name}), which is never replaced"
            raise FileExistsError(errno.EEXIST, kind)
        return target


def check_own_folder(folder: Path) -> None:
    """Raise ``OSError`` for a folder that holds, here or below, a file that blurnoise did not write there.

    Hidden files, such as a desktop's own, are passed over.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_whole(folder / "a.txt", b"one")
    >>> check_own_folder(folder)  # all of it is ours
    >>> (folder / "b.txt").write_text("mine") and check_own_folder(folder)
    Traceback (most recent call last):
    FileExistsError: [Errno 17] holds files that blurnoise did not write (b.txt); choose another folder: ...
    """
    with _naming(folder):
        for root, _, names in os.walk(folder):
            lines = lines_of(Path(root) / MANIFEST)
            for name in sorted(names):
                if name not in lines and not name.startswith("."):
                    other = os.path.relpath(Path(root) / name, folder)
                    why = f"holds files that blurnoise did not write ({other}); choose another folder"
                    raise FileExistsError(errno.EEXIST, why)


def remove(path: Path) -> None:
    """Delete a file that :func:`write_whole` could replace; it may be missing. Raises ``OSError``.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> write_whole(path, b"one")
    >>> remove(path)
    >>> path.exists()
    False
    """
    if path.exists() and (target := check_replaceable(path)):
        target.unlink(missing_ok=True)


def remove_made(command: Writing, since: int) -> None:
    """Delete the files that were made from the one of this number on, unless they changed, and lists of no file.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with writing() as command:
    ...     write_whole(path, b"one")
    ...     remove_made(command, since=0)
    >>> path.exists()
    False
    """
    made, command.made[since:] = command.made[since:], []
    for path in made:
        manifest = path.parent / MANIFEST
        with suppress(OSError):
            if is_written(path):
                path.unlink()
            if not any((path.parent / name).exists() for name in lines_of(manifest)):
                manifest.unlink()


def _home(path: Path, command: Writing) -> Path:
    """The file that links lead to; leftovers in its folder are removed."""
    target = Path(os.path.realpath(path))
    if _WRITING.get() is not None:
        command.sweep(target.parent)
    return target


def _standard(facts: os.stat_result) -> int | None:
    """The descriptor of standard output or error if it is redirected to this file."""
    for handle in (1, 2):
        with suppress(OSError):
            if os.path.samestat(facts, os.fstat(handle)):
                return handle
    return None


def _write_to(path: Path, unfinished: Path) -> None:
    facts = path.stat()
    stream = _standard(facts) if stat.S_ISREG(facts.st_mode) else None
    with (
        unfinished.open("rb") as data,
        path.open("wb") if stream is None else os.fdopen(os.dup(stream), "wb") as to,
    ):
        shutil.copyfileobj(data, to)


def _note(path: Path, target: Path, unfinished: Path) -> None:
    """Add the new file to the folder's list, before it replaces the former; raise if it must not."""
    check_replaceable(path, unfinished)  # again: the file may have appeared meanwhile
    with unfinished.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        content = size, digest_of(file, size)
    if not target.exists():
        if (command := _WRITING.get()) is not None:
            command.made.append(target)
    elif content in lines_of(target.parent / MANIFEST).get(target.name, ()):
        return
    add_line(target.parent / MANIFEST, target.name, content)


def _will_be_text(path: Path, new: Path | None, target: Path) -> bool:
    """Whether the new content is text; before it exists, whether the suffix says so."""
    if new is not None:
        return _is_text(new)
    return path.suffix.lower() in _TEXTS or _is_text(target)


def _is_text(path: Path) -> bool:
    with path.open("rb") as file:
        return b"\0" not in file.read(4096)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.filename not in (None, str(path)) and not _PARTIAL.fullmatch(Path(error.filename).name):
            raise  # names another file, such as one that the data are read from
        why = error.strerror or str(error)
        if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM) and "; " not in why:
            why += "; choose a folder that you can write to"
        raise OSError(error.errno, why, str(path)) from None


def _probe(folder: Path) -> None:
    probe = _beside(folder / "probe")
    probe.touch(exist_ok=False)
    probe.unlink()
    if (command := _WRITING.get()) is not None:
        command.sweep(folder)


def _beside(path: Path) -> Path:
    """A temporary name beside a path, with machine, process and the start of the process: its owner."""
    start = _start(os.getpid()) or "0" * 8
    return path.with_name(f".blurnoise-{_host()}-{os.getpid()}-{start}-{uuid.uuid4().hex}.partial")


@cache
def _host() -> str:
    """The machine and its process namespace (of a container), in which process numbers are valid."""
    space = ""
    with suppress(OSError):
        space = str(Path("/proc/self/ns/pid").readlink())
    return _short(f"{platform.node()} {space}")


def _start(process: int) -> str | None:
    """When a process began; None if there is no such process, "" if this system cannot tell."""
    try:
        facts = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text()
        return None if facts[0] == "Z" else _short(f"{boot} {facts[19]}")
    except (OSError, IndexError):
        return None if Path("/proc/self/stat").exists() else ""


def _short(text: str) -> str:
    return hashlib.blake2b(text.encode(errors="replace"), digest_size=4).hexdigest()


def _delete(path: Path) -> None:
    with suppress(OSError):
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _sync(path: Path) -> None:
    """Write a file's content to disk, or a folder's names where its file system can do so."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:
        if not path.is_dir():  # many file systems cannot sync a folder
            raise
    finally:
        os.close(handle)
