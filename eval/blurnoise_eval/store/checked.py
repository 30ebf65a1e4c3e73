"""Whether a run's rows are what its manifest and its tables say, whoever wrote them: checked before they are read.

SQLite keeps any value in any column. What stands in one is found with the greatest value of each, in one scan of a
table: it orders NULL before numbers, numbers before texts, texts before bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from blurnoise_eval.store.store import Store, extent

_NEEDED = {
    "cells": ("cell_id", "model", "image", "repeat", "clean", "detections"),
    "targets": ("cell_id", "model", "image", "repeat", "clean", "target_id", "group", "confidence"),
}
_HELD = {"TEXT": ("text",), "INTEGER": ("integer", "real"), "REAL": ("integer", "real"), "BLOB": ("blob",)}


def check_rows(store: Store) -> None:
    """Raise :class:`~blurnoise_eval.store.store.StoreError` that names table and column, for rows that no sweep has
    written: values of another type, missing ones, models or classes that the manifest lacks."""
    models = {model["name"]: model for model in (store.about("manifest") or {"models": []})["models"]}
    for table, needed in _NEEDED.items():
        _check_types(store, table, needed)
        for (name,) in (row for rows in store.tuples(f"SELECT DISTINCT model FROM {table}") for row in rows):
            if name not in models:
                raise store.damaged(f"{table}.model", f"{name!r} is none of the manifest's {[*models]}")
    _check_detections(store, models)


def _check_types(store: Store, table: str, needed: tuple[str, ...]) -> None:
    kinds = store.columns(table)
    kinds |= {"detections": "BLOB"} if table == "cells" else {}
    asked = [
        *(f'typeof(MAX("{name}"))' for name in kinds),
        *(f'COUNT(*) - COUNT("{name}")' for name in needed),
    ]
    ((found,),) = store.tuples(f"SELECT {', '.join(asked)} FROM {table} NOT INDEXED")
    for (name, must), kind in zip(kinds.items(), found, strict=False):
        if kind not in ("null", *_HELD.get(must, (kind,))):
            raise store.damaged(f"{table}.{name}", f"holds {kind}; must be {must}")
    for name, missing in zip(needed, found[len(kinds) :], strict=True):
        if missing:
            raise store.damaged(f"{table}.{name}", f"is missing in {missing} rows")


def _check_detections(store: Store, models: Mapping[str, Mapping[str, Any]]) -> None:
    classes = {name: len(model["contract"].get("classes", ())) for name, model in models.items()}
    for rows in store.tuples("SELECT model, detections FROM cells NOT INDEXED WHERE length(detections) > 0"):
        for model in {row[0] for row in rows}:
            try:
                most = extent([packed for name, packed in rows if name == model])
            except ValueError as error:
                raise store.damaged("cells.detections", str(error)) from None
            if most >= classes[model]:
                told = f"class {most} of {model!r}, which has {classes[model]}"
                raise store.damaged("cells.detections", told)
