"""The tables of a run, made from the axes: their columns, what their rows hold, their indices, their order.

Each column has a type, and a condition that holds for each value that a sweep writes; ``{0}`` is the column's name.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable

from blurnoise_eval.plan.axes import AXES, NAMES, Axis

CONDITIONS = ("clean", *NAMES)
"""Columns that identify a condition; the original pictures have None on every axis."""
LIGHT_FIRST = tuple(sorted(NAMES, key=lambda name: name != "illuminance_lux"))
"""The axes in the order by which rows are sorted: the light, then as in the table of axes."""
SORTED = ", ".join(("clean DESC", *LIGHT_FIRST))
ROWS = f"image, repeat, {SORTED}, model"
DETECTION_BYTES = 24
"""Of a detection in a blob: four corners, score and class."""
Column = tuple[str, str, str]
"""Name, type, and the condition on each value."""


def _number(low: float, high: float, kind: str = "real") -> str:
    ends = " AND ".join(
        "9e999" if end == math.inf else "-9e999" if end == -math.inf else repr(end) for end in (low, high)
    )
    return f"typeof({{0}}) = '{kind}' AND {{0}} BETWEEN {ends}"


def _or_none(condition: str) -> str:
    return f"{{0}} IS NULL OR {condition}"


def _on(axis: Axis) -> str:
    """None of original pictures, a number on the axis of others."""
    allowed = _number(axis.low, axis.high)
    if axis.choices:
        allowed += " AND {0} = round({0})"
    if axis.positive:
        allowed += f" AND {{0}} > {axis.low!r}"
    if axis.automatic:
        allowed = f"({allowed} OR typeof({{0}}) = 'real' AND {{0}} = 9e999)"
    return f"CASE WHEN clean THEN {{0}} IS NULL ELSE {allowed} END"


_BYTES = "length(CAST({0} AS BLOB))"  # length alone ends at a zero
_TEXT = f"typeof({{0}}) = 'text' AND {_BYTES} BETWEEN 1 AND 4000"
_ANY_TEXT = f"typeof({{0}}) = 'text' AND {_BYTES} <= 20000"
_ID = "typeof({0}) = 'text' AND length({0}) = 20 AND {0} NOT GLOB '*[^0-9a-f]*'"
_HASH = "typeof({0}) = 'text' AND length({0}) <= 32 AND {0} NOT GLOB '*[^0-9a-f]*'"
_COUNT, _SIZE, _FLAG = (_number(low, high, "integer") for low, high in ((0, 10**6), (1, 10**5), (0, 1)))
_BIG = _number(0, 2**63 - 1, "integer")
_SHARE, _PX = _number(0.0, 1.000001), _number(-1e9, 1e9)
_MEASURED = _or_none(_number(-math.inf, math.inf))
_DETECTIONS = (
    f"typeof({{0}}) = 'blob' AND length({{0}}) % {DETECTION_BYTES} = 0"
    f" AND length({{0}}) <= {DETECTION_BYTES * 50_000}"
)

_SHARED: tuple[Column, ...] = (
    ("cell_id", "TEXT", _ID), ("model", "TEXT", _TEXT), ("camera", "TEXT", _TEXT), ("image", "TEXT", _TEXT),
    ("repeat", "INTEGER", _COUNT), ("clean", "INTEGER", _FLAG), *((axis.name, "REAL", _on(axis)) for axis in AXES),
    ("blur_px", "REAL", _or_none(_number(0.0, 1e12))),
)  # fmt: skip
COLUMNS: dict[str, tuple[Column, ...]] = {
    "about": (
        ("key", "TEXT", _TEXT), ("value", "TEXT", "typeof({0}) = 'text'"), ("signature", "TEXT", _or_none(_TEXT)),
    ),
    "cells": (
        *_SHARED, ("seed", "INTEGER", _BIG), ("n_targets", "INTEGER", _COUNT),
        ("target_confidence", "REAL", _or_none(_SHARE)), ("detection_rate", "REAL", _or_none(_SHARE)),
        ("n_detections", "INTEGER", _COUNT), ("saturated_share", "REAL", _or_none(_SHARE)),
        ("applied_exposure_s", "REAL", _or_none(_number(1e-12, 3600.0))), ("applied_gain_db", "REAL", _MEASURED),
        ("snr_db", "REAL", _MEASURED), ("brightness", "REAL", _or_none(_SHARE)),
        ("inpainted_share", "REAL", _or_none(_SHARE)), ("simulate_ms", "REAL", _MEASURED),
        ("infer_ms", "REAL", _MEASURED), ("error", "TEXT", _or_none(_ANY_TEXT)), ("example", "TEXT", _or_none(_TEXT)),
        ("computed_by", "TEXT", _or_none(_HASH)), ("non_finite_values", "INTEGER", _or_none(_BIG)),
        ("detections", "BLOB", _DETECTIONS),
    ),
    "targets": (
        *_SHARED, ("target_id", "INTEGER", _COUNT), ("group", "TEXT", _TEXT), ("label", "TEXT", _ANY_TEXT),
        *((name, "REAL", _PX) for name in ("x0", "y0", "x1", "y1", "width_px", "height_px")),
        ("confidence", "REAL", _SHARE), ("confidence_swept", "REAL", _or_none(_SHARE)),
        ("inpainted_share", "REAL", _or_none(_SHARE)), ("truth", "TEXT", _or_none(_ANY_TEXT)),
        ("text", "TEXT", _or_none(_ANY_TEXT)), ("read_confidence", "REAL", _or_none(_SHARE)),
        ("character_error_rate", "REAL", _or_none(_number(0.0, 1e6))),
    ),
    "pictures": (
        ("image", "TEXT", _TEXT), ("identity", "TEXT", _ANY_TEXT), ("content", "TEXT", _HASH),
        ("width_px", "INTEGER", _SIZE), ("height_px", "INTEGER", _SIZE),
        ("look", "TEXT", f"{_HASH} AND length({{0}}) <= 16"),
    ),
    "skipped": (("image", "TEXT", _TEXT), ("reason", "TEXT", _ANY_TEXT)),
}  # fmt: skip
"""The columns of each table."""
OF_LAMPS: dict[str, Column] = {
    name: (name, kind, _or_none(condition))
    for name, kind, condition in (("pwm_phase", "REAL", _SHARE), ("missed_pulse", "INTEGER", _FLAG))
}
"""Further columns of cells in runs with a pulsed lamp: its phase, and whether the exposure fell between pulses."""
RUN_TABLES = ("cells", "targets", "pictures", "skipped")
"""All but ``about``."""
_KEYS = {"about": "key", "cells": "cell_id, model", "targets": "cell_id, model, target_id"}
_INDICES = {"cells_by_image": "image", "cells_by_conditions": f"model, clean, {', '.join(LIGHT_FIRST)}"}


def _listed(columns: Iterable[Column]) -> str:
    return ", ".join(f'"{name}" {kind}' for name, kind, _ in columns)


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
APPLICATION = 0x626C6E73
"""In the head of each run's file, as SQLite has it: "blns"."""
VERSION = int.from_bytes(hashlib.sha256(TABLES.encode()).digest()[:4]) >> 1
"""Of the tables: a number made of their columns."""


def faulty(table: str, columns: Iterable[Column], *, one_by_one: bool = False) -> str:
    """The query for a row in which a condition does not hold; one_by_one: for each condition whether it does."""
    holds = ["({})".format(condition.format(f'"{name}"')) for name, _, condition in columns]
    shown = ", ".join(holds) if one_by_one else "1"
    return f"SELECT {shown} FROM {table} WHERE ({' AND '.join(holds)}) IS NOT 1 LIMIT 1"


def add_column(name: str) -> str:
    """The statement that gives the cells a column of ``OF_LAMPS``."""
    return f"ALTER TABLE cells ADD COLUMN {name} {OF_LAMPS[name][1]}"
