"""The bench of moving things: its truths against closed forms, its wrong ways by their errors, and what it writes."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.bench import (
    motion,
    motion_objects,
    motion_peers,
    motion_scenes,
    motion_truth,
    motion_view,
)
from blurnoise_eval.bench.motion import Bench, Row
from blurnoise_eval.bench.motion_job import OURS, Case, Extent, Job, Method
from blurnoise_eval.bench.timing import Quartiles
from blurnoise_eval.cli import main
from rich.console import Console

from blurnoise import Layer

TINY = Extent(120, 176, sign_px=24, moved_px=12.0, moments=64, fewest=1, most=2, seconds=0)


def plane_wave(height: int, width: int, fx: float, fy: float, contrast: float = 1.0) -> motion_truth.Floats:
    """Of phase 0 in the middle of the picture, (1, H, W)."""
    y, x = np.mgrid[:height, :width] - np.array([(height - 1) / 2, (width - 1) / 2])[:, None, None]
    return contrast * np.cos(2 * np.pi * (fx * x + fy * y))[None]


@pytest.fixture(scope="module")
def tiny() -> tuple[Bench, float]:
    told: list[float] = []
    return motion.measure(TINY, 1, told.append), math.fsum(told)


def test_truth_of_a_path_is_sinc_of_a_straight_one() -> None:
    """64 moments err by (pi f.d / 64)^2 / 6, less than 1e-3; Lanczos's taps by no more at these frequencies."""
    fx, fy, (dx, dy) = 0.11, -0.07, (6.0, -4.0)
    times = motion_truth.moments(64)
    seen = motion_truth.along_path(plane_wave(61, 74, fx, fy), times * dx, times * dy)
    expected = plane_wave(61, 74, fx, fy, np.sinc(fx * dx + fy * dy))
    inside = np.s_[:, 12:-12, 12:-12]
    np.testing.assert_allclose(seen[inside], expected[inside], atol=3e-3)
    assert abs(np.sinc(fx * dx - fy * dy) - np.sinc(fx * dx + fy * dy)) > 0.1  # a mirrored path would show


def test_truth_displaces_to_the_right_and_down() -> None:
    point = np.zeros((1, 25, 31))
    point[0, 12, 15] = 1
    for seen in (
        motion_truth.displaced(point, 3.0, -2.0),
        motion_truth.along_path(point, np.array([3.0]), np.array([-2.0])),
        motion_peers.displaced(np.float32(point[0]), 3.0, -2.0),
    ):
        assert np.unravel_index(np.argmax(seen), point.shape[1:]) == (10, 18)
        assert seen.max() == pytest.approx(1, abs=1e-6)


def test_truth_of_an_object_has_the_covariance() -> None:
    """Matte and background that are waves along x, black light: the mean of their product in closed form."""
    f, of_object, of_background = 0.09, 7.0, -4.0
    wave = plane_wave(41, 96, f, 0.0)[0]
    alpha, background = (1 + wave) / 2, (1 + wave[None]) / 2
    seen = motion_truth.layered(
        background, np.zeros_like(background), alpha, (of_object, 0.0), (of_background, 0.0), 128
    )
    constant = 1 - np.sinc(f * (of_background - of_object)) / 2
    second = plane_wave(41, 96, 2 * f, 0.0)[0] * np.sinc(f * (of_object + of_background)) / 2
    expected = (constant + (np.sinc(f * of_background) - np.sinc(f * of_object)) * wave - second) / 4
    inside = np.s_[:, 14:-14]
    np.testing.assert_allclose(seen[0][inside], expected[inside], atol=2e-3)
    formula = (1 - (1 + np.sinc(f * of_object) * wave) / 2) * (1 + np.sinc(f * of_background) * wave) / 2
    assert np.abs(formula - expected).max() > 0.05


def test_truth_of_a_rolling_shutter() -> None:
    """The plane wave (.07, -.05) at (900, -500) px/s, 10 ms, 24.098 us per row: sinc .133156, seen f_y -.0521206."""
    fx, fy, vx, vy, exposure_s, row_s = 0.07, -0.05, 900.0, -500.0, 0.01, 24.098e-6
    light = plane_wave(61, 90, fx, fy)
    seen = motion_truth.rolled(light, lambda time: (vx * time, vy * time), row_s, exposure_s, 128)
    expected = plane_wave(61, 90, fx, -0.0521206, 0.133156)
    inside = np.s_[:, 14:-14, 16:-16]
    np.testing.assert_allclose(seen[inside], expected[inside], atol=2e-3)
    mirrored = plane_wave(61, 90, fx, 2 * fy + 0.0521206, 0.133156)
    assert np.abs(seen - mirrored)[inside].max() > 5e-3


def test_truth_of_a_road() -> None:
    """Bars that are even on the road keep their places and lose sinc of what is travelled; lines ahead stay."""
    height, width, focal_px, mount_m, travelled_m, period_m = 161, 201, 100.0, 1.4, 0.5, 1.0
    y, x = np.mgrid[:height, :width] - np.array([(height - 1) / 2, (width - 1) / 2])[:, None, None]
    depth_m = mount_m * focal_px / np.maximum(y, 1)
    bars = np.cos(2 * np.pi * depth_m / period_m)
    lines = np.cos(2 * np.pi * 2 * x / np.maximum(y, 1))
    seen = motion_truth.over_road(np.stack([bars, lines]), focal_px, mount_m, travelled_m, 64)
    near = np.s_[-30:-12, 60:-60]  # where bars are many pixels long
    expected = np.sinc(travelled_m / period_m) * bars
    np.testing.assert_allclose(seen[0][near], expected[near], atol=0.01)
    np.testing.assert_allclose(seen[1][near], lines[near], atol=0.01)
    assert np.abs(bars - expected)[near].max() > 0.3
    np.testing.assert_array_equal(seen[:, : height // 2], np.stack([bars, lines])[:, : height // 2])


def square() -> motion_objects.Objects:
    """White, 20 px, before black, 10 px along x: its share of the exposure is a ramp of 10 px."""
    alpha = torch.ones(20, 20)
    background = torch.zeros(1, 3, 60, 80)
    light = torch.ones(3, 20, 20)
    layer = Layer(light, alpha, (1000.0, 0.0), (30, 20))
    picture = background.clone()
    picture[..., 20:40, 30:50] = 1
    share = np.clip((10 + 5 - np.abs(np.arange(80) - 39.5)) / 10, 0, 1)
    truth = np.broadcast_to(share, (3, 10, 80))
    return motion_objects.Objects(
        picture, truth, slice(25, 35), slice(0, 80), background, layer, (10.0, 0.0), (0.0, 0.0)
    )


def test_naive_blend_leaves_its_ghost() -> None:
    """Errors a (1 - a) outside, (1 - a)^2 inside, over the band .1514 RMS of white; the exact picture has none."""
    case = square()
    band = np.r_[25:35, 45:55]

    def rms(name: str) -> float:
        (method,) = (each for each in motion_objects.jobs()[0].methods if each.name == name)
        seen = method.of(case)()
        assert isinstance(seen, torch.Tensor)
        return float(np.sqrt(np.mean((seen[0, :, 25:35].numpy() - case.truth)[..., band] ** 2)))

    assert rms("naive blend") == pytest.approx(0.1514, abs=0.01)
    assert rms(OURS) < 0.02  # the band-limited line's ringing at a hard edge
    share = (np.arange(10) + 0.5) / 10
    error = np.where(share < 0.5, share * (1 - share), (1 - share) ** 2)
    assert math.sqrt(float(np.mean(error**2))) == pytest.approx(0.1514, abs=1e-3)


def test_errors_are_of_eight_bit_codes() -> None:
    """Middle grey of sRGB, code 127.5 of 255, is .2140 of white; what is not judged does not count."""
    picture = torch.zeros(1, 3, 4, 5)
    case = Case(picture, np.full((3, 2, 3), 0.21404114), slice(1, 3), slice(2, 5))
    assert case.error_dn(picture) == pytest.approx(127.5, abs=1e-3)
    seen = np.ones((4, 5, 3), np.float32)
    seen[1:3, 2:5] = 0.21404114
    assert case.error_dn(seen) == pytest.approx(0, abs=1e-3)


def test_spreads_of_a_path() -> None:
    """Four pixels share a place by its distances; a histogram has it in one; x is across."""
    one = np.array([[1.25], [-0.5]])
    shared = motion_peers.spread_of(one, 7, whole=False)
    np.testing.assert_allclose(shared[2:4, 4:6], [[0.375, 0.125], [0.375, 0.125]])
    assert motion_peers.spread_of(np.array([[1.25], [-0.6]]), 7, whole=True)[2, 4] == 1
    many = np.random.default_rng(2).uniform(-3, 3, (2, 500))
    spread = motion_peers.spread_of(many, 9, whole=False)
    y, x = np.mgrid[:9, :9] - 4
    np.testing.assert_allclose([(spread * x).sum(), (spread * y).sum()], many.mean(1), atol=1e-12)


def test_deepinv_is_given_our_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a generator that counts as deepinv's does: first axis down, from -1 to 1, convolved with the picture."""
    seen = []

    class Generator:
        def __init__(self, psf_size: tuple[int, int], n_steps: int) -> None:
            self.psf_size, self.n_steps = psf_size, n_steps

        def f_matern(self, batch: int) -> torch.Tensor:
            raise AssertionError("its own path")

        def step(self) -> dict[str, torch.Tensor]:
            first, second = self.f_matern(1), self.f_matern(1)
            assert first.shape == second.shape == (1, self.n_steps)
            both = torch.cat([first, second]).T.contiguous()
            filled = torch.histogramdd(both, list(self.psf_size), range=[-1.0, 1.0] * 2).hist
            return {"filter": (filled / filled.sum())[None, None]}

    def convolved(picture: torch.Tensor, spread: torch.Tensor, padding: str) -> torch.Tensor:
        seen.append(spread)
        return picture

    for name, content in (
        ("generator", {"MotionBlurGenerator": Generator}),
        ("functional", {"conv2d_fft": convolved}),
    ):
        module = ModuleType(f"deepinv.physics.{name}")
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, module.__name__, module)
    places = np.random.default_rng(3).uniform(-3, 3, (2, 400))
    call = motion_peers.deepinv_path(torch.zeros(1, 3, 8, 9), places, 9)
    call(), call()
    expected = motion_peers.spread_of(places, 9, whole=True)
    for spread in seen:
        np.testing.assert_allclose(spread[0, 0].numpy(), expected, atol=1e-6)


def test_scenes() -> None:
    leaves = motion_scenes.leaves(60, 90)
    assert leaves.shape == (3, 60, 90)
    assert leaves.min() >= 0
    assert leaves.max() <= 1
    assert leaves.std() > 0.1
    light, alpha = motion_scenes.sign(24)
    assert light.shape == (3, 36, 36)
    assert alpha[18, 18] == pytest.approx(1)
    assert alpha[0].max() < 1e-3
    octagon = 2 * (math.sqrt(2) - 1) * 24**2  # of a width between opposite flats
    assert alpha.sum() == pytest.approx(octagon, rel=0.01)
    assert light[0, 8, 18] > 2 * light[1, 8, 18]  # red above the legend


def test_ours_are_exact_and_others_are_not(tiny: tuple[Bench, float]) -> None:
    """What must err more does, by the factors of such motions."""
    bench, _ = tiny
    errors = {job.name: {row.method: row.error_dn for row in bench.of(job)} for job in bench.jobs}
    for job in bench.jobs:
        own = [method.name for method in job.methods if method.family == OURS]
        others = [error for name, error in errors[job.name].items() if name not in own]
        assert errors[job.name][OURS] < min(others), job.name
        assert errors[job.name][OURS] < 1.5, job.name
        at_rest = bench.of(job)[0].at_rest_dn
        assert errors[job.name][OURS] < at_rest / (4 if job.name == "road" else 50), (
            job.name
        )  # few rows blur much
    one, both = errors["object"], errors["object and background"]
    assert one["naive blend"] > 50 * one[OURS]
    assert both["ours, matte formula"] > 3 * both[OURS]
    assert both["ours, parts of 1 px"] < 1.1 * both[OURS] < both["ours, parts of 4 px"]  # 2 px is as good
    path = errors["path"]
    assert path["histogram PSF"] > path["splatted PSF"] > 3 * path[OURS]
    assert path["ours, a new path"] == pytest.approx(path[OURS], rel=1e-3)
    assert path["ours, polyline_blur"] == pytest.approx(path[OURS], rel=0.1)
    assert path["kornia, chord"] > 20 * path[OURS]
    rows = errors["rolling shutter"]
    assert rows["blur, remap linear"] > rows["blur, remap cubic"] > 2 * rows[OURS]
    assert min(rows["sheared, no blur"], rows["blurred, no shear"]) > 10 * rows[OURS]
    assert errors["road"]["one blur"] > 4 * errors["road"][OURS]
    assert errors["road"]["4 frames"] > 2 * errors["road"][OURS]


def test_progress_adds_up(tiny: tuple[Bench, float]) -> None:
    assert tiny[1] == pytest.approx(motion.steps(TINY))


def test_methods_are_named_once_and_drawn() -> None:
    for job in motion.jobs():
        names = [method.name for method in job.methods]
        assert len(set(names)) == len(names)
        assert names[0] == OURS
        assert {method.family for method in job.methods} <= set(motion_view._MARKERS)


@pytest.mark.slow
def test_files(tiny: tuple[Bench, float], tmp_path: Path) -> None:
    bench, _ = tiny
    motion.write(bench, tmp_path)
    motion_view.write(bench, tmp_path)
    with (tmp_path / "motion.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["job"], row["method"]) for row in rows] == [(row.job, row.method) for row in bench.rows]
    assert [float(row["ms_median"]) for row in rows] == [row.ms.median for row in bench.rows]
    ours = [float(row["to_ours"]) for row in rows if row["method"] == OURS]
    assert ours == [1.0] * len(bench.jobs)
    values = 3 * TINY.height_px * TINY.width_px
    for row in bench.rows:
        assert row.ns_per_value == pytest.approx(1e6 * row.ms.median / values)
    document = json.loads((tmp_path / "motion.json").read_text())
    assert len(document["rows"]) == len(rows)
    assert list(document["jobs"]) == [job.name for job in bench.jobs]
    picture = cv2.imread(str(tmp_path / "motion.png"))
    assert picture.shape[0] > 400
    assert picture.std() > 10


def test_chart_and_tables(tiny: tuple[Bench, float]) -> None:
    bench, _ = tiny
    figure = motion_view.chart(bench)
    figure.draw_without_rendering()
    assert [axes.get_title(loc="left") for axes in figure.axes[:5]] == [job.title for job in bench.jobs]
    told = io.StringIO()
    console = Console(file=told, width=80)
    for table in motion_view.tables(bench):
        console.print(table)
    for method in (method.name for job in bench.jobs for method in job.methods):
        assert method in told.getvalue()  # none is cut short


def test_losses_are_told() -> None:
    """Who is quicker or more exact than all of ours, and useful; and who is not here."""
    ways = tuple(
        Method(name, family, "", lambda case: lambda: case)
        for name, family in (
            (OURS, OURS),
            ("slow", OURS),
            ("quick", "a"),
            ("better", "b"),
            ("worse", "c"),
            ("bad", "d"),
        )
    )
    job = Job("job", "", lambda extent: SimpleNamespace(), ways, {"deepinv": "not installed"})  # type: ignore[arg-type, return-value]
    figures = {
        "slow": (4, 0.1),
        OURS: (1, 0.5),
        "quick": (0.5, 2),
        "better": (2, 0.2),
        "worse": (1.1, 0.6),
        "bad": (0.1, 5),
    }
    rows = [
        Row("job", way.name, Quartiles(ms, ms, ms), 1.0, ms, error, 9.0)
        for way in ways
        for ms, error in (figures[way.name],)
    ]
    assert Bench(rows, TINY, (job,), {}).losses() == [
        "job: quick in 0.50 of our time, 4.00 of our error",
        "job: better in 2.00 of our time, 0.40 of our error",
        "job: deepinv is left out: not installed",
    ]
    matched = [replace(row, error_dn=0.2) if row.method == OURS else row for row in rows]
    assert "better" not in str(Bench(matched, TINY, (job,), {}).losses())


@pytest.mark.slow
def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "QUICK", TINY)
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "motion", "--quick", "--threads", "1", "-o", "made", "--json"]) == 0
    names = sorted(path.name for path in (tmp_path / "made").iterdir())
    assert names == ["motion.csv", "motion.json", "motion.png"]
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "made" / "motion.json").read_text())


def test_quick_is_smaller() -> None:
    assert motion.QUICK.values < motion.FULL.values
    assert motion.FULL.moments >= 256
    assert motion.QUICK.moved_px == motion.FULL.moved_px
