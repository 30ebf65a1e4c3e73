"""The tables of a run, made from the axes: their columns, their index, the order of their rows."""

from __future__ import annotations

import hashlib

from blurnoise_eval.grid.axes import NAMES

CONDITIONS = ("clean", *NAMES)
"""Columns that identify a condition; the original pictures have None on every axis."""
LIGHT_FIRST = tuple(sorted(NAMES, key=lambda name: name != "illuminance_lux"))
"""The axes in the order by which rows are sorted: the light, then as in the table of axes."""
SORTED = ", ".join(("clean DESC", *LIGHT_FIRST))
ROWS = f"image, repeat, {SORTED}, model"

_SHARED = (
    "cell_id TEXT, model TEXT, camera TEXT, image TEXT, repeat INTEGER, clean INTEGER, "
    f"{', '.join(f'{name} REAL' for name in NAMES)}, blur_px REAL"
)
OF_LAMPS = {"pwm_phase": "REAL", "missed_pulse": "INTEGER"}
"""Further columns of cells in runs with a pulsed lamp: its phase, and whether the exposure fell between pulses."""
RUN_TABLES = ("cells", "targets", "pictures", "skipped")
"""All but ``about``."""
TABLES = f"""
CREATE TABLE IF NOT EXISTS about (key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE IF NOT EXISTS cells ({_SHARED}, seed INTEGER, n_targets INTEGER, target_confidence REAL,
  detection_rate REAL, n_detections INTEGER, saturated_share REAL, applied_exposure_s REAL, applied_gain_db REAL,
  snr_db REAL, brightness REAL, inpainted_share REAL, simulate_ms REAL, infer_ms REAL, error TEXT,
  example TEXT, computed_by TEXT, non_finite_values INTEGER, detections BLOB, PRIMARY KEY (cell_id, model));
CREATE INDEX IF NOT EXISTS cells_by_image ON cells (image);
CREATE INDEX IF NOT EXISTS cells_by_conditions ON cells (model, clean, {", ".join(LIGHT_FIRST)});
CREATE TABLE IF NOT EXISTS targets ({_SHARED}, target_id INTEGER, "group" TEXT, label TEXT, x0 REAL,
  y0 REAL, x1 REAL, y1 REAL, width_px REAL, height_px REAL, confidence REAL, confidence_swept REAL,
  inpainted_share REAL, truth TEXT, text TEXT, read_confidence REAL, character_error_rate REAL,
  PRIMARY KEY (cell_id, model, target_id));
CREATE TABLE IF NOT EXISTS pictures (image TEXT PRIMARY KEY, identity TEXT, content TEXT, width_px INTEGER,
  height_px INTEGER, look TEXT);
CREATE TABLE IF NOT EXISTS skipped (image TEXT PRIMARY KEY, reason TEXT);
"""
RENAMED = {"saturated": "saturated_share", "invented_share": "inpainted_share"}
"""Columns of runs of earlier versions, and their names today."""
VERSION = int.from_bytes(hashlib.sha256(TABLES.encode()).digest()[:4]) >> 1
"""Of the tables: a number made of their columns."""
