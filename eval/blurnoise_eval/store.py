"""Results that survive: one SQLite file per run, written as cells finish.

A cell is committed whole, with its targets and detections, or not at all; a killed run loses the cells in
flight and goes on where it stopped. One process writes at a time; the lock dies with the process.
"""

from __future__ import annotations

import csv
import io
import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from blurnoise_eval.files import write_whole
from blurnoise_eval.records import Detections

FILE_NAME = "results.sqlite"

_CONDITIONS = (
    "cell_id TEXT, model TEXT, camera TEXT, image TEXT, repeat INTEGER, clean INTEGER, exposure_s REAL, "
    "illuminance_lux REAL, velocity_x_px_s REAL, velocity_y_px_s REAL, blur_px REAL"
)
_SCHEMA = f"""
CREATE TABLE IF NOT EXISTS about (key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE IF NOT EXISTS cells ({_CONDITIONS}, seed INTEGER, n_targets INTEGER, target_confidence REAL,
  detection_rate REAL, n_detections INTEGER, simulate_ms REAL, infer_ms REAL, error TEXT, example TEXT,
  detections BLOB, PRIMARY KEY (cell_id));
CREATE TABLE IF NOT EXISTS targets ({_CONDITIONS}, target_id INTEGER, "group" TEXT, label TEXT, x0 REAL,
  y0 REAL, x1 REAL, y1 REAL, width_px REAL, height_px REAL, confidence REAL,
  PRIMARY KEY (cell_id, target_id));
CREATE TABLE IF NOT EXISTS skipped (image TEXT PRIMARY KEY, reason TEXT);
"""
_ORDER = "image, repeat, clean DESC, illuminance_lux, exposure_s, velocity_x_px_s, velocity_y_px_s"
_DETECTION = np.dtype([("box_xyxy", "<f4", 4), ("score", "<f4"), ("class_id", "<i4")])


class StoreError(ValueError):
    """A run folder cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class CellResult:
    """One finished cell: its row, one row per target, its detections. Keys are the store's columns."""

    cell: dict[str, Any]
    targets: tuple[dict[str, Any], ...]
    detections: Detections


class Store:
    """The results of one run. Use as a context manager; raises :class:`StoreError` when it cannot be used."""

    def __init__(self, folder: Path, *, create: bool = False) -> None:
        self.folder = folder
        path = folder / FILE_NAME
        if not create and not path.is_file():
            raise StoreError(f"run = {str(folder)!r}: holds no {FILE_NAME}; make one with 'blurnoise sweep'")
        with self._explained():
            folder.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(path, timeout=1.0)
            self._db.row_factory = sqlite3.Row
            self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = NORMAL")  # a killed process loses nothing
            self._db.executescript(_SCHEMA)

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._db.close()

    def set_about(self, key: str, value: Any) -> None:
        """Keep a JSON value under ``key``."""
        with self._transaction() as db:
            db.execute("INSERT OR REPLACE INTO about VALUES (?, ?)", (key, json.dumps(value)))

    def about(self, key: str) -> Any:
        """The JSON value under ``key``, None when there is none."""
        rows = self._rows("SELECT value FROM about WHERE key = ?", key)
        return json.loads(rows[0]["value"]) if rows else None

    def add(self, results: Sequence[CellResult]) -> None:
        """Commit finished cells, all of them or none."""
        with self._transaction() as db:
            for result in results:
                _insert(db, "cells", {**result.cell, "detections": _pack(result.detections)})
                for target in result.targets:
                    _insert(db, "targets", target)

    def skip(self, image: str, reason: str) -> None:
        """Note a picture that cannot be used."""
        with self._transaction() as db:
            db.execute("INSERT OR REPLACE INTO skipped VALUES (?, ?)", (image, reason))

    def done(self) -> set[str]:
        """The ids of finished cells."""
        return {row["cell_id"] for row in self._rows("SELECT cell_id FROM cells")}

    def cells(self) -> list[dict[str, Any]]:
        """Every cell's row without its detections, in the order of images and conditions."""
        return self._rows(f"SELECT {', '.join(self._columns('cells'))} FROM cells ORDER BY {_ORDER}")

    def targets(self) -> list[dict[str, Any]]:
        """One row per cell and target, in the order of cells."""
        return self._rows(f"SELECT * FROM targets ORDER BY {_ORDER}, target_id")

    def skipped(self) -> list[dict[str, Any]]:
        """Pictures that could not be used, with the reason."""
        return self._rows("SELECT * FROM skipped ORDER BY image")

    def detections(self, cell_id: str) -> Detections:
        """What the detector found in a cell, down to a score of 0.001. Raises ``KeyError`` for no such cell."""
        rows = self._rows("SELECT detections FROM cells WHERE cell_id = ?", cell_id)
        if not rows:
            raise KeyError(cell_id)
        packed = np.frombuffer(rows[0]["detections"], _DETECTION)
        return Detections(packed["box_xyxy"], packed["score"], packed["class_id"])

    def export(self) -> list[Path]:
        """Write results.csv (a row per cell), targets.csv (a row per cell and target) and results.json.

        Each file appears whole or stays what it was. Raises ``OSError`` where it cannot be written.
        """
        cells = self.cells()
        tables = {
            "results.csv": _csv(self._columns("cells"), cells),
            "targets.csv": _csv(self._columns("targets"), self.targets()),
            "results.json": json.dumps(cells, indent=1),
        }
        for name, text in tables.items():
            write_whole(self.folder / name, text.encode("utf-8"))
        return [self.folder / name for name in tables]

    def _rows(self, query: str, *values: str) -> list[dict[str, Any]]:
        with self._explained():
            rows = [dict(row) for row in self._db.execute(query, values)]
        for row in rows:
            if "clean" in row:
                row["clean"] = bool(row["clean"])
        return rows

    def _columns(self, table: str) -> list[str]:
        """Names of the columns that people read."""
        with self._explained():
            columns = self._db.execute(f"SELECT * FROM {table} LIMIT 0").description
        return [name for name, *_ in columns if name != "detections"]

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._explained(), self._db:
            yield self._db

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """SQLite's and the file system's errors as a :class:`StoreError` that names the run."""
        run = f"run = {str(self.folder)!r}"
        try:
            yield
        except OSError as error:
            raise StoreError(f"{run}: cannot be written ({error.strerror or error})") from None
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise StoreError(f"{run}: another process is using it") from None
            raise StoreError(f"{run}: cannot be used ({error})") from None
        except sqlite3.DatabaseError as error:
            raise StoreError(f"{run}: {FILE_NAME} is damaged ({error})") from None


def _insert(db: sqlite3.Connection, table: str, row: dict[str, Any]) -> None:
    names = ", ".join(f'"{name}"' for name in row)
    marks = ", ".join("?" * len(row))
    db.execute(f"INSERT OR REPLACE INTO {table} ({names}) VALUES ({marks})", list(row.values()))


def _pack(detections: Detections) -> bytes:
    packed = np.empty(len(detections), _DETECTION)
    packed["box_xyxy"] = detections.boxes_xyxy
    packed["score"] = detections.scores
    packed["class_id"] = detections.class_ids
    return packed.tobytes()


def _csv(columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=columns)
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
