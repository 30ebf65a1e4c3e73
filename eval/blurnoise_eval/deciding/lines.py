"""Lines of the plane of exposures, the lattice of nodes about them, and the conditions of a node.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`. A line is every exposure under one light and velocity:
it rises by 45 degrees, or lies on the floor at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import AT_REST, DIGITS, STILL_PX, direction_of, places_of
from blurnoise_eval.grid.axes import LIGHT, VELOCITY
from blurnoise_eval.grid.conditions import Conditions

STEP = 0.5
"""Stops between nodes."""
FLOOR = math.log2(STILL_PX)
"""w of all that is at rest."""
_ROUNDED = 6  # significant digits of the conditions of a node: they move the place by less than 1e-5 stops
_SAME = 9  # decimals of distances
Array = NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """All exposures under one light, lux above 0, and one velocity (x, y), px/s."""

    illuminance_lux: float
    velocity_px_s: tuple[float, float] = (0.0, 0.0)

    @property
    def speed_px_s(self) -> float:
        """Length of the velocity."""
        return math.hypot(*self.velocity_px_s)

    @property
    def axes(self) -> dict[str, float]:
        """Light and velocity by axis."""
        return {LIGHT.name: self.illuminance_lux, **dict(zip(VELOCITY, self.velocity_px_s, strict=True))}

    def places(self, exposures_s: ArrayLike) -> Array:
        """(N, 2) of exposures, s above 0."""
        return places_of(exposures_s, self.illuminance_lux, self.speed_px_s)


def direction_of_all(lines: Sequence[Line]) -> tuple[float, float]:
    """Direction of motion of the first line that moves."""
    found = (direction_of(line.velocity_px_s) for line in lines)
    return next((each for each in found if each is not None), AT_REST)


def exposures_on(exposures: Range, per_stop: float) -> Array:
    """Exposures from end to end, both included, at least ``per_stop`` to a stop."""
    low, high = exposures
    count = 1 + math.ceil(per_stop * math.log2(high / low) - 1e-9)
    return np.geomspace(low, high, max(count, 1))


def lattice(lines: Sequence[Line], exposures: Range, step: float = STEP) -> Array:
    """Places (N, 2) of a lattice of this step within half a step of any line, from end to end of the exposures.

    By u, then w; multiples of the step from u = 0 and from the floor, so lattices of other lines share their places.
    """
    times = exposures_on(exposures, 16 / step)
    index = (np.concatenate([line.places(times) for line in lines]) - (0.0, FLOOR)) / step
    low, high = np.ceil(index - 0.5 - 1e-9), np.floor(index + 0.5 + 1e-9)
    corners = [np.stack([u, w], axis=1) for u in (low[:, 0], high[:, 0]) for w in (low[:, 1], high[:, 1])]
    near = np.unique(np.concatenate(corners), axis=0)
    return near[near[:, 1] >= 0] * step + (0.0, FLOOR)


def spread(places: Array, count: int, taken: Array | None = None) -> NDArray[np.int64]:
    """Which ``count`` of the places (N, 2) lie farthest apart, one after the other, and from those taken (M, 2).

    The first, where nothing is taken, is the one nearest to the middle; of equals it is the first in order.
    """
    if taken is None or not len(taken):
        taken = np.zeros((0, 2))
        away = -np.abs(places - (places.min(axis=0) + places.max(axis=0)) / 2).max(axis=1)
    else:
        away = np.sqrt(((places[:, None] - taken) ** 2).sum(axis=-1)).min(axis=1)
    chosen: list[int] = []
    for _ in range(min(count, len(places))):
        best = int(np.argmax(away.round(DIGITS)))
        if chosen and away[best] <= 0:
            break
        distance = np.sqrt(((places - places[best]) ** 2).sum(axis=1))
        away = distance if not chosen and not len(taken) else np.minimum(away, distance)
        chosen.append(best)
    return np.array(chosen, np.int64)


def conditions_at(
    place: tuple[float, float], lines: Sequence[Line], exposures_s: Range, further: Mapping[str, float] = {}
) -> Conditions:
    """The conditions of a place, on lines of one direction; of infinitely many, all the same experiment.

    The exposure is the one, within the shortest and the longest, at which a line passes nearest; of equal ones the
    nearest to their middle, then by the order of the lines. further: values of the other axes.
    """
    low, high = exposures_s
    middle = math.log2(low * high) / 2

    def order(candidate: tuple[float, Line]) -> tuple[float, float]:
        exposure_s, line = candidate
        away = math.dist(line.places(exposure_s), place)
        return round(away, _SAME), round(abs(math.log2(exposure_s) - middle), _SAME)

    candidates = [(exposure_s, line) for line in lines for exposure_s in _nearest(place, line, low, high)]
    exposure_s, _ = min(candidates, key=order)
    exposure_s = min(max(_rounded(exposure_s), low), high)
    speed = 2.0 ** place[1] / exposure_s if place[1] > FLOOR else 0.0
    x, y = direction_of_all(lines)
    line = Line(_rounded(2.0 ** place[0] / exposure_s), (_rounded(speed * x), _rounded(speed * y)))
    return Conditions(exposure_s=exposure_s, **line.axes, **further)


def _nearest(place: tuple[float, float], line: Line, low: float, high: float) -> list[float]:
    """Exposures at which the line may be nearest: in motion, and where motion counts as none."""
    by_light = place[0] - math.log2(line.illuminance_lux)
    logs = [by_light]
    if line.speed_px_s > 0:
        by_motion = place[1] - math.log2(line.speed_px_s)
        logs += [(by_light + by_motion) / 2, FLOOR - math.log2(line.speed_px_s)]
    return [float(np.clip(2.0 ** min(each, math.log2(high)), low, high)) for each in logs]


def _rounded(value: float) -> float:
    return float(f"{value:.{_ROUNDED}g}")
