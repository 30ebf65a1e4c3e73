"""The list of what was written to a folder, ``.blurnoise``: a line of JSON per file, with name, size and a hash.

Its names are those of files in that folder, none below or elsewhere. What is on the list, unchanged since, is ours.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

MANIFEST = ".blurnoise"
"""The name of the list."""
_LINE = b'{"wrote": '  # begin of every line; a file of that name without it is the user's
_LARGEST, _AT_ONCE = 16 << 20, 1 << 20  # bytes
_NOT_OURS = errno.EACCES, errno.EPERM, errno.EISDIR, errno.ELOOP, errno.ENXIO


def is_written(target: Path) -> bool:
    """Whether the file has any content on the list, which may be ahead: a writer may end between list and file.

    The file is opened before the list is read. Another process notes a content before it takes the name, so that
    the list has whatever is open here.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> path.write_text("mine") and is_written(path)
    False
    """
    with target.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        held = lines_of(target.parent / MANIFEST).get(target.name, set())
        # The size first: a large file of the user's is not read only to learn that it is not ours.
        return size in {each for each, _ in held} and (size, digest_of(file, size)) in held


def lines_of(manifest: Path) -> dict[str, set[tuple[int, str]]]:
    """Sizes and hashes of the written files in a list, by name; invalid lines are skipped.

    >>> import tempfile
    >>> manifest = Path(tempfile.mkdtemp()) / MANIFEST
    >>> add_line(manifest, "a.txt", (3, "5c"))
    >>> lines_of(manifest)
    {'a.txt': {(3, '5c')}}
    """
    contents: dict[str, set[tuple[int, str]]] = {}
    with suppress(OSError), _opened(manifest, os.O_RDONLY) as handle, os.fdopen(os.dup(handle), "rb") as file:
        if file.read(len(_LINE)) != _LINE:
            return contents
        file.seek(max(0, os.fstat(handle).st_size - _LARGEST))
        for line in file.read(_LARGEST).splitlines():
            with suppress(ValueError, KeyError, TypeError, RecursionError):
                held = json.loads(line)
                contents.setdefault(str(held["wrote"]), set()).add((held["size"], held["blake2b"]))
    return contents


def add_line(manifest: Path, name: str, content: tuple[int, str]) -> None:
    """Add a file's name and content, (size, hash), to a list. A folder that takes no list is no error: without one,
    the file counts as the user's, which is safe.

    >>> add_line(Path("/dev/null"), "a.txt", (3, "5c"))  # no regular file, so no list
    """
    line = json.dumps({"wrote": name, "size": content[0], "blake2b": content[1]})
    try:
        with _opened(manifest, os.O_RDWR | os.O_CREAT) as handle:
            if os.read(handle, len(_LINE)) in (b"", _LINE):
                os.write(handle, f"{line}\n".encode())
    except OSError as error:
        if error.errno not in _NOT_OURS:
            raise


@contextmanager
def _opened(manifest: Path, how: int) -> Iterator[int]:
    """Open a regular file, without following links or waiting for pipes."""
    for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_APPEND", "O_CLOEXEC", "O_BINARY"):
        how |= getattr(os, flag, 0)
    handle = os.open(manifest, how, 0o666)
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise PermissionError(errno.EACCES, "is no regular file")
        yield handle
    finally:
        os.close(handle)


def digest_of(file: BinaryIO, size: int) -> str:
    """A hash of the content; "" if its size has changed.

    >>> import io
    >>> digest_of(io.BytesIO(b"one"), 3)[:8], digest_of(io.BytesIO(b"more"), 3)
    ('c88d4df7', '')
    """
    digest, left = hashlib.blake2b(digest_size=16), size
    while data := file.read(min(_AT_ONCE, left + 1)):
        left -= len(data)
        digest.update(data)
        if left < 0:
            break
    return digest.hexdigest() if left == 0 else ""
