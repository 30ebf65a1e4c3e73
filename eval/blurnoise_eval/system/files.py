"""Files that appear whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any


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


def json_lines(rows: Iterable[dict[str, Any]]) -> Iterator[str]:
    """A list of rows as JSON, a line each, for :func:`write_whole` to write as they come."""
    before = "["
    for row in rows:
        yield f"{before}\n {json.dumps(row)}"
        before = ","
    yield "[]\n" if before == "[" else "\n]\n"
