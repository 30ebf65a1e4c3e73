"""Frames that deceive a fit are named, what can be mended is, and honest frames pass; by a model in NumPy alone."""

from __future__ import annotations

from pathlib import Path

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import Measurement, measure
from blurnoise_eval.calibration.to_camera import camera_of

SIZE = (120, 162)
GAIN, READ_E, DARK_E_S, DSNU_E, BLACK_DN, WELL_E = 0.4, 3.0, 400.0, 3.0, 40.0, 9000.0
REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "emva_ccd"


def found_in(folder: Path, seed: int, **how: float) -> Measurement:
    return measure(made_frames.save(folder, frames(seed, **how)), bit_depth=12)


def frames(
    seed: int, *, warming: float = 0.0, hot: float = 0.0, gamma: float = 1.0, stray_e_s: float = 0.0,
    slope: float = 0.0, filters: float = 0.0, prnu: float = 0.01, dark_e_s: float = DARK_E_S, uneven: float = 0.0,
    lamp: float = 0.0, jitter_dn: float = 0.0,
) -> dict[tuple[str, float], list[np.ndarray]]:  # fmt: skip
    """Eight exposures, two dark and two flat frames of each, taken one after the other.

    warming: growth of the dark current over all. hot: share of pixels with about 40 000 e-/s. stray_e_s: light in
    the dark frames, ``slope`` of it more at the right. filters: a mosaic's, by which its places differ. uneven: the
    dark current of the pixels; lamp, jitter_dn: light of levels, black level of frames; all RMS.
    """
    random = np.random.default_rng(seed)
    x, y = np.linspace(-1, 1, SIZE[1])[None], np.linspace(-1, 1, SIZE[0])[:, None]
    places = np.arange(SIZE[0])[:, None] % 2 + np.arange(SIZE[1]) % 2
    response = (1 + prnu * random.standard_normal(SIZE)) * (1 - filters * places / 2)
    offset_e = DSNU_E * random.standard_normal(SIZE)
    charge_e_s = dark_e_s * (1 + uneven * random.standard_normal(SIZE)).clip(0)
    charge_e_s += np.where(random.random(SIZE) < hot, 40e3 * random.gamma(2, 0.5, SIZE), 0)
    lights = random.standard_normal(8)
    taken: dict[tuple[str, float], list[np.ndarray]] = {}
    for place in range(32):
        exposure_s, kind = 0.0125 * (1 + place // 4), ("dark", "flat")[place // 2 % 2]
        vignetted = (1 - 0.15 * (x * x + y * y)) * (1 + lamp * lights[place // 4])
        flat_e = 0.85 * WELL_E * exposure_s / 0.1 * vignetted
        light_e = flat_e if kind == "flat" else stray_e_s * exposure_s * (1 + slope * x)
        mean_e = charge_e_s * (1 + warming * place / 31) * exposure_s + light_e * response
        electrons = (
            np.minimum(random.poisson(mean_e), WELL_E) + READ_E * random.standard_normal(SIZE) + offset_e
        )
        full_e = (4095 - BLACK_DN) / GAIN
        electrons = np.sign(electrons) * full_e * (np.abs(electrons) / full_e) ** gamma
        dn = np.round(BLACK_DN + jitter_dn * random.standard_normal() + GAIN * electrons)
        taken.setdefault((kind, exposure_s), []).append(dn.clip(0, 4095).astype(np.uint16))
    return taken


def holds(found: Measurement, name: str, truth: float) -> bool:
    told = found.estimates[name]
    return told.low <= truth <= told.high


def test_a_sensor_that_warms_is_named_and_read_noise_is_right(tmp_path: Path) -> None:
    """From 400 to 800 e-/s: a straight line said 755 (675-835), and 1.5 e- of read noise."""
    found = found_in(tmp_path / "frames", 1, warming=1.0)
    (doubt,) = found.doubts
    assert "sensor warms" in doubt.text
    assert holds(found, "dark_current_e_s", DARK_E_S)
    assert holds(found, "dark_current_e_s", 2 * DARK_E_S * 0.95)
    assert found.estimates["dark_current_e_s"].value == pytest.approx(1.5 * DARK_E_S, rel=0.1)
    assert found.estimates["read_noise_e"].value == pytest.approx(READ_E, rel=0.05)


def test_hot_pixels_are_named_and_left_out_of_dsnu(tmp_path: Path) -> None:
    found = found_in(tmp_path / "frames", 1, hot=0.001)
    (doubt,) = found.doubts
    assert "hot pixels: " in doubt.text
    assert found.estimates["dsnu_e"].value == pytest.approx(DSNU_E, rel=0.05)
    assert found.estimates["prnu"].value == pytest.approx(0.01, rel=0.06)
    camera = camera_of(found, "mine")
    assert doubt.text in camera.sources["dsnu_e"]
    assert "doubtful" not in camera.sources["system_gain_dn_per_e"]


def test_one_per_cent_of_hot_pixels_changes_nothing(tmp_path: Path) -> None:
    """Their neighbours' smooth part tripled the PRNU."""
    found = found_in(tmp_path / "frames", 5, hot=0.01)
    (doubt,) = found.doubts
    share = float(doubt.text.split("(")[1].split(" %")[0])
    assert share == pytest.approx(1, abs=4 * 100 * (0.01 / (SIZE[0] * SIZE[1])) ** 0.5)
    assert found.estimates["prnu"].value == pytest.approx(0.01, rel=0.06)
    assert found.estimates["dsnu_e"].value == pytest.approx(DSNU_E, rel=0.06)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.02)


def test_a_sensor_that_warms_over_one_exposure_is_named(tmp_path: Path) -> None:
    """Frames of one dark level, each with 1 % of an exposure's dark charge more than that before."""
    random = np.random.default_rng(6)
    taken = {key: each for key, each in frames(6).items() if key[0] == "flat"}
    for growth, doubts in ((0.0, 0), (0.4, 1)):
        dark = [
            BLACK_DN + GAIN * (40 + growth * n + READ_E * random.standard_normal(SIZE)) for n in range(10)
        ]
        taken["dark", 0.1] = [np.round(each).astype(np.uint16) for each in dark]
        found = measure(made_frames.save(tmp_path / str(growth), taken), bit_depth=12)
        assert len(found.doubts) == doubts
    assert found.doubts[0].text.startswith(
        "the sensor warms: frames of dark 100 ms get brighter one after the other"
    )
    assert (
        found.estimates["black_level_dn"].low < BLACK_DN + GAIN * 40 < found.estimates["black_level_dn"].high
    )


def test_levels_too_dim_for_a_black_level_that_wanders_are_left_out(tmp_path: Path) -> None:
    """0.8 DN of light beside 0.1 DN of wandering: 'flickering' refused the whole. A lamp that flickers still is."""
    taken = frames(7, jitter_dn=0.1)
    random = np.random.default_rng(7)

    def lit(light_e: float, jitter_dn: float) -> np.ndarray:
        noisy_e = random.poisson(light_e, SIZE) + READ_E * random.standard_normal(SIZE)
        return np.round(BLACK_DN + jitter_dn + GAIN * noisy_e).astype(np.uint16)

    taken["flat", 1e-5] = [lit(2.0, 0.1), lit(2.0, -0.1)]
    found = measure(made_frames.save(tmp_path / "frames", taken), bit_depth=12)
    assert any(
        note.startswith("left out: 1 flat levels too dim") and "flat 0.01 ms" in note for note in found.notes
    )
    assert 0 not in found.used
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.02)
    taken["flat", 1e-5] = [lit(20.0, 0.0), lit(25.0, 0.0)]
    with pytest.raises(ValueError, match=r"^flat 0\.01 ms: flickering"):
        measure(made_frames.save(tmp_path / "frames", taken), bit_depth=12)


def test_a_lamp_that_drifts_within_levels_is_named(tmp_path: Path) -> None:
    taken = frames(8)
    for (kind, _), each in taken.items():
        if kind == "flat":
            each[1] = np.round(BLACK_DN + (each[1] - BLACK_DN) * 1.012).astype(np.uint16)
    found = measure(made_frames.save(tmp_path / "frames", taken), bit_depth=12)
    assert any("the lamp's light differs by up to 1.2% within a level" in note for note in found.notes)
    assert not any("lamp" in note for note in found_in(tmp_path / "steady", 8).notes)


@pytest.mark.parametrize("gamma", [0.9, 0.95, 1.1])
def test_a_tone_curve_is_named_with_its_gamma(tmp_path: Path, gamma: float) -> None:
    found = found_in(tmp_path / "frames", 2, gamma=gamma)
    (doubt,) = found.doubts
    assert doubt.text.startswith("not linear")
    told = float(doubt.text.split("gamma ")[1].split(")")[0])
    assert told == pytest.approx(gamma, abs=0.03)
    assert holds(found, "system_gain_dn_per_e", GAIN)


STRAY = {
    "even": {"stray_e_s": 300.0},
    "from one side": {"slope": 0.7, "prnu": 0.001, "stray_e_s": 300.0},
    "through colour filters": {"filters": 0.6, "stray_e_s": 100.0},
}


@pytest.mark.parametrize("stray", STRAY.values(), ids=STRAY)
def test_light_in_dark_frames_is_named(tmp_path: Path, stray: dict[str, float]) -> None:
    """Even light by the pixels' sensitivity, other light by where it falls."""
    found = found_in(tmp_path / "frames", 3, dark_e_s=20.0, **stray)
    (doubt,) = found.doubts
    assert doubt.text.startswith("light in dark frames")
    assert "doubtful: light" in camera_of(found, "mine").sources["dark_current_e_s"]


HONEST = {
    "plain": {},
    "a lamp that varies by 1 %": {"lamp": 0.01},
    "a black level that varies": {"jitter_dn": 0.1},
    "pixels of unlike dark current": {"uneven": 0.3},
    "hardly any dark current": {"dark_e_s": 2.0},
    "colour filters": {"filters": 0.6},
}


@pytest.mark.parametrize("how", HONEST.values(), ids=HONEST)
def test_honest_frames_pass(tmp_path: Path, how: dict[str, float]) -> None:
    assert not found_in(tmp_path / "frames", 4, **how).doubts


@pytest.mark.slow
@pytest.mark.parametrize("how", HONEST.values(), ids=HONEST)
def test_of_twenty_honest_folders_one_at_most_is_doubted(tmp_path: Path, how: dict[str, float]) -> None:
    doubted = [seed for seed in range(20) if found_in(tmp_path / str(seed), 100 + seed, **how).doubts]
    assert len(doubted) <= 1


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared frames are absent")
def test_real_frames_of_a_ccd_pass() -> None:
    assert not measure(REAL, bit_depth=12).doubts
