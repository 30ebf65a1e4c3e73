"""The results of a run: one SQLite file, written as cells finish.

A cell is committed for all models with its targets and detections, or not at all. A run that is killed loses only
the cells that were being computed, and can be resumed. One process writes at a time; its lock ends with it.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.store import schema
from blurnoise_eval.store.columns import columns_of
from blurnoise_eval.store.reading import (
    LARGEST_DOCUMENT,
    LARGEST_VALUE,
    Steps,
    check_files,
    check_tables,
    connect,
    most_steps,
)
from blurnoise_eval.store.rows import CellRow, SkippedRow, TargetRow
from blurnoise_eval.system.files import RUN_FILE, path_within
from blurnoise_eval.system.signing import is_own, signed

_DETECTION = np.dtype([("box_xyxy", "<f4", 4), ("score", "<f4"), ("class_id", "<i4")])
"""A class that is not the first of its box is stored as its complement, a number below 0."""
_CELLS, _TARGETS = (
    [column.name for column in columns_of(row, optional=False)] for row in (CellRow, TargetRow)
)
_BY_TARGET = f"{schema.ROWS}, target_id"
_AT_ONCE = 20_000  # rows that are read at a time
_JOURNAL_PAGES = 8000  # 32 MB; rows go to pages all over the file, which are synced when the journal is full


class StoreError(ValueError):
    """A run folder cannot be used; the message says why and what to do."""


class Stated(dict[str, Any]):
    """A JSON object whose error names a missing key, where other software made the run."""

    def __missing__(self, key: str) -> Any:
        raise ValueError(f"run: was not made by blurnoise ({key!r} is missing)")


class PictureFacts(NamedTuple):
    """A picture of the run: its source, a hash of its pixels, its size, and a hash of its appearance, see
    :func:`~blurnoise_eval.datasets.likeness.perceptual_hash`. headlit: its targets in headlamps, as JSON; None in a
    run without."""

    identity: str
    content: str
    width_px: int
    height_px: int
    look: str
    headlit: str | None = None


@dataclass(frozen=True)
class CellResult:
    """One finished cell of one model: its row, one row per target, its detections.

    non_finite_values: NaN and infinite values among the model's outputs, None where nobody has counted them.
    example_png: the picture, where it is kept as the row's ``example``. picture: the original picture.
    """

    cell: CellRow
    targets: tuple[TargetRow, ...]
    detections: Detections
    non_finite_values: int | None = None
    example_png: bytes | None = None
    picture: PictureFacts | None = None


class Store:
    """The results of one run. Use as a context manager; raises :class:`StoreError` when it cannot be used.

    A run that is there is read: see :mod:`~blurnoise_eval.store.reading`. create: it is written, by one process at a
    time, and made where it is not there. own: what is written is signed as this user's. ``memory``: values computed
    from the rows, until the rows change.
    """

    def __init__(self, folder: Path, *, create: bool = False, own: bool = True) -> None:
        self.folder, self._own, self._reads = folder, own, not create
        self.memory: dict[str, Any] = {}
        self._steps: Steps | None = None
        path = folder / RUN_FILE
        if not create and not path.is_file():
            raise StoreError(f"run = {str(folder)!r}: holds no {RUN_FILE}; make one with 'blurnoise sweep'")
        path = self.file(RUN_FILE)
        with self._explained(), ExitStack() as opened:
            try:
                if create:
                    db = self._written(path)
                else:
                    self._steps = most_steps(path)
                    db = connect(path, self._steps)
            except ValueError as error:
                raise StoreError(f"run = {str(folder)!r}: {error}") from None
            self._db = opened.enter_context(closing(db))
            if create:
                opened.callback(
                    db.execute, "PRAGMA journal_mode = DELETE"
                )  # no files beside one that is done
            self._opened = opened.pop_all()

    def _written(self, path: Path) -> sqlite3.Connection:
        """The connection of the one that writes."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if (beside := check_files(path)) and not path.exists():
            raise ValueError(f"{beside[0].name} is not of a run; choose another folder")
        with ExitStack() as opened:
            db = opened.enter_context(closing(sqlite3.connect(path, timeout=1.0)))
            db.execute("PRAGMA locking_mode = EXCLUSIVE")
            if not path.stat().st_size:
                db.execute(f"PRAGMA application_id = {schema.APPLICATION}")  # in the file before any journal
            (version,) = db.execute("PRAGMA user_version").fetchone()
            if version == 0:
                db.executescript(f"BEGIN; {schema.TABLES} PRAGMA user_version = {schema.VERSION}; COMMIT")
            check_tables(db)
            db.execute("PRAGMA journal_mode = WAL")
            db.execute("PRAGMA synchronous = NORMAL")  # a killed process loses nothing
            db.execute(f"PRAGMA wal_autocheckpoint = {_JOURNAL_PAGES}")
            opened.pop_all()
            return db

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(sqlite3.Error):  # the rows are committed already
            self._opened.close()

    def file(self, name: str) -> Path:
        """The path of a file that the run names. Raises :class:`StoreError` for one outside the run's folder."""
        try:
            return path_within(self.folder, name)
        except (ValueError, OSError) as error:
            raise StoreError(f"run = {str(self.folder)!r}: {error}") from None

    def damaged(self, field: str, what: str) -> StoreError:
        """The error of a run in which ``field`` has a value that no sweep writes."""
        return StoreError(
            f"run = {str(self.folder)!r}: {RUN_FILE} is damaged, or was made by other software ({field}: {what})"
        )

    def set_about(self, key: str, value: Any) -> None:
        """Keep a value under ``key``, as JSON, signed; arrays are lists there."""
        text = json.dumps(value, default=np.ndarray.tolist)
        signature = signed(f"{key} {text}") if self._own else None
        with self._transaction() as db:
            db.execute("INSERT OR REPLACE INTO about VALUES (?, ?, ?)", (key, text, signature))

    def is_own(self) -> bool:
        """Whether this user has written every document of the run."""
        rows = self.rows("SELECT key, value, signature FROM about")
        return all(is_own(f"{key} {value}", signature) for key, value, signature in rows)

    def about(self, key: str, *, own: bool = False) -> Any:
        """The JSON value under ``key``, None when there is none. own: nor one that somebody else has written."""
        for value, signature in self.rows("SELECT value, signature FROM about WHERE key = ?", key):
            signed_here = is_own(f"{key} {value}", signature)
            if len(value) > LARGEST_DOCUMENT and not signed_here:
                raise self.damaged(key, f"has more than {LARGEST_DOCUMENT} letters")
            if signed_here or not own:
                return self._document(key, value)
        return None

    def keep(self, key: str, value: Any) -> None:
        """As :meth:`set_about`, for later; where it is too large, or the run that is read cannot be written or is
        another account's, nothing happens."""
        if len(json.dumps(value, default=np.ndarray.tolist)) > LARGEST_VALUE // 2:
            return
        if not self._reads:
            self.set_about(key, value)
        elif self.is_own():
            with suppress(sqlite3.Error, StoreError):
                self._db.rollback()  # others may write
                with Store(self.folder, create=True) as writing:
                    writing.set_about(key, value)
            with self._explained():
                self._db.execute("BEGIN")

    def add(self, results: Sequence[CellResult]) -> None:
        """Commit finished cells, all of them or none; their pictures are not skipped."""
        self.memory.clear()
        if any(result.cell.lamp is not None for result in results):
            self._add_lamp_columns()
        with self._transaction() as db:
            _insert(db, "cells", (self._stored(result) for result in results))
            _insert(db, "targets", (row for result in results for row in _target_rows(result.targets)))
            images = {(result.cell.image,) for result in results}
            db.executemany("DELETE FROM skipped WHERE image = ?", images)

    def _stored(self, result: CellResult) -> dict[str, Any]:
        """A result by the columns of ``cells``."""
        return replace(result.cell, computed_by=self._computed_by).stored() | {
            "non_finite_values": result.non_finite_values,
            "detections": _pack(result.detections),
        }

    def software(self) -> dict[str, dict[str, str]]:
        """Versions of the software that computes the run, by the ``computed_by`` of its cells."""
        versions = (self.about("manifest") or {}).get("versions")
        text = json.dumps(versions, sort_keys=True)
        digest = hashlib.blake2b(text.encode(), digest_size=4).hexdigest()
        return {digest: versions} if versions else {}

    @cached_property
    def _computed_by(self) -> str | None:
        return next(iter(self.software()), None)

    def take(self, other: Store) -> None:
        """Add the rows of another run, all or none; cells that exist already stay as they are."""
        self.memory.clear()
        if other.lamp_columns():
            self._add_lamp_columns()
        with self._transaction() as db:
            for table in schema.RUN_TABLES:
                for rows in other.blocks(f"SELECT * FROM {table}"):
                    marks = ", ".join("?" * len(rows[0]))
                    db.executemany(f"INSERT OR IGNORE INTO {table} VALUES ({marks})", rows)
            db.execute("DELETE FROM skipped WHERE image IN (SELECT image FROM cells)")

    def clear(self) -> None:
        """Delete everything."""
        self.memory.clear()
        with self._transaction() as db:
            for table in ("about", *schema.RUN_TABLES):
                db.execute(f"DELETE FROM {table}")

    def skip(self, image: str, reason: str) -> None:
        """Record a picture that cannot be used."""
        with self._transaction() as db:
            db.execute("INSERT OR REPLACE INTO skipped VALUES (?, ?)", (image, reason))

    def done(self, image: str) -> set[str]:
        """The ids of a picture's finished cells; a cell is finished for every model of the run or for none."""
        return {cell_id for (cell_id,) in self.rows("SELECT cell_id FROM cells WHERE image = ?", image)}

    def note_picture(self, image: str, facts: PictureFacts) -> None:
        """Record a picture that cells are computed from. Raises :class:`StoreError` where its content has changed."""
        held = self.pictures(image).get(image)
        if held is not None and held.content != facts.content:
            was = "has changed since its first cells were computed; choose another folder"
            raise StoreError(f"run = {str(self.folder)!r}: picture {image!r} {was}")
        if held != facts:
            with self._transaction() as db:
                db.execute("INSERT OR REPLACE INTO pictures VALUES (?, ?, ?, ?, ?, ?, ?)", (image, *facts))

    def pictures(self, image: str | None = None) -> dict[str, PictureFacts]:
        """The pictures that cells were computed from, or one of them, by name."""
        query = "SELECT * FROM pictures WHERE image IN (SELECT image FROM cells)"
        found = self.rows(query) if image is None else self.rows(f"{query} AND image = ?", image)
        return {name: PictureFacts(*facts) for name, *facts in found}

    def cells(self, where: str = "TRUE", *values: object, order: str = schema.ROWS) -> Iterator[CellRow]:
        """The rows of cells without their detections, in the order of images and conditions; where: some of them."""
        names = ", ".join(self.cell_columns())
        return map(
            CellRow.read, self.rows(f"SELECT {names} FROM cells WHERE {where} ORDER BY {order}", *values)
        )

    def targets(self, where: str = "TRUE", *values: object, order: str = _BY_TARGET) -> Iterator[TargetRow]:
        """A row per cell and target, in the order of cells; where: some of them."""
        names = ", ".join(f'"{name}"' for name in _TARGETS)
        query = f"SELECT {names} FROM targets WHERE {where} ORDER BY {order}"
        return map(TargetRow.read, self.rows(query, *values))

    def skipped(self) -> list[SkippedRow]:
        """Pictures that could not be used, with the reason."""
        return list(map(SkippedRow.read, self.rows("SELECT image, reason FROM skipped ORDER BY image")))

    def detections(self, cell_id: str, model: str) -> Detections:
        """The detections of a model in a cell, down to a score of 0.001. Raises ``KeyError`` for no such cell."""
        query = "SELECT detections FROM cells WHERE cell_id = ? AND model = ?"
        for (packed,) in self.rows(query, cell_id, model):
            return unpack(packed)
        raise KeyError(cell_id, model)

    def count_different(self, *columns: str) -> int:
        """The number of different combinations of values in ``columns``."""
        ((count,),) = self.rows(f"SELECT COUNT(*) FROM (SELECT DISTINCT {', '.join(columns)} FROM cells)")
        return int(count)

    def rows(self, query: str, *values: object) -> Iterator[tuple[Any, ...]]:
        """The result of an SQL query."""
        return chain.from_iterable(self.blocks(query, *values))

    def blocks(
        self, query: str, *values: object, at_once: int | None = None
    ) -> Iterator[list[tuple[Any, ...]]]:
        """The result of an SQL query, some thousands of rows at a time."""
        with self._explained():
            self._begin()
            cursor = self._db.execute(query, values)
            while rows := cursor.fetchmany(at_once or _AT_ONCE):
                yield rows

    def _begin(self) -> None:
        if self._steps is not None:
            self._steps.begin()

    def cell_columns(self) -> list[str]:
        """The columns of a :class:`CellRow` that the run has: those of a pulsed lamp only with one."""
        return _CELLS + self.lamp_columns()

    def lamp_columns(self) -> list[str]:
        """The columns of a pulsed lamp, none in a run without."""
        with self._explained():
            there = {name for _, name, *_ in self._db.execute("PRAGMA table_info(cells)")}
        return [name for name in schema.OF_LAMPS if name in there]

    def _add_lamp_columns(self) -> None:
        """Add the columns of a pulsed lamp, which the cells of other runs lack."""
        if not self.lamp_columns():
            with self._transaction() as db:
                for name in schema.OF_LAMPS:
                    db.execute(schema.add_column(name))

    def _document(self, field: str, text: str) -> Any:
        try:
            return json.loads(text, object_hook=Stated, parse_constant=_infinite)
        except (ValueError, RecursionError) as error:
            raise self.damaged(field, str(error)) from None

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._explained(), self._db:
            yield self._db

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """SQLite's and the file system's errors as a :class:`StoreError` that names the run."""
        try:
            yield
            return
        except OSError as error:
            why = f"cannot be written ({error.strerror or error})"
        except sqlite3.OperationalError as error:
            if str(error) == "interrupted":
                if self._steps is None or not self._steps.used_up:
                    raise KeyboardInterrupt from None
                error = sqlite3.OperationalError("a query of it does not end")
            why = "another process is using it" if "locked" in str(error) else f"cannot be used ({error})"
        except sqlite3.DatabaseError as error:
            why = f"{RUN_FILE} is damaged ({error})"
        raise StoreError(f"run = {str(self.folder)!r}: {why}") from None


def _infinite(constant: str) -> float:
    """What the camera sets is infinite; nothing is no number."""
    if constant == "NaN":
        raise ValueError("NaN")
    return float(constant)


def _target_rows(rows: Sequence[TargetRow]) -> Iterator[dict[str, Any]]:
    """The rows of one cell and model by column; what they share is looked up once."""
    shared = rows[0].stored() if rows else {}
    for row in rows:
        yield {**shared, "blur_px": row.blur_px, **row.target.stored()}


def _insert(db: sqlite3.Connection, table: str, rows: Iterable[dict[str, Any]]) -> None:
    """Add rows by column, those of the same columns at once."""
    for columns, alike in groupby(rows, key=tuple):
        names, marks = ", ".join(f'"{name}"' for name in columns), ", ".join("?" * len(columns))
        into = f"INSERT OR REPLACE INTO {table} ({names}) VALUES ({marks})"
        db.executemany(into, [list(row.values()) for row in alike])


def _pack(detections: Detections) -> bytes:
    packed = np.empty(len(detections), _DETECTION)
    packed["box_xyxy"] = detections.boxes_xyxy
    packed["score"] = detections.scores
    leads, class_ids = detections.leads, detections.class_ids
    packed["class_id"] = class_ids if leads is None else np.where(leads, class_ids, ~class_ids)
    return packed.tobytes()


def unpack_all(names: Sequence[str], repeats: Sequence[int], packed: Sequence[bytes]) -> Answers:
    """Detections of many pictures, as the column ``detections`` holds them."""
    counts = np.array([len(each) for each in packed], np.int64) // _DETECTION.itemsize
    boxes, scores, class_ids, leads = _unpacked(b"".join(packed))
    return Answers(names, repeats, counts, boxes, scores, class_ids.astype(np.int64), leads)


def unpack(packed: bytes) -> Detections:
    """Detections as the column ``detections`` holds them."""
    return Detections(*_unpacked(packed))


def _unpacked(packed: bytes) -> tuple[Any, Any, Any, Any]:
    found = np.frombuffer(packed, _DETECTION)
    class_ids, leads = found["class_id"], found["class_id"] >= 0
    return found["box_xyxy"], found["score"], np.where(leads, class_ids, ~class_ids), leads
