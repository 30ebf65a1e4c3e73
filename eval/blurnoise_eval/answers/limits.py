"""Limits: what ends a window of exposures, and what holds the best exposure back where none works.

Domain: exposures in s, values in a criterion's unit. All follow from comparison with
what was tested beside them; where that is not enough, there is no guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.choosing import SATURATED
from blurnoise_eval.answers.table import ScoreTable

Limit = Literal["missed pulses", "noise", "darkness", "blur", "saturation"]
Array = NDArray[np.float64]
MATTERS = 0.02
"""So much better, in the criterion's unit, must it be without a limit that this counts as one."""
SATURATES = 0.01
"""So much more of the picture's values at a limit of the sensor is saturation that may count."""
DARK = 0.33
"""Mean brightness of a picture, coded by sRGB, of 9 %: half of what auto-exposure aims at."""


class WindowLimits(NamedTuple):
    """At either end of a window, or at the best exposure ("blur and noise"); None where the tests do not tell."""

    low: Limit | None = None
    high: Limit | None = None
    by: str | None = None


@dataclass(frozen=True, eq=False)
class TestedLine:
    """Tested exposures of one light and velocity.

    of: a table of one exposure after the other. slower: mean score at the slowest speed tested under this light (E,),
    NaN beyond what was tested there; None: this is it. dark_below: brightness of a picture that is half of
    auto-exposure's aim.
    """

    of: ScoreTable
    slower: Array | None = None
    dark_below: float = DARK

    @property
    def x(self) -> Array:
        """Exposures, s."""
        return self.of.conditions["exposure_s"]

    @property
    def moves(self) -> bool:
        """Whether this moves at all."""
        return bool(self.of.speeds_px_s.any())

    def lacks(self, index: int) -> Limit | None:
        """What too little light means at an exposure: missed pulses where pictures miss a pulsed lamp; darkness in a
        picture that is darker than half of auto-exposure's aim, since gain has ended or was fixed; noise in one as
        bright as it should be."""
        if self.of.missed_pulses is not None and self.of.missed_pulses[index] > MATTERS:
            return "missed pulses"
        brightness = self.of.brightness[index]
        return None if np.isnan(brightness) else "darkness" if brightness < self.dark_below else "noise"

    def saturates(self, index: int, others: Sequence[int] | NDArray[np.int64]) -> bool | None:
        """Whether more is saturated at one exposure than at the least saturated of others."""
        more = self.of.saturated[index] - np.fmin.reduce(self.of.saturated[others])
        return bool(more > SATURATES) if np.isfinite(more) else None


def of_window(line: TestedLine, window: tuple[float, float], level: float) -> WindowLimits:
    """What ends a window, from one exposure to another, in which the value is at or above the level.

    At the last exposure that fails before its lower end: darkness or noise, see :meth:`TestedLine.lacks`. At the
    first that fails beyond its upper end: blur, if the slowest speed works with the same light and time, else
    saturation if more of the picture is saturated than somewhere in the window. With no slower speed tested it is
    saturation at rest; of a line that moves it is blur where nothing saturates, else unknown.
    """
    x, value = line.x, line.of.mean
    inside = (window[0] <= x) & (x <= window[1])
    here = np.flatnonzero(inside) if inside.any() else np.array([np.abs(x - window[0]).argmin()])
    low: Limit | None = None
    high: Limit | None = None
    if window[0] > x[0] or value[0] < level:
        # At the lower end light lacks in any case; which kind of lack it is shows at the last exposure that fails.
        low = line.lacks(max(int((x < window[0]).sum()) - 1, 0))
    if window[1] < x[-1] or value[-1] < level:
        index = min(int((x <= window[1]).sum()), len(x) - 1)
        saturates = line.saturates(index, here)
        slower = np.nan if line.slower is None else line.slower[index]
        # With the same light and time the slowest speed works: so only motion is left.
        if slower >= level:
            high = "blur"
        elif np.isfinite(slower) or not line.moves:
            high = "saturation" if saturates else None
        else:
            high = "blur" if saturates is False else None
    return WindowLimits(low, high)


def of_best(line: TestedLine, best: int, level: float) -> WindowLimits:
    """What holds the best of the tested exposures back, where none reaches the level.

    By the slowest speed under this light: noise or darkness, if it does better at a longer time or still rises at the
    longest tested; saturation, if at a shorter one. Beside it blur: if the slowest does better with the same light
    and time, or with the longer exposure that would bring the light, at which this line is worse. On the slowest line
    itself: what has the value fall on either side of the best, and too little light if it still rises at the longest
    tested. With one exposure there is nothing beside it: what the slowest line lacks is light, unless much saturates.
    """
    value, x = line.of.mean, line.x
    parts: list[Limit | None] = []
    if len(x) == 1:
        slowest = value[0] if line.slower is None or np.isnan(line.slower[0]) else line.slower[0]
        parts += ["blur"] * bool(slowest - value[0] > MATTERS)
        burned = line.of.saturated[0] > SATURATED
        parts += [("saturation" if burned else line.lacks(0)) if slowest < level else None]
    elif line.slower is not None and np.isfinite(line.slower[best]):
        slowest, after = line.slower[best], slice(best + 1, None)
        brighter = line.slower[after] - slowest > MATTERS
        if (
            slowest - value[best] > MATTERS
            or (brighter & (line.slower[after] - value[after] > MATTERS)).any()
        ):
            parts.append("blur")
        rises = best + 1 == len(x) > 1 and slowest - line.slower[best - 1] > MATTERS
        if brighter.any() or rises:
            parts.append(line.lacks(best))
        else:
            falls = best == 0 and slowest - line.slower[1] > MATTERS and line.saturates(1, [0])
            parts += ["saturation"] * bool(falls or (line.slower[:best] - slowest > MATTERS).any())
    else:
        if best > 0 and value[best] - value[best - 1] > MATTERS:
            parts.append(line.lacks(best - 1 if best + 1 < len(x) else best))
        if best + 1 < len(x) and value[best] - value[best + 1] > MATTERS:
            saturates = line.saturates(best + 1, [best])
            parts.append("saturation" if saturates else "blur" if line.moves and saturates is False else None)
    named = list(dict.fromkeys(part for part in parts if part is not None))
    return WindowLimits(by=" and ".join(named) or None)
