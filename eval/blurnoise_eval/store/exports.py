"""Exports: the rows of a run as CSV, each file whole or not at all.

Rows go from the store to the file some thousands at a time, so that memory does not grow with the run. Choices have
their names, and "clean" is a truth value. Infinity, an axis's value where the camera sets it itself, is "auto". What
is not known is empty.
"""

from __future__ import annotations

from pathlib import Path

from blurnoise_eval.grid.axes import CHOICES
from blurnoise_eval.store.schema import ROWS
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_text

_ORDER = ", ".join(f"cells.{name.strip()}" for name in ROWS.split(","))
_TABLES = {  # sorted by an index, picture by picture, in little memory
    "results": ("cells", f"cells ORDER BY {_ORDER}"),
    "targets": (
        "targets",
        "cells CROSS JOIN targets ON targets.cell_id = cells.cell_id AND targets.model = cells.model "
        f"ORDER BY {_ORDER}, targets.target_id",
    ),
}


def write_exports(store: Store, folder: Path | None = None) -> list[Path]:
    """Write results.csv (a row per cell and model) and targets.csv (a row per target of these).

    In the order of pictures and conditions. folder: by default the run's. Raises ``OSError`` where a file cannot be
    written.
    """
    written = []
    for name, (table, rows_of) in _TABLES.items():
        columns = store.columns(table)
        asked = ", ".join(_as_text(table, column, kind) for column, kind in columns.items())
        path = (folder or store.folder) / f"{name}.csv"
        blocks = [[tuple(columns)]], store.tuples(f"SELECT {asked} FROM {rows_of}")
        write_whole(path, (csv_text(rows).encode("utf-8") for each in blocks for rows in each))
        written.append(path)
    return written


def _as_text(table: str, name: str, kind: str) -> str:
    value = f'{table}."{name}"'
    if name in CHOICES:
        places = " ".join(f"WHEN {place} THEN '{choice}'" for place, choice in enumerate(CHOICES[name]))
        return f"CASE {value} {places} END"
    if name == "clean":
        return f"CASE WHEN {value} THEN 'True' ELSE 'False' END"
    return f"CASE WHEN {value} = 9e999 THEN 'auto' ELSE {value} END" if kind == "REAL" else value
