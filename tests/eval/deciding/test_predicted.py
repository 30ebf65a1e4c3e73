"""Predicted sums of clusters: linear, weighted as observed, for any nodes."""

import numpy as np
import pytest
from blurnoise_eval.deciding.question import FLOOR, Line, lattice, spread
from blurnoise_eval.deciding.surface import Predicted
from made_tables import on_plane

LINES = [Line(lux, (speed, 0.0)) for lux in (2.0, 45.0, 1000.0) for speed in (0.0, 100.0, 1600.0)]
PLACES = lattice(LINES, (0.001, 0.09))
NODES = PLACES[spread(PLACES, 40)]
EDGES = np.array([-5.0, -4.0, -2.0])
COUNTS = np.array([4.0, 0.5, 2.0])


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
