"""Standings of models: means at the best exposures, and differences that are paired by picture."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.standings import AtBest, standings
from blurnoise_eval.scoring.surfaces import Surface
from numpy.typing import NDArray

Array = NDArray[np.float64]
EXPOSURES_S = (0.001, 0.01)


def _surface(values: Array, counts: Array | None = None, group: str = "sign", first: int = 0) -> Surface:
    """Of values (C, E) at one velocity; clusters are numbered from ``first`` on."""
    n = np.ones_like(values) if counts is None else counts
    clusters = tuple(f"picture {first + index}" for index in range(len(values)))
    at = np.zeros((len(EXPOSURES_S), 1))
    own = "m", group, (50.0,), EXPOSURES_S, ((0.0, 0.0),), clusters
    return Surface(*own, (values * n)[:, :, None], n[:, :, None], at, len(values), at)


def _standing(*surfaces: Surface) -> AtBest:
    found = AtBest()
    for surface in surfaces:
        found.add(surface)
    return found


def _values(n: int, mean: float, seed: int = 0) -> Array:
    """The longer exposure is the better one; pictures differ."""
    each = np.random.default_rng(seed).normal(mean, 0.2, n)
    return np.stack([each - 0.3, each], axis=1)


def test_the_value_is_the_mean_over_conditions_at_the_best_exposure() -> None:
    a, b = _values(20, 0.8), _values(20, 0.4, seed=1)
    row = standings({"m": _standing(_surface(a), _surface(b, group="mark"))})["m"]
    assert row["best_value"] == pytest.approx((a[:, 1].mean() + b[:, 1].mean()) / 2)
    together = (
        a[:, 1] + b[:, 1]
    ) / 2  # the same pictures: of their means the interval is Student's and Hall's
    ends = certainty.joined(together.mean(), together - together.mean())
    assert (row["best_low"], row["best_high"]) == pytest.approx((float(ends.low), float(ends.high)))
    assert row["behind"] is row["behind_low"] is row["pictures_to_tell_behind"] is None
    assert row["standing_pictures"] == 20


def test_groups_in_other_pictures_add_their_own_departures() -> None:
    """Of two independent means of 10 the variance of the half sum is a quarter of the sum of theirs."""
    a, b = _values(10, 0.8), _values(10, 0.4, seed=1)
    row = standings({"m": _standing(_surface(a), _surface(b, group="mark", first=10))})["m"]
    assert row["standing_pictures"] == 20
    error = np.sqrt(sum(np.var(each[:, 1], ddof=1) / 10 for each in (a, b))) / 2
    low, high = row["best_low"], row["best_high"]
    assert low is not None
    assert high is not None
    wide = (high - low) / (2 * float(certainty.critical(20)))
    assert wide == pytest.approx(error, rel=0.12)  # (n - 1)/n of each part, and Hall's correction


def test_a_difference_is_told_where_the_pictures_agree() -> None:
    """Spread over pictures is 0.2, that of the differences 0.02: 0.05 is told in pairs, never apart."""
    one = _values(20, 0.8)
    other = one - 0.05 + np.random.default_rng(3).normal(0, 0.02, one.shape)
    found = standings({"second": _standing(_surface(other)), "first": _standing(_surface(one))})
    first, second = found["first"], found["second"]
    assert first["best_low"] is not None
    assert second["best_value"] is not None
    assert first["best_low"] < second["best_value"]
    assert second["behind"] == pytest.approx(0.05, abs=0.02)
    assert second["behind_low"] is not None
    assert second["behind_low"] > 0
    assert second["pictures_to_tell_behind"] is None


def test_a_difference_that_is_not_told_says_how_many_pictures_would() -> None:
    one = _values(20, 0.8)
    away = np.tile([0.2, -0.2], 10)  # its mean is 0
    other = one - 0.05 + away[:, None]
    row = standings({"first": _standing(_surface(one)), "second": _standing(_surface(other))})["second"]
    assert row["behind_low"] is not None
    assert row["behind_low"] < 0
    wanted = row["pictures_to_tell_behind"]
    assert wanted is not None
    spread = 0.2 * np.sqrt(20 / 19)
    assert float(certainty.critical(wanted)) * spread / np.sqrt(wanted) <= 0.05
    assert float(certainty.critical(wanted - 1)) * spread / np.sqrt(wanted - 1) > 0.05
    alike = standings({"a": _standing(_surface(one)), "b": _standing(_surface(one))})["b"]
    assert alike["behind"] == 0
    assert alike["pictures_to_tell_behind"] is None


def test_only_common_conditions_count() -> None:
    one, other = _values(20, 0.8), _values(20, 0.6, seed=2)
    alone = _surface(_values(20, 0.1, seed=4), group="mark")
    found = standings({"a": _standing(_surface(one), alone), "b": _standing(_surface(other))})
    assert found["a"]["best_value"] == pytest.approx(one[:, 1].mean())
    apart = standings({"a": _standing(alone), "b": _standing(_surface(other))})
    assert set(apart["a"].values()) == {None}
    assert standings({}) == {}


def test_below_eight_pictures_there_is_no_interval() -> None:
    found = standings({"a": _standing(_surface(_values(7, 0.8))), "b": _standing(_surface(_values(7, 0.6)))})
    assert found["b"]["best_low"] is found["b"]["behind_low"] is None
    assert found["b"]["behind"] == pytest.approx(0.2)
