"""Surfaces: exact at nodes, honest between them, the same weights for every cluster, and what they say on lines."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.question import FLOOR, Line, Question, lattice, spread
from blurnoise_eval.deciding.surface import USUAL, Kriging, Predicted, correlation, predicted_table
from made_tables import answers, on_plane, table
from numpy.typing import NDArray

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


def test_two_routes_to_the_weights():
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


def test_sigma_is_honest():
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


def rates(places: np.ndarray) -> np.ndarray:
    """Of three clusters, (3, N): lost in the dark at three edges."""
    light = 1 / (1 + np.exp(-1.5 * (places[:, 0] - EDGES[:, None])))
    return np.asarray(light / (1 + np.exp(places[:, 1] - 4)))


def observed(places: np.ndarray) -> Predicted:
    counts = np.repeat(COUNTS[:, None], len(places), axis=1)
    return Predicted(on_plane(places, rates(places) * counts, counts))


def test_no_swing_beyond_what_was_observed():
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


def test_inside_is_among_the_nodes():
    found = observed(NODES)
    assert found.inside(PLACES).mean() > 0.9
    assert not found.inside([(20.0, 0.0), (0.0, 9.0), (-9.0, 7.0), (-12.0, FLOOR)]).any()
    rest = observed(lattice([Line(5.0)], (0.001, 0.5)))
    assert rest.inside([(0.0, FLOOR), (0.0, 1.0), (5.0, FLOOR)]).tolist() == [True, False, False]
    alone = observed(np.array([[0.0, 1.0]]))
    assert alone.inside([(0.1, 1.1), (0.0, 2.0)]).tolist() == [True, False]


def test_every_direction_has_a_plane_and_rest_is_in_each():
    velocities = [(0.0, 0.0), (100.0, 0.0), (-50.0, 0.0), (0.0, 70.0), (300.0, -400.0)]
    made = table(np.random.default_rng(0).random((2, 3, 5)), [0.01, 0.02, 0.04], velocities)
    planes = {each.direction: each for each in made.on_plane()}
    # three exposures at rest and in motion; 50 px/s for 10 ms is half a pixel, which is none
    sizes = {direction: len(each) for direction, each in planes.items()}
    assert sizes == {(1.0, 0.0): 3 + 3 + 2, (0.0, 1.0): 3 + 3, (0.6, -0.8): 3 + 3}
    means = {tuple(made.at(place).values()): made.mean[place] for place in range(len(made))}
    upwards = planes[0.0, 1.0]
    assert upwards.mean == pytest.approx([means[tuple(upwards.at(place).values())] for place in range(6)])


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


def test_lines_through_a_smooth_plane_are_the_truth():
    found = predicted_table(plane(), QUESTION, USUAL)
    expected = np.mean([truth(found.places, cluster) for cluster in range(24)], axis=0)
    # half-stop nodes of a plane that bends over about a stop; the prototype found 0.005-0.008 RMS
    assert np.abs(found.mean - expected).max() < 0.02
    lines = list(found.along("exposure_s"))
    assert [line.at(0)["illuminance_lux"] for line in lines] == [3.0, 3.0, 40.0, 40.0]
    for line in lines:
        off = np.abs(line.mean - np.mean([truth(line.places, cluster) for cluster in range(24)], axis=0))
        cov = line.prediction_cov(np.arange(len(line)))
        assert cov.shape == (len(line), len(line))
        assert (off <= 4 * np.sqrt(np.diag(cov)) + 1e-3).all()
    assert [answer.n_pictures for answer in answers(found, CRITERION)] == [24] * 4
    bright = lines[2].saturated
    assert bright[0] == 0
    assert bright[-1] == pytest.approx(0.5)
