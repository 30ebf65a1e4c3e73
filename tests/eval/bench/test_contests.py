"""Contests: contenders timed in turns and held against a truth, tables and charts, and each contest's own truth."""

import csv
import importlib
import json
import math
import subprocess
import sys
from functools import partial

import cv2
import numpy as np
import pytest
from blurnoise_eval.bench import augmentations, chain, contest, denoise, glare, motion
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_models.detector import STOP_SIGN
from commands import main

from blurnoise import motion_blur

Output = pytest.CaptureFixture[str]


def made(clock):
    """Ours takes 2 ms a picture and is off by 1, another 1 ms and 0.5, a third 4 ms and 3."""

    def work(seconds, answer):
        clock[0] += seconds
        return answer

    ways = [
        Contender("ours", partial(work, 0.02, 1.0), True),
        Contender("rival", partial(work, 0.01, 0.5)),
        Contender("slow", partial(work, 0.04, 3.0)),
    ]
    case = Case("a case", ways, lambda answer: answer, units=10.0)
    return Contest("made", "Made up", [lambda: case, lambda: Case("no truth", ways)], error_unit="DN")


@pytest.fixture
def result(monkeypatch):
    clock, told = [0.0], list[float]()
    monkeypatch.setattr(contest.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(contest.time, "process_time", lambda: 2 * clock[0])  # two threads
    found = contest.run(made(clock), threads=1, progress=told.append)
    assert sum(told) == pytest.approx(2)
    return found


def test_a_contender_has_its_time_and_its_error(result):
    ours, rival, slow, *others = result.rows
    assert [ours.time, rival.time, slow.time] == pytest.approx([2.0, 1.0, 4.0])
    assert [ours.to_first, rival.to_first, slow.to_first] == pytest.approx([1.0, 0.5, 2.0])
    assert [rival.cpu, rival.cpu_to_first] == pytest.approx([2.0, 0.5])
    assert [row.error for row in result.rows] == [1.0, 0.5, 3.0, None, None, None]
    assert others[0].time == pytest.approx(20.0)  # not divided


def test_table_json_and_chart_are_written(result, tmp_path):
    result.write(tmp_path)
    with (tmp_path / "made.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["contender"] for row in rows] == ["ours", "rival", "slow"] * 2
    assert len(json.loads((tmp_path / "made.json").read_text())["rows"]) == 6
    assert cv2.imread(str(tmp_path / "made.png")).std() > 10
    figure = result.chart()
    assert [axes.get_title(loc="left") for axes in figure.axes[:2]] == ["a case", "no truth"]
    assert figure.axes[0].get_yscale() == "log"
    legend = figure.axes[2].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["ours", "rival", "slow"]


def test_time_is_drawn_along_what_cases_differ_in():
    """CPU times of one case are a line over its places, and an error may be missing."""

    def at(place):
        ways = [Contender("ours", lambda: None, True), Contender("rival", lambda: None)]
        return Case("a panel", ways, at=place)

    made_up = Contest("made", "Made up", [partial(at, 3.0), partial(at, 9.0)], along="length, px")
    rows = [
        contest.ContestRow("a panel", name, name == "ours", 1.0, time, 9.0, 1.0, cpu, 1.0, None, place)
        for place, name, time, cpu in ((3, "ours", 5.0, 2.0), (3, "rival", 5.0, 1.0), (9, "ours", 5.0, 4.0))
    ]
    result = contest.Result(made_up, rows, {"threads": 1, "processor": "one"})
    (axes,) = result.chart().axes
    lines = {str(line.get_label()): np.asarray(line.get_xydata()).tolist() for line in axes.lines}
    assert lines == {"ours": [[3.0, 2.0], [9.0, 4.0]], "rival": [[3.0, 1.0]]}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("length, px", "CPU ms")
    assert "a panel, 9" in "".join(result.table())
    assert [row.at for row in contest.run(made_up, quick=True).rows] == [3.0, 3.0, 9.0, 9.0]


def test_cpu_time_has_that_of_processes_that_ended():
    before = contest._cpu_s()
    subprocess.run([sys.executable, "-c", "sum(range(10_000_000))"], check=True)
    assert contest._cpu_s() - before > 0.05


def test_the_chain_is_within_rounding_of_the_full_model():
    """In single precision; a camera whose stages were left out would be off by more than 0.01 DN."""
    case = chain.moved("some", (6.0, 2.0), (1, 3, 40, 56))
    assert case.error is not None
    errors = {each.name: case.error(each.call()) for each in case.contenders}
    assert errors["torch.randn"] is None
    assert errors["part: blur"] is None
    assert 0 < errors["simulate, tolerance_dn = 0.1"] < 0.01


def test_packages_of_a_folder_come_first_and_go_again(tmp_path):
    """Another module called albumentations is imported, and the own one is back afterwards."""
    own = sys.modules.get("albumentations")
    (tmp_path / "albumentations.py").write_text("__version__ = '9.9.9'\n")
    with augmentations._first_from(tmp_path):
        assert importlib.import_module("albumentations").__version__ == "9.9.9"
    assert sys.modules.get("albumentations") is own
    assert str(tmp_path) not in sys.path


def test_truth_of_straight_motion_is_sinc():
    """A sinusoid of period 16 px that moves 10 px keeps sinc(10 / 16) of its contrast, but for the pixel's area."""
    x = (np.arange(96 * motion.FINE) + 0.5) / motion.FINE - 0.5
    row = (0.5 + 0.4 * np.cos(2 * np.pi * x / 16)).astype(np.float32)
    fine = np.repeat(np.repeat(row[None], 32 * motion.FINE, 0)[..., None], 3, 2)
    times = (((np.arange(128) + 0.5) / 128) - 0.5)[:, None, None]
    seen = motion.truth(fine, lambda x, y, time: (x - 10 * time, y + 0 * time), times)[16, 32:64, 0]
    sharp = motion.pixels(fine)[16, 32:64, 0]
    assert np.ptp(seen) / np.ptp(sharp) == pytest.approx(np.sinc(10 / 16), abs=0.002)
    assert int(np.argmax(seen)) == int(np.argmax(sharp))


def test_ours_are_exact_and_others_are_not(monkeypatch):
    """6 px: below 1 DN of error against the naive ways' more; a motion in the wrong direction is far off."""
    monkeypatch.setattr(motion, "HEIGHT", 160)
    monkeypatch.setattr(motion, "WIDTH", 200)
    case = motion.straight(6.0)
    assert case.error is not None
    errors = {each.name: case.error(each.call()) for each in case.contenders}
    assert errors["motion_blur"] < 1
    assert min(error for name, error in errors.items() if not name.startswith("motion_blur")) > 2.5
    wrong = motion_blur(motion.picture(), (6 * math.cos(0.3), -6 * math.sin(0.3)))
    assert case.error(wrong) > 8


def test_the_truth_of_halos_has_their_light_and_their_shape():
    """1 / (2 pi ln 64 r^2) around a lamp in the middle, where neither end is near."""
    light = np.zeros((241, 261, 1))
    light[120, 130] = 1.0
    seen = glare.by_kernel(light, 400)[..., 0]
    assert seen.sum() == pytest.approx(1, abs=glare.HALO_SHARE * 0.02)  # 1.5 % of a halo lies beyond 400 px
    mirrored = seen[120, 148] - seen[120, 168]  # 18 and 38 px: what is mirrored is nearly even, and cancels
    expected = glare.HALO_SHARE / (2 * np.pi * np.log(64)) * (18**-2 - 38**-2)
    assert mirrored == pytest.approx(expected, rel=0.05)


@pytest.mark.slow  # the kernel has 1537 x 1537 px
def test_our_halos_are_exact_and_others_are_not():
    case = glare.lamps((60, 80))
    assert case.error is not None
    ours, _, pyramid, _ = case.contenders
    assert case.error(ours.call()) < 0.01
    assert case.error(pyramid.call()) > 10


def test_noise_reduction_is_exact_and_others_are_not():
    """To what rounding to 8 bits alone is off, 1 / sqrt(12) DN; a bright pixel keeps the share of its own weight."""
    spot = np.full((9, 9), 100.0)
    spot[4, 4] = 130.0
    near = 4 * sum(math.exp(-distance2 / 4.5) for distance2 in (1, 2, 4)) * math.exp(-(30**2) / 800)
    assert denoise.truth(spot, 20.0)[4, 4] == pytest.approx(100 + 30 / (1 + near))
    case = denoise.noisy(80)
    assert case.error is not None
    errors = {each.name: case.error(each.call()) for each in case.contenders}
    assert errors["blurnoise"] < 0.30
    assert errors["cv2.bilateralFilter, 8 bits"] > 0.5
    assert errors["Kornia, bilateral_blur"] > 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "options", "shown"),
    [
        ("blur", [], "Kornia, nearest odd length"),
        ("motion", [], "cv2.filter2D by the path"),
        ("glare", [], "pyramid of averages"),
        ("denoise", [], "Kornia, bilateral_blur"),
        ("augment", [], "RandomExposure, p = 0.5"),
        ("chain", [], "part: normal numbers"),
        ("lengths", [], "tensors, 3"),
        ("loaders", [], "RandomExposure of tensors"),
        ("sweep", ["--model", str(STOP_SIGN)], "bare onnxruntime"),
    ],
)
def test_command(tmp_path, capsys, what, options, shown):
    assert main(["bench", what, "--quick", "--threads", "1", "-o", str(tmp_path), *options]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert shown in out
    assert f"chart: {tmp_path / what}.png" in out
    assert {path.name for path in tmp_path.glob("[!.]*")} == {
        f"{what}.{kind}" for kind in ("csv", "json", "png")
    }
