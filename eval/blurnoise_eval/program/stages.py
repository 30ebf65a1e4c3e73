"""Stages of exposure and gain, as cameras hold their programs, and the best few of them.

Domain: seconds; gain as a factor, 1 and more. Convention, libcamera's: from the first time and gain on, as more total
exposure (time x gain) is asked for, time rises to the next stage's at the present gain, then gain to the next
stage's at that time; beyond the last stage nothing rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MOST = 7
"""With the first, and two nodes each, they fit into the 16 nodes of an AE route."""


@dataclass(frozen=True)
class Stages:
    """Times and gains, neither ever falling; the first is where the least light ends. Raises ``ValueError``."""

    times_s: tuple[float, ...]
    gains: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.times_s) != len(self.gains) or len(self.gains) < 2:
            raise ValueError("stages: must hold as many times as gains, and two or more")
        if self.times_s[0] <= 0 or self.gains[0] < 1:
            raise ValueError("stages: times must be > 0, gains >= 1")
        for values in (self.times_s, self.gains):
            if any(a > b for a, b in pairwise(values)):
                raise ValueError(f"stages = {values!r}: must not fall")

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
    longest. Gains have the times' steps. Of programs on that
    lattice these are the best: dynamic programming over paths that rise by one step of time or of gain.
    """
    step = float(np.log2(times_s[1] / times_s[0])) if len(times_s) > 1 else 0.125
    asked = np.maximum(np.rint(np.log2(np.asarray(totals_s) / times_s[0]) / step), 0).astype(int)
    n_times = len(times_s)
    gains = int(np.floor(np.log2(most_gain) / step + 1e-9))
    most = np.full(n_times, int(np.floor(np.log2(min(most_gain, early_gain)) / step + 1e-9)))
    most[-1] = gains
    reach = max(1, min(int(asked.max()), n_times - 1 + gains))
    gained = np.zeros((reach + 1, n_times))
    np.add.at(gained, np.minimum(asked, reach), np.where(np.isnan(worth), -np.inf, worth))
    return _decoded(gained, most, np.asarray(times_s, float), step)


_TIME, _GAIN = 0, 1


def _decoded(gained: Array, most: NDArray[np.int_], times_s: Array, step: float) -> list[Staged]:
    """Paths over total exposure k = i + j, i steps of time and j of gain; state: stages so far, what rose last, i."""
    reach, n_times = len(gained) - 1, gained.shape[1]
    left = np.cumsum(gained[::-1], axis=0)[::-1]  # of all lights from k on, at one time
    value = np.full((MOST + 1, 2, n_times), -np.inf)
    value[1, _TIME, 0] = gained[0, 0]
    came = np.zeros((reach + 1, MOST + 1, 2, n_times), np.int8)
    ends: list[tuple[float, tuple[int, int, int]]] = [(-np.inf, (0, 0, 0))] * (MOST + 1)

    def end(k: int, total: Array) -> None:
        for n in range(1, MOST + 1):
            rose, i = np.unravel_index(int(np.argmax(total[n])), total[n].shape)
            if total[n, rose, i] > ends[n][0]:
                ends[n] = float(total[n, rose, i]), (k, int(rose), int(i))

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
        if k < reach and full.any():
            end(k, np.where(full, value + left[k + 1], -np.inf))
    end(reach, value)
    return [
        Staged(_traced(came, n, state, times_s, step), worth)
        for n, (worth, state) in enumerate(ends)
        if np.isfinite(worth)
    ]


def _traced(
    came: NDArray[np.int8], n: int, state: tuple[int, int, int], times_s: Array, step: float
) -> Stages:
    """The stages whose path ends there."""
    k, rose, i = state
    risen = []
    while k > 0:
        risen.append(rose)
        before = int(came[k, n, rose, i])
        if rose == _TIME:
            i -= 1
            n, rose = (n - 1, _GAIN) if before == _GAIN else (n, _TIME)
        else:
            rose = before
        k -= 1
    times, gains = [float(times_s[0])], [1.0]
    i = j = 0
    last = _GAIN
    for rose in reversed(risen):
        if len(times) == 1 or (rose == _TIME and last == _GAIN):
            times.append(times[-1])
            gains.append(gains[-1])
        i, j = (i + 1, j) if rose == _TIME else (i, j + 1)
        times[-1], gains[-1] = float(times_s[i]), float(2 ** (j * step))
        last = rose
    return Stages(tuple(times), tuple(gains))
