"""The studies among the examples: items of the paper with made-up measurements and known verdicts, ranks of metrics
against SciPy and closed forms, and both scripts as a user runs them."""

import csv
import json
import math

import matched_filter
import numpy as np
import paper
import paper_items
import pytest
import which_metric
from blurnoise_eval.measure.charts import TILT_DEG
from commands import main
from paper_checks import Check, Figure, Item, near
from paper_measurements import Measurements, NotRun
from scipy import stats
from scipy.optimize import brentq

from blurnoise.blur import convolution
from blurnoise.camera import Camera
from blurnoise.metrics.values import Estimate

ITEM = {item.name: item for item in paper_items.ITEMS}
METRICS = ("mtf50_x", "patch_snr_dark", "patch_snr_bright", "edge_snr_db", "sic_square", "neq_integral")


# --- the paper ---


def test_formulas_give_the_papers_numbers():
    blurs_px = ["3.9380", "1.9691", "0.9845", "1.9691", "3.9374", "9.8435", "19.6751", "39.3502", "19.6869"]
    table, _ = ITEM["table-2"].run(Measurements())
    assert [row["result"] for row in table] == [f"{blur} px" for blur in blurs_px]
    (quanta,), _ = ITEM["quanta"].run(Measurements())
    assert quanta["result"] == "5774.6 quanta"


@pytest.mark.slow
def test_mtf50_over_speed_is_that_of_the_closed_form():
    """Within 1 %, or its 95 % interval widened as Bonferroni does for seven speeds."""
    numbers = Measurements()[paper_items.OVER_SPEED]
    assert closed_mtf50(60.0) == pytest.approx(0.603355 / 60, rel=2e-3)  # the motion alone
    estimates = [numbers["mtf50_x", 30.0, speed] for speed in paper_items.OVER_SPEED.speeds_px_s]
    truth = [closed_mtf50(30e-3 * speed) for speed in paper_items.OVER_SPEED.speeds_px_s]
    assert near("", "", estimates, truth, "", 0.01).agrees
    assert not near("", "", estimates, [1.05 * mtf50 for mtf50 in truth], "", 0.01).agrees


def closed_mtf50(length_px):
    """MTF50, cycles/px, of the lin2024 camera across an edge at the charts' angle from vertical, moved along x.

    The chart's pixel, the areas of the camera's disc in the pixels, and uniform motion.
    """
    areas = convolution.disc(Camera.preset("lin2024").lens.defocus_radius_px)
    at = np.arange(len(areas)) - len(areas) // 2

    def above_half(f):
        fx, fy = f * math.cos(math.radians(TILT_DEG)), f * math.sin(math.radians(TILT_DEG))
        disc = (areas * np.cos(2 * math.pi * (at * fx + at[:, None] * fy))).sum()
        return float(np.sinc(fx) * np.sinc(fy) * disc * np.sinc(fx * length_px)) - 0.5

    return float(brentq(above_half, 1e-4, min(0.4, 0.9 / max(length_px, 1e-9))))


@pytest.mark.parametrize(
    ("value", "low", "agrees"),
    [(1.005, math.nan, True), (1.02, 0.98, True), (1.02, 1.004, True), (1.02, 1.01, False)],
)
def test_a_number_may_miss_within_its_interval(value, low, agrees):
    """Widened for seven numbers, 2.69 / 1.96 times: one of seven intervals of 95 % misses in three runs of ten."""
    assert near("", "", [Estimate(10 * value, 10 * low, 10.5)] * 7, [10.0] * 7, "", 0.01).agrees == agrees


def test_verdicts_and_what_was_not_run_are_in_the_table(tmp_path, monkeypatch, capsys):
    def two(measurements):
        yield Check("a statement", "1 px", "1 px", "equal", True)
        yield Check("a statement", "1 px", "2 px", "equal", False)
        lines = {"a line": {1.0: 0.2, 10.0: 0.4}}
        yield Figure("Drawn", "Exposure / ms", "Score", lines, [(2.0, 5.0, "range")])

    def none(measurements):
        raise NotRun("needs a network")

    items = [Item("a", "Title", "Figure 1", "", two), Item("b", "Title", "Figure 2", "", none)]
    monkeypatch.setattr(paper, "ITEMS", items)
    assert paper.main(["-o", str(tmp_path)]) == 1
    assert "1 agrees; 1 differs; 1 not run" in capsys.readouterr().out
    with (tmp_path / "paper.csv").open(newline="") as file:
        rows = [(row["item"], row["result"], row["verdict"]) for row in csv.DictReader(file)]
    assert rows == [("a", "1 px", "agrees"), ("a", "2 px", "differs"), ("b", "needs a network", "not run")]
    assert [path.name for path in tmp_path.glob("*.png")] == ["a.png"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "verdicts"),
    [
        (("mtf50", "mtf50-dx", "patch-snr", "edge-snr", "clipping", "sic", "neq"), {"agrees"}),
        (("detection", "maps"), {"agrees", "differs"}),  # a detector that bears more blur
        (("ocr-dx",), {"agrees"}),
    ],
)
def test_the_paper_agrees(tmp_path, names, verdicts):
    if "ocr-dx" in names:
        pytest.importorskip("rapidocr")
    only = [word for name in names for word in ("--only", name)]
    assert paper.main(["-o", str(tmp_path), "--quick", *only]) == int("differs" in verdicts)
    with (tmp_path / "paper.csv").open(newline="") as file:
        assert {row["verdict"] for row in csv.DictReader(file)} == verdicts


# --- which metric ---


LIGHT, MOTION = (stops.ravel() for stops in np.meshgrid(np.arange(-10.0, 0), np.arange(-1.0, 5)))
PLACE = np.stack([LIGHT, MOTION])


def scores_of(y, pictures=12):
    """The mean, then that without each picture, from which the pictures depart."""
    others = 0.02 * np.random.default_rng(0).normal(size=(pictures, len(y)))
    return np.vstack([y, y + others])


def test_a_metric_of_light_alone_ranks_right_along_light():
    """Over both axes it misses all that motion does; the score itself misses nothing."""
    y = LIGHT / 20 - MOTION / 5
    light, itself = (which_metric.rank(m, scores_of(y), PLACE) for m in (LIGHT, y**3))
    assert light["along_light"] == pytest.approx(1)
    assert light["spearman"] == pytest.approx(stats.spearmanr(LIGHT, y).statistic)
    assert [itself["spearman"], itself["along_motion"]] == pytest.approx([1, 1])


def test_the_interval_is_the_jackknifes_and_needs_eight_pictures():
    y, m = LIGHT / 20 - MOTION / 5, LIGHT + 0.3 * MOTION
    twelve, seven = (which_metric.rank(m, scores_of(y, pictures), PLACE) for pictures in (12, 7))
    without = [stats.spearmanr(m, scores).statistic for scores in scores_of(y)[1:]]
    error = np.sqrt(11 / 12 * np.sum((without - np.mean(without)) ** 2))  # Efron and Tibshirani, 11.5
    assert twelve["high"] - twelve["low"] == pytest.approx(2 * stats.t.ppf(0.975, 11) * error)
    assert "low" not in seven


@pytest.mark.parametrize(("count", "ranked"), [(19, False), (20, True)])
def test_few_nodes_have_no_rank(count, ranked):
    y = np.linspace(0, 1, count)
    assert ("spearman" in which_metric.rank(y, scores_of(y), PLACE[:, :count])) == ranked


def test_the_sentence_names_what_ranks_best_and_what_misleads():
    rank = {"model": "m", "group": "signs", "n_nodes": 40}
    best = which_metric.Rank(**rank, metric="ssim", known=1.0, spearman=0.9, low=0.8, high=1.0)
    rarely = which_metric.Rank(**rank, metric="sic_square", known=0.3, spearman=0.99)
    misleads = which_metric.Rank(**rank, metric="cta", known=1.0, spearman=0.4, along_light=0.95)
    assert which_metric.sentence([misleads, rarely, best]) == (
        "SSIM ranks conditions best (rank correlation 0.90 (0.80 to 1.00); available at 100% of 40 nodes). "
        "CTA misleads: 0.95 along light alone, 0.40 over both."
    )
    assert which_metric.sentence([rarely]).startswith("cannot tell which metric ranks conditions")


@pytest.mark.slow
def test_a_run_has_its_ranks(tmp_path, capsys):
    """Of the matched filter on small rendered signs. Equal light, motion and gain are one node: of the 24 conditions
    two pairs are, as 1 lux x 30 ms at rest is 30 lux x 1 ms."""
    model = matched_filter.build(tmp_path / "small.onnx", sizes_px=(100, 50, 32), input_px=160)
    plan, run, out = tmp_path / "plan.yaml", tmp_path / "run", tmp_path / "maps"
    plan.write_text("refine: false\n", encoding="utf-8")
    grid = ["--exposure-ms", "1,5,30,60", "--lux", "1,30,900", "--dx", "0,300", "--gain", "0"]
    words = ["--model", model, *grid, "--limit", "2", "--threads", "1", "--plan", plan, "-o", run]
    assert main(["sweep", *words]) == 0
    capsys.readouterr()
    which_metric.main([str(run), "-o", str(out)])
    assert "ranks conditions" in capsys.readouterr().out
    with (out / "maps.csv").open(encoding="utf-8") as file:
        assert {row["n_nodes"] for row in csv.DictReader(file)} == {"22"}
    assert {path.suffix for path in out.iterdir()} == {".csv", ".png"}

    conditions = run / "conditions.json"
    about = json.loads(conditions.read_text(encoding="utf-8"))
    conditions.write_text(json.dumps({**about, "trajectory": "shake:6"}), encoding="utf-8")
    with pytest.raises(SystemExit):
        which_metric.main([str(run), "-o", str(out)])
    assert "trajectory: charts need one straight motion" in capsys.readouterr().err
