"""Whole rows and columns, gains, small frames and the headline of a validation, on frames that NumPy made."""

import math
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.calibration import fit, to_camera
from blurnoise_eval.calibration.formats import RawLayout
from blurnoise_eval.cli import main
from blurnoise_eval.measure import frames as held_out
from blurnoise_eval.measure.comparison import AGREES, DIFFERS, MEASURES, Comparison, Stack
from blurnoise_eval.measure.frames import Pair, Validation

from blurnoise import Camera

CAMERA = Camera.preset("imx250m").with_figures(
    cfa="none", system_gain_dn_per_e=0.5, read_noise_e=5.0, row_noise_e=0.0,
    column_noise_e=0.0, prnu=0.006, prnu_row=0.0, prnu_column=0.0, dsnu_e=3.0, dsnu_row_e=0.0, dsnu_column_e=0.0,
    dark_current_e_s=0.0, black_level_dn=40.0, full_well_e=8000.0, black_level_drift_dn=0.0,
)  # fmt: skip
SHARES = np.linspace(0.05, 0.7, 6)


def folder(
    path, camera = CAMERA, *, seed = 0, size = (64, 96), levels = 6,
    gain_db = 0.0, kind = "npy", site = (1.0,) * 4,
):  # fmt: skip
    """Two dark levels and flat ones, two frames each, by NumPy alone. site: light of the four places of a mosaic."""
    random = np.random.default_rng(seed)

    def normal(pixel, row, column):
        height, width = size
        parts = (pixel, (height, width)), (row, (height, 1)), (column, (1, width))
        return sum((sigma * random.standard_normal(shape) for sigma, shape in parts), np.zeros(size))

    response = 1 + normal(camera.sensor.prnu, camera.sensor.prnu_row, camera.sensor.prnu_column)
    response *= np.tile(np.reshape(site, (2, 2)), (size[0] // 2, size[1] // 2))
    offset = normal(camera.sensor.dsnu_e, camera.sensor.dsnu_row_e, camera.sensor.dsnu_column_e)
    path.mkdir()
    lines = ["file,kind,exposure_s,gain_db"]
    for number, share in enumerate((0.0, 0.0, *SHARES[:levels])):
        exposure_s = 0.02 * share if share else 0.001 * (1 + number)
        for place in range(2):
            charge = random.poisson(share * camera.sensor.full_well_e * np.maximum(response, 0.0))
            noise = normal(
                camera.sensor.read_noise_e, camera.sensor.row_noise_e, camera.sensor.column_noise_e
            )
            dn = camera.sensor.system_gain_dn_per_e * (charge + offset + noise) + camera.sensor.black_level_dn
            frame = np.clip(np.round(dn), 0, 4095).astype("<u2")
            name = f"{number}_{place}.{kind}"
            np.save(path / name, frame) if kind == "npy" else frame.tofile(path / name)
            lines.append(f"{name},{'flat' if share else 'dark'},{exposure_s:.6f},{gain_db}")
    (path / "frames.csv").write_text("\n".join(lines))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    "whole",
    [
        {"prnu_column": 0.012},
        {"prnu_column": 0.004, "dsnu_column_e": 1.5},
        {"prnu_row": 0.003, "dsnu_row_e": 1.0, "row_noise_e": 1.0, "column_noise_e": 0.5},
    ],
)
def test_same_rows_and_columns_agree_but_for_chance(tmp_path, whole):
    """At most one validation of 20 is to find a difference; of 16, 4 or more once in 140."""
    camera, wrong = CAMERA.with_figures(**whole), 0
    for seed in range(16):
        frames = folder(tmp_path / f"{seed}", camera, seed=seed, size=(192, 256))
        found = held_out.validate(frames, camera, seed=1000 + seed)
        wrong += any(each.verdict == DIFFERS for each in found.comparisons)
    assert wrong <= 3


@pytest.mark.parametrize("name", ["noise", "pattern"])
def test_octaves_leave_whole_rows_and_columns_out(name):
    """Their power is that of the pixels, block by block, whatever whole rows and columns have."""
    random = np.random.default_rng(0)
    pixels = random.standard_normal((2, 128, 128))
    whole = 3 * random.standard_normal((2, 1, 128)) + 2 * random.standard_normal((2, 128, 1))
    for measure in (each for each in MEASURES if each.octave and each.name.startswith(name)):
        alone, both = (measure.sums(Stack(frames)) for frames in (pixels, pixels + whole))
        np.testing.assert_allclose(both, alone, rtol=1e-9)


def test_mean_is_as_uncertain_as_few_rows_and_columns(tmp_path):
    """Of 96 columns of 6 e- the mean varies by 6 / sqrt 96, of 64 rows of 4 e- by 4 / 8; in both, by sqrt 2 more."""
    camera = CAMERA.with_figures(dsnu_row_e=4.0, dsnu_column_e=6.0)
    found = held_out.validate(folder(tmp_path / "frames", camera), camera)
    half = 1.96 * 0.5 * math.sqrt(2 * (6**2 / 96 + 4**2 / 64)) / 40
    for each in found.of("mean", "dark"):
        assert (each.high - each.low) / 2 > half
        assert each.verdict != DIFFERS


def test_camera_counts_gains_as_its_fit_did(tmp_path):
    """From the lowest of its folder, 6 dB: with frames of 6 dB it is as it was fitted, with those of 0 dB refused."""
    frames = folder(tmp_path / "frames", gain_db=6.0)
    fitted = to_camera.camera_of(fit.measure(frames), "mine", base="imx250m")
    fitted.save(tmp_path / "mine.yaml")
    camera = Camera.load(tmp_path / "mine.yaml")
    assert to_camera.lowest_gain_db(camera) == 6.0
    used = held_out.validate(frames, camera).camera
    assert used.sensor.system_gain_dn_per_e == pytest.approx(fitted.sensor.system_gain_dn_per_e)
    assert held_out._at_gain(camera, 12.0) == camera.at_gain(6.0).camera
    assert (
        held_out._at_gain(CAMERA, 6.0) == CAMERA.at_gain(6.0).camera
    )  # a preset's 0 dB is that of the frames
    with pytest.raises(ValueError, match="gain_db = 0; must be 6 to"):
        held_out._at_gain(camera, 0.0)


@pytest.mark.parametrize(
    ("made", "options", "message"),
    [
        ({"levels": 4}, [], "4 flat levels; must be 5 or more without --camera"),
        ({}, ["--seed", "-1"], "--seed = -1: must be >= 0"),
        ({}, ["--camera", "imx250c"], "imx250c: has the colour filters RGGB"),
        ({}, ["--cfa", "XYZ"], "--cfa = 'XYZ': must be one of"),
        ({"kind": "raw"}, ["--raw-layout", "u16,96x65"], "12288 bytes"),
    ],
)
def test_what_cannot_be_compared_says_why(tmp_path, capsys, made, options, message):
    frames = folder(tmp_path / "frames", **made)
    assert main(["validate", str(frames), "-o", str(tmp_path / "out"), *options]) != 0
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_small_raw_frames_are_compared(tmp_path):
    frames = folder(tmp_path / "frames", size=(32, 48), kind="raw")
    found = held_out.validate(frames, CAMERA, layout=RawLayout.parse("u16,48x32"), cfa="none")
    assert found.pairs[0].real.shape == (2, 32, 48)
    assert "behave like" in found.answer


def test_green_pixels_of_a_mosaic_are_compared(tmp_path):
    """With those of a camera whose mosaic the frames have, too: of 32 x 48 px, 16 x 24."""
    frames = folder(tmp_path / "frames", size=(32, 48), site=(0.6, 1.0, 1.0, 0.5))
    colour = Camera.preset("imx250c")
    camera = CAMERA.with_figures(cfa=colour.sensor.cfa, quantum_efficiency=colour.sensor.quantum_efficiency)
    found = held_out.validate(frames, camera, cfa="RGGB")
    assert found.pairs[0].real.shape == (2, 16, 24)
    assert not [each for each in found.comparisons if each.verdict == DIFFERS]


def test_headline_follows_the_verdicts():
    """A dim level is not what means are within; what differs is said, also in the dark."""
    mean, variance = MEASURES[:2]

    def level(name, kind, measure, apart, chance):
        return Comparison(name, kind, measure, 1.0, 1.0, apart, apart - 0.01, apart + 0.01, chance)  # type: ignore[arg-type]

    pairs = [
        Pair(name, "flat", np.full((2, 4, 4), dn), np.full((2, 4, 4), dn))
        for name, dn in (("dim", 50.0), ("bright", 2000.0))
    ]
    rows = [
        level("dim", "flat", mean, 0.055, 1.0), level("bright", "flat", mean, 0.004, 1.0),
        level("dim", "flat", variance, 0.03, 1.0), level("bright", "flat", variance, -0.01, 1.0),
    ]  # fmt: skip
    alike = Validation(CAMERA, None, rows, {}, pairs, [])
    assert {each.verdict for each in rows} == {AGREES}
    near = "mean within 0.4 %, variance within 1 % at 1 levels (and 1 dim ones)"
    assert (
        alike.answer
        == f"Simulated frames behave like the real frames: {near}. There are no significant differences."
    )
    dark = level("d", "dark", variance, 0.3, 0.01)
    apart = replace(alike, comparisons=[*rows, dark]).answer
    assert apart.startswith("Simulated frames differ from the real frames: mean within 0.4 %")
    assert apart.endswith("Significant differences: on dark frames variance (1 of 1).")
