"""Maps of runs: ranks of metrics against SciPy and by hand, what is said of them, and the command from end to end."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import pytest
from blurnoise_eval.maps import figures, maps
from blurnoise_eval.maps.maps import Map, Maps, Rank, map_of, sentences, write
from blurnoise_eval.quality.measure import METRICS
from commands import Output, main
from made_maps import KEEP, exact, plane, scores_at
from made_tables import table
from scipy import stats

PLANE = plane()
U, W = PLANE.places.T
N = len(PLANE)
RNG = np.random.default_rng(1)


def ranks(metrics: dict[str, Any], values: Any, clusters: int = 12) -> tuple[Rank, ...]:
    return map_of(PLANE, metrics, scores_at(PLANE, values, clusters), KEEP.score).ranks


def made(**grid: Any) -> Maps:
    """A detector that needs light and dislikes blur, before sixteen metrics that know all, but the second light
    alone, and the third nothing."""
    of = plane(**grid)
    u, w = of.places.T
    values = exact(1 / (1 + np.exp(-u)) / (1 + np.exp(3 * w - 3)))
    metrics = dict.fromkeys((metric.name for metric in METRICS), values)
    metrics |= {METRICS[0].name: values**2, METRICS[1].name: u}
    metrics |= {METRICS[2].name: np.full(len(of), np.nan)}
    return Maps(KEEP, of, metrics, (map_of(of, metrics, scores_at(of, values), KEEP.score),))


@pytest.mark.parametrize("digits", [1, 6])  # with ties, and without
def test_rank_correlation_is_scipys(digits: int) -> None:
    m, y = RNG.normal(size=40).round(digits), RNG.normal(size=(3, 40)).round(digits)
    y[1] += m
    expected = [stats.spearmanr(m, each).statistic for each in y]
    assert maps.spearman(m, y) == pytest.approx(expected, abs=1e-12)


def test_what_never_changes_has_no_rank() -> None:
    m = np.arange(30.0)
    assert np.isnan(maps.spearman(m, np.ones(30)))
    assert np.isnan(maps.spearman(np.ones(30), m))
    assert np.isnan(maps.spearman(m, np.where(m == 3, np.nan, m)))


def test_clusters_are_left_out_in_turn() -> None:
    """By hand, of three clusters at two nodes: the second cluster is at neither."""
    sums, counts = (
        np.array([[[1.0], [0]], [[0], [0]], [[2], [3]]]),
        np.array([[[2.0], [0]], [[0], [0]], [[4], [4]]]),
    )
    found = maps.all_and_each_left_out(table(sums, (0.01, 0.02), counts=counts))
    assert found == pytest.approx(np.array([[0.5, 0.75], [0.5, 0.75], [0.5, np.nan]]), nan_ok=True)


def test_a_metric_of_light_alone_ranks_right_along_light() -> None:
    """Over both axes it misses all that blur does; the score itself misses nothing."""
    y = exact((U - U.min()) / np.ptp(U) * 0.5 + 0.5 * (W.max() - W) / np.ptp(W))
    light, itself = ranks({"light": U, "itself": y**3}, y)
    assert light.along_light == pytest.approx(1)
    assert light.along[1] == "light"
    assert light.spearman == pytest.approx(stats.spearmanr(U, y).statistic)
    assert itself.spearman == pytest.approx(1)
    at_rest = W.min() == W
    assert maps.along_lines(U[at_rest], -y[at_rest], W[at_rest]) == pytest.approx(-1)


def test_the_interval_is_the_jackknifes_and_needs_eight_clusters() -> None:
    y = np.clip(U, -3, 3) / 3 - W / 9
    m = {"light": U + 0.3 * W}
    (twelve,), (seven,) = ranks(m, y), ranks(m, y, 7)
    _, *without = maps.spearman(m["light"], maps.all_and_each_left_out(scores_at(PLANE, y)))
    error = np.sqrt(11 / 12 * np.sum((without - np.mean(without)) ** 2))  # Efron and Tibshirani, 11.5
    assert twelve.low is not None
    assert twelve.high is not None
    assert twelve.high - twelve.low == pytest.approx(2 * stats.t.ppf(0.975, 11) * error)
    assert (seven.low, seven.high) == (None, None)


def test_few_nodes_have_no_rank_and_the_share_is_of_those_with_a_score() -> None:
    y = exact(U / 10 + 1)
    few = np.where(np.arange(N) < maps.FEWEST_NODES - 1, U, np.nan)
    enough = np.where(np.arange(N) < maps.FEWEST_NODES, U, np.nan)
    none, some = ranks({"few": few, "enough": enough}, y)
    assert none.spearman is None
    assert none.share_told == (maps.FEWEST_NODES - 1) / N
    assert some.spearman == pytest.approx(1)
    (half,) = ranks({"light": U}, np.where(np.arange(N) < 30, y, np.nan))
    assert (half.n_nodes, half.share_told) == (30, 1.0)


def test_the_answer_opens_with_what_ranks_best_and_what_misleads() -> None:
    (text,) = sentences(made())
    assert text.startswith("m, signs: MTF50 across x ranks conditions best (rank correlation 1.00")
    assert text.endswith("MTF50 across y misleads: 1.00 along light alone, 0.36 over both.")
    (text,) = sentences(made(exposures_s=(0.01,)))
    assert text.endswith(
        "cannot tell which metric ranks conditions: none is known at 20 and half of the nodes."
    )


def test_a_metric_that_may_not_rank_at_all_is_not_called_best() -> None:
    table = scores_at(PLANE, U)
    unsure = [
        Rank("m", metric.name, "", "signs", N, 0.3, -0.1 - 0.01 * place, 0.7, 1.0)
        for place, metric in enumerate(METRICS)
    ]
    text, other = sentences(Maps(KEEP, PLANE, {}, (Map(table, tuple(unsure)),), ("m, small",)))
    assert other == "m, small: cannot tell; its targets score too little in the original pictures."
    assert "no metric surely ranks; the best is MTF50 across x (rank correlation 0.30 (-0.10" in text


def test_tables_are_written_whole(tmp_path: Path) -> None:
    found = made()
    write(found, tmp_path)
    rows = list(csv.DictReader((tmp_path / "maps.csv").open(encoding="utf-8")))
    assert [row["metric"] for row in rows] == [metric.name for metric in METRICS]
    columns = "model metric score group n_nodes spearman low high share_told along_light along_blur"
    assert list(rows[0]) == columns.split()
    assert (rows[2]["spearman"], rows[2]["share_told"]) == ("", "0.0")
    nodes = list(csv.DictReader((tmp_path / "nodes.csv").open(encoding="utf-8")))
    assert len(nodes) == len(found.nodes)
    assert list(nodes[0])[:4] == ["light_lux_s", "blur_px", "gain_db", "mtf50_x"]


@pytest.mark.slow
@pytest.mark.parametrize("grid", [{}, {"speeds": (0.0,)}, {"exposures_s": (0.01,)}])
def test_figures_of_any_grid(tmp_path: Path, grid: dict[str, Any]) -> None:
    figures.write(made(**grid), tmp_path)
    written = sorted(tmp_path.iterdir())
    assert [path.name for path in written] == ["map-m.png", "scatter-m-signs.png"]
    assert all(path.stat().st_size > 10_000 for path in written)


@pytest.mark.slow
@pytest.mark.parametrize(("lights", "nodes"), [("1,30,900", 24), ("50", 8)])
def test_the_command(tmp_path: Path, capsys: Output, lights: str, nodes: int) -> None:
    """Of the matched filter before one small rendered sign; with one light there are too few nodes for ranks."""
    model = matched_filter.build(tmp_path / "small.onnx", sizes_px=(100, 50, 32), input_px=160)
    plan = tmp_path / "plan.yaml"
    plan.write_text("refine: false\n", encoding="utf-8")
    run, out = tmp_path / "run", tmp_path / "maps"
    grid = ["--exposure-ms", "1,4,16,64", "--lux", lights, "--dx", "0,300"]
    words = ["--limit", "2", "--plan", str(plan), "--threads", "1", "-o", str(run)]
    assert main(["sweep", "--model", str(model), *grid, *words]) == 0
    capsys.readouterr()
    assert main(["maps", str(run), "-o", str(out), "--threads", "1"]) == 0
    shown = capsys.readouterr().out
    assert ("ranks conditions best" in shown) == (nodes >= maps.FEWEST_NODES)
    rows = list(csv.DictReader((out / "maps.csv").open(encoding="utf-8")))
    assert {(row["score"], row["n_nodes"]) for row in rows} == {("target_confidence", str(nodes))}
    every = list(csv.DictReader((out / "nodes.csv").open(encoding="utf-8")))
    assert len(every) == nodes


def test_a_folder_without_a_run_is_refused(tmp_path: Path, capsys: Output) -> None:
    assert main(["maps", str(tmp_path), "-o", str(tmp_path / "maps")]) == 2
    assert capsys.readouterr().err.startswith("blurnoise: error: run = ")
    assert not (tmp_path / "maps").exists()
