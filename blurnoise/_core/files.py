"""Files: those read are regular files of limited size; those written are complete and on disk, or not there."""

from __future__ import annotations

import errno
import os
import stat
import uuid
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

LARGEST_TEXT_BYTES = 64 << 20
"""Of a table as CSV: a day of readings at 20 Hz, or an hour at 500 Hz."""


def check_regular(path: Path) -> None:
    """Raise ``OSError`` for a missing file, and for a directory, device or pipe, which may never end."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a directory, device or pipe, no file", str(path))


def read_bytes(path: Path, largest: int = LARGEST_TEXT_BYTES) -> bytes:
    """The content of a regular file. Raises ``OSError``, and ``ValueError`` above ``largest`` bytes."""
    check_regular(path)
    with path.open("rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise ValueError(f"larger than {largest} bytes")
    return data


def read_text(path: Path) -> str:
    """A text in UTF-8, with or without a byte-order mark; line ends are ``\\n``.

    Raises ``OSError``, and ``ValueError`` that names the file for other bytes or above ``LARGEST_TEXT_BYTES``.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not UTF-8 text (byte {error.start})") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def write_whole(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write ``data``, at once or piece by piece, to ``path``; what stood there stays until all is on disk.

    Several writers of one path do not disturb each other: the last one's content stands. Raises ``OSError`` that
    names ``path``, and leaves nothing behind, where it cannot be written.
    """
    unfinished = path.with_name(f".{uuid.uuid4().hex}.partial")
    try:
        with unfinished.open("xb") as file:
            file.writelines([data] if isinstance(data, bytes) else data)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        with suppress(OSError):
            unfinished.unlink()


def check_writable(path: Path) -> None:
    """Raise ``OSError`` where :func:`write_whole` could not write ``path``, before anything is computed for it."""
    probe = path.with_name(f".{uuid.uuid4().hex}.partial")
    try:
        probe.open("xb").close()
        probe.unlink()
        if path.is_dir():
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _sync_folder(folder: Path) -> None:
    """Have the folder's names on disk, too, where its file system can do so."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
