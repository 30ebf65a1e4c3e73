"""Checks of a run's rows before anything is computed from them: types and ranges of values, and that tables agree."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from blurnoise_eval.store import queries, schema
from blurnoise_eval.store.columns import CONDITIONS
from blurnoise_eval.store.store import Store, StoreError, unpack_all
from blurnoise_eval.system.files import inside

_AT_ONCE = 100  # blobs, of 7 kB mostly and 1 MB at most
_OF_CELLS = ("image", "repeat", *CONDITIONS)
_SAME = " AND ".join(f"cells.{name} IS targets.{name}" for name in _OF_CELLS)
_ALIEN = {
    "cells.image": "SELECT image FROM cells EXCEPT SELECT image FROM pictures LIMIT 1",
    "targets.cell_id": "SELECT targets.cell_id FROM targets LEFT JOIN cells ON cells.cell_id = targets.cell_id "
    f"AND cells.model = targets.model WHERE ({_SAME}) IS NOT 1 LIMIT 1",
}
"""By column, a value that another table lacks, or describes otherwise."""


def check_rows(store: Store, classes: Mapping[str, int]) -> None:
    """Raise :class:`StoreError` for rows that no sweep writes. classes: by model, the number of its classes."""
    if (pages := _first(store, "PRAGMA quick_check(1)")) != [("ok",)]:
        raise store.damaged("pages", str(pages))
    for table, columns in schema.COLUMNS.items():
        known = [*columns, *(schema.OF_LAMPS[name] for name in store.lamp_columns() if table == "cells")]
        if _first(store, schema.faulty(table, known)):
            (held,) = _first(store, schema.faulty(table, known, one_by_one=True))
            (name, *_), *_ = (column for column, holds in zip(known, held, strict=True) if holds != 1)
            raise store.damaged(f"{table}.{name}", "a value of another type, or out of its range")
    for column, query in _ALIEN.items():
        for (value,) in _first(store, query):
            raise store.damaged(column, f"{value!r} is not in the other tables")
    for name in (*store.pictures(), *queries.example_files(store)):
        try:
            inside(name)
        except ValueError as error:
            raise StoreError(f"run = {str(store.folder)!r}: {error}") from None
    for rows in store.blocks("SELECT model, image, repeat, detections FROM cells", at_once=_AT_ONCE):
        for model in {row[0] for row in rows}:
            if model not in classes:
                raise store.damaged("cells.model", f"{model!r} is no model of the run")
            detections = unpack_all(*zip(*(row[1:] for row in rows if row[0] == model), strict=True))
            # A blob is bytes to SQLite: only here are NaN and classes that the model lacks seen.
            numbers = np.concatenate([detections.boxes_xyxy.ravel(), detections.scores])
            if not np.isfinite(numbers).all() or (detections.class_ids >= classes[model]).any():
                raise store.damaged("cells.detections", f"no detections of {model!r}")


def _first(store: Store, query: str) -> list[tuple[object, ...]]:
    """The first row, if any."""
    return next(store.blocks(query), [])[:1]
