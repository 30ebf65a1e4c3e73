"""Levels of a folder: by gain, light and exposure."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.frames import Folder
from blurnoise_eval.calibration.levels import level_of

CAMERA = replace(
    made_frames.drawn_camera(2),
    full_well_e=9000.0, system_gain_dn_per_e=0.4, read_noise_e=4.0, prnu=0.01, dsnu_e=2.0, black_level_dn=20.0,
    bit_depth=12,
)  # fmt: skip


def listed(folder: Path, rows: list[dict[str, object]]) -> Path:
    """``frames.csv`` of these rows."""
    with (folder / "frames.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list({name: None for row in rows for name in row}))
        writer.writeheader()
        writer.writerows(rows)
    return folder


def test_gain_light_and_temperature_reach_the_levels(tmp_path: Path) -> None:
    """Two gains of the same exposures: the gain of the lower one is fitted."""
    rows: list[dict[str, object]] = []
    for gain_db, camera in ((6.0, replace(CAMERA, system_gain_dn_per_e=0.8)), (0.0, CAMERA)):
        for (kind, exposure_s), planes in made_frames.exposed(
            camera, 1, size=(64, 80), levels=4, top=0.5
        ).items():
            for number, plane in enumerate(planes):
                name = f"{gain_db}_{kind}_{exposure_s:.4f}_{number}.npy"
                np.save(tmp_path / name, plane)
                light = {"illuminance_lux": 120.5, "wavelength_nm": 525} if kind == "flat" else {}
                how = {"kind": kind, "exposure_s": exposure_s, "gain_db": gain_db, "temperature_c": 31}
                rows.append({"file": name, **how, **light})
    files = Folder(listed(tmp_path, rows))
    assert files.gains_db == [0.0, 6.0]
    high = files.at_gain(6.0)
    assert (len(high.dark), len(high.flat)) == (4, 4)
    level, _ = level_of(high.planes(high.flat[1]), high.flat[1][0])
    assert (level.gain_db, level.illuminance_lux, level.wavelength_nm, level.temperature_c) == (
        6,
        120.5,
        525,
        31,
    )
    assert str(level) == "flat 50 ms, 120.5 lx, 525 nm, 6 dB"
    assert measure(tmp_path).estimates["system_gain_dn_per_e"].value == pytest.approx(0.4, rel=0.05)
