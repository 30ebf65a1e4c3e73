"""Levels of a folder: by gain, light and exposure; mosaics taken apart."""

import csv
import re

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.frames import Folder
from blurnoise_eval.calibration.levels import level_of
from blurnoise_eval.calibration.to_camera import camera_of

from blurnoise import Camera

CAMERA = made_frames.CAMERA


def listed(folder, rows):
    with (folder / "frames.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list({name: None for row in rows for name in row}))
        writer.writeheader()
        writer.writerows(rows)
    return folder


def test_gain_light_and_temperature_reach_the_levels(tmp_path):
    """Two gains of the same exposures: the gain of the lower one is fitted."""
    rows = []
    for gain_db, camera in ((6.0, CAMERA.with_figures(system_gain_dn_per_e=0.8)), (0.0, CAMERA)):
        taken = made_frames.exposed(camera, 1, size=(64, 80), levels=4, top=0.5)
        for (kind, exposure_s), planes in taken.items():
            how = {
                "kind": kind,
                "exposure_s": exposure_s,
                "gain_db": gain_db,
                "temperature_c": 31 + gain_db / 3,
            }
            how |= {"illuminance_lux": 120.5, "wavelength_nm": 525} if kind == "flat" else {}
            for number, plane in enumerate(planes):
                name = f"{gain_db}_{kind}_{exposure_s:.4f}_{number}.npy"
                np.save(tmp_path / name, plane)
                rows.append({"file": name, **how})
    files = Folder(listed(tmp_path, rows))
    assert files.gains_db == [0.0, 6.0]
    assert files.notes == [
        "the temperature of the sensor varies from 31 to 33 °C; the dark current is a mean over it"
    ]
    high = files.at_gain(6.0)
    assert (len(high.dark), len(high.flat)) == (4, 4)
    level, _ = level_of(high.planes(high.flat[1]), high.flat[1][0])
    assert level.taken.temperature_c == 33
    assert str(level) == "flat 50 ms, 120.5 lx, 525 nm, 6 dB"
    assert measure(tmp_path).estimates["system_gain_dn_per_e"].value == pytest.approx(0.4, rel=0.05)


def mosaic(folder, shares):
    """Frames behind filters that pass these shares, in reading order, with 0.01 of PRNU."""
    random, size = np.random.default_rng(3), (128, 160)
    passed = np.tile(np.reshape(shares, (2, 2)), (64, 80))
    response = passed * (1 + 0.01 * random.standard_normal(size))
    planes = {}
    for exposure_s in (0.01, 0.02, 0.04, 0.06, 0.08, 0.1):
        for kind, light_e in (("dark", 0.0), ("flat", 60e3 * exposure_s)):
            for _ in range(2):
                noisy_e = random.poisson(light_e * response) + 4 * random.standard_normal(size)
                each = np.round(60 + 0.4 * noisy_e).astype(np.uint16)
                planes.setdefault((kind, exposure_s), []).append(each)
    return made_frames.save(folder, planes)


MOSAICS = {
    "RGGB": ((0.5, 1.0, 1.0, 0.3), (0, 1), "XGGX"),
    "GBRG": ((1.0, 0.3, 0.5, 1.0), (0, 0), "GXXG"),
    "RCCB": ((0.5, 1.0, 1.0, 0.3), (0, 1), "XGGX"),
    "green light": ((0.1, 1.0, 1.0, 0.1), (0, 1), "XGGX"),
    "no filters": ((1.0, 1.0, 1.0, 1.0), None, None),
    "four amplifiers": ((1.0, 0.9, 0.8, 0.7), None, None),
}


@pytest.mark.parametrize(("shares", "site", "cfa"), MOSAICS.values(), ids=MOSAICS)
def test_a_mosaic_is_detected(tmp_path, shares, site, cfa):
    files = Folder(mosaic(tmp_path / "frames", shares))
    assert (files.site, files.cfa, files.size_px) == (site, cfa, (160, 128))
    assert next(files.planes(files.flat[0])).shape == ((64, 80) if site else (128, 160))


def test_figures_of_a_mosaic_are_of_its_green_pixels(tmp_path):
    """The signal of each plane is in a note; a given mosaic counts, also "none"."""
    folder = mosaic(tmp_path / "frames", (0.5, 1.0, 1.0, 0.3))
    found = measure(folder, cfa="RGGB")
    (note,) = (note for note in found.notes if "colour filters" in note)
    assert note.startswith(
        "colour filters RGGB: values are for the green pixels, those in row 1, column 2 of each 2 x 2; "
    )
    assert note.endswith("relative signal of the others: R 0.50, G 1.00, B 0.30")
    assert found.size_px == (160, 128)
    assert found.flat[-1].pixels == 64 * 80
    assert found.flat[-1].mean_dn == pytest.approx(60 + 0.4 * 6000, rel=0.002)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(0.4, rel=0.04)
    assert found.estimates["prnu"].value == pytest.approx(0.01, rel=0.1)
    assert measure(folder, cfa="none").flat[-1].pixels == 128 * 160
    assert any(note.startswith("detected: colour filters XGGX") for note in measure(folder).notes)


HALF, FLAT = (0.5, 1.0, 1.0, 0.3), (1.0, 1.0, 1.0, 1.0)
DOUBTED = {
    "a row off": (
        HALF, "GBRG",
        "the two green ones of GBRG differ by 5[0-9]%, the other two by 0%; BGGR or RGGB is likely",
    ),
    "not a mosaic's": (HALF, "RGGB", None),
    "a column off": (HALF, "BGGR", None),
    "other letters": (HALF, "GRBG", "BGGR or RGGB is likely; set --cfa"),
    "three clear ones": (HALF, "RCCC", "the three clear ones of RCCC differ by 91%"),
    "a mosaic, none stated": (HALF, "none", "none by --cfa or the files, but .* as those of XGGX; set --cfa"),
    "none, a mosaic stated": (FLAT, "RGGB", "RGGB by --cfa or the files, but .* get the same light"),
    "none": (FLAT, "none", None),
}  # fmt: skip


@pytest.mark.parametrize(("shares", "cfa", "why"), DOUBTED.values(), ids=DOUBTED)
def test_filters_that_the_light_contradicts_are_doubted(tmp_path, shares, cfa, why):
    """Of R 0.5, G 1, B 0.3 red and blue look alike."""
    found = measure(mosaic(tmp_path / "frames", shares), cfa=cfa)
    filters = [doubt for doubt in found.doubts if doubt.text.startswith("colour filters")]
    assert [bool(re.search(why or "", doubt.text)) for doubt in filters] == ([True] if why else [])
    if why and found.cfa and found.cfa != "RCCC":
        assert "doubtful: colour filters" in camera_of(found, "mine", base="imx250c").sources["cfa"]


def test_the_camera_without_a_mosaic_is_monochrome(tmp_path):
    camera = camera_of(measure(mosaic(tmp_path / "frames", FLAT)), "mine")
    assert camera.sensor.cfa == "mono"
    assert camera.sources["cfa"].startswith("measured")


def test_a_dark_current_that_may_be_0_is_0(tmp_path):
    """Exposure programs hold for cameras without; the interval is in the source."""
    found = measure(mosaic(tmp_path / "frames", FLAT))
    assert found.estimates["dark_current_e_s"].low == 0
    camera = camera_of(found, "mine")
    assert camera.sensor.dark_current_e_s == 0
    assert "is not told from 0, which is used" in camera.sources["dark_current_e_s"]


def test_the_camera_behind_a_mosaic(tmp_path):
    """A base with a mosaic takes that of the frames; one efficiency is not that of three colours."""
    folder = mosaic(tmp_path / "frames", (1.0, 0.3, 0.5, 1.0))
    rows = []
    for path in sorted(folder.iterdir()):
        kind, exposure_ms, _ = path.stem.split("_")
        photons = 100 * float(exposure_ms[:-2]) if kind == "flat" else 0.0
        rows.append(
            {"file": path.name, "photons_per_px": photons, "kind": kind} | {"exposure_s": exposure_ms[:-2]}
        )
    listed(folder, rows)
    found = measure(folder, cfa="GBRG")
    assert found.estimates["quantum_efficiency"].value == pytest.approx(0.6, rel=0.04)
    camera = camera_of(found, "mine", base="imx250c")
    assert (camera.sensor.cfa, camera.sources["cfa"]) == ("GBRG", "stated with the frames")
    assert camera.sensor.quantum_efficiency == Camera.preset("imx250c").sensor.quantum_efficiency
    assert "measured was 0.59" in camera.sources["quantum_efficiency"]
    assert camera_of(found, "mine").sensor.cfa == "none"  # whose base has no mosaic
