from __future__ import annotations

import csv
import json
import math
import sys
from dataclasses import replace
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.bench import blur, blur_view, contenders, timing, truth
from blurnoise_eval.bench.blur import EXACT, NO_BLUR, Bench, Extent, Row
from blurnoise_eval.bench.timing import Quartiles
from blurnoise_eval.cli import main
from blurnoise_eval.system.threads import limited_threads
from scipy.optimize import brentq

Output = pytest.CaptureFixture[str]
TINY = Extent(
    timed_px=(1.5, 6, 120),
    judged_px=(1.5, 6),
    angles_deg=(0, 45),
    scenes=("Siemens star", "text"),
    shape=(3, 1, 150, 161),
    scene_px=48,
    fewest=1,
    most=2,
    seconds=0,
)
METHODS = [method.name for method in contenders.contenders()]
ANGLES = (0, 17, 45, 73, 107, 163, 200, -30)


def noise(height: int, width: int) -> truth.Plane:
    return np.random.default_rng(5).random((height, width))


@pytest.mark.parametrize("angle_deg", ANGLES)
def test_truth_of_a_sinusoid_is_sinc(angle_deg: float) -> None:
    """Along the motion, x right and y down; the mirrored motion would leave another contrast."""
    height, width, length = 96, 160, 7.3
    fx, fy = 9 / width, 4 / height
    y, x = np.mgrid[:height, :width]
    wave = np.cos(2 * np.pi * (fx * x + fy * y))
    (moved,) = truth.moved(wave, [(length, angle_deg)])
    along = length * (fx * math.cos(math.radians(angle_deg)) + fy * math.sin(math.radians(angle_deg)))
    contrast = math.sin(math.pi * along) / (math.pi * along)
    np.testing.assert_allclose(moved, contrast * wave, atol=1e-12)


def test_truth_keeps_grey_and_flux() -> None:
    plane = noise(48, 56)
    for moved in truth.moved(plane, [(length, 31.0) for length in (0.3, 5.0, 200.0)]):
        assert moved.mean() == pytest.approx(plane.mean(), rel=1e-12)
        assert moved.std() < plane.std()
    (grey,) = truth.moved(np.full((48, 56), 0.4), [(9.0, 31.0)])
    np.testing.assert_allclose(grey, 0.4, atol=1e-12)
    (still,) = truth.moved(plane, [(0.0, 31.0)])
    np.testing.assert_allclose(still, plane, atol=1e-12)


@pytest.mark.parametrize(("length", "angle_deg"), [(1.5, 17), (6, 0), (10.4, 45), (10.4, -45), (25, 107)])
def test_truth_of_an_edge_is_a_ramp(length: float, angle_deg: float) -> None:
    """An edge moved by L is a ramp of width L |cos phi| across it, averaged here over 40 x 40 points a pixel.

    The truth's samples are 1/8 px wide, so it may be off by the ramp's curvature over one: at the two ends of
    the ramp, 1/8 px of 8 times 8, less than 1/64 of its slope.
    """
    size = 32
    side = truth.plane_side(size, 25)
    fine = truth.slanted_edge(size, side)
    (moved,) = map(truth.pixels, truth.moved(fine, [(truth.FINE * length, angle_deg)]))
    first, points = side // 2 - size // 2, 40
    at = first - side / 2 + (np.arange(size * points) + 0.5) / points
    across = at * math.cos(math.radians(5)) - at[:, None] * math.sin(math.radians(5))
    width = length * abs(math.cos(math.radians(angle_deg + 5)))
    ramp = np.clip(0.5 + across / width, 0, 1).reshape(size, points, size, points).mean(axis=(1, 3))
    crop = moved[first : first + size, first : first + size]
    tolerance = 1 / (64 * width)
    assert np.abs(crop - ramp).max() < tolerance
    longer = np.clip(0.5 + across / (1.1 * width), 0, 1).reshape(size, points, size, points).mean(axis=(1, 3))
    assert np.abs(crop - longer).max() > tolerance


def test_pixels_are_means_of_their_samples() -> None:
    means = truth.pixels(np.repeat(np.repeat(noise(5, 7), truth.FINE, axis=0), truth.FINE, axis=1))
    np.testing.assert_allclose(means, noise(5, 7), rtol=1e-12)
    ramp = np.arange(16.0 * truth.FINE).reshape(truth.FINE, 16)
    np.testing.assert_allclose(truth.pixels(ramp), [[ramp[:, :8].mean(), ramp[:, 8:].mean()]])


@pytest.mark.parametrize("taps", [3, 7, 31])
def test_mtf50_of_taps_in_a_row(taps: int) -> None:
    """N equal taps have the response sin(pi N f) / (N sin(pi f)), wherever in the plane they lie."""
    half = brentq(
        lambda f: math.sin(math.pi * taps * f) / (taps * math.sin(math.pi * f)) - 0.5, 1e-6, 1 / taps
    )
    row = np.zeros((41, 53))
    row[11, 9 : 9 + taps] = 1
    assert truth.mtf50(row, 0.0) == pytest.approx(half, rel=1e-6)
    assert truth.mtf50(row, 60.0) == pytest.approx(half / math.cos(math.radians(60)), rel=1e-6)
    assert truth.mtf50(row, 90.0) is None
    assert truth.mtf50(row.T, 90.0) == pytest.approx(half, rel=1e-6)
    down_right = np.eye(41)[:taps, :taps]
    assert truth.mtf50(down_right, 45.0) == pytest.approx(half / math.sqrt(2), rel=1e-6)
    assert truth.mtf50(down_right, -45.0) is None


def test_constant_of_mtf50() -> None:
    assert np.sinc(truth.MTF50_LENGTH) == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize("scene", truth.SCENES)
@pytest.mark.parametrize("size", [48, 64])
def test_scenes_have_detail_where_they_are_measured(scene: str, size: int) -> None:
    side = truth.plane_side(size, 6.0)
    assert side >= size + 6 + 2 * 16
    fine = truth.SCENES[scene](size, side)
    assert fine.shape == (side * truth.FINE, side * truth.FINE)
    assert fine.dtype == np.float64
    assert fine.min() >= 0
    assert fine.max() <= 1
    start = side // 2 - size // 4
    centre = truth.pixels(fine)[start : start + size // 2, start : start + size // 2]
    assert centre.std() > 0.2
    assert 0.2 < centre.mean() < 0.9


def one(name: str) -> contenders.Contender:
    return next(method for method in contenders.contenders() if method.name == name)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("angle_deg", [30, 120, -60])
def test_contenders_move_the_right_way(name: str, angle_deg: float) -> None:
    """Colour pictures, each by its own angle: twice as close to their own truth as to the mirrored one."""
    fine = truth.siemens_star(48, 72)
    own, mirrored = (
        torch.from_numpy(truth.pixels(plane))
        for plane in truth.moved(fine, [(9.0 * truth.FINE, angle_deg), (9.0 * truth.FINE, -angle_deg)])
    )
    image = torch.from_numpy(truth.pixels(fine)).float().repeat(2, 3, 1, 1)
    out = one(name).blur(image, 9.0, (angle_deg, -angle_deg))
    assert out.shape == image.shape
    for picture, right, wrong in ((out[0], own, mirrored), (out[1], mirrored, own)):
        inner = picture[:, 18:54, 18:54].double()
        error, other = ((inner - plane[18:54, 18:54]).square().mean().sqrt() for plane in (right, wrong))
        assert error < other / 2


@pytest.mark.parametrize(("length", "taps"), [(0.2, 3), (1.5, 3), (3.9, 3), (4.1, 5), (31, 31), (101.4, 101)])
def test_nearest_odd(length: float, taps: int) -> None:
    assert contenders.nearest_odd(length) == taps


class MotionBlur:
    """What albumentations 2 promises: one size of odd taps, one angle, float32 (H, W, C)."""

    def __init__(self, **options: Any) -> None:
        self.angle_range, self.taps = options["angle_range"], options["blur_limit"][0]
        assert options["blur_limit"] == (self.taps, self.taps)
        assert self.taps % 2 == 1
        assert 0 <= self.angle_range[0] == self.angle_range[1] <= 360
        assert (options["direction_range"], options["allow_shifted"], options["p"]) == ((0, 0), False, 1)

    def __call__(self, image: np.ndarray) -> dict[str, np.ndarray]:
        assert image.dtype == np.float32
        assert image.ndim == 3
        angle = math.radians(self.angle_range[0])
        taps = np.zeros((self.taps, self.taps), np.float32)
        for t in np.linspace(-(self.taps // 2), self.taps // 2, 2 * self.taps):
            taps[self.taps // 2 + round(t * math.sin(angle)), self.taps // 2 + round(t * math.cos(angle))] = 1
        return {"image": cv2.filter2D(image, -1, taps / taps.sum()).reshape(image.shape)}


class OlderMotionBlur:
    def __init__(self, **options: Any) -> None:
        self.blur_limit = options["blur_limit"]


@pytest.mark.parametrize(
    ("kind", "state", "measured"),
    [
        (None, "not installed", False),
        (MotionBlur, "2.0.8, measured", True),
        (OlderMotionBlur, "2.0.8, left out: its angle is random", False),
    ],
)
def test_albumentations_is_measured_where_it_can_be(
    monkeypatch: pytest.MonkeyPatch, kind: type | None, state: str, measured: bool
) -> None:
    module = ModuleType("albumentations")
    module.__spec__ = ModuleSpec("albumentations", None)
    monkeypatch.setattr(module, "MotionBlur", kind, raising=False)
    monkeypatch.setitem(sys.modules, "albumentations", module)
    monkeypatch.setattr(contenders, "version", lambda name: "2.0.8")
    if kind is None:
        monkeypatch.setattr(contenders, "find_spec", lambda name: None)
    assert contenders.albumentations_state() == state
    assert ("albumentations" in [method.name for method in contenders.contenders()]) == measured
    if measured:
        test_contenders_move_the_right_way("albumentations", -60)
        grey = one("albumentations").blur(torch.rand(1, 1, 9, 11), 3.0, (17,))
        assert grey.shape == (1, 1, 9, 11)


def test_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock of their own: as often as fits, evenly spread, one uncounted call first."""
    now, order = [0.0], []
    monkeypatch.setattr(timing.time, "perf_counter", lambda: now[0])

    def call(name: str, seconds: float) -> None:
        order.append(name)
        now[0] += seconds

    calls = {
        name: (lambda n=name, s=s: call(n, s)) for name, s in (("slow", 1.0), ("mid", 0.125), ("fast", 1e-3))
    }
    shares: list[float] = []
    times = timing.in_turns_ms(calls, fewest=2, most=8, seconds=0.5, progress=shares.append)
    assert {name: len(values) for name, values in times.items()} == {"slow": 2, "mid": 4, "fast": 8}
    assert times["mid"] == pytest.approx([125.0] * 4)
    assert order[:3] == ["slow", "mid", "fast"]
    assert "".join(name[0] for name in order[3:]) == "fmffsmffmffsmf"
    assert sum(shares) == pytest.approx(3)


def test_threads_are_given_back() -> None:
    before = torch.get_num_threads(), cv2.getNumThreads()

    def interrupted() -> None:
        with limited_threads(before[0] + 1):
            assert torch.get_num_threads() == cv2.getNumThreads() == before[0] + 1
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert (torch.get_num_threads(), cv2.getNumThreads()) == before


def test_quartiles() -> None:
    assert timing.quartiles([5, 1, 2, 3, 4]) == (2, 3, 4)


@pytest.fixture(scope="module")
def tiny() -> tuple[Bench, float]:
    shares: list[float] = []
    bench = blur.measure(TINY, 1, shares.append)
    return bench, sum(shares)


def test_bench_measures_everything(tiny: tuple[Bench, float]) -> None:
    bench, done = tiny
    assert done == pytest.approx(blur.steps(TINY))
    kinds = [row.kind for row in bench.rows]
    dense = sum(method.longest_px < 120 for method in bench.methods)
    assert dense == 3
    assert kinds.count("time") == 3 * len(METHODS) - dense
    assert kinds.count("error") == 2 * 2 * 2 * (len(METHODS) + 2)
    assert kinds.count("mtf50") == 2 * 2 * len(METHODS)
    for row in bench.rows:
        assert row.quartiles is None or row.quartiles.low <= row.value <= row.quartiles.high
    assert bench.median("kornia", 120) is None
    assert bench.ratio("auto", 120) is None
    assert bench.ratio("kornia", 6) == 1


def test_bench_knows_what_is_exact(tiny: tuple[Bench, float]) -> None:
    """The analytic response ends where the pixels' aliasing does; leaving the blur out, or Kornia, far above."""
    bench, _ = tiny
    for length in TINY.judged_px:
        best = bench.error_dn(EXACT, length)
        assert bench.error_dn("transfer", length) == pytest.approx(best, rel=0.1)
        assert 100 > bench.error_dn(NO_BLUR, length) > 2 * best > 2
        assert bench.error_dn("kornia", length) > 2 * best
        assert abs(bench.mtf50_error("transfer", length)) < 1e-4
    assert bench.mtf50_error("kornia", 6) > 0.1


def test_bench_is_written_whole(tiny: tuple[Bench, float], tmp_path: Path) -> None:
    bench, _ = tiny
    blur.write(bench, tmp_path)
    blur_view.write(bench, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["blur.csv", "blur.json", "blur.png"]
    with (tmp_path / "blur.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(bench.rows)
    assert list(rows[0]) == [
        "kind", "method", "length_px", "angle_deg", "scene", "value", "unit", "low_quartile", "high_quartile",
    ]  # fmt: skip
    for written, row in zip(rows, bench.rows, strict=True):
        assert written["method"] == row.method
        assert written["value"] == ("" if row.value is None else str(row.value))
    document = json.loads((tmp_path / "blur.json").read_text())
    assert len(document["rows"]) == len(rows)
    assert len(document["summary"]) == 3 * (len(METHODS) + 2)
    assert document["albumentations"] == contenders.albumentations_state()
    assert document["machine"]["threads"] == 1
    assert {"processor", "load"} <= set(document["machine"])
    assert {"torch", "kornia", "numpy"} <= set(document["machine"]["versions"])
    (auto,) = (e for e in document["summary"] if (e["method"], e["length_px"]) == ("auto", 6))
    assert auto["time_to_kornia"] == pytest.approx(bench.median("auto", 6) / bench.median("kornia", 6))
    picture = cv2.imread(str(tmp_path / "blur.png"))
    assert picture.shape[0] > 800
    assert picture.std() > 10


def test_chart_has_a_panel_for_each_common_length(tiny: tuple[Bench, float]) -> None:
    """Panels first, then time and error over the length; all of them can be drawn."""
    figure = blur_view.chart(tiny[0])
    figure.draw_without_rendering()
    assert [axes.get_title().split(":")[0] for axes in figure.axes] == ["1.5 px", "6 px", "", ""]
    apart = blur_view.chart(replace(tiny[0], extent=replace(TINY, timed_px=(120,))))
    apart.draw_without_rendering()
    assert len(apart.axes) == 2


def test_summary_of_rows() -> None:
    """RMS of the errors, the MTF50 farthest from the truth, none where one angle never halves."""
    rows = [Row("error", "auto", 6, angle, "text", dn, "DN") for angle, dn in ((0, 3.0), (45, 4.0))]
    rows += [
        Row("mtf50", "auto", 6, angle, None, error, "relative")
        for angle, error in ((0, 0.1), (17, 0.2), (45, 0))
    ]
    rows += [
        Row("mtf50", "kernel", 6, angle, None, error, "relative") for angle, error in ((0, 0.1), (17, None))
    ]
    bench = Bench(rows, Extent((6,), (6,)), contenders.contenders(), {})
    assert bench.error_dn("auto", 6) == pytest.approx(math.sqrt(12.5))
    assert bench.mtf50_error("auto", 6) == 0.2
    assert bench.mtf50_error("kernel", 6) is None
    assert bench.error_dn("kernel", 6) is None
    assert bench.median("auto", 6) is None


def test_losses_are_told() -> None:
    def measured(name: str, ms: float, dn: float) -> list[Row]:
        time = Row("time", name, 6, None, None, ms, "ms/megapixel", Quartiles(ms, ms, ms))
        return [time, Row("error", name, 6, 0, "text", dn, "DN"), Row("error", name, 6, 45, "text", dn, "DN")]

    def bench(*rows: list[Row]) -> Bench:
        return Bench([row for each in rows for row in each], Extent((6,), (6,)), contenders.contenders(), {})

    auto = measured("auto", 4, 2)
    assert bench(auto, measured("opencv", 3.95, 2.1), measured("tiles", 1, 1)).losses() == []
    assert bench(auto, measured("opencv", 1, 3), measured("kornia", 8, 1.8)).losses() == [
        "6 px: kornia has 2.00 of auto's time, 0.90 of auto's error",
        "6 px: opencv has 0.25 of auto's time, 1.50 of auto's error",
    ]
    unjudged = bench(auto[:1], measured("opencv", 1, 3)[:1])
    assert unjudged.losses() == ["6 px: opencv has 0.25 of auto's time"]


@pytest.mark.slow
def test_command(tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blur, "QUICK", TINY)
    folder = tmp_path / "new" / "bench"
    assert main(["bench", "blur", "--quick", "--threads", "1", "-o", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "Time, ms per megapixel" in shown
    assert all(name in shown for name in (*METHODS, EXACT, NO_BLUR))
    assert f"open {folder / 'blur.png'}" in shown.replace("\n", "")
    assert sorted(path.name for path in folder.iterdir()) == ["blur.csv", "blur.json", "blur.png"]
    assert main(["bench", "blur", "--quick", "--threads", "1", "-o", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((folder / "blur.json").read_text())


def test_quick_is_a_part_of_the_whole() -> None:
    for name in ("timed_px", "judged_px", "angles_deg", "scenes"):
        assert set(getattr(blur.QUICK, name)) < set(getattr(blur.FULL, name)), name


def test_a_peer_that_does_not_start_is_said_and_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "albumentations.py").write_text("raise KeyError('numpy.uint32')", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "albumentations", raising=False)
    assert "does not start here: KeyError" in contenders.albumentations_state()
    assert "albumentations" not in [method.name for method in contenders.contenders()]
