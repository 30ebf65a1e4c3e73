"""Every metric of simulated charts against physics in closed form, and what is withheld, written and drawn."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import torch
from blurnoise_eval.cameras import behind_one_filter
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.quality import figures as quality_figures
from blurnoise_eval.quality import measure as quality
from blurnoise_eval.quality.measure import BRIGHT, DARK, METRICS, TILT_DEG, Row
from blurnoise_eval.quality.picture import Metric
from closed_edges import closed_mtf, closed_mtf50
from commands import main
from matplotlib.colors import to_hex
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.metrics import information
from blurnoise.metrics.values import Estimate
from blurnoise.optics.camera import staggered
from blurnoise.optics.radiometry import photoelectrons

Output = pytest.CaptureFixture[str]
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


def measured(plan: SweepPlan, camera: Camera = CAMERA, threads: int = 1) -> list[Row]:
    return quality.measure(camera, plan.conditions(), repeats=plan.repeats, seed=plan.seed, threads=threads)


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return measured(PLAN)


def reading(rows: list[Row], metric: str, exposure_s: float, speed_px_s: float = 0.0) -> Estimate:
    wanted = (metric, exposure_s, speed_px_s)
    (found,) = (
        row.estimate
        for row in rows
        if (row.metric, row.at["exposure_s"], row.at["velocity_x_px_s"]) == wanted
    )
    return found


def near(found: Estimate, truth: float, widths: float = 3.0) -> bool:
    """Whether the truth lies within so many half widths of the interval, which must be there."""
    assert found.low < found.value < found.high
    return abs(found.value - truth) < widths * max(found.high - found.value, found.value - found.low)


def electrons(exposure_s: float, reflectance: float) -> float:
    return reflectance * photoelectrons(CAMERA, LUX, exposure_s)


def noise_e2(exposure_s: float, reflectance: float) -> float:
    """Temporal and spatial variance of a patch, electrons squared (EMVA 1288)."""
    signal, gain = electrons(exposure_s, reflectance), CAMERA.system_gain_dn_per_e
    dark = CAMERA.dark_variance_dn2(CAMERA.dark_current_e_s * exposure_s) / gain**2
    return signal + dark + CAMERA.dsnu_e**2 + (CAMERA.prnu * signal) ** 2


# --- the physics ------------------------------------------------------------


def test_a_row_per_condition_and_metric(rows: list[Row]) -> None:
    wanted = [(at.on(CAMERA), metric.name) for at in PLAN.conditions() for metric in METRICS]
    assert [(row.at, row.metric) for row in rows] == wanted


@pytest.mark.parametrize("exposure_s", [0.001, 0.004, 0.016])
@pytest.mark.parametrize(("metric", "level"), [("patch_snr_bright", BRIGHT), ("patch_snr_dark", DARK)])
def test_patch_snr_is_that_of_the_sensor_model(
    rows: list[Row], metric: str, level: float, exposure_s: float
) -> None:
    truth = electrons(exposure_s, level) / math.sqrt(noise_e2(exposure_s, level))
    found = reading(rows, metric, exposure_s)
    assert near(found, truth)
    assert not near(found, 1.05 * truth)
    assert found.flags == frozenset()


@pytest.mark.parametrize("exposure_s", [0.004, 0.016])
def test_contrasts_are_those_of_the_charts(rows: list[Row], exposure_s: float) -> None:
    assert near(reading(rows, "michelson", exposure_s), (BRIGHT - DARK) / (BRIGHT + DARK))
    step = electrons(exposure_s, BRIGHT) - electrons(exposure_s, DARK)
    noise = math.sqrt((noise_e2(exposure_s, BRIGHT) + noise_e2(exposure_s, DARK)) / 2)
    assert near(reading(rows, "cnr", exposure_s), step / noise)
    assert near(reading(rows, "edge_snr_db", exposure_s), 20 * math.log10(step / noise))


@pytest.mark.parametrize("exposure_s", [0.004, 0.016])
def test_mtf50_falls_with_motion_as_the_closed_form_does(rows: list[Row], exposure_s: float) -> None:
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
def test_information_is_the_closed_forms(rows: list[Row], exposure_s: float) -> None:
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


def test_information_is_highest_at_an_exposure_between(rows: list[Row]) -> None:
    """Moving, more light first tells more, then blur takes it back; at rest only saturation ends it."""
    for metric in ("sic_square", "psnr_db"):
        moving = [reading(rows, metric, exposure_s, 500.0).value for exposure_s in (0.001, 0.004, 0.016)]
        assert moving[1] == max(moving), metric
    resting = [reading(rows, "sic_square", exposure_s).value for exposure_s in (0.001, 0.004, 0.016)]
    assert resting == sorted(resting)


def test_psnr_at_rest_is_that_of_the_noise(rows: list[Row]) -> None:
    """40 000 pixels of three colours know their variance to 0.4 %, 0.02 dB; dark red, cut at 0, takes little."""
    scene = charts.stop_sign(100, height_px=200, width_px=200, background=DARK).double().flatten()[::7]
    for exposure_s in (0.004, 0.016):
        variance = sum(noise_e2(exposure_s, float(level)) for level in scene) / len(scene)
        truth = 10 * math.log10(electrons(exposure_s, 1.0) ** 2 / variance)
        assert reading(rows, "psnr_db", exposure_s).value == pytest.approx(truth, abs=0.1)


# --- what is withheld -------------------------------------------------------


def test_saturation_withholds_what_it_falsifies(rows: list[Row]) -> None:
    """At 0.1 s white would hold 28 000 e-, the pixel 10 700; the grey at 18 % is still whole."""
    for speed in (0.0, 500.0):
        for metric in (*EDGES, "patch_snr_bright", "neq_0", "cnr", "michelson", "cdp"):
            found = reading(rows, metric, 0.1, speed)
            assert "clipped" in found.flags, metric
            assert math.isnan(found.value)
            assert math.isnan(found.low)
        for metric in ("psnr_db", "ssim"):
            found = reading(rows, metric, 0.1, speed)
            assert (found.told, found.flags) == (True, {"clipped"})
        assert reading(rows, "patch_snr_dark", 0.1, speed).flags == frozenset()
    assert reading(rows, "psnr_db", 0.1).value < reading(rows, "psnr_db", 0.016).value - 10


def test_without_light_nothing_is_available_but_why() -> None:
    for row in measured(swept((0.01,), (0.0,))):
        if row.metric not in ("cnr", "michelson", "cdp", "patch_snr_bright", "patch_snr_dark", "neq_0"):
            assert not row.estimate.told, row.metric
            assert row.estimate.flags, row.metric


def test_without_noise_what_rests_on_it_is_withheld_with_a_flag() -> None:
    """Shot noise of 0.02 DN rounds to none."""
    silent: Any = {"read_noise_e": 0.0, "prnu": 0.0, "dsnu_e": 0.0, "dark_current_e_s": 0.0}
    camera = replace(
        CAMERA, full_well_e=1e8, system_gain_dn_per_e=2.4e-6, black_level_dn=0.0, bit_depth=8, **silent
    )
    rows = measured(swept((0.1,), (5e4,), (0.0,)), camera)
    for row in rows:
        assert row.estimate.told or "noiseless" in row.record()["flags"], row.metric
    assert not reading(rows, "edge_snr_db", 0.1).told


def test_motion_beyond_the_chart_is_withheld() -> None:
    rows = measured(swept((0.03,), (LUX,), (0.0,), (5000.0,)))
    for metric in ("mtf50_x", "sic_radial_x", "sic_square", "snri"):
        found = reading(rows, metric, 0.03)
        assert not found.told
        assert "region_too_small" in found.flags
    truth = 0.603355 / 150 / math.cos(math.radians(TILT_DEG))
    assert reading(rows, "mtf50_y", 0.03).value == pytest.approx(truth, rel=0.01)


def test_repeats_are_averaged_and_any_of_them_can_withhold() -> None:
    told = [Estimate(1.0, 0.8, 1.4, frozenset({"a"})), Estimate(3.0, 2.6, 3.2, frozenset({"b"}))]
    both = quality.mean_of(told)
    assert (both.value, both.flags) == (2.0, {"a", "b"})
    assert both.low == pytest.approx(2 - 0.3 / math.sqrt(2))
    assert both.high == pytest.approx(2 + 0.3 / math.sqrt(2))
    assert quality.mean_of(told[:1]) == told[0]
    lost = quality.mean_of([*told, Estimate(math.nan, flags=frozenset({"clipped"}))])
    assert (lost.told, lost.flags) == (False, {"a", "b", "clipped"})


# --- the same rows ----------------------------------------------------------


def test_rows_hang_on_the_seed_and_their_own_condition_alone(rows: list[Row]) -> None:
    def records(*plan: Any, threads: int = 1) -> list[dict[str, object]]:
        return [row.record() for row in measured(swept(*plan), threads=threads)]

    some = ((0.004, 0.016), (LUX,), (500.0,))
    alike = [row for row in rows if row.at["exposure_s"] in some[0] and row.at["velocity_x_px_s"] == 500.0]
    wanted, before = [row.record() for row in alike], torch.get_num_threads()
    assert records(*some, threads=2) == wanted
    assert torch.get_num_threads() == before  # given back
    pairs = list(zip(wanted, records(*some, (0.0,), 1, 7), strict=True))
    assert all(
        mine["value"] != theirs["value"] for mine, theirs in pairs if mine["metric"] != "cdp"
    )  # can be 1


@pytest.mark.slow
def test_further_axes_reach_the_charts_and_the_table(rows: list[Row]) -> None:
    """Of f-numbers, defocus, heat and gain each changes what physics says, against the still chart at 16 ms."""
    still = [row for row in rows if (row.at["exposure_s"], row.at["velocity_x_px_s"]) == (0.016, 0)]
    plain = {row.metric: row.estimate for row in still}

    def told(camera: Camera = CAMERA, **axis: float) -> dict[str, Estimate]:
        ((name, value),) = axis.items()
        found = measured(swept((0.016,), (LUX,), **{name: (value,)}), camera)
        assert {row.record()[name] for row in found} == {value}
        return {row.metric: row.estimate for row in found}

    # A quarter of the light: mean square over variance, by shot noise.
    stopped = told(f_number=2 * CAMERA.f_number)
    assert stopped["neq_0"].value == pytest.approx(plain["neq_0"].value / 4, rel=0.05)
    assert stopped["mtf50_x"].value < 0.99 * plain["mtf50_x"].value  # diffraction
    soft = told(defocus_radius_px=3.0)
    assert soft["mtf50_x"].value < 0.5 * plain["mtf50_x"].value
    assert soft["neq_0"].value == pytest.approx(plain["neq_0"].value, rel=0.05)
    hot = told(replace(CAMERA, dark_current_e_s=50.0), temperature_c=100.0)  # 2^10 x 50 e-/s: 800 e- in 16 ms
    assert hot["cnr"].value < 0.9 * plain["cnr"].value
    darker = told(gain_db=-6.0)  # signal and noise alike
    assert darker["patch_snr_bright"].value == pytest.approx(plain["patch_snr_bright"].value, rel=1e-5)
    assert darker["psnr_db"].value == pytest.approx(plain["psnr_db"].value, abs=0.2)
    brighter = told(gain_db=30.0)
    assert "clipped" in brighter["patch_snr_bright"].flags
    assert not brighter["patch_snr_bright"].told


@pytest.mark.slow
def test_colour_cameras_are_measured_behind_one_filter() -> None:
    """As if green were before every pixel: the raw pixels of a mosaic would be edges of their own."""
    camera, short = Camera.preset("imx250c"), swept((0.01,), (50.0,), (0.0,))
    found, expected = (measured(short, each) for each in (camera, behind_one_filter(camera)))
    assert repr(found) == repr(expected)  # NaN, where one chart has no interval, equals no NaN


# --- files, figures, the command --------------------------------------------


def test_the_table_and_the_document_say_the_same(rows: list[Row], tmp_path: Path) -> None:
    quality.write(rows, CAMERA, PLAN, tmp_path)
    document = json.loads((tmp_path / "quality.json").read_text(), parse_constant=pytest.fail)
    assert document["rows"] == [row.record() for row in rows]
    assert set(document["metrics"]) == {metric.name for metric in METRICS}
    assert Camera.from_dict(document["camera"]) == CAMERA
    table = pd.read_csv(tmp_path / "quality.csv")
    assert len(table) == len(rows)
    lost = table[table["value"].isna()]
    assert set(lost["exposure_s"]) == {0.1}
    assert lost["flags"].str.contains("clipped").all()
    assert (lost["told"] == 0).all()


def test_lines_have_gaps_where_numbers_are_not_available(rows: list[Row]) -> None:
    """Saturation is shaded, halfway between exposures: from the root of 16 x 100 ms to the axis' end."""
    figure = quality_figures.against_exposure(rows, CAMERA.name)
    assert [axes.get_title().split(" / ")[0] for axes in figure.axes] == [metric.title for metric in METRICS]
    for axes, metric in zip(figure.axes, METRICS, strict=True):
        told = sum(row.estimate.told for row in rows if row.metric == metric.name)
        drawn = [line for line in axes.lines if line.get_linestyle() == "-"]
        assert sum(math.isfinite(y) for line in drawn for y in line.get_ydata()) == told, metric.name
        shaded = [each for each in axes.patches if to_hex(each.get_facecolor()) == quality_figures.SATURATED]
        assert len(shaded) == (metric.name != "patch_snr_dark")
        for span in shaded:
            assert span.get_x() == pytest.approx(40, rel=1e-3)
            assert span.get_x() + span.get_width() == pytest.approx(axes.get_xlim()[1])
        crosses = sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == "x")
        assert crosses == 8 - told
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"500 px/s", "a line saturates"} <= set(texts)


def test_a_picture_per_setting(tmp_path: Path) -> None:
    plan = swept((0.001, 0.01), (5.0, LUX), (0.0, 100.0), f_number=(2.0, 4.0), gain_db=(6.0,))
    found = Estimate(1.0, 0.5, 2.0)
    rows = [Row(at.on(CAMERA), metric.name, found, 1, 1) for at in plan.conditions() for metric in METRICS]
    names = [path.name for path in quality_figures.write(rows, "a camera", tmp_path)]
    assert names == [f"exposure-{lux}lux-f{n}.png" for lux in (5, 50) for n in (2, 4)]


def test_a_new_metric_is_one_entry(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Weber contrast as the seventeenth: measured, written and drawn."""
    weber: Metric = Metric(
        "weber", "Weber contrast", "1", "bright / dark - 1",
        lambda taken: [Estimate(float(b.mean() / d.mean()) - 1) for b, d in zip(*taken.patches, strict=True)],
    )  # fmt: skip
    for module in (quality, quality_figures):
        monkeypatch.setattr(module, "METRICS", (*METRICS, weber))
    plan = swept((0.004, 0.008), (LUX,), (0.0,))
    rows = measured(plan)
    assert reading(rows, "weber", 0.004).value == pytest.approx(BRIGHT / DARK - 1, rel=0.05)
    assert len(rows) == 2 * 17
    quality.write(rows, CAMERA, plan, tmp_path)
    assert (
        json.loads((tmp_path / "quality.json").read_text())["metrics"]["weber"]["title"] == "Weber contrast"
    )
    assert quality_figures.against_exposure(rows, "").axes[16].get_title() == "Weber contrast"


@pytest.mark.slow
def test_command_writes_everything(tmp_path: Path, capsys: Output) -> None:
    few = ["--exposure-ms", "4,16", "--lux", "50", "--dx", "0,500", "--repeats", "1", "--threads", "1"]
    assert main(["quality", "-o", str(tmp_path / "q"), *few, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["rows"] == 4 * len(METRICS)
    assert [Path(path).name for path in told["figures"]] == ["exposure-50lux.png"]
    assert all(Path(path).stat().st_size > 10_000 for path in told["figures"])
    assert len(pd.read_csv(tmp_path / "q" / "quality.csv")) == told["rows"]


def test_help_shows_this_commands_defaults_and_offers_nothing_else(capsys: Output) -> None:
    assert main(["quality", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for usual in ("0.5,1,2,5,10,15,20,30,45,60,90", "5,50,500", "0,200,500,1000", "0", "imx250m"):
        assert f"(default: {usual})" in shown
    for other in ("auto", "1,30,1000,20000", "--moves", "--ego-kmh", "of the pictures"):
        assert other not in shown


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["--repeats", "0"], "repeats"),
        (["--exposure-ms", "0"], "--exposure-ms"),
        (["--camera", "nosuch"], "nosuch"),
        (["--camera", "hdr.yaml"], "captures"),
        (["--threads", "0"], "threads"),
        (["--gain", "0,auto"], "--gain = '0,auto': must be numbers"),
        (["--exposure-ms", "auto"], "--exposure-ms = 'auto': must be numbers"),
        (["--moves", "targets"], "moves: must be all"),
    ],
)
def test_wrong_input_is_one_line(
    given: list[str], named: str, tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    replace(CAMERA, captures=staggered(16)).save(tmp_path / "hdr.yaml")
    assert main(["quality", "-o", "q", *given]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert named in error
    assert not (tmp_path / "q").exists()
