"""Stages of exposure and gain, as cameras hold their programs, and the best few of them.

Domain: seconds; gain as a factor, 1 and more. Convention, libcamera's: from the first time and gain on, as more total
exposure (time x gain) is asked for, time rises to the next stage's at the present gain, then gain to the next
stage's at that time; beyond the last stage nothing rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Places = NDArray[np.int64]
MOST = 7


@dataclass(frozen=True)
class Stages:
    """Times and gains, two or more, neither ever falling; the first is where the least light ends."""

    times_s: tuple[float, ...]
    gains: tuple[float, ...]

    def divided(self, total_s: float) -> tuple[float, float]:
        """Time and gain for a total exposure, as libcamera divides it up."""
        time, gain = self.times_s[0], self.gains[0]
        for next_time, next_gain in zip(self.times_s[1:], self.gains[1:], strict=True):
            if time * gain >= total_s:
                break
            time = min(next_time, total_s / gain)
            gain = min(next_gain, max(gain, total_s / time))
        return time, gain

    def starting_at(self, least_s: float) -> Stages:
        """The same, with a first stage no longer than this, so that more light is met by shorter exposures."""
        return Stages((min(least_s, self.times_s[0]), *self.times_s[1:]), self.gains)

    def no_longer(self, most_s: float) -> Stages:
        """The same with times up to ``most_s``, as libcamera limits them by the frame's duration."""
        return Stages(tuple(min(time, most_s) for time in self.times_s), self.gains)


STOCK = {
    "libcamera imx296 normal": Stages((100e-6, 30e-3, 45e-3, 60e-3, 66.666e-3), (1.0, 1.0, 2.0, 4.0, 16.0)),
    "libcamera imx296 short": Stages((100e-6, 5e-3, 10e-3, 20e-3, 66.666e-3), (1.0, 2.0, 4.0, 8.0, 16.0)),
}
"""Exposure modes of Raspberry Pi's global shutter camera: libcamera, src/ipa/rpi/vc4/data/imx296.json."""


class Staged(NamedTuple):
    """Stages, and the sum of worth that they reach on the lattice on which they were sought."""

    stages: Stages
    worth: float


def best_stages(
    worth: Array,
    totals_s: Sequence[float],
    times_s: Sequence[float],
    most_gain: float,
    early_gain: float = math.inf,
) -> list[Staged]:
    """The best programs of at most 1, 2 ... ``MOST`` stages; none where nothing is allowed.

    worth: (L, I) of each light at each of ``times_s`` (I,), equally many stops apart and rising, NaN where it is not
    allowed; totals_s: (L,) what each light asks for, times gain; early_gain: the most gain at any time but the
    longest. Gains have the times' steps. Of programs on that lattice these are the best: dynamic programming over
    paths that rise by one step of time (i) or of gain (j) from the first time and gain on. A path of a stage rises
    in time, then in gain; it meets a light that asks for i + j steps.
    """
    n_times = len(times_s)
    step = math.log2(times_s[1] / times_s[0]) if n_times > 1 else 0.125
    asked = np.maximum(np.rint(np.log2(np.asarray(totals_s) / times_s[0]) / step), 0).astype(int)
    gains, early = (
        math.floor(math.log2(each) / step + 1e-9) for each in (most_gain, min(most_gain, early_gain))
    )
    reach = max(1, min(int(asked.max()), n_times - 1 + gains))
    of_steps = np.zeros((reach + 2, n_times))  # worth of all lights that ask for so many steps
    np.add.at(of_steps, np.minimum(asked, reach), np.where(np.isnan(worth), -np.inf, worth))
    of_more = np.cumsum(of_steps[::-1], axis=0)[::-1]
    i, j = np.indices((n_times, gains + 1))
    steps = np.minimum(i + j, reach)
    allowed = (i + j <= reach) & ((j <= early) | (i == n_times - 1))
    met = np.where(allowed, of_steps[steps, i], -np.inf)
    # the darkest light is reached, or the most gain, at which all darker lights stay
    may_end = allowed & (i + j > 0) & ((i + j == reach) | (j == gains))
    darker = np.where(may_end, of_more[steps + 1, i], -np.inf)

    best = np.full(met.shape, -np.inf)
    best[0, 0] = met[0, 0]
    risen: list[tuple[Places, Places]] = []
    found = []
    for _ in range(MOST):
        best, from_time = _rising(best, met, early=True)
        transposed, from_gain = _rising(best.T, met.T, early=False)
        best = transposed.T
        risen.append((from_time, from_gain.T))
        total = best + darker
        ends = np.argwhere(total == total.max())
        end = ends[np.lexsort((ends[:, 0], ends.sum(axis=1)))[0]]
        if np.isfinite(total.max()):
            corners = _corners(risen, int(end[0]), int(end[1]))
            times = tuple(float(times_s[time]) for time, _ in corners)
            stages = Stages(times, tuple(float(2 ** (gain * step)) for _, gain in corners))
            found.append(Staged(stages, float(total.max())))
    return found


def _rising(best: Array, met: Array, early: bool) -> tuple[Array, Places]:
    """Sums after any number of steps along the first axis, and the place there from which they rise.

    Of equal ways the one that begins to rise ``early``, or the one that does late.
    """
    sums = best.copy()
    begun = np.repeat(np.arange(len(best))[:, None], best.shape[1], axis=1)
    for k in range(1, len(best)):
        rising = sums[k - 1] + met[k]
        better = rising >= sums[k] if early else rising > sums[k]
        sums[k] = np.where(better, rising, sums[k])
        begun[k] = np.where(better, begun[k - 1], begun[k])
    return sums, begun


def _corners(risen: Sequence[tuple[Places, Places]], i: int, j: int) -> list[tuple[int, int]]:
    """Steps of time and gain where each stage of the path to (i, j) ends, the start first; each once."""
    corners = [(i, j)]
    for from_time, from_gain in reversed(risen):
        j = int(from_gain[i, j])
        i = int(from_time[i, j])
        if (i, j) != corners[-1]:
            corners.append((i, j))
    return corners[::-1]
