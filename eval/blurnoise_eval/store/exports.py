"""Exports: the rows of a run as CSV and Parquet, each file or folder whole or not at all.

Rows go from the store to the file some thousands at a time, so that memory does not grow with the run. Choices have
their names, and "clean" is a truth value. Infinity, an axis's value where the camera sets it itself, is "auto" as
text and infinity in Parquet, whose columns have one type each. What is not known is empty, or null.
"""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from blurnoise_eval.grid.axes import CHOICES
from blurnoise_eval.grid.parts import place_of
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_whole, written_whole

MOST_HERE = 100_000
"""Rows above which a process of its own writes the tables, by pyarrow where that is installed."""
_ROWS_PER_SHARD = 1_000_000
_PICTURES_AT_ONCE = 20
Row = tuple[Any, ...]


def write_exports(store: Store, folder: Path | None = None) -> list[Path]:
    """Write results.csv (a row per cell and model) and targets.csv (a row per target of these).

    folder: by default the run's. Raises ``OSError`` where a file cannot be written.
    """
    folder = folder or store.folder
    written = []
    for name, table in (("results.csv", "cells"), ("targets.csv", "targets")):
        rows = _rows(store, table, clean="CASE WHEN {} THEN 'True' ELSE 'False' END")
        quick = not _is_small(store) and _has_arrow()
        parts = _arrow_csv(store, table, rows) if quick else _csv(list(store.columns(table)), rows)
        write_whole(folder / name, parts)
        written.append(folder / name)
    return written


_ALONE = """
import signal, sys
from pathlib import Path
from blurnoise_eval.store.exports import write_exports
from blurnoise_eval.store.store import Store
signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # leaves no half a file
with Store(Path(sys.argv[1]), shared=True) as store:
    write_exports(store, Path(sys.argv[2]))
"""


@contextmanager
def exported_meanwhile(run: Path, folder: Path) -> Iterator[None]:
    """:func:`write_exports` of a run, which nothing else may hold open unless shared.

    Of more than ``MOST_HERE`` rows by a process of its own, in the time that the body takes; where that fails, here
    once the body is done. Raises ``OSError`` where a file cannot be written.
    """
    with Store(run, shared=True) as store:
        small = _is_small(store)
        if small:
            write_exports(store, folder)
    if small:
        yield
        return
    nothing = subprocess.DEVNULL
    command = [sys.executable, "-c", _ALONE, str(run), str(folder)]
    with subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing) as alone:
        try:
            yield
        except BaseException:
            alone.terminate()
            raise
        failed = alone.wait() != 0
    if failed:
        with Store(run, shared=True) as store:
            write_exports(store, folder)


def _is_small(store: Store) -> bool:
    return queries.count_rows(store) <= MOST_HERE


def check_parquet() -> None:
    """Raise ``ValueError`` where what writes Parquet is not installed."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise ValueError("parquet: needs the package pyarrow; pip install 'blurnoise[parquet]'") from None


def write_parquet(store: Store, folder: Path | None = None) -> list[Path]:
    """Write the rows of results.csv and targets.csv as results.parquet and targets.parquet, folders that pandas,
    Arrow, DuckDB and Spark read as one table.

    In each ``model=NAME/shard=NN/part.parquet``, the name percent-encoded; a picture stands in the shard that the
    hash of its name says, of as many as keep a shard near a million rows. folder: by default the run's. Raises
    ``ValueError`` without pyarrow, ``OSError`` where it cannot be written.
    """
    check_parquet()
    folder = folder or store.folder
    shards = -(-queries.count_rows(store) // _ROWS_PER_SHARD) or 1
    pictures: list[list[str]] = [[] for _ in range(shards)]
    for name in queries.pictures_seen(store):
        pictures[place_of(name, shards)].append(name)
    written = []
    for name, table in (("results.parquet", "cells"), ("targets.parquet", "targets")):
        with written_whole(folder / name) as unfinished:
            for model in queries.models_seen(store):
                for number, held in enumerate(pictures):
                    place = unfinished / f"model={quote(model, safe='')}" / f"shard={number:02}"
                    place.mkdir(parents=True)
                    _write_part(store, table, model, held, place / "part.parquet")
        written.append(folder / name)
    return written


def _write_part(store: Store, table: str, model: str, pictures: Sequence[str], path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    columns = {name: kind for name, kind in store.columns(table).items() if name != "model"}
    own = {"clean": pa.bool_(), **dict.fromkeys(CHOICES, pa.string())}
    schema = pa.schema([(name, own.get(name, _arrow_kind(kind))) for name, kind in columns.items()])
    of = queries.OF[table]
    asked = [_named(name, of, f'{of}."{name}"') for name in columns]
    with parquet.ParquetWriter(path, schema) as writer:
        for first in range(0, len(pictures), _PICTURES_AT_ONCE):
            some = pictures[first : first + _PICTURES_AT_ONCE]
            for rows in queries.rows_of_pictures(store, table, asked, model, some):
                values = [
                    pa.array([bool(each) for each in column] if name == "clean" else column, kind)
                    for (name, kind), column in zip(
                        zip(schema.names, schema.types, strict=True), zip(*rows, strict=True), strict=True
                    )
                ]
                writer.write_batch(pa.record_batch(values, schema=schema))


def _rows(store: Store, table: str, *, clean: str = "{}") -> Iterator[list[Row]]:
    """All rows as people read them, in the order of images and conditions."""
    asked = []
    of = queries.OF[table]
    for name, kind in store.columns(table).items():
        value = f'{of}."{name}"'
        if kind == "REAL":
            value = f"CASE WHEN {value} = 9e999 THEN 'auto' ELSE {value} END"
        asked.append(clean.format(value) if name == "clean" else _named(name, of, value))
    return queries.every_row(store, table, asked)


def _named(name: str, of: str, value: str) -> str:
    """A column's value, of a choice its name."""
    if name not in CHOICES:
        return value
    places = " ".join(f"WHEN {place} THEN '{choice}'" for place, choice in enumerate(CHOICES[name]))
    return f'CASE {of}."{name}" {places} END'


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


def _arrow_csv(store: Store, table: str, blocks: Iterator[list[Row]]) -> Iterator[bytes]:
    """As :func:`_csv`, in a sixth of its time: the same values, texts in quotes, whole numbers without ".0", and
    lines that end as on Unix."""
    import pyarrow as pa
    from pyarrow.csv import WriteOptions, write_csv

    kinds = store.columns(table)
    automatic = queries.infinite_somewhere(store, table, [name for name in kinds if kinds[name] == "REAL"])
    texts = {"clean", *CHOICES, *automatic}
    schema = pa.schema(
        [(name, pa.string() if name in texts else _arrow_kind(kind)) for name, kind in kinds.items()]
    )
    plain = WriteOptions(include_header=False)
    yield f"{','.join(kinds)}\n".encode()
    for rows in blocks:
        part = io.BytesIO()
        columns = dict(zip(kinds, zip(*rows, strict=True), strict=True))
        for name in automatic:
            columns[name] = tuple(None if each is None else str(each) for each in columns[name])
        values = [pa.array(column, schema.field(name).type) for name, column in columns.items()]
        write_csv(pa.record_batch(values, schema=schema), part, plain)
        yield part.getvalue()


def _arrow_kind(kind: str) -> Any:
    """Arrow's type for one of SQLite's."""
    import pyarrow as pa

    return {"TEXT": pa.string(), "INTEGER": pa.int64(), "REAL": pa.float64()}[kind]


def _has_arrow() -> bool:
    try:
        check_parquet()
    except ValueError:
        return False
    return True
