"""Stages: divided as libcamera divides, corners as AE routes want them, the best few as brute force finds them."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from blurnoise_eval.program.optimise import MOST, STOCK, Stages, best_stages

SHORT = STOCK["libcamera imx296 short"]


@pytest.mark.parametrize(
    ("total_s", "time_s", "gain"),
    [
        (50e-6, 100e-6, 1.0),  # below the first stage nothing is shorter
        (3e-3, 3e-3, 1.0),  # time first
        (5e-3, 5e-3, 1.0),
        (8e-3, 5e-3, 1.6),  # then gain
        (10e-3, 5e-3, 2.0),
        (16e-3, 8e-3, 2.0),  # the next stage's time, at the present gain
        (30e-3, 10e-3, 3.0),
        (0.5, 62.5e-3, 8.0),
        (0.8, 66.666e-3, 0.8 / 66.666e-3),
        (5.0, 66.666e-3, 16.0),  # beyond the last nothing rises
    ],
)
def test_a_total_is_divided_up_in_stages(total_s: float, time_s: float, gain: float) -> None:
    assert SHORT.divided(total_s) == pytest.approx((time_s, gain), rel=1e-12)


def staged_ways(n_times: int, n_gains: int, most: int) -> dict[int, list[Stages]]:
    """Every way on the lattice by its number of stages; steps of one stop."""
    found: dict[int, list[Stages]] = {}
    for n in range(1, most + 1):
        for times in product(range(n_times), repeat=n):
            for gains in product(range(n_gains), repeat=n):
                if all(np.diff(times) >= 0) and all(np.diff(gains) >= 0):
                    way = (0, *times), (0, *gains)
                    stages = Stages(tuple(2.0**k for k in way[0]), tuple(2.0**k for k in way[1]))
                    found.setdefault(n, []).append(stages)
    return found


@pytest.mark.parametrize("seed", range(12))
def test_equals_brute_force(seed: int) -> None:
    """4 times, gains 1 to 4, lights that ask for 1 to 64 times the first time: some reach the most gain."""
    generator = np.random.default_rng(seed)
    totals = [2.0**k for k in (6, 5, 4, 3, 2, 1, 0)]
    times = [1.0, 2.0, 4.0, 8.0]
    worth = generator.normal(size=(len(totals), len(times)))
    ways = staged_ways(len(times), 3, 3)
    found = best_stages(worth, totals, times, 4.0)
    for n in (1, 2, 3):
        of_stages = [
            sum(worth[k, times.index(way.divided(total)[0])] for k, total in enumerate(totals))
            for way in (way for m in range(1, n + 1) for way in ways[m])
            if all(way.divided(total)[0] in times for total in totals)
            and (way.divided(totals[0])[0] * way.divided(totals[0])[1] == totals[0] or way.gains[-1] == 4.0)
        ]
        got = found[n - 1][1]
        assert got == pytest.approx(max(of_stages), abs=1e-12), n


def test_their_worth_is_what_they_do() -> None:
    generator = np.random.default_rng(3)
    totals = [2.0 ** (-k / 2) for k in range(22)]
    times = (2.0 ** (np.arange(-60, 1) / 8)).tolist()
    u = np.log2(totals)[:, None]
    worth = -((np.log2(times)[None] - 0.4 * u + 2) ** 2) + 0.01 * generator.normal(size=(22, 61))
    found = best_stages(worth, totals, times, 2.0**10)
    assert len(found) == MOST
    assert all(a[1] <= b[1] + 1e-12 for a, b in pairwise(found))
    for n, (stages, reached) in enumerate(found, start=1):
        assert len(stages.gains) <= n + 1
        places = [
            int(np.argmin(np.abs(np.log2(stages.divided(total)[0] / np.array(times))))) for total in totals
        ]
        assert sum(worth[k, place] for k, place in enumerate(places)) == pytest.approx(reached, abs=1e-9)
