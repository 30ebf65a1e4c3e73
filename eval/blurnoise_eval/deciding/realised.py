"""Conditions that stand for a place of the plane: an exposure, a light and a speed.

Convention: u = log2 (lux s), w = log2 max(px, 0.5), as in :mod:`blurnoise_eval.answers.plane`. Infinitely many
conditions stand at a place, all the same experiment. Taken are those nearest to what was asked: of the line that
passes nearest the exposure at which it does, within those asked, and the light and speed that then lead to the
place. Where several lines are as near, the exposure nearest the middle of those asked decides, then the order of
the lines. All three are rounded to ``DIGITS`` digits, which moves the place by less than 1e-5 stops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from blurnoise_eval.deciding.nodes import FLOOR, Line, place_of
from blurnoise_eval.grid.axes import VELOCITY
from blurnoise_eval.grid.conditions import Conditions

DIGITS = 6
_SAME = 9  # decimals by which distances are


def conditions_at(
    place: tuple[float, float],
    lines: Sequence[Line],
    exposures_s: tuple[float, float],
    further: Mapping[str, float] | None = None,
) -> Conditions:
    """The conditions of a place, on lines of one direction.

    exposures_s: the shortest and the longest asked. further: values of the other axes.
    """
    low, high = exposures_s
    middle = math.log2(low * high) / 2

    def order(candidate: tuple[float, Line]) -> tuple[float, float]:
        exposure_s, line = candidate
        u, w = place_of(exposure_s, line)
        away = math.hypot(u - place[0], w - place[1])
        return round(away, _SAME), round(abs(math.log2(exposure_s) - middle), _SAME)

    candidates = [(exposure_s, line) for line in lines for exposure_s in _nearest(place, line, low, high)]
    exposure_s, _ = min(candidates, key=order)
    exposure_s = min(max(_rounded(exposure_s), low), high)
    x, y = next((line.direction for line in lines if line.direction), (1.0, 0.0))
    speed = 2.0 ** place[1] / exposure_s if place[1] > FLOOR else 0.0
    velocity = dict(zip(VELOCITY, (_rounded(speed * x), _rounded(speed * y)), strict=True))
    light = _rounded(2.0 ** place[0] / exposure_s)
    return Conditions(exposure_s=exposure_s, illuminance_lux=light, **velocity, **(further or {}))


def _nearest(place: tuple[float, float], line: Line, low: float, high: float) -> list[float]:
    """Exposures at which the line may be nearest: in motion, and where it counts as none."""
    by_light = place[0] - math.log2(line.illuminance_lux)
    logs = [by_light]
    if line.speed_px_s > 0:
        by_motion = place[1] - math.log2(line.speed_px_s)
        logs += [(by_light + by_motion) / 2, FLOOR - math.log2(line.speed_px_s)]
    return [float(np.clip(2.0 ** min(each, math.log2(high)), low, high)) for each in logs]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
