"""Brackets: the least and the most that a condition scores, by others that are measured and surely easier or harder.

At the same exposure time nothing gets worse in more light, unless it saturates, or with less motion; at rest nothing
does in a longer exposure. Of two dense runs with signs and photographs no score broke this by more than 0.024.

Domain: N conditions, each a setting and a velocity, at E exposures, increasing; values and saturated shares are
(N, E), NaN where not measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.choosing import SATURATED
from blurnoise_eval.plan.axes import LIGHT, SETTING

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Setting = tuple[float, ...]
Velocity = tuple[float, float]
_LIGHT = SETTING.index(LIGHT.name)


class Order(NamedTuple):
    """Which conditions are easier than others, (N, N) each, [n, m] where m is easier than n or n itself.

    slower: in the same light; brighter: in as much light or more, and not faster. at_rest: (N,).
    """

    slower: Flags
    brighter: Flags
    at_rest: Flags

    @classmethod
    def of(cls, settings: Sequence[Setting], velocities: Sequence[Velocity], *, monotone: bool) -> Order:
        """Of conditions. monotone: whether more motion can only hurt.

        >>> dark, bright = [tuple(lux * (name == LIGHT.name) for name in SETTING) for lux in (1.0, 5.0)]
        >>> Order.of([dark, bright], [(0.0, 0.0)] * 2, monotone=True).brighter.tolist()
        [[True, True], [False, True]]
        """
        others = [setting[:_LIGHT] + setting[_LIGHT + 1 :] for setting in settings]
        alike = np.array([[a == b for b in others] for a in others], bool)
        light = np.array([setting[_LIGHT] for setting in settings])
        slower = np.array(
            [[v == w or (monotone and _slower(v, w)) for w in velocities] for v in velocities], bool
        )
        return cls(
            alike & slower & (light == light[:, None]),
            alike & slower & (light >= light[:, None]),
            np.array([v == (0.0, 0.0) for v in velocities]) & monotone,
        )

    def bounds(self, value: Array, saturated: Array) -> tuple[Array, Array]:
        """The most and the least, (N, E); infinite and 0 where nothing says so."""
        known = np.isfinite(value)
        clear = known & (np.nan_to_num(saturated) <= SATURATED)
        # What is no brighter than one that does not saturate, and exposed no longer, does not either.
        until = np.maximum.accumulate(clear[:, ::-1], axis=1)[:, ::-1]
        unsaturated = (self.brighter[:, :, None] & until).any(axis=1)
        no_more, no_less = np.where(known, value, np.inf), np.where(known, value, 0.0)
        rest = self.at_rest[:, None]
        in_light = np.where(clear, value, np.inf)
        longer = np.minimum.accumulate(in_light[:, ::-1], axis=1)[:, ::-1]
        in_dark = np.where(rest, np.maximum.accumulate(no_less, axis=1), no_less)
        most = np.minimum(
            _over(self.slower, no_more, np.inf).min(axis=1),
            _over(self.brighter, np.where(rest, longer, in_light), np.inf).min(axis=1),
        )
        least = np.maximum(
            _over(self.slower.T, no_less, 0.0).max(axis=1),
            np.where(unsaturated, _over(self.brighter.T, in_dark, 0.0).max(axis=1), 0.0),
        )
        return most, np.minimum(least, most)


def _over(order: Flags, each: Array, nothing: float) -> Array:
    """(N, N, E), of the conditions m that stand in an order to n."""
    return np.where(order[:, :, None], each, nothing)


def _slower(one: Velocity, other: Velocity) -> bool:
    """Whether the other velocity is one's, only slower, or rest."""
    (x, y), (u, v) = one, other
    return math.hypot(u, v) < math.hypot(x, y) and math.isclose(x * v, y * u) and x * u + y * v >= 0
