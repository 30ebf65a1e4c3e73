"""The tables of a run's file, made of the fields of rows: their columns, indices and order."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.store.columns import (
    ANY_TEXT,
    BIG,
    HASH,
    NAME,
    SIZE,
    TableColumn,
    columns_of,
    or_none,
)
from blurnoise_eval.store.rows import CellRow, OfLamp, TargetRow

LIGHT_FIRST = tuple(sorted(NAMES, key=lambda name: name != "illuminance_lux"))
"""The axes in the order by which rows are sorted: the light, then as in the table of axes."""
SORTED = ", ".join(("clean DESC", *LIGHT_FIRST))
ROWS = f"image, repeat, {SORTED}, model"
DETECTION_BYTES = 24
"""Of a detection in a blob: four corners, score and class."""
_DETECTIONS = (
    f"typeof({{0}}) = 'blob' AND length({{0}}) % {DETECTION_BYTES} = 0"
    f" AND length({{0}}) <= {DETECTION_BYTES * 50_000}"
)
COLUMNS: dict[str, tuple[TableColumn, ...]] = {
    "about": (
        TableColumn("key", "TEXT", NAME),
        TableColumn("value", "TEXT", "typeof({0}) = 'text'"),
        TableColumn("signature", "TEXT", or_none(NAME)),
    ),
    "cells": (
        *columns_of(CellRow, optional=False),
        TableColumn("non_finite_values", "INTEGER", or_none(BIG)),
        TableColumn("detections", "BLOB", _DETECTIONS),
    ),
    "targets": (*columns_of(TargetRow),),
    "pictures": (
        TableColumn("image", "TEXT", NAME),
        TableColumn("identity", "TEXT", ANY_TEXT),
        TableColumn("content", "TEXT", HASH),
        TableColumn("width_px", "INTEGER", SIZE),
        TableColumn("height_px", "INTEGER", SIZE),
        TableColumn("look", "TEXT", f"{HASH} AND length({{0}}) <= 16"),
        TableColumn("headlit", "TEXT", or_none(ANY_TEXT)),
    ),
    "skipped": (TableColumn("image", "TEXT", NAME), TableColumn("reason", "TEXT", ANY_TEXT)),
}
"""The columns of each table."""
OF_LAMPS: dict[str, TableColumn] = {column.name: column for column in columns_of(OfLamp)}
"""Further columns of cells in runs with a pulsed lamp."""
RUN_TABLES = ("cells", "targets", "pictures", "skipped")
"""All but ``about``."""
_KEYS = {"about": "key", "cells": "cell_id, model", "targets": "cell_id, model, target_id"}
_INDICES = {"cells_by_image": "image", "cells_by_conditions": f"model, clean, {', '.join(LIGHT_FIRST)}"}


def _listed(columns: Iterable[TableColumn]) -> str:
    return ", ".join(f'"{column.name}" {column.kind}' for column in columns)


TABLES = ";\n".join(
    [
        *(
            f"CREATE TABLE {table} ({_listed(columns)}, PRIMARY KEY ({_KEYS.get(table, 'image')}))"
            for table, columns in COLUMNS.items()
        ),
        *(f"CREATE INDEX {name} ON cells ({columns})" for name, columns in _INDICES.items()),
        "",
    ]
)
# SQLite keeps four bytes in a file's head for its owner, by which `file` and we recognise it.
APPLICATION = 0x626C6E73
"""In the head of each run's file, as SQLite has it: "blns"."""
VERSION = int.from_bytes(hashlib.sha256(TABLES.encode()).digest()[:4]) >> 1
"""Of the tables: a number made of their columns."""


def faulty(table: str, columns: Iterable[TableColumn], *, one_by_one: bool = False) -> str:
    """The query for a row in which a condition does not hold; one_by_one: for each condition whether it does."""
    holds = ["({})".format(column.holds.format(f'"{column.name}"')) for column in columns]
    shown = ", ".join(holds) if one_by_one else "1"
    return f"SELECT {shown} FROM {table} WHERE ({' AND '.join(holds)}) IS NOT 1 LIMIT 1"


def add_column(name: str) -> str:
    """The statement that gives the cells a column of ``OF_LAMPS``.

    >>> add_column("pwm_phase")
    'ALTER TABLE cells ADD COLUMN pwm_phase REAL'
    """
    return f"ALTER TABLE cells ADD COLUMN {name} {OF_LAMPS[name].kind}"
