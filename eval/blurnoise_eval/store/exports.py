"""Exports: the rows of a run as CSV and Parquet, each file whole or not at all.

Rows go from the store to the file some thousands at a time, so that memory does not grow with the run. Choices have
their names, and "clean" is a truth value. Infinity, an axis's value where the camera sets it itself, is "auto" as
text and infinity in Parquet, whose columns have one type each. What is not known is empty, or null.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from blurnoise_eval.grid.axes import CHOICES
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_whole, written_whole

_TABLES = {"results": "cells", "targets": "targets"}
Row = tuple[Any, ...]


def write_exports(store: Store, folder: Path | None = None) -> list[Path]:
    """Write results.csv (a row per cell and model) and targets.csv (a row per target of these).

    folder: by default the run's. Raises ``OSError`` where a file cannot be written.
    """
    written = []
    for name, table in _TABLES.items():
        path = (folder or store.folder) / f"{name}.csv"
        write_whole(path, _csv(list(store.columns(table)), _rows(store, table, as_text=True)))
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
        fields = [(column, own.get(column, kinds[kind])) for column, kind in store.columns(table).items()]
        with (
            written_whole(path) as unfinished,
            parquet.ParquetWriter(unfinished, pa.schema(fields)) as writer,
        ):
            for rows in _rows(store, table, as_text=False):
                columns = zip(fields, zip(*rows, strict=True), strict=True)
                values = [
                    pa.array([bool(each) for each in column] if kind == pa.bool_() else column, kind)
                    for (_, kind), column in columns
                ]
                writer.write_batch(pa.record_batch(values, schema=pa.schema(fields)))
        written.append(path)
    return written


def _rows(store: Store, table: str, *, as_text: bool) -> Iterator[list[Row]]:
    """All rows as people read them, in the order of images and conditions."""
    asked = []
    for name, kind in store.columns(table).items():
        value = f'{queries.OF[table]}."{name}"'
        if name in CHOICES:
            places = " ".join(f"WHEN {place} THEN '{choice}'" for place, choice in enumerate(CHOICES[name]))
            value = f"CASE {value} {places} END"
        elif as_text and kind == "REAL":
            value = f"CASE WHEN {value} = 9e999 THEN 'auto' ELSE {value} END"
        elif as_text and name == "clean":
            value = f"CASE WHEN {value} THEN 'True' ELSE 'False' END"
        asked.append(value)
    return queries.every_row(store, table, asked)


def _csv(columns: Sequence[str], blocks: Iterator[list[Row]]) -> Iterator[bytes]:
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    for rows in blocks:
        writer.writerows(rows)
        yield text.getvalue().encode("utf-8")
        text.seek(0)
        text.truncate()
    yield text.getvalue().encode("utf-8")
