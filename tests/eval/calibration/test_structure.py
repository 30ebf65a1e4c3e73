"""Rows, columns and pixels of real frames: EMVA's own set of a CCD, and the package that measures by the standard."""

import csv
import logging
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.patterns import common_variances, dark_lines
from blurnoise_eval.calibration.temporal import FrameMeans

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "emva_ccd"
SPATIAL_S, SPATIAL_PHOTONS = 0.00516, 15508.0
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not REAL.is_dir(), reason="the shared frames are absent")]


def stack_of(kind):
    """The eight frames of one level, flat (b) or dark (d)."""
    return [f"images/{kind}_s_000_snap_{number:03}.png" for number in range(8)]


def listed():
    """Rows of the folder's list, and the two stacks that it leaves out."""
    with (REAL / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    for kind, letter, photons in (("flat", "b", SPATIAL_PHOTONS), ("dark", "d", "")):
        common = {"kind": kind, "exposure_s": SPATIAL_S, "photons_per_px": photons}
        rows += [{"file": name, **common} for name in stack_of(letter)]
    return rows


def measured(folder, rows):
    (folder / "images").symlink_to(REAL / "images")
    with (folder / "frames.csv").open("w") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return measure(folder, bit_depth=12)


def test_figures_of_a_real_ccd(tmp_path):
    of_all = measured(tmp_path, listed())
    assert not of_all.doubts
    found = of_all.estimates
    expected = {
        "system_gain_dn_per_e": 0.2801, "quantum_efficiency": 0.4525, "read_noise_e": 10.78, "row_noise_e": 1.79,
        "prnu": 0.00262, "dsnu_column_e": 0.541,
    }  # fmt: skip
    assert {name: found[name].value for name in expected} == pytest.approx(expected, rel=0.015)
    assert found["column_noise_e"].value == found["dsnu_row_e"].value == 0
    # the lamp's shading is none of it
    assert max(found["prnu_row"].value, found["prnu_column"].value) < 0.0002
    assert 0.01 < found["black_level_drift_dn"].value < 0.04
    black = found["black_level_dn"]
    assert black.low < 14.760 < black.high  # mean of 50 further dark frames of the same set


def test_the_package_of_the_standard_finds_the_same(tmp_path, monkeypatch):
    """On the same frames, within 3 %; levels without dark frames of their own get the nearest ones.

    Its patterns are of one stack with the lamp's shading; temporal noise of rows is in its row pattern (variance over
    8 frames) and, with the opposite sign, in its pixel pattern, which comes out below 0.
    """
    process = pytest.importorskip("emva1288.process", reason="needs emva1288: pip install 'blurnoise[test]'")
    monkeypatch.setattr(np, "asfarray", lambda values: np.asarray(values, float), raising=False)
    found = measured(tmp_path, listed()).estimates
    levels = {}
    for row in listed():
        if "_s_" not in row["file"]:
            levels.setdefault((row["kind"], float(row["exposure_s"]), row["photons_per_px"]), []).append(
                row["file"]
            )
    dark = {exposure_s: files for (kind, exposure_s, _), files in levels.items() if kind == "dark"}
    lines = ["v 4.0", "n 12 640 480"]
    for (kind, exposure_s, photons), files in levels.items():
        if kind == "flat":
            nearest = min(dark, key=lambda each: abs(each - exposure_s))
            lines += [f"b {1e9 * exposure_s:.0f} {photons}", *(f"i {name}" for name in files)]
            lines += [f"d {1e9 * exposure_s:.0f}", *(f"i {name}" for name in dark[nearest])]
    lines += [f"b {1e9 * SPATIAL_S:.0f} {SPATIAL_PHOTONS}", *(f"i {name}" for name in stack_of("b"))]
    lines += [f"d {1e9 * SPATIAL_S:.0f}", *(f"i {name}" for name in stack_of("d"))]
    (tmp_path / "emva.txt").write_text("\n".join(lines) + "\n")
    quiet = {"loglevel": logging.ERROR}
    parsed = process.ParseEmvaDescriptorFile(str(tmp_path / "emva.txt"), **quiet)
    loaded = process.LoadImageData(
        parsed.images, path=str(REAL), fload=lambda name: cv2.imread(name, cv2.IMREAD_UNCHANGED), **quiet
    )
    theirs = process.Results1288(process.Data1288(loaded.data, **quiet).data, **quiet)

    assert found["system_gain_dn_per_e"].value == pytest.approx(theirs.K, rel=0.03)
    assert 100 * found["quantum_efficiency"].value == pytest.approx(theirs.QE, rel=0.03)
    dark_e = math.hypot(found["read_noise_e"].value, found["row_noise_e"].value)
    assert dark_e == pytest.approx(theirs.sigma_d, rel=0.03)
    assert 100 * found["prnu"].value == pytest.approx(theirs.PRNU1288_pixel, rel=0.03)
    stacks = {}
    for letter in "bd":
        stacks[letter] = FrameMeans()
        planes = [cv2.imread(str(REAL / name), cv2.IMREAD_UNCHANGED) for name in stack_of(letter)]
        list(stacks[letter].add(planes))
    signal = np.subtract(*(np.mean(stacks[letter].halves) for letter in "bd"))
    one, other = (half - half.mean() for half in stacks["b"].halves)
    light, unlit = common_variances(one, other), dark_lines(stacks["d"].halves)
    assert 100 * math.sqrt(light.row[0]) / signal == pytest.approx(theirs.PRNU1288_row, rel=0.03)
    column = math.sqrt(light.column[0] - unlit.column[0])
    assert 100 * column / signal == pytest.approx(theirs.PRNU1288_col, rel=0.03)
    assert 100 * math.sqrt(light.pixel[0]) / signal == pytest.approx(theirs.PRNU1288_pixel, rel=0.03)
    assert math.sqrt(unlit.column[0]) / theirs.K == pytest.approx(theirs.DSNU1288_col, rel=0.03)
    in_time = (found["row_noise_e"].value * found["system_gain_dn_per_e"].value) ** 2 / 8
    assert math.sqrt(unlit.row[0] + in_time) / theirs.K == pytest.approx(theirs.DSNU1288_row, rel=0.03)
    assert math.isnan(theirs.DSNU1288_pixel)
