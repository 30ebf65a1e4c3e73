"""Frames that deceive a fit are named, what can be mended is, and honest frames pass; by a model in NumPy alone."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.to_camera import camera_of

SIZE = (120, 162)
GAIN, READ_E, DARK_E_S, DSNU_E, BLACK_DN, WELL_E = 0.4, 3.0, 400.0, 3.0, 40.0, 9000.0


def found_in(folder, seed, **how):
    return measure(made_frames.save(folder, frames(seed, **how)), bit_depth=12)


def frames(
    seed,
    *,
    warming=0.0,
    hot=0.0,
    gamma=1.0,
    stray_e_s=0.0,
    slope=0.0,
    filters=0.0,
    prnu=0.01,
    dark_e_s=DARK_E_S,
    uneven=0.0,
    lamp=0.0,
    jitter_dn=0.0,
):
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
    taken = {}
    for index in range(32):
        exposure_s, kind = 0.0125 * (1 + index // 4), ("dark", "flat")[index // 2 % 2]
        vignetted = (1 - 0.15 * (x * x + y * y)) * (1 + lamp * lights[index // 4])
        flat_e = 0.85 * WELL_E * exposure_s / 0.1 * vignetted
        light_e = flat_e if kind == "flat" else stray_e_s * exposure_s * (1 + slope * x)
        mean_e = charge_e_s * (1 + warming * index / 31) * exposure_s + light_e * response
        electrons = (
            np.minimum(random.poisson(mean_e), WELL_E) + READ_E * random.standard_normal(SIZE) + offset_e
        )
        full_e = (4095 - BLACK_DN) / GAIN
        electrons = np.sign(electrons) * full_e * (np.abs(electrons) / full_e) ** gamma
        dn = np.round(BLACK_DN + jitter_dn * random.standard_normal() + GAIN * electrons)
        taken.setdefault((kind, exposure_s), []).append(dn.clip(0, 4095).astype(np.uint16))
    return taken


def holds(found, name, truth):
    estimate = found.estimates[name]
    return estimate.low <= truth <= estimate.high


def test_a_sensor_that_warms_is_named_and_read_noise_is_right(tmp_path):
    """From 400 to 800 e-/s: a straight line said 755 (675-835), and 1.5 e- of read noise."""
    found = found_in(tmp_path / "frames", 1, warming=1.0)
    (doubt,) = found.doubts
    assert "sensor warms" in doubt.text
    assert holds(found, "dark_current_e_s", DARK_E_S)
    assert holds(found, "dark_current_e_s", 2 * DARK_E_S * 0.95)
    assert found.estimates["dark_current_e_s"].value == pytest.approx(1.5 * DARK_E_S, rel=0.1)
    assert found.estimates["read_noise_e"].value == pytest.approx(READ_E, rel=0.05)


@pytest.mark.parametrize("share", [0.001, 0.01])
def test_hot_pixels_are_named_and_left_out(tmp_path, share):
    """Their neighbours' smooth part tripled the PRNU."""
    found = found_in(tmp_path / "frames", 5, hot=share)
    (doubt,) = found.doubts
    assert "hot pixels: " in doubt.text
    number = float(doubt.text.split("(")[1].split(" %")[0])
    assert number == pytest.approx(100 * share, abs=4 * 100 * (share / (SIZE[0] * SIZE[1])) ** 0.5)
    assert found.estimates["prnu"].value == pytest.approx(0.01, rel=0.06)
    assert found.estimates["dsnu_e"].value == pytest.approx(DSNU_E, rel=0.06)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.02)
    camera = camera_of(found, "mine")
    assert doubt.text in camera.sources["dsnu_e"]
    assert "doubtful" not in camera.sources["system_gain_dn_per_e"]


def test_levels_too_dim_for_a_black_level_that_wanders_are_left_out(tmp_path):
    """0.8 DN of light with a black level that scatters by 0.1 DN: 'flickering' refused the whole."""
    taken = frames(7, jitter_dn=0.1)
    random = np.random.default_rng(7)

    def lit(light_e, jitter_dn):
        noisy_e = random.poisson(light_e, SIZE) + READ_E * random.standard_normal(SIZE)
        return np.round(BLACK_DN + jitter_dn + GAIN * noisy_e).astype(np.uint16)

    taken["flat", 1e-5] = [lit(2.0, 0.1), lit(2.0, -0.1)]
    found = measure(made_frames.save(tmp_path / "frames", taken), bit_depth=12)
    assert any(
        note.startswith("left out: 1 flat levels that are too dim") and "flat 0.01 ms" in note
        for note in found.notes
    )
    assert 0 not in found.used
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.02)


@pytest.mark.parametrize("gamma", [0.9, 0.95, 1.1])
def test_a_tone_curve_is_named_with_its_gamma(tmp_path, gamma):
    found = found_in(tmp_path / "frames", 2, gamma=gamma)
    (doubt,) = found.doubts
    assert doubt.text.startswith("not linear")
    number = float(doubt.text.split("gamma ")[1].split(")")[0])
    assert number == pytest.approx(gamma, abs=0.03)
    assert holds(found, "system_gain_dn_per_e", GAIN)


STRAY = {
    "even": {"stray_e_s": 300.0},
    "from one side": {"slope": 0.7, "prnu": 0.001, "stray_e_s": 300.0},
    "through colour filters": {"filters": 0.6, "stray_e_s": 100.0},
}


@pytest.mark.parametrize("stray", STRAY.values(), ids=STRAY)
def test_light_in_dark_frames_is_named(tmp_path, stray):
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


@pytest.mark.slow
@pytest.mark.parametrize("how", HONEST.values(), ids=HONEST)
def test_of_twenty_honest_folders_one_at_most_is_doubted(tmp_path, how):
    doubted = [seed for seed in range(20) if found_in(tmp_path / str(seed), 100 + seed, **how).doubts]
    assert len(doubted) <= 1
