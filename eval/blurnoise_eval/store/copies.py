"""Copies of rows under other names: how a small run is made a large one, in order to measure what that costs."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from blurnoise_eval.system.files import RUN_FILE


def copy_pictures(run: Path, other: Mapping[str, str], last: str, before: str) -> None:
    """Add the rows of a run's pictures up to ``last``, and before ``before``, again.

    other: by column the expression, of a row's columns, that stands in the copy.
    """
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        for table in ("cells", "targets", "pictures"):
            names = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            columns = ", ".join(f'"{name}"' for name in names)
            values = ", ".join(other.get(name, f'"{name}"') for name in names)
            db.execute(
                f"INSERT INTO {table} ({columns}) SELECT {values} FROM {table} WHERE image <= ? AND image < ?",
                (last, before),
            )
