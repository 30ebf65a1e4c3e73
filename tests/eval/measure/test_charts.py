"""Every metric of simulated charts against physics in closed form, and what is withheld, written and drawn."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from blurnoise_eval.measure import charts as quality
from blurnoise_eval.measure import figures as quality_figures
from blurnoise_eval.measure.charts import BRIGHT, DARK, METRICS, TILT_DEG
from blurnoise_eval.measure.edges import Metric
from blurnoise_eval.plan.lamps import Lamps
from closed_edges import closed_mtf, closed_mtf50
from plans import plan as swept

from blurnoise import Camera, Pwm
from blurnoise.camera.radiometry import photoelectrons
from blurnoise.metrics import information
from blurnoise.metrics.sharpness import contrast_sensitivity
from blurnoise.metrics.values import Estimate

CAMERA = Camera.preset("imx250")
LUX = 50.0
PLAN = swept((0.001, 0.004, 0.016, 0.1), (LUX,), (0.0, 500.0))
EDGES = [
    "mtf50_x",
    "mtf50_y",
    "edge_snr_db",
    "sic_radial_x",
    "sic_radial_y",
    "sic_square",
    "neq_integral",
    "snri",
]


def measured(plan, camera=CAMERA, threads=1):
    return quality.measure(camera, plan.conditions(), repeats=plan.repeats, seed=plan.seed, threads=threads)


@pytest.fixture(scope="module")
def rows():
    return measured(PLAN)


def reading(rows, metric, exposure_s, speed_px_s=0.0):
    wanted = (metric, exposure_s, speed_px_s)
    (found,) = (
        row.estimate
        for row in rows
        if (row.metric, row.at["exposure_s"], row.at["velocity_x_px_s"]) == wanted
    )
    return found


def near(found, truth, widths=3.0):
    """Whether the truth lies within so many half widths of the interval, which must be there."""
    assert found.low < found.value < found.high
    return abs(found.value - truth) < widths * max(found.high - found.value, found.value - found.low)


def electrons(exposure_s, reflectance):
    return reflectance * photoelectrons(CAMERA, LUX, exposure_s)


def noise_e2(exposure_s, reflectance):
    """Temporal and spatial variance of a patch, electrons squared (EMVA 1288)."""
    signal, gain = electrons(exposure_s, reflectance), CAMERA.sensor.system_gain_dn_per_e
    dark = CAMERA.sensor.dark_variance_dn2(CAMERA.sensor.dark_current_e_s * exposure_s) / gain**2
    return signal + dark + CAMERA.sensor.dsnu_e**2 + (CAMERA.sensor.prnu * signal) ** 2


# --- the physics ------------------------------------------------------------


def test_a_row_per_condition_and_metric(rows):
    wanted = [(at.on(CAMERA), metric.name) for at in PLAN.conditions() for metric in METRICS]
    assert [(row.at, row.metric) for row in rows] == wanted


@pytest.mark.parametrize("exposure_s", [0.001, 0.004, 0.016])
@pytest.mark.parametrize(("metric", "level"), [("patch_snr_bright", BRIGHT), ("patch_snr_dark", DARK)])
def test_patch_snr_is_that_of_the_sensor_model(rows, metric, level, exposure_s):
    truth = electrons(exposure_s, level) / math.sqrt(noise_e2(exposure_s, level))
    found = reading(rows, metric, exposure_s)
    assert near(found, truth)
    assert not near(found, 1.05 * truth)
    assert found.flags == frozenset()


@pytest.mark.parametrize("exposure_s", [0.004, 0.016])
def test_contrasts_are_those_of_the_charts(rows, exposure_s):
    assert near(reading(rows, "michelson", exposure_s), (BRIGHT - DARK) / (BRIGHT + DARK))
    step = electrons(exposure_s, BRIGHT) - electrons(exposure_s, DARK)
    noise = math.sqrt((noise_e2(exposure_s, BRIGHT) + noise_e2(exposure_s, DARK)) / 2)
    assert near(reading(rows, "cnr", exposure_s), step / noise)
    assert near(reading(rows, "edge_snr_db", exposure_s), 20 * math.log10(step / noise))


@pytest.mark.parametrize("exposure_s", [0.004, 0.016])
def test_mtf50_falls_with_motion_as_the_closed_form_does(rows, exposure_s):
    """2 and 8 px along x: across x the motion's box, across y only its sine; 1 % for aliases."""
    motion = {"sigma_px": 0.0, "motion_px": (500 * exposure_s, 0.0)}
    across = {}
    for metric, angle_deg in (("mtf50_x", TILT_DEG), ("mtf50_y", 90 + TILT_DEG)):
        across[metric] = reading(rows, metric, exposure_s, 500.0)
        truth = closed_mtf50(angle_deg=angle_deg, **motion)
        assert near(across[metric], truth)
        assert across[metric].value == pytest.approx(truth, rel=0.03)
    still = closed_mtf50(angle_deg=TILT_DEG, sigma_px=0.0)
    assert near(reading(rows, "mtf50_x", exposure_s), still)
    assert across["mtf50_x"].value < 0.5 * still < across["mtf50_y"].value


@pytest.mark.parametrize("exposure_s", [0.001, 0.016])
def test_information_is_the_closed_forms(rows, exposure_s):
    """Without motion, from the electrons alone: to 3 standard errors (half an interval is 2)."""
    step = electrons(exposure_s, BRIGHT) - electrons(exposure_s, DARK)
    noise = (noise_e2(exposure_s, BRIGHT) + noise_e2(exposure_s, DARK)) / 2
    frequency = torch.linspace(0, 0.5, 257, dtype=torch.float64)
    power = torch.from_numpy(closed_mtf(frequency.numpy(), angle_deg=TILT_DEG, sigma_px=0.0)) ** 2
    white = {"signal_pp": step, "noise_variance": noise}
    plane = power[:, None] * power
    quanta = electrons(exposure_s, BRIGHT) ** 2 / noise_e2(exposure_s, BRIGHT)
    truths = {
        "sic_radial_x": information.shannon_capacity_radial(frequency, power=power, **white),
        "sic_square": information.shannon_capacity_square(frequency, frequency, power=plane, **white),
        "neq_integral": information.square_integral(frequency, frequency, plane) * quanta,
        "neq_0": torch.tensor(quanta),
    }
    for metric, truth in truths.items():
        found = reading(rows, metric, exposure_s)
        assert near(found, float(truth), 1.5), metric
        assert found.value == pytest.approx(float(truth), rel=0.07), metric
    ideal = 10 * step / math.sqrt(noise)  # a 10 px square without blur; the pixel's own takes a little
    assert 0.9 * ideal < reading(rows, "snri", exposure_s).value < ideal


def test_acutance_and_the_star_fall_with_motion_as_the_closed_forms_do(rows):
    """8 px along x: the edge's response weighed by the eye; the star's by the mean power of its segments."""
    frequency = torch.linspace(0, 1, 1001, dtype=torch.float64)
    weights = contrast_sensitivity(60 * frequency)
    for speed_px_s, moved_px in ((0.0, 0.0), (500.0, 8.0)):
        response = np.abs(
            closed_mtf(frequency.numpy(), angle_deg=TILT_DEG, sigma_px=0.0, motion_px=(moved_px, 0.0))
        )
        truth = float(torch.from_numpy(response) @ weights / weights.sum())
        found = reading(rows, "acutance_x", 0.016, speed_px_s)
        assert found.value == pytest.approx(truth, rel=0.005)
        turn = (torch.arange(800, dtype=torch.float64) + 0.5) / 800 * 2 * math.pi - math.pi / 8
        x, y = (frequency[1:, None] * wave(turn) for wave in (torch.sin, torch.cos))
        seen = torch.sinc(x) * torch.sinc(y) * torch.sinc(moved_px * x)
        power = seen.view(len(seen), 8, 100).mean(2).square().mean(1)
        half = float(frequency[1:][power < 0.25][0])
        assert near(star := reading(rows, "mtf50_star", 0.016, speed_px_s), half)
        assert star.value == pytest.approx(half, rel=0.02)


def test_veiling_glare_is_the_share_that_the_lens_spreads():
    """A veil v of a field with a trap of area a: v (1 - a) over 1 - v a."""
    veil, area = 0.03, math.pi * (quality.TRAP_PX / quality.PATCH_PX) ** 2
    plan = swept((0.004, 0.1), (LUX,), (0.0,))
    for share, truth in ((0.0, 0.0), (veil, veil * (1 - area) / (1 - veil * area))):
        rows = measured(plan, CAMERA.with_figures(veil_share=share))
        found = reading(rows, "veiling_glare", 0.004)
        assert near(found, truth, 2.0)
        assert found.high - found.low < 0.001
        assert "clipped" in reading(rows, "veiling_glare", 0.1).flags


def test_flicker_of_a_pulsed_lamp_is_that_of_its_light():
    """90 Hz, on for a quarter: frames of 2 ms miss it, those of 12 ms see 0.25 to 0.33 periods of light."""
    plan = replace(swept((0.002, 0.012), (LUX,), (0.0,)), lamps=Lamps(pwm="90,0.25"))
    quality.check(CAMERA, plan)
    rows = quality.measure(CAMERA, plan.conditions(), lamp=Pwm(90.0, 0.25))
    assert reading(rows, "fmi", 0.002).value == pytest.approx(1.0, abs=0.01)
    low, high = Pwm(90.0, 0.25).extremes(0.012)
    assert reading(rows, "fmi", 0.012).value == pytest.approx((high - low) / (high + low), abs=0.005)
    middle = 1 / quality.LAMP_FRAMES
    starts = torch.arange(0, 1, 1e-4, dtype=torch.float64) / 90
    factors = Pwm(90.0, 0.25).factor(0.012, starts)
    share = float(((factors - factors.mean()).abs() < 0.1 * factors.mean()).double().mean())
    assert reading(rows, "mmp", 0.012).value == pytest.approx(share, abs=2 * middle)
    assert not {"fmi", "mmp"} & {row.metric for row in measured(swept((0.002,), (LUX,), (0.0,)))}
    with pytest.raises(ValueError, match="emitters, pwm_mask"):
        quality.check(CAMERA, replace(plan, lamps=Lamps(emitters="targets:3")))


# --- what is withheld -------------------------------------------------------


def test_saturation_withholds_what_it_falsifies(rows):
    """At 0.1 s white would hold 28 000 e-, the pixel 10 700; the grey at 18 % is still whole."""
    for speed in (0.0, 500.0):
        for metric in (*EDGES, "patch_snr_bright", "neq_0", "cnr", "michelson", "cta"):
            found = reading(rows, metric, 0.1, speed)
            assert "clipped" in found.flags, metric
            assert math.isnan(found.value)
            assert math.isnan(found.low)
        for metric in ("psnr_db", "ssim"):
            found = reading(rows, metric, 0.1, speed)
            assert (found.available, found.flags) == (True, {"clipped"})
        assert reading(rows, "patch_snr_dark", 0.1, speed).flags == frozenset()
    assert reading(rows, "psnr_db", 0.1).value < reading(rows, "psnr_db", 0.016).value - 10


def test_digital_gain_clips_where_light_leaves_the_range():
    """Beyond 24 dB it is digital: 280 e- of white are 1700 DN at 24 dB, 3400 at 30, 6800 at 36."""
    for row in measured(swept((0.001,), (LUX,), (0.0,), gain_db=(30.0, 36.0))):
        if row.metric == "patch_snr_bright":
            assert ("clipped" in row.estimate.flags) == (row.at["gain_db"] > 30)


def test_repeats_are_averaged_and_any_of_them_can_withhold():
    repeats = [Estimate(1.0, 0.8, 1.4, frozenset({"a"})), Estimate(3.0, 2.6, 3.2, frozenset({"b"}))]
    both = quality.mean_of(repeats)
    assert (both.value, both.flags) == (2.0, {"a", "b"})
    assert both.low == pytest.approx(2 - 0.3 / math.sqrt(2))
    assert both.high == pytest.approx(2 + 0.3 / math.sqrt(2))
    assert quality.mean_of(repeats[:1]) == repeats[0]
    lost = quality.mean_of([*repeats, Estimate(math.nan, flags=frozenset({"clipped"}))])
    assert (lost.available, lost.flags) == (False, {"a", "b", "clipped"})


# --- the same rows ----------------------------------------------------------


def test_rows_hang_on_the_seed_and_their_own_condition_alone(rows):
    def records(*plan, threads=1, seed=0):
        return [row.record() for row in measured(swept(*plan, seed=seed), threads=threads)]

    some = ((0.004, 0.016), (LUX,), (500.0,))
    alike = [row for row in rows if row.at["exposure_s"] in some[0] and row.at["velocity_x_px_s"] == 500.0]
    wanted, before = [row.record() for row in alike], torch.get_num_threads()
    assert records(*some, threads=2) == wanted
    assert torch.get_num_threads() == before  # given back
    pairs = list(zip(wanted, records(*some, seed=7), strict=True))
    # can be 1
    assert all(mine["value"] != theirs["value"] for mine, theirs in pairs if mine["metric"] != "cta")


# --- files, figures, the command --------------------------------------------


def test_a_new_metric_is_one_entry(monkeypatch, tmp_path):
    """Weber contrast as one more: measured, written and drawn."""
    weber: Metric = Metric(
        "weber", "Weber contrast", "1", "bright / dark - 1",
        lambda taken: [Estimate(float(b.mean() / d.mean()) - 1) for b, d in zip(*taken.patches, strict=True)],
    )  # fmt: skip
    monkeypatch.setattr(quality, "METRICS", (*METRICS, weber))
    plan = swept((0.004, 0.008), (LUX,), (0.0,))
    rows = measured(plan)
    assert reading(rows, "weber", 0.004).value == pytest.approx(BRIGHT / DARK - 1, rel=0.05)
    assert len(rows) == 2 * (len(METRICS) + 1)
    quality.write(rows, CAMERA, plan, tmp_path)
    assert (
        json.loads((tmp_path / "quality.json").read_text())["metrics"]["weber"]["title"] == "Weber contrast"
    )
    assert quality_figures.against_exposure(rows, "").axes[len(METRICS)].get_title() == "Weber contrast"
