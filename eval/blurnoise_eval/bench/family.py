"""Family of a process: itself and all that it and its children began; the memory that they hold. Linux.

Domain: MB (2**20 bytes) of memory, proportional set size (PSS): a page that n processes share counts 1/n in each, so
that a family's is the sum of its members'.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

_PSS_KB = re.compile(rb"^Pss:\s+(\d+)", re.MULTILINE)


def family(process: int) -> set[int]:
    """Numbers of the process and of its descendants that live; of itself alone where /proc does not tell."""
    parents = dict(_parents())
    found = {process}
    while more := {number for number, parent in parents.items() if parent in found} - found:
        found |= more
    return found


def held_mb(process: int) -> float | None:
    """Memory of one process; None: gone, or /proc does not tell."""
    try:
        told = _PSS_KB.search(Path(f"/proc/{process}/smaps_rollup").read_bytes())
    except OSError:
        return None
    return None if told is None else int(told[1]) / 1024


def called(process: int) -> bytes:
    """The command that the process was begun with; nothing where it is gone."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""


def written_bytes() -> int:
    """That this process has written so far, to whatever it is; 0 where /proc does not tell."""
    try:
        return int(Path("/proc/self/io").read_text().split("wchar:")[1].split()[0])
    except OSError:
        return 0


def _parents() -> Iterator[tuple[int, int]]:
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:  # gone meanwhile
            continue
        yield int(stat.parent.name), int(text[text.rindex(")") + 2 :].split()[1])
