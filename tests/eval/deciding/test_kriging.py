"""Kriging: exact at its nodes, honest between them, the same weights for every picture."""

import numpy as np
import pytest
from blurnoise_eval.deciding.question import Line, lattice, spread
from blurnoise_eval.deciding.surface import Kriging, Trend, correlation
from numpy.typing import NDArray

from blurnoise import Camera

Array = NDArray[np.float64]
LINES = [Line(lux, (speed, 0.0)) for lux in (2.0, 45.0, 1000.0) for speed in (0.0, 100.0, 1600.0)]
PLACES = lattice(LINES, (0.001, 0.09))


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
    assert surface.weights(chosen) @ logistic(chosen) == pytest.approx(logistic(chosen), abs=0.01)
    assert surface.sigma(chosen).max() < 0.01
    wrong = surface.weights(PLACES) @ logistic(chosen) - logistic(PLACES)
    assert np.sqrt(np.mean(wrong**2)) < 0.03


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


def test_one_line_only() -> None:
    """At rest every place lies on the floor: the length along w is what it usually is."""
    places = lattice([Line(5.0)], (0.001, 0.5))
    surface = Kriging.fit(places[::3], logistic(places[::3]))
    assert np.abs(surface.weights(places) @ logistic(places[::3]) - logistic(places)).max() < 0.02


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
