"""Files: those that are read are files, those that are written appear whole or not at all."""

from __future__ import annotations

import errno
import io
import stat
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

RUN_FILE = "results.sqlite"
"""The file by which a folder is known to be a sweep's."""
RUN_PICTURES = ("examples", "figures")
"""The folders in it that hold pictures."""


def write_whole(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write ``data``, at once or piece by piece, to ``path``; what stood there stays until all is on disk.

    Raises ``OSError`` that names ``path``, and leaves nothing behind, where it cannot be written.
    """
    unfinished = path.with_name(f".{path.name}.partial")
    try:
        with unfinished.open("wb") as file:
            file.writelines([data] if isinstance(data, bytes) else data)
        unfinished.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        with suppress(OSError):
            unfinished.unlink()


def write_figure(path: Path, figure: Any, *, dpi: int) -> None:
    """Write a figure of matplotlib's in the format of ``path``'s suffix, as :func:`write_whole` does."""
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix[1:].lower(), dpi=dpi)
    write_whole(path, picture.getvalue())


def check_regular(path: Path) -> None:
    """Raise ``OSError`` for what is missing, or no file but a folder, a device or a pipe, which may never end."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a directory, device or pipe, no file", str(path))
