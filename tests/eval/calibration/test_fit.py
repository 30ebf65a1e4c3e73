"""Cameras found again in their frames, by the simulator and by a model that knows nothing of it; and the figure."""

import logging

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.figure import draw_fit
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.transfer import rounded, spatial_variance

SIZE = (241, 320)
ROUNDS_DN = 0.2
"""Noise in the dark before rounding below which frames hold two numbers and tell bounds only."""
CAMERA = made_frames.CAMERA.with_figures(read_noise_e=3.0, dark_current_e_s=300.0)
FIGURES = (
    "system_gain_dn_per_e", "read_noise_e", "dark_current_e_s", "black_level_dn", "prnu", "dsnu_e", "full_well_e",
)  # fmt: skip


def found_in(folder, camera, seed, **how):
    frames = made_frames.save(folder, made_frames.exposed(camera, seed, **how))
    return measure(frames, bit_depth=camera.sensor.bit_depth)


def off(found, camera, name):
    return abs(found.estimates[name].value / camera.figure(name) - 1)


def covers(found, camera, name, more=1.0):
    """Whether the interval, ``more`` times as wide, holds the truth."""
    estimate, off = found.estimates[name], camera.figure(name) - found.estimates[name].value
    return bool(-more * (estimate.value - estimate.low) <= off <= more * (estimate.high - estimate.value))


def test_a_camera_is_found_in_two_frames_each_of_eight_exposures(tmp_path):
    """Bounds: K 2 %, read noise 5 %; the others 2.5 half-widths of their interval, passed once in 10^6."""
    found = found_in(tmp_path / "frames", CAMERA, 5, size=SIZE, top=1.3)
    assert off(found, CAMERA, "system_gain_dn_per_e") < 0.02
    assert off(found, CAMERA, "read_noise_e") < 0.05
    assert off(found, CAMERA, "full_well_e") < 0.02
    assert [name for name in FIGURES if not covers(found, CAMERA, name, 2.5)] == []
    widths = {
        name: (estimate.high - estimate.low) / estimate.value
        for name, estimate in found.estimates.items()
        if name in FIGURES
    }
    assert widths["system_gain_dn_per_e"] < 0.015  # not so wide that they would hold anything
    assert widths["dark_current_e_s"] < 0.05
    assert widths["prnu"] < 0.1
    assert found.clip_dn == pytest.approx(
        CAMERA.sensor.clip_dn, abs=0.5
    )  # read noise may lie on top of a full well
    brightest = max(found.flat[index].mean_dn for index in found.used)  # up to 70 % of saturation
    assert brightest - CAMERA.sensor.black_level_dn < 0.71 * (
        CAMERA.sensor.clip_dn - CAMERA.sensor.black_level_dn
    )
    assert found.size_px == (320, 241)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_ten_drawn_cameras_are_found(tmp_path, seed):
    camera = made_frames.drawn_camera(seed)
    found = found_in(tmp_path / "frames", camera, seed, size=SIZE)
    assert off(found, camera, "system_gain_dn_per_e") < 0.02
    if camera.sensor.system_gain_dn_per_e * camera.sensor.read_noise_e >= ROUNDS_DN:
        assert off(found, camera, "read_noise_e") < 0.05
    else:
        assert covers(found, camera, "read_noise_e")
        assert any("rounding" in note for note in found.notes)
    available = [name for name in FIGURES if name in found.estimates]
    assert [name for name in available if not covers(found, camera, name, 2.5)] == []


@pytest.mark.parametrize(("read_e", "bound"), [(6.0, 0.02), (4.0, 0.02), (2.5, 0.04)])
def test_read_noise_below_the_rounding(tmp_path, read_e, bound):
    """0.6, 0.4 and 0.25 DN of noise: 1/12 DN^2 taken off instead would be wrong by 1, 10 and 30 %."""
    figures = {
        "system_gain_dn_per_e": 0.1,
        "full_well_e": 35000.0,
        "read_noise_e": read_e,
        "dark_current_e_s": 9.0,
    }
    camera = CAMERA.with_figures(**figures)
    found = found_in(tmp_path / "frames", camera, 3, size=SIZE)
    assert off(found, camera, "read_noise_e") < bound
    assert found.fit.rounding


SHADES = {
    "shading": np.linspace(0.4, 1, 201)[None, :],
    "mosaic": np.array([[0.5, 1.0], [1.0, 0.6]])[np.arange(160)[:, None] % 2, np.arange(201) % 2],
}


@pytest.mark.parametrize("shade", SHADES.values(), ids=SHADES)
def test_uneven_light_and_a_lamp_that_drifts_change_nothing(tmp_path, shade):
    """Shading over the frame, or the filters of a colour sensor; the second frame has 1.2 % more light."""
    planes = made_frames.exposed(CAMERA, 6, size=(160, 201))
    random = np.random.default_rng(1)
    for (kind, exposure_s), each in planes.items():
        if kind == "flat":
            light_e = made_frames.photons_s(CAMERA) * exposure_s * 0.6 * shade * np.ones((160, 1))
            dark_e = CAMERA.sensor.dark_current_e_s * exposure_s
            each[:] = [drawn(random, factor * light_e + dark_e) for factor in (1.0, 1.012)]
    found = measure(made_frames.save(tmp_path / "frames", planes), bit_depth=12)
    assert off(found, CAMERA, "system_gain_dn_per_e") < 0.015
    assert covers(found, CAMERA, "system_gain_dn_per_e", 2)
    assert found.estimates["prnu"].value < 0.002  # none, in these


def test_dark_charge_whose_mean_the_camera_subtracts_shows_in_the_variance(tmp_path):
    camera = CAMERA.with_figures(dark_current_e_s=600.0)
    planes = made_frames.exposed(camera, 6, size=SIZE)
    for (_, exposure_s), each in planes.items():
        taken_off = round(camera.sensor.system_gain_dn_per_e * 600 * exposure_s)
        each[:] = [np.maximum(plane.astype(int) - taken_off, 0).astype(np.uint16) for plane in each]
    found = measure(made_frames.save(tmp_path / "frames", planes), bit_depth=12)
    assert any("measured from the variance" in note for note in found.notes)
    assert off(found, camera, "dark_current_e_s") < 0.05
    assert off(found, camera, "read_noise_e") < 0.05
    assert off(found, camera, "system_gain_dn_per_e") < 0.02


def drawn(random, mean_e):
    noisy_e = random.poisson(mean_e) + CAMERA.sensor.read_noise_e * random.standard_normal(mean_e.shape)
    return np.round(CAMERA.sensor.black_level_dn + CAMERA.sensor.system_gain_dn_per_e * noisy_e).astype(
        np.uint16
    )


@pytest.mark.slow
def test_intervals_hold_as_often_as_they_say(tmp_path):
    """95 % of 120 seeds, less 4 standard deviations of a share: 0.95 - 4 sqrt(0.95 0.05/120) = 0.87."""
    covered = {name: 0 for name in FIGURES if name != "full_well_e"}
    for seed in range(120):
        found = found_in(tmp_path / str(seed), CAMERA, 100 + seed, size=(64, 81))
        for name in covered:
            covered[name] += covers(found, CAMERA, name)
    assert {name: count for name, count in covered.items() if count < 0.87 * 120} == {}


@pytest.mark.slow
def test_emva_1288s_own_analysis_finds_the_same(tmp_path, monkeypatch):
    """Of as many exposures as the standard asks for, by the package, which fits without weights."""
    process = pytest.importorskip("emva1288.process", reason="needs emva1288: pip install 'blurnoise[test]'")
    monkeypatch.setattr(np, "asfarray", lambda values: np.asarray(values, float), raising=False)
    found = found_in(tmp_path / "frames", CAMERA, 1, size=(120, 161), levels=52, top=1.2)
    exposure_ns = np.array([level.exposure_s for level in found.flat]) * 1e9
    temporal = {"texp": exposure_ns, "u_p": exposure_ns}
    for suffix, levels in (("", found.flat), ("dark", found.dark)):
        temporal[f"u_y{suffix}"] = np.array([level.mean_dn for level in levels])
        temporal[f"s2_y{suffix}"] = np.array([level.variance_dn2 for level in levels])
    theirs = process.Results1288({"temporal": temporal, "spatial": {}}, loglevel=logging.WARNING)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(theirs.K, rel=0.02)
    assert found.estimates["read_noise_e"].value == pytest.approx(theirs.sigma_d, rel=0.03)
    assert found.estimates["dark_current_e_s"].value == pytest.approx(theirs.u_I_mean, rel=0.03)


@pytest.mark.slow
def test_a_camera_of_the_independent_model_is_found(tmp_path):
    """emva1288's own simulator, which adds a uniform draw and rounds: 1/12 DN^2 more than rounding alone."""
    module = pytest.importorskip(
        "emva1288.camera.camera", reason="needs emva1288: pip install 'blurnoise[test]'"
    )
    gain, read_e2, dark_e_s, size = 0.8, 20.0, 200.0, (120, 160)
    random = np.random.default_rng(8)
    device = module.Camera(
        bit_depth=12, width=size[1], height=size[0], K=gain, K_min=gain, K_steps=1, temperature=22,
        temperature_ref=22,
        dark_current_ref=dark_e_s, dark_signal_0=40.0, sigma2_dark_0=read_e2, u_esat=4200.0, seed=11,
        dsnu=1.5 * random.standard_normal(size), prnu=1 + 0.01 * random.standard_normal(size),
    )  # fmt: skip
    planes = {}
    for step in range(1, 9):
        exposure_s = 0.0125 * step
        device.exposure = exposure_s * 1e9
        light = device.get_radiance_for(mean=3000.0, exposure=0.1e9)
        for kind, radiance in (("dark", 0 * light), ("flat", light)):
            planes[kind, exposure_s] = [device.grab(radiance) for _ in range(2)]
    found = measure(made_frames.save(tmp_path / "frames", planes), bit_depth=12)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(gain, rel=0.02)
    expected = (read_e2 + 1 / 12 / gain**2) ** 0.5
    assert found.estimates["read_noise_e"].value == pytest.approx(expected, rel=0.05)
    assert found.estimates["dark_current_e_s"].value == pytest.approx(dark_e_s, rel=0.05)
    assert found.estimates["dsnu_e"].value == pytest.approx(1.5, rel=0.1)
    assert found.estimates["prnu"].value == pytest.approx(0.01, rel=0.05)


def test_figure_of_frames_shows_their_levels(tmp_path):
    camera = made_frames.drawn_camera(3)
    found = measure(made_frames.save(tmp_path / "f", made_frames.exposed(camera, 3, size=(64, 81))))
    axes = draw_fit(found, "mine").axes
    assert len(axes) == 2
    dark, flat = axes[0].lines[:2]
    assert len(dark.get_ydata()) == len(found.dark)
    assert len(flat.get_ydata()) == len(found.used)
    assert "off the line" in axes[1].get_title()


# --- rounding of normal noise, against draws and against the range that the standard's users know ---


@pytest.mark.parametrize(
    ("sigma", "mean_dn", "spread"), [(0.3, 7.2, 0.0), (0.2, 7.45, 0.1), (0.5, 7.0, 0.3), (0.9, 7.4, 2.0)]
)
def test_moments_are_those_of_draws(sigma, mean_dn, spread):
    """20 000 pixels of 50 draws: a mean to sigma/1000, a variance to sqrt(2/10^6), patterns to sqrt(2/20 000)."""
    random = np.random.default_rng(1)
    pixels = mean_dn + spread * random.standard_normal(20_000)
    drawn = np.round(pixels + sigma * random.standard_normal((50, 20_000)))
    mean, variance, by_pixel = rounded(np.array([mean_dn]), np.array([sigma**2]), spread)
    assert mean[0] == pytest.approx(drawn.mean(), abs=5 * (0.001 + spread / 141))
    assert variance[0] == pytest.approx(drawn.var(0, ddof=1).mean(), abs=0.01 * (sigma**2 + 0.08))
    expected = drawn.mean(0).var() - drawn.var(0, ddof=1).mean() / 50
    assert spatial_variance(by_pixel) == pytest.approx(expected, rel=0.06, abs=1e-4)


def test_what_rounding_adds_at_a_quarter_step_depends_on_the_phase():
    added = rounded(np.linspace(0, 1, 101), np.full(101, 0.0625), 0.0)[1] - 0.0625
    assert added.min() == pytest.approx(-0.017, abs=0.001)
    assert added.max() == pytest.approx(0.188, abs=0.001)


def test_the_law_of_a_twelfth_joins_on():
    low, high = (rounded(np.array([0.25]), np.array([v]), 0.0)[1][0] - v for v in (0.4899, 0.4901))
    assert low == pytest.approx(high, abs=2e-4)
    assert high == pytest.approx(1 / 12)
