"""A run's file opened to read: it is anybody's, so it is checked before a row of it is believed.

SQLite opens it read-only, without functions or modules that a file may name, within limits. Its tables are those that
a sweep writes, to the letter; a view, a trigger or a computed column is none. A query takes at most as many steps as
rows that the file has room for, and Ctrl-C ends it.
"""

from __future__ import annotations

import os
import sqlite3
import stat
from contextlib import closing
from pathlib import Path

from blurnoise_eval.store import schema

LARGEST_DOCUMENT = 16 << 20
"""Letters of JSON that another account has written."""
OTHER_VERSION = "was made by another version of blurnoise, or by other software; choose another folder"
LARGEST_VALUE = 32 << 20
"""Bytes of a text or blob: some hundred thousand detections."""
_LIMITS = {
    sqlite3.SQLITE_LIMIT_LENGTH: LARGEST_VALUE,
    sqlite3.SQLITE_LIMIT_SQL_LENGTH: 100_000,
    sqlite3.SQLITE_LIMIT_COLUMN: 200,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 200,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 5,
    sqlite3.SQLITE_LIMIT_ATTACHED: 0,
    sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH: 1,
    sqlite3.SQLITE_LIMIT_WORKER_THREADS: 0,
}
_AT_A_TIME = 100_000  # steps of SQLite's machine, about a millisecond, after which Python looks for Ctrl-C
_STEPS, _STEPS_PER_BYTE = 300_000_000, 100
"""Steps of a query: a row of 100 bytes takes about 500; some seconds in a small file."""
_DEFENSIVE = 1010  # SQLite's SQLITE_DBCONFIG_DEFENSIVE
_WAL = b"\2"  # at byte 18 of a file with a journal ahead of it


def most_steps(path: Path) -> Steps:
    """Those of a query of this file.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "results.sqlite"
    >>> path.touch()
    >>> most_steps(path)()  # some hundred million for an empty file
    False
    """
    facts = path.stat()
    # A file may claim any size with holes in it, and would be allowed as many steps.
    n_bytes = min(facts.st_size, 512 * getattr(facts, "st_blocks", facts.st_size))  # without holes
    return Steps(_STEPS + _STEPS_PER_BYTE * n_bytes)


class Steps:
    """A progress handler of SQLite's: ends a query after so many steps, and knows whether it did.

    >>> steps = Steps(250_000)  # looked at every 100 000
    >>> [steps() for _ in range(3)], steps.used_up
    ([False, False, True], True)
    """

    def __init__(self, most: int) -> None:
        self._most = most // _AT_A_TIME
        self.begin()

    def begin(self) -> None:
        """Count anew: another query."""
        self._left, self.used_up = self._most, False

    def __call__(self) -> bool:
        """Whether the query ends here."""
        self._left -= 1
        self.used_up = self._left < 0
        return self.used_up


def check_files(path: Path) -> list[Path]:
    """The journals beside a run's file. Raises ``ValueError`` for one that is no file: SQLite would write through a
    link. And for a file that no run was begun in: SQLite would write beside one that it opens."""
    journals = [path.with_name(path.name + end) for end in ("-wal", "-journal", "-shm", "")]
    journals = [each for each in journals if os.path.lexists(each)]
    for each in journals:
        if not stat.S_ISREG(each.lstat().st_mode):
            raise ValueError(f"{each.name} must be a file, no link, device or pipe")
    if path in journals and path.stat().st_size:
        # by SQLite, since whoever else closes it drops the locks of this process
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as db:
            if db.execute("PRAGMA application_id").fetchone() != (schema.APPLICATION,):
                raise ValueError(OTHER_VERSION)
    return [each for each in journals if each.name.endswith(("-wal", "-journal"))]


def connect(path: Path, steps: Steps) -> sqlite3.Connection:
    """Open a run's file to read. Raises ``ValueError`` that says what is wrong, ``OSError``, and SQLite's errors."""
    beside, how = check_files(path), "mode=ro"
    if not os.access(path.parent, os.W_OK):
        if any(each.stat().st_size for each in beside):
            raise ValueError(
                "was stopped before it ended, and its folder is read-only; copy the folder, use the copy"
            )
        with path.open("rb") as file:  # of a journal that SQLite would make beside it
            how = "immutable=1" if file.read(20)[18:19] == _WAL else how
    db = sqlite3.connect(f"{path.absolute().as_uri()}?{how}", uri=True, timeout=1.0, isolation_level=None)
    try:
        for limit, most in _LIMITS.items():
            db.setlimit(limit, most)
        db.set_progress_handler(steps, _AT_A_TIME)
        # Against files made to harm: no functions from the schema, pages checked when they are read, no writes.
        db.execute("PRAGMA trusted_schema = OFF")
        db.execute("PRAGMA cell_size_check = ON")
        db.execute("PRAGMA query_only = ON")
        if hasattr(db, "setconfig"):  # from Python 3.12 on
            db.setconfig(_DEFENSIVE, True)
        db.execute("BEGIN")  # all that is read is of one moment
        check_tables(db)
    except BaseException:
        db.close()
        raise
    return db


def check_tables(db: sqlite3.Connection) -> None:
    """Raise ``ValueError`` for a file whose tables are not those that a sweep writes, to the letter."""
    names = "user_version", "application_id"
    version, application = (db.execute(f"PRAGMA {name}").fetchone()[0] for name in names)
    if version != schema.VERSION or application != schema.APPLICATION:
        raise ValueError(OTHER_VERSION)
    # Compared as text with tables made on the spot: whatever else a file defines is a difference.
    with closing(sqlite3.connect(":memory:")) as new:
        new.executescript(schema.TABLES)
        for _, name, *_ in db.execute("PRAGMA table_info(cells)"):
            if name in schema.OF_LAMPS:
                new.execute(schema.add_column(name))
        if _listed(db) != _listed(new):
            raise ValueError("has other tables than a sweep writes")


def _listed(db: sqlite3.Connection) -> list[tuple[object, ...]]:
    listed = db.execute("SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY name LIMIT 50")
    return [tuple(row) for row in listed]
