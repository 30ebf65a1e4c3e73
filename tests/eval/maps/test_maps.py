"""Maps of runs: nodes that are one experiment, ranks of metrics against SciPy and by hand, the command."""

import csv
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import matched_filter
import numpy as np
import pytest
from blurnoise_eval.maps import maps
from blurnoise_eval.maps.maps import Maps, map_of, sentences
from blurnoise_eval.maps.nodes import nodes_at, nodes_of
from blurnoise_eval.quality.measure import METRICS
from blurnoise_eval.store.store import StoreError
from commands import main
from made_planes import KEEP, exact, plane, row, scores_at
from made_tables import table
from plans import IMX250
from plans import plan as swept
from scipy import stats

PLANE = plane()
U, W = PLANE.places.T
RNG = np.random.default_rng(1)


def ranks(metrics, values, clusters=12):
    return map_of(PLANE, metrics, scores_at(PLANE, values, clusters), KEEP.score).ranks


def made(**grid):
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
def test_rank_correlation_is_scipys(digits):
    m, y = RNG.normal(size=40).round(digits), RNG.normal(size=(3, 40)).round(digits)
    y[1] += m
    expected = [stats.spearmanr(m, each).statistic for each in y]
    assert maps.spearman(m, y) == pytest.approx(expected, abs=1e-12)


def test_clusters_are_left_out_in_turn():
    """By hand, of three clusters at two nodes: the second cluster is at neither."""
    sums, counts = (
        np.array([[[1.0], [0]], [[0], [0]], [[2], [3]]]),
        np.array([[[2.0], [0]], [[0], [0]], [[4], [4]]]),
    )
    found = maps.all_and_each_left_out(table(sums, (0.01, 0.02), counts=counts))
    assert found == pytest.approx(np.array([[0.5, 0.75], [0.5, 0.75], [0.5, np.nan]]), nan_ok=True)


def test_a_metric_of_light_alone_ranks_right_along_light():
    """Over both axes it misses all that blur does; the score itself misses nothing."""
    y = exact((U - U.min()) / np.ptp(U) * 0.5 + 0.5 * (W.max() - W) / np.ptp(W))
    light, itself = ranks({"light": U, "itself": y**3}, y)
    assert light.along_light == pytest.approx(1)
    assert light.along[1] == "light"
    assert light.spearman == pytest.approx(stats.spearmanr(U, y).statistic)
    assert itself.spearman == pytest.approx(1)
    at_rest = W.min() == W
    assert maps.along_lines(U[at_rest], -y[at_rest], W[at_rest]) == pytest.approx(-1)


def test_the_interval_is_the_jackknifes_and_needs_eight_clusters():
    y = np.clip(U, -3, 3) / 3 - W / 9
    m = {"light": U + 0.3 * W}
    (twelve,), (seven,) = ranks(m, y), ranks(m, y, 7)
    _, *without = maps.spearman(m["light"], maps.all_and_each_left_out(scores_at(PLANE, y)))
    error = np.sqrt(11 / 12 * np.sum((without - np.mean(without)) ** 2))  # Efron and Tibshirani, 11.5
    assert twelve.high - twelve.low == pytest.approx(2 * stats.t.ppf(0.975, 11) * error)
    assert (seven.low, seven.high) == (None, None)


def test_the_answer_opens_with_what_ranks_best_and_what_misleads():
    (text,) = sentences(made())
    assert text.startswith("m, signs: MTF50 across x ranks conditions best (rank correlation 1.00")
    assert text.endswith("MTF50 across y misleads: 1.00 along light alone, 0.36 over both.")
    (text,) = sentences(made(exposures_s=(0.01,)))
    assert text.endswith(
        "cannot tell which metric ranks conditions; none is known at 20 and half of the nodes."
    )


@pytest.mark.slow
@pytest.mark.parametrize(("lights", "nodes"), [("1,30,900", 24), ("50", 8)])
def test_the_command(tmp_path, capsys, lights, nodes):
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


def nodes(*rows, planned=(), **figures):
    return len(nodes_at(rows, IMX250.with_figures(**figures), planned))  # type: ignore[arg-type]


def test_equal_light_and_motion_are_one_experiment():
    found = nodes_at([row(0.01, 50.0, 300.0), row(0.02, 25.0, 150.0), row(0.02, 25.0)], IMX250, ())
    assert list(found.node_at.values()) == [0, 0, 1]
    assert found.places[:, 0] == pytest.approx([-1, -1])
    assert found.places[:, 1] == pytest.approx([np.log2(3), -1])  # at rest: half a pixel
    assert {name: values[0] for name, values in found.figures.items()} == pytest.approx(
        {"light_lux_s": 0.5, "blur_px": 3.0, "gain_db": 0.0}
    )


PAIR = row(0.01, 50.0), row(0.05, 10.0)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ((row(0.01, 50.0, 300.0), row(0.01, 50.0, -300.0), row(0.01, 50.0, -300.0, -0.0)), 1),
        ((row(0.01, 50.0, 300.0), row(0.01, 50.0, 0.0, 300.0)), 2),
        ((row(0.01, 50.0, 300.0, 40.0), row(0.01, 50.0, 300.0, -40.0)), 2),
        ((row(0.01, 50.0), row(0.02, 25.0, applied_gain_db=12.0)), 2),  # set by the camera, too
        ((row(0.01, 50.0, applied_gain_db=11.98), row(0.02, 25.0, applied_gain_db=12.01)), 1),
        ((row(0.01, 0.0),), 0),
        (PAIR, 1),
    ],
)
def test_conditions_and_their_nodes(rows, expected):
    assert nodes(*rows) == expected


def test_dark_charge_that_counts_separates_exposures():
    assert nodes(*PAIR, dark_current_e_s=1000.0) == 2


def test_conditions_of_one_node_are_summed():
    """50 lux x 10 ms is 25 lux x 20 ms; picture c is only in the second light; nothing was measured at 1 ms."""
    at = nodes_at([row(0.01, 50.0), row(0.02, 25.0), row(0.04, 25.0), row(0.001, 25.0)], IMX250, ())
    sums = np.array([[[1.0], [0.0], [0.0]], [[0.2], [0.4], [0.9]], [[0.0], [0.6], [0.0]]])
    counts = np.array([[[2.0], [0.0], [0.0]], [[1.0], [1.0], [1.0]], [[0.0], [3.0], [0.0]]])
    of_lights = table(sums, [0.01, 0.02, 0.04], counts=counts, kept=True)
    of_lights.conditions["illuminance_lux"][1:] = 25.0
    assert at.group(of_lights).mean == pytest.approx([2.2 / 7, 0.9, np.nan], nan_ok=True)


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        (swept((0.01,), (5.0,), moves=(0.0, 1.0)), "targets or background move separately"),
        (swept((0.01,), (5.0,), ego_speed_m_s=(10.0,)), "its camera drives"),
        (replace(swept((0.01,), (5.0,)), trajectory="shake:6"), "its pictures follow a trajectory"),
    ],
)
def test_runs_whose_motion_no_chart_has_are_refused(plan, reason):
    run: Any = SimpleNamespace(folder="run", plan=plan, camera=IMX250)
    with pytest.raises(StoreError, match=reason):
        nodes_of(run)
