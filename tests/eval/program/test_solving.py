"""The dynamic program, beside every way there is."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from blurnoise_eval.program.optimise import solve


@pytest.mark.parametrize("seed", range(20))
def test_equals_brute_force(seed: int) -> None:
    worth = np.random.default_rng(seed).normal(size=(4, 6))
    worth[worth > 1.2] = np.nan
    never_longer = [way for way in product(range(6), repeat=4) if all(np.diff(way) <= 0)]
    sums = {way: sum(worth[light, place] for light, place in enumerate(way)) for way in never_longer}
    best = max((total for total in sums.values() if np.isfinite(total)), default=None)
    chosen = solve(worth)
    if best is None:
        assert chosen is None
    else:
        assert chosen in sums
        assert sums[chosen] == pytest.approx(best, abs=1e-12)


def test_of_equals_the_shortest_is_taken() -> None:
    assert solve(np.zeros((3, 5))) == (0, 0, 0)


def test_nothing_allowed_is_none() -> None:
    longer_in_more_light = np.array([[1.0, np.nan], [np.nan, 1.0]])
    assert solve(longer_in_more_light) is None
    assert solve(longer_in_more_light[::-1]) == (1, 0)
