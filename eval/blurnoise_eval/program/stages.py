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
MOST = 7
"""With the first, and two nodes each, they fit into the 16 nodes of an AE route."""


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

    @property
    def corners(self) -> list[tuple[float, float]]:
        """(time, gain) where one of them stops to rise, total exposure strictly rising."""
        found = [(self.times_s[0], self.gains[0])]
        for time, gain in zip(self.times_s[1:], self.gains[1:], strict=True):
            for corner in ((time, found[-1][1]), (time, gain)):
                if corner[0] * corner[1] > found[-1][0] * found[-1][1]:
                    found.append(corner)
        return found


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
    """The best programs of 1, 2 ... ``MOST`` stages.

    worth: (L, I) of each light at each of ``times_s`` (I,), equally many stops apart and rising, NaN where it is not
    allowed; totals_s: (L,) what each light asks for, times gain; early_gain: the most gain at any time but the
    longest. Gains have the times' steps. Of programs on that lattice these are the best: dynamic programming over
    paths that rise by one step of time or of gain.
    """
    n_times = len(times_s)
    step = float(np.log2(times_s[1] / times_s[0])) if n_times > 1 else 0.125
    asked = np.maximum(np.rint(np.log2(np.asarray(totals_s) / times_s[0]) / step), 0).astype(int)
    gains, early = (
        int(np.floor(np.log2(each) / step + 1e-9)) for each in (most_gain, min(most_gain, early_gain))
    )
    most = np.array([early] * (n_times - 1) + [gains])
    reach = max(1, min(int(asked.max()), n_times - 1 + gains))
    gained = np.zeros((reach + 1, n_times))
    np.add.at(gained, np.minimum(asked, reach), np.where(np.isnan(worth), -np.inf, worth))
    ends, came = _best_paths(gained, most)
    found = []
    for n, (total, (k, rose, i)) in enumerate(ends):
        if np.isfinite(total):
            risen = _risen(came[: k + 1, :, :, :], n, rose, i)
            found.append(Staged(_stages_of(risen, times_s, step), total))
    return found


_TIME, _GAIN = 0, 1
_End = tuple[float, tuple[int, int, int]]


def _best_paths(gained: Array, most: NDArray[np.int_]) -> tuple[list[_End], NDArray[np.int8]]:
    """Paths over total exposure k = i + j, i steps of time and j of gain; state: stages so far, what rose last, i.

    The worth of the best path of each number of stages with its end (k, what rose last, i); and what rose before, by
    k and state.
    """
    reach, n_times = len(gained) - 1, gained.shape[1]
    left = np.cumsum(gained[::-1], axis=0)[::-1]  # of all lights from k on, at one time
    value = np.full((MOST + 1, 2, n_times), -np.inf)
    value[1, _TIME, 0] = gained[0, 0]
    came = np.zeros((reach + 1, MOST + 1, 2, n_times), np.int8)
    ends: list[_End] = [(-np.inf, (0, 0, 0))] * (MOST + 1)
    places = np.arange(n_times)
    for k in range(1, reach + 1):
        following = np.full_like(value, -np.inf)
        again = np.full((MOST + 1, n_times), -np.inf)
        again[1:] = value[:-1, _GAIN]  # time rises after gain: a new stage
        longer = np.stack([value[:, _TIME], again])
        came[k, :, _TIME, 1:] = np.argmax(longer, axis=0)[:, :-1]
        following[:, _TIME, 1:] = longer.max(axis=0)[:, :-1]
        came[k, :, _GAIN] = np.argmax(value, axis=1)
        following[:, _GAIN] = np.where(k - places <= most, value.max(axis=1), -np.inf)
        value = following + gained[k]
        full = k - places == most[-1]  # gain has reached its most: darker lights may stay there
        total = value if k == reach else np.where(full, value + left[k + 1], -np.inf)
        for n in range(1, MOST + 1):
            rose, i = np.unravel_index(int(np.argmax(total[n])), total[n].shape)
            if total[n, rose, i] > ends[n][0]:
                ends[n] = float(total[n, rose, i]), (k, int(rose), int(i))
    return ends, came


def _risen(came: NDArray[np.int8], n: int, rose: int, i: int) -> list[int]:
    """What rose, step by step, on the path that ends in this state at the last k."""
    risen = []
    for k in range(len(came) - 1, 0, -1):
        risen.append(rose)
        before = int(came[k, n, rose, i])
        if rose == _TIME:
            i -= 1
            n -= before == _GAIN
        rose = before
    return risen[::-1]


def _stages_of(risen: Sequence[int], times_s: Sequence[float], step: float) -> Stages:
    """A stage begins where time rises after gain."""
    times, gains = [float(times_s[0])], [1.0]
    i = j = 0
    for place, rose in enumerate(risen):
        if place == 0 or (rose == _TIME and risen[place - 1] == _GAIN):
            times.append(times[-1])
            gains.append(gains[-1])
        i, j = (i + 1, j) if rose == _TIME else (i, j + 1)
        times[-1], gains[-1] = float(times_s[i]), float(2 ** (j * step))
    return Stages(tuple(times), tuple(gains))
