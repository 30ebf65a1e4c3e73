"""Every metric of simulated charts against physics in closed form, and what is withheld, written and drawn."""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import torch
from blurnoise_eval.cameras import behind_one_filter
from blurnoise_eval.grid.conditions import Conditions, SweepPlan
from blurnoise_eval.quality import figures as quality_figures
from blurnoise_eval.quality import measure as quality
from blurnoise_eval.quality import table as quality_table
from blurnoise_eval.quality.measure import BRIGHT, DARK, METRICS, TILT_DEG, Metric, Row
from closed_edges import closed_mtf, closed_mtf50
from commands import main
from matplotlib.colors import to_hex, to_rgba
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
    (found,) = (
        row.estimate
        for row in rows
        if (row.metric, row.at["exposure_s"], row.at["velocity_x_px_s"]) == (metric, exposure_s, speed_px_s)
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
    truths = {
        "sic_radial_x": information.shannon_capacity_radial(frequency, power=power, **white),
        "sic_square": information.shannon_capacity_square(frequency, frequency, power=plane, **white),
        "neq_integral": information.square_integral(frequency, frequency, plane)
        * electrons(exposure_s, BRIGHT) ** 2
        / noise_e2(exposure_s, BRIGHT),
        "neq_0": torch.tensor(electrons(exposure_s, BRIGHT) ** 2 / noise_e2(exposure_s, BRIGHT)),
    }
    for metric, truth in truths.items():
        found = reading(rows, metric, exposure_s)
        assert near(found, float(truth), 1.5), metric
        assert found.value == pytest.approx(float(truth), rel=0.07), metric
    ideal = 10 * step / math.sqrt(noise)  # a 10 px square without blur; the pixel's own takes a little
    assert 0.9 * ideal < reading(rows, "snri", exposure_s).value < ideal


def test_information_is_highest_at_an_exposure_between(rows: list[Row]) -> None:
    """Moving, more light first tells more, then blur takes it back; at rest only saturation ends it."""
    best = {row["velocity_x_px_s"]: row["exposure_s"] for row in quality_table.most_information(rows)}
    assert best == {0.0: 0.016, 500.0: 0.004}
    assert reading(rows, "psnr_db", 0.004, 500.0).value > max(
        reading(rows, "psnr_db", exposure_s, 500.0).value for exposure_s in (0.001, 0.016)
    )


def test_psnr_at_rest_is_that_of_the_noise(rows: list[Row]) -> None:
    """40 000 pixels of three colours know their variance to 0.4 %, 0.02 dB; dark red, cut at 0, takes little."""
    scene = charts.stop_sign(100, height_px=200, width_px=200, background=DARK).double()
    for exposure_s in (0.004, 0.016):
        signal = electrons(exposure_s, 1.0)
        variance = sum(noise_e2(exposure_s, float(level)) for level in scene.flatten()[::7]) / len(
            scene.flatten()[::7]
        )
        truth = 10 * math.log10(signal**2 / variance)
        assert reading(rows, "psnr_db", exposure_s).value == pytest.approx(truth, abs=0.1)


# --- what is withheld -------------------------------------------------------


def test_saturation_withholds_what_it_falsifies(rows: list[Row]) -> None:
    """At 0.1 s white would hold 28 000 e-, the pixel 10 700; the grey at 18 % is still whole."""
    for speed in (0.0, 500.0):
        for metric in (*EDGES, "patch_snr_bright", "neq_0", "cnr", "michelson", "cdp"):
            found = reading(rows, metric, 0.1, speed)
            assert "clipped" in found.flags, metric
            assert not found.told
            assert math.isnan(found.low)
        for metric in ("psnr_db", "ssim"):
            found = reading(rows, metric, 0.1, speed)
            assert found.told
            assert found.flags == {"clipped"}
        assert reading(rows, "patch_snr_dark", 0.1, speed).flags == frozenset()
    assert reading(rows, "psnr_db", 0.1).value < reading(rows, "psnr_db", 0.016).value - 10


def test_without_light_nothing_is_told_but_why() -> None:
    for row in measured(swept((0.01,), (0.0,))):
        if row.metric not in ("cnr", "michelson", "cdp", "patch_snr_bright", "patch_snr_dark", "neq_0"):
            assert not row.estimate.told, row.metric
            assert row.estimate.flags, row.metric


def test_motion_beyond_the_chart_is_withheld() -> None:
    rows = measured(swept((0.03,), (LUX,), (0.0,), (5000.0,)))
    for metric in ("mtf50_x", "sic_radial_x", "sic_square", "snri"):
        found = reading(rows, metric, 0.03)
        assert not found.told
        assert "region_too_small" in found.flags
    assert reading(rows, "mtf50_y", 0.03).value == pytest.approx(
        0.603355 / 150 / math.cos(math.radians(TILT_DEG)), rel=0.01
    )


def test_repeats_are_averaged_and_any_of_them_can_withhold() -> None:
    told = [Estimate(1.0, 0.8, 1.4, frozenset({"a"})), Estimate(3.0, 2.6, 3.2, frozenset({"b"}))]
    both = quality.together(told)
    assert (both.value, both.flags) == (2.0, {"a", "b"})
    assert both.low == pytest.approx(2 - 0.3 / math.sqrt(2))
    assert both.high == pytest.approx(2 + 0.3 / math.sqrt(2))
    assert quality.together(told[:1]) == told[0]
    lost = quality.together([*told, Estimate(math.nan, flags=frozenset({"clipped"}))])
    assert not lost.told
    assert lost.flags == {"a", "b", "clipped"}


# --- the same rows ----------------------------------------------------------


def test_rows_hang_on_the_seed_and_their_own_condition_alone(rows: list[Row]) -> None:
    def records(*plan: object, **options: int) -> list[dict[str, object]]:
        return [row.record() for row in measured(swept(*plan), **options)]  # type: ignore[arg-type]

    some = ((0.004, 0.016), (LUX,), (500.0,))
    wanted = [
        row.record() for row in rows if row.at["exposure_s"] in some[0] and row.at["velocity_x_px_s"] == 500.0
    ]
    assert records(*some, threads=2) == wanted
    other = records(*some, (0.0,), 1, 7)
    assert [row["metric"] for row in other] == [row["metric"] for row in wanted]
    pairs = list(zip(wanted, other, strict=True))
    assert all(
        mine["value"] != theirs["value"] for mine, theirs in pairs if mine["metric"] != "cdp"
    )  # can be 1


@pytest.mark.slow
def test_further_axes_reach_the_charts_and_the_table(rows: list[Row]) -> None:
    """Of f-numbers, defocus, heat and gain each changes what physics says, against the still chart at 16 ms."""
    plain = {row.metric: row.estimate for row in rows if (row.at["exposure_s"], row.blur_px) == (0.016, 0)}

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
    leaky = replace(CAMERA, dark_current_e_s=50.0)
    hot = told(leaky, temperature_c=100.0)  # 16 ms at 2^10 times 50 e-/s: 800 e- beside the light's
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


@pytest.mark.slow
def test_a_picture_and_a_line_per_setting(tmp_path: Path) -> None:
    rows = [
        Row(at.on(CAMERA), metric.name, Estimate(1.0, 0.5, 2.0), 1, 1)
        for at in swept(
            (0.001, 0.01), (5.0, LUX), (0.0, 100.0), f_number=(2.0, 4.0), gain_db=(6.0,)
        ).conditions()
        for metric in METRICS
    ]
    names = [path.name for path in quality_figures.write(rows, "a camera", tmp_path)]
    assert names == [
        f"{kind}-{lux}lux-f{n}.png" for lux in (5, 50) for n in (2, 4) for kind in ("exposure", "blur")
    ]
    best = quality_table.most_information(rows)
    assert len(best) == 2 * 2 * 2
    assert {row["gain_db"] for row in best} == {6.0}
    table = quality_table.as_table(best)
    assert [column.header for column in table.columns][:3] == ["lux", "f-number", "motion"]
    assert [next(iter(table.columns[1].cells)), table.row_count] == ["2", 8]


def test_threads_are_given_back() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        measured(swept((0.01,), (LUX,)))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


# --- files, figures, the command --------------------------------------------


def test_the_table_and_the_document_say_the_same(rows: list[Row], tmp_path: Path) -> None:
    quality_table.write(rows, CAMERA, PLAN, tmp_path)

    def forbidden(constant: str) -> float:
        raise AssertionError(constant)

    document = json.loads((tmp_path / "quality.json").read_text(), parse_constant=forbidden)
    assert document["rows"] == [row.record() for row in rows]
    assert set(document["metrics"]) == {metric.name for metric in METRICS}
    assert Camera.from_dict(document["camera"]) == CAMERA
    table = pd.read_csv(tmp_path / "quality.csv")
    assert len(table) == len(rows)
    lost = table[table["value"].isna()]
    assert set(lost["exposure_s"]) == {0.1}
    assert lost["flags"].str.contains("clipped").all()
    assert (lost["told"] == 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["exposure", "blur"])
def test_lines_have_gaps_where_numbers_are_withheld(rows: list[Row], kind: str) -> None:
    figure = getattr(quality_figures, f"against_{kind}")(rows, CAMERA.name)
    assert [axes.get_title().split(" / ")[0] for axes in figure.axes] == [metric.title for metric in METRICS]
    for axes, metric in zip(figure.axes, METRICS, strict=True):
        told = sum(row.estimate.told for row in rows if row.metric == metric.name)
        shown = [
            y
            for line in axes.lines
            if line.get_linestyle() == "-"
            for y in line.get_ydata()
            if math.isfinite(y)
        ]
        assert len(shown) == told, metric.name
        saturated = [
            patch for patch in axes.patches if to_hex(patch.get_facecolor()) == quality_figures.SATURATED
        ]
        assert len(saturated) == (kind == "exposure" and metric.name != "patch_snr_dark")
        crosses = sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == "x")
        assert crosses == (8 - told if kind == "exposure" else 0)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("500 px/s" if kind == "exposure" else "100 ms (saturated)") in texts
    assert ("a line saturates" in texts) == (kind == "exposure")


def test_shade_ends_halfway_between_exposures(rows: list[Row]) -> None:
    """Logarithmic: from the root of 16 x 100 ms to the axis' end."""
    axes = quality_figures.against_exposure(rows, "a camera").axes[0]
    (span,) = axes.patches
    assert span.get_x() == pytest.approx(40, rel=1e-3)
    assert span.get_x() + span.get_width() == pytest.approx(axes.get_xlim()[1])


def test_noise_and_blur_have_a_shade_of_their_own() -> None:
    def row(speed: float, exposure_s: float, found: Estimate) -> list[Row]:
        at = Conditions(exposure_s=exposure_s, illuminance_lux=1.0, velocity_x_px_s=speed).on(CAMERA)
        return [Row(at, metric.name, found, int(found.told), 1) for metric in METRICS]

    lost, noisy = Estimate(math.nan, flags=frozenset({"region_too_small"})), frozenset({"noise_dominated"})
    rows = [
        *row(0.0, 0.001, Estimate(1.0, 0.5, 2.0, noisy)),
        *row(0.0, 0.01, Estimate(0.5, 0.4, 0.6)),
        *row(0.0, 0.1, lost),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        axes = quality_figures.against_exposure(rows, "a camera").axes[0]
        quality_figures.against_exposure(row(0.0, 0.1, lost), "a camera")
    assert len(axes.patches) == 2
    assert {to_rgba(patch.get_facecolor())[:3] for patch in axes.patches} == {
        to_rgba(quality_figures.FAILED)[:3]
    }
    hollow = [line.get_xdata() for line in axes.lines if line.get_markerfacecolor() == "white"]
    assert [list(x) for x in hollow] == [[1.0]]


@pytest.mark.slow
def test_command_writes_everything(tmp_path: Path, capsys: Output) -> None:
    few = ["--exposure-ms", "4,16", "--lux", "50", "--dx", "0,500", "--repeats", "1", "--threads", "1"]
    assert main(["quality", "-o", str(tmp_path / "q"), *few, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["rows"] == 4 * len(METRICS)
    assert [Path(path).name for path in told["figures"]] == ["exposure-50lux.png", "blur-50lux.png"]
    assert all(Path(path).stat().st_size > 10_000 for path in told["figures"])
    assert len(pd.read_csv(tmp_path / "q" / "quality.csv")) == told["rows"]
    assert [row["exposure_s"] for row in told["most_information"]] == [0.016, 0.004]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["--repeats", "0"], "repeats"),
        (["--exposure-ms", "0"], "--exposure-ms"),
        (["--camera", "nosuch"], "nosuch"),
        (["--threads", "0"], "threads"),
        (["--gain", "auto"], "--gain ="),
        (["--gain", "0,auto"], "--gain ="),
    ],
)
def test_wrong_input_is_one_line(given: list[str], named: str, tmp_path: Path, capsys: Output) -> None:
    assert main(["quality", "-o", str(tmp_path / "q"), *given]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert named in error
    assert not (tmp_path / "q").exists()


def test_cameras_of_several_captures_leave_no_folder(tmp_path: Path, capsys: Output) -> None:
    replace(CAMERA, captures=staggered(16)).save(tmp_path / "hdr.yaml")
    assert main(["quality", "-o", str(tmp_path / "q"), "--camera", str(tmp_path / "hdr.yaml")]) == 2
    assert "captures" in capsys.readouterr().err
    assert not (tmp_path / "q").exists()


def test_a_new_metric_is_one_entry(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Weber contrast as the seventeenth: measured, withheld by its flags, written and drawn."""
    weber = Metric(
        "weber", "Weber contrast", "1", "bright / dark - 1",
        lambda taken: [Estimate(float(b.mean() / d.mean()) - 1) for b, d in zip(*taken.patches, strict=True)],
    )  # fmt: skip
    every = (*METRICS, weber)
    for module in (quality, quality_figures, quality_table):
        monkeypatch.setattr(module, "METRICS", every)
    plan = swept((0.004, 0.008), (LUX,), (0.0,))
    rows = measured(plan)
    assert reading(rows, "weber", 0.004).value == pytest.approx(BRIGHT / DARK - 1, rel=0.05)
    assert len(rows) == 2 * 17
    quality_figures.write(rows, CAMERA.name, tmp_path)
    assert list(tmp_path.rglob("*.png"))
