"""Exports: the rows of a run as CSV and Parquet, each file whole or not at all.

Rows go from the store to the file some thousands at a time, so that memory does not grow with the run. Choices have
their names, and "clean" is a truth value. Infinity, an axis's value where the camera sets it itself, is "auto" as
text and infinity in Parquet, whose columns have one type each. What is not known is empty, or null.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from blurnoise_eval.grid.axes import CHOICES
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_whole, written_whole
from blurnoise_eval.system.tables import csv_text

_TABLES = {"results": "cells", "targets": "targets"}


def write_exports(store: Store, folder: Path | None = None) -> list[Path]:
    """Write results.csv (a row per cell and model) and targets.csv (a row per target of these).

    folder: by default the run's. Raises ``OSError`` where a file cannot be written.
    """
    written = []
    for name, table in _TABLES.items():
        blocks = [[tuple(store.columns(table))]], _rows(store, table, as_text=True)
        path = (folder or store.folder) / f"{name}.csv"
        write_whole(path, (csv_text(rows).encode("utf-8") for each in blocks for rows in each))
        written.append(path)
    return written


def check_parquet() -> None:
    """Raise ``ValueError`` where what writes Parquet is not installed."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise ValueError("parquet: needs the package pyarrow; pip install 'blurnoise[parquet]'") from None


def write_parquet(store: Store, folder: Path | None = None) -> list[Path]:
    """Write the rows of results.csv and targets.csv as results.parquet and targets.parquet.

    folder: by default the run's. Raises ``ValueError`` without pyarrow, ``OSError`` where a file cannot be written.
    """
    check_parquet()
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {"TEXT": pa.string(), "INTEGER": pa.int64(), "REAL": pa.float64()}
    own = {"clean": pa.bool_(), **dict.fromkeys(CHOICES, pa.string())}
    written = []
    for name, table in _TABLES.items():
        path = (folder or store.folder) / f"{name}.parquet"
        columns = store.columns(table).items()
        schema = pa.schema([(column, own.get(column, kinds[kind])) for column, kind in columns])
        with written_whole(path) as unfinished, parquet.ParquetWriter(unfinished, schema) as writer:
            for rows in _rows(store, table, as_text=False):
                values = [
                    pa.array(map(bool, column) if kind == pa.bool_() else column, kind)
                    for kind, column in zip(schema.types, zip(*rows, strict=True), strict=True)
                ]
                writer.write_batch(pa.record_batch(values, schema=schema))
        written.append(path)
    return written


def _rows(store: Store, table: str, *, as_text: bool) -> Iterator[list[tuple[Any, ...]]]:
    """All rows as people read them, in the order of images and conditions."""
    asked = []
    for name, kind in store.columns(table).items():
        value = f'{table}."{name}"'
        if name in CHOICES:
            places = " ".join(f"WHEN {place} THEN '{choice}'" for place, choice in enumerate(CHOICES[name]))
            value = f"CASE {value} {places} END"
        elif as_text and kind == "REAL":
            value = f"CASE WHEN {value} = 9e999 THEN 'auto' ELSE {value} END"
        elif as_text and name == "clean":
            value = f"CASE WHEN {value} THEN 'True' ELSE 'False' END"
        asked.append(value)
    return queries.every_row(store, table, asked)
