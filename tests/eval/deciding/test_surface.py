"""Surfaces: exact at nodes, honest between them, the same weights for every cluster, and what they say on lines."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.question import FLOOR, Line, Question, lattice, spread
from blurnoise_eval.deciding.surface import USUAL, Kriging, Predicted, Trend, correlation, predicted_table
from made_tables import answers, on_plane, table
from numpy.typing import NDArray

from blurnoise import Camera

Array = NDArray[np.float64]
LINES = [Line(lux, (speed, 0.0)) for lux in (2.0, 45.0, 1000.0) for speed in (0.0, 100.0, 1600.0)]
PLACES = lattice(LINES, (0.001, 0.09))
NODES = PLACES[spread(PLACES, 40)]
EDGES = np.array([-5.0, -4.0, -2.0])
COUNTS = np.array([4.0, 0.5, 2.0])
CRITERION = Criterion(0.6, kept=False)


def logistic(places: Array) -> Array:
    """Rises with the light at -4 stops, falls with motion at 3."""
    return np.asarray(1 / (1 + np.exp(-1.2 * (places[:, 0] + 4))) / (1 + np.exp(1.5 * (places[:, 1] - 3))))


def drawn(lengths: tuple[float, float], scale: float, seed: int) -> Array:
    """A surface over PLACES out of the law that kriging assumes, about 0.5."""
    covariance = correlation(PLACES, PLACES, lengths) + 1e-8 * np.eye(len(PLACES))
    return 0.5 + scale * np.linalg.cholesky(covariance) @ np.random.default_rng(seed).normal(size=len(PLACES))


@pytest.mark.parametrize("trend", [None, Trend()])
def test_exact_at_nodes_and_near_between(trend: Trend | None) -> None:
    chosen = PLACES[spread(PLACES, 60)]
    surface = Kriging.fit(chosen, logistic(chosen), trend=trend)
    assert surface.mean(chosen) == pytest.approx(logistic(chosen), abs=0.01)
    assert surface.sigma(chosen).max() < 0.01
    assert np.sqrt(np.mean((surface.mean(PLACES) - logistic(PLACES)) ** 2)) < 0.03


def test_weights_are_linear_and_add_up() -> None:
    chosen = PLACES[spread(PLACES, 20)]
    surface = Kriging.fit(chosen, logistic(chosen))
    weights = surface.weights(PLACES)
    assert weights.shape == (len(PLACES), 20)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    # a plane of values that follows the trend is reproduced, whatever its height
    follows = surface.basis(chosen) @ (0.2, 0.1)
    assert weights @ follows == pytest.approx(surface.basis(PLACES) @ (0.2, 0.1))


def test_two_routes_to_the_weights() -> None:
    """By generalised least squares for the trend, then simple kriging of what it leaves."""
    chosen = PLACES[spread(PLACES, 15)]
    surface = Kriging.fit(chosen, logistic(chosen))
    asked = PLACES[::7]
    basis, there = surface.basis(chosen), surface.basis(asked)
    assert basis.shape == (15, 2)
    covariance = correlation(chosen, chosen, surface.lengths) + surface.nugget * np.eye(15)
    simple = np.linalg.solve(covariance, correlation(chosen, asked, surface.lengths)).T
    of_trend = np.linalg.inv(basis.T @ np.linalg.solve(covariance, basis))
    fit = of_trend @ np.linalg.solve(covariance, basis).T
    rest = there - simple @ basis
    assert surface.weights(asked) == pytest.approx(simple + rest @ fit, abs=1e-8)
    known = (simple * correlation(asked, chosen, surface.lengths)).sum(axis=1)
    variance = surface.scale**2 * (1 - known + (rest @ of_trend * rest).sum(axis=1))
    own = surface.scale**2 * surface.nugget
    assert surface.sigma(asked) == pytest.approx(np.sqrt(np.maximum(variance, 0) + own), abs=1e-6)
    assert np.diag(surface.covariance(asked)) == pytest.approx(variance, abs=1e-9)


def test_sigma_is_honest() -> None:
    """Of 20 surfaces of the law assumed, lengths to be found: the root mean square of departure by sigma is 1. Its
    spread over surfaces is about 0.3, so 0.07 of the mean; k = 4."""
    chosen = np.sort(spread(PLACES, 40))
    squares = []
    for seed in range(20):
        values = drawn((3.3, 2.5), 0.1, seed)
        surface = Kriging.fit(PLACES[chosen], values[chosen], trend=None)
        rest = np.setdiff1d(np.arange(len(PLACES)), chosen)
        wrong = surface.weights(PLACES[rest]) @ values[chosen] - values[rest]
        squares.append(np.mean((wrong / surface.sigma(PLACES[rest])) ** 2))
    assert np.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=0.28)


def test_finds_which_way_is_rough() -> None:
    values = drawn((6.0, 1.2), 0.2, 3)
    length_u, length_w = Kriging.fit(PLACES, values, trend=None).lengths
    assert length_u > 2 * length_w


def test_nothing_known_is_not_taken_for_certain() -> None:
    """Few equal values say little: sigma stays, between them and more so beyond."""
    chosen = PLACES[spread(PLACES, 5)]
    surface = Kriging.fit(chosen, np.full(5, 0.7))
    assert surface.coefficients is None
    assert surface.weights(PLACES) @ np.full(5, 0.7) == pytest.approx(0.7)
    assert surface.sigma(PLACES).max() > 0.02
    one = Kriging.fit(chosen[:1], [0.7])
    assert one.weights(PLACES) == pytest.approx(1.0)
    assert one.sigma(PLACES).max() > 0.02


def test_many_nodes() -> None:
    """More than lengths are chosen by: all count in the weights."""
    places = np.stack(np.meshgrid(np.arange(-8, 6, 0.5), np.arange(-1, 7, 0.5)), axis=-1).reshape(-1, 2)
    surface = Kriging.fit(places, logistic(places))
    between = places[:-20] + np.array([0.0, 0.25])
    assert surface.weights(between).shape[1] == len(places) > 400
    assert np.abs(surface.weights(between) @ logistic(places) - logistic(between)).max() < 0.01


def test_trend_of_a_camera() -> None:
    camera = Camera.preset("imx250")
    trend = Trend.of(camera)
    assert trend.electrons_per_lux_s > 100
    assert 1 < trend.noise_e < 10
    assert trend.full_lux_s == pytest.approx(camera.saturation_e / trend.electrons_per_lux_s)


def rates(places: np.ndarray) -> np.ndarray:
    """Of three clusters, (3, N): lost in the dark at three edges."""
    light = 1 / (1 + np.exp(-1.5 * (places[:, 0] - EDGES[:, None])))
    return np.asarray(light / (1 + np.exp(places[:, 1] - 4)))


def observed(places: np.ndarray) -> Predicted:
    counts = np.repeat(COUNTS[:, None], len(places), axis=1)
    return Predicted(on_plane(places, rates(places) * counts, counts))


def test_every_cluster_by_the_weights_of_the_mean() -> None:
    sums, counts = observed(NODES).on(PLACES)
    assert counts == pytest.approx(np.repeat(COUNTS[:, None], len(PLACES), axis=1))
    assert np.abs(sums / counts - rates(PLACES)).max() < 0.25
    mean, truth = sums.sum(axis=0) / COUNTS.sum(), COUNTS @ rates(PLACES) / COUNTS.sum()
    assert np.sqrt(np.mean((mean - truth) ** 2)) < 0.03
    surface = observed(NODES).surface
    at_nodes = COUNTS @ rates(surface.places) / COUNTS.sum()
    assert mean == pytest.approx((surface.weights(PLACES) @ at_nodes).clip(0.0, at_nodes.max()))


def test_no_swing_beyond_what_was_observed() -> None:
    """A detector that is 0.9 sure in a window of light and blind beside it is nowhere surer, nor less than blind."""
    seen = np.where(abs(NODES[:, 0] + 1) < 2.5, 0.9, 0.0)
    counts = np.ones((2, len(NODES)))
    window = Predicted(on_plane(NODES, seen * [[1.0], [0.5]], counts))
    weights = window.surface.weights(PLACES)
    seen = np.where(abs(window.places[:, 0] + 1) < 2.5, 0.9, 0.0)
    swing = weights @ (0.75 * seen)
    assert swing.max() > 0.68
    assert swing.min() < -0.01
    sums, _ = window.on(PLACES)
    mean = sums.mean(axis=0)
    assert mean.min() == pytest.approx(0.0, abs=1e-12)
    assert mean.max() == pytest.approx(0.675)
    assert sums[0] - sums[1] == pytest.approx(weights @ (0.5 * seen))


def test_places_twice_count_as_one() -> None:
    """As in a grid whose conditions fall together: the same surface, whatever the order."""
    twice = np.concatenate([NODES[::-1], NODES[:7]])
    counts = np.repeat(COUNTS[:, None], len(twice), axis=1)
    found = Predicted(on_plane(twice, rates(twice) * counts, counts))
    assert len(found.places) == len(NODES)
    assert np.array(found.on(PLACES)) == pytest.approx(np.array(observed(NODES).on(PLACES)), abs=1e-9)


def test_a_cluster_observed_at_some_nodes() -> None:
    """It has the mean of the others at the rest, so that the mean is theirs; one never observed counts nothing."""
    counts = np.repeat(COUNTS[:, None], len(NODES), axis=1)
    counts[1, ::3] = 0
    counts[2] = 0
    seen = on_plane(NODES, rates(NODES) * counts, counts)
    plane = Predicted(seen)
    sums, counts = plane.on(PLACES)
    assert (sums[2] == 0).all()
    assert (counts[2] == 0).all()
    assert counts[1] == pytest.approx(0.5)
    mean = sums.sum(axis=0) / counts.sum(axis=0)
    assert mean == pytest.approx((plane.surface.weights(PLACES) @ seen.mean).clip(0.0, seen.mean.max()))


def test_inside_is_among_the_nodes() -> None:
    found = observed(NODES)
    assert found.inside(PLACES).mean() > 0.9
    assert not found.inside([(20.0, 0.0), (0.0, 9.0), (-9.0, 7.0), (-12.0, FLOOR)]).any()
    rest = observed(lattice([Line(5.0)], (0.001, 0.5)))
    assert rest.inside([(0.0, FLOOR), (0.0, 1.0), (5.0, FLOOR)]).tolist() == [True, False, False]
    alone = observed(np.array([[0.0, 1.0]]))
    assert alone.inside([(0.1, 1.1), (0.0, 2.0)]).tolist() == [True, False]


def test_every_direction_has_a_plane_and_rest_is_in_each() -> None:
    velocities = [(0.0, 0.0), (100.0, 0.0), (-50.0, 0.0), (0.0, 70.0), (300.0, -400.0)]
    made = table(np.random.default_rng(0).random((2, 3, 5)), [0.01, 0.02, 0.04], velocities)
    planes = {each.direction: each for each in made.on_plane()}
    # three exposures at rest and in motion; 50 px/s for 10 ms is half a pixel, which is none
    sizes = {direction: len(each) for direction, each in planes.items()}
    assert sizes == {(1.0, 0.0): 3 + 3 + 2, (0.0, 1.0): 3 + 3, (0.6, -0.8): 3 + 3}
    means = {tuple(made.at(place).values()): made.mean[place] for place in range(len(made))}
    upwards = planes[0.0, 1.0]
    assert upwards.mean == pytest.approx([means[tuple(upwards.at(place).values())] for place in range(6)])


def test_one_experiment_under_two_conditions_is_one_place() -> None:
    """4 lux for 10 ms and 2 lux for 20 ms, 100 px/s and 50 px/s: 0.04 lux s and 1 px."""
    sums = np.array([[[0.2, 0.0], [0.0, 0.4]], [[0.6, 0.0], [0.0, 0.8]]])
    made = table(sums, [0.01, 0.02], [(100.0, 0.0), (50.0, 0.0)], counts=(sums > 0).astype(float))
    made.conditions["illuminance_lux"][:2], made.conditions["illuminance_lux"][2:] = 4.0, 2.0
    (seen,) = made.on_plane()
    assert seen.places == pytest.approx(np.array([[math.log2(0.04), 0.0]]))
    assert seen.sums == pytest.approx(np.array([[0.3], [0.7]]))
    assert seen.counts.tolist() == [[1.0], [1.0]]
    made.conditions["illuminance_lux"][:] = 0.0  # darkness has no place
    assert list(made.on_plane()) == []


QUESTION = Question(
    {
        "exposure_s": (0.002, 0.064),
        "illuminance_lux": (3.0, 40.0),
        "velocity_x_px_s": (0.0, 300.0),
        "velocity_y_px_s": (0.0,),
    }
)


def truth(places: NDArray[np.float64], cluster: int) -> NDArray[np.float64]:
    """A score that rises with light and falls with motion, in each cluster at another light."""
    u, w = places[..., 0], places[..., 1]
    return np.asarray(0.9 / (1 + np.exp(-1.5 * (u + 3 + 0.1 * cluster))) / (1 + np.exp(1.2 * (w - 3))))


def plane(clusters: int = 24, **changed: Any) -> ScoreTable:
    """At the lattice of the question, by exposures of 10 ms."""
    places = lattice(QUESTION.lines, QUESTION.exposures_s)
    sums = np.array([truth(places, cluster) for cluster in range(clusters)])
    made = table(np.zeros((clusters, len(places), 1)), np.full(len(places), 0.01), clean=0.9, reference=21.6)
    made.conditions["illuminance_lux"][:] = 2.0 ** places[:, 0] / 0.01
    made.conditions["velocity_x_px_s"][:] = 2.0 ** places[:, 1] / 0.01
    return replace(made, **{"sums": sums, "saturated": np.where(places[:, 0] > 0, 0.5, 0.0)} | changed)


@pytest.mark.filterwarnings("error")
def test_one_cluster_has_no_standard_error() -> None:
    assert np.isnan(plane(clusters=1).standard_error).all()
    assert np.isfinite(plane(clusters=2).standard_error).all()


def test_lines_through_a_smooth_plane_are_the_truth() -> None:
    found = predicted_table(plane(), QUESTION, USUAL)
    expected = np.mean([truth(found.places, cluster) for cluster in range(24)], axis=0)
    # half-stop nodes of a plane that bends over about a stop; the prototype found 0.005-0.008 RMS
    assert np.abs(found.mean - expected).max() < 0.02
    lines = list(found.along("exposure_s"))
    assert [line.at(0)["illuminance_lux"] for line in lines] == [3.0, 3.0, 40.0, 40.0]
    for line in lines:
        off = np.abs(line.mean - np.mean([truth(line.places, cluster) for cluster in range(24)], axis=0))
        assert line.prediction_cov is not None
        cov = line.prediction_cov(np.arange(len(line)))
        assert cov.shape == (len(line), len(line))
        assert (off <= 4 * np.sqrt(np.diag(cov)) + 1e-3).all()
    assert [answer.n_pictures for answer in answers(found, CRITERION)] == [24] * 4
    bright = lines[2].saturated
    assert bright[0] == 0
    assert bright[-1] == pytest.approx(0.5)


def test_where_the_model_knows_too_little_nothing_is_predicted() -> None:
    nothing = replace(plane(), kept=True, counts=np.zeros_like(plane().counts), reference=0.0, clean=0.0)
    found = predicted_table(nothing, QUESTION, USUAL)
    assert (len(found), found.reference, found.kept) == (0, 0.0, True)
