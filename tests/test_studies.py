"""The study of metrics among the examples: ranks against SciPy and closed forms, and the script as a user runs it."""

import csv
import json

import matched_filter
import numpy as np
import pytest
import which_metric
from commands import main
from scipy import stats

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
