"""The tables of a run, made from the axes: their columns, their index, the order of their rows."""

from __future__ import annotations

from blurnoise_eval.grid.axes import NAMES

VERSION = 10  # of the tables below


def _added(table: str, *columns: str) -> str:
    return "".join(f"ALTER TABLE {table} ADD COLUMN {column};" for column in columns)


_SOFTWARE = "CREATE TABLE IF NOT EXISTS software (computed_by TEXT PRIMARY KEY, versions TEXT);"
_STEPS = {
    3: _added("cells", "saturated REAL")
    + _added("targets", "confidence_swept REAL")
    + _added("pictures", "width_px INTEGER", "height_px INTEGER"),
    4: _added("cells", "applied_gain_db REAL", "snr_db REAL", "brightness REAL"),
    5: _added("cells", "applied_exposure_s REAL") + "UPDATE cells SET applied_exposure_s = exposure_s;",
    6: "".join(
        _added(table, "moves REAL", "invented_share REAL")
        + f"UPDATE {table} SET moves = 0, invented_share = 0 WHERE clean = 0;"
        for table in ("cells", "targets")
    ),
    7: "".join(
        _added(table, "ego_speed_m_s REAL") + f"UPDATE {table} SET ego_speed_m_s = 0 WHERE clean = 0;"
        for table in ("cells", "targets")
    ),
    8: _added("pictures", "look TEXT"),
    9: _added("cells", "computed_by TEXT") + _SOFTWARE,
}
UPGRADES = {first: "".join(_STEPS[step] for step in sorted(_STEPS) if step >= first) for first in _STEPS}
"""What makes the tables of an older version those below, but for the order of columns and what an index holds; what
that version did not measure is NULL."""
READ_BY = {
    0: "blurnoise 0.1.0 up to commit 3f7252b",
    2: "blurnoise 0.1.0 up to commit c423369",
}
"""Who reads the tables of versions that have no way to those below; there was no version 1."""
CONDITIONS = ("clean", *NAMES)
"""Columns that tell one condition from another; the untouched pictures have None on every axis."""
LIGHT_FIRST = tuple(sorted(NAMES, key=lambda name: name != "illuminance_lux"))
"""The axes in the order by which rows are sorted: the light, then as in the table of axes."""
SORTED = ", ".join(("clean DESC", *LIGHT_FIRST))
ROWS = f"image, repeat, {SORTED}, model"

_SHARED = (
    "cell_id TEXT, model TEXT, camera TEXT, image TEXT, repeat INTEGER, clean INTEGER, "
    f"{', '.join(f'{name} REAL' for name in NAMES)}, blur_px REAL"
)
TABLES = f"""
CREATE TABLE IF NOT EXISTS about (key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE IF NOT EXISTS cells ({_SHARED}, seed INTEGER, n_targets INTEGER, target_confidence REAL,
  detection_rate REAL, n_detections INTEGER, saturated REAL, applied_exposure_s REAL, applied_gain_db REAL,
  snr_db REAL, brightness REAL, invented_share REAL, simulate_ms REAL, infer_ms REAL, error TEXT,
  example TEXT, computed_by TEXT, detections BLOB, PRIMARY KEY (cell_id, model));
{_SOFTWARE}
CREATE INDEX IF NOT EXISTS cells_by_image ON cells (image);
CREATE INDEX IF NOT EXISTS cells_by_conditions ON cells (model, clean, {", ".join(LIGHT_FIRST)});
CREATE TABLE IF NOT EXISTS targets ({_SHARED}, target_id INTEGER, "group" TEXT, label TEXT, x0 REAL,
  y0 REAL, x1 REAL, y1 REAL, width_px REAL, height_px REAL, confidence REAL, confidence_swept REAL,
  invented_share REAL, truth TEXT, text TEXT, read_confidence REAL, character_error_rate REAL,
  PRIMARY KEY (cell_id, model, target_id));
CREATE TABLE IF NOT EXISTS pictures (image TEXT PRIMARY KEY, identity TEXT, content TEXT, width_px INTEGER,
  height_px INTEGER, look TEXT);
CREATE TABLE IF NOT EXISTS skipped (image TEXT PRIMARY KEY, reason TEXT);
"""
