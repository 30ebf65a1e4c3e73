"""Nodes of the plane of exposures: where the lines of given light and velocity run in it, and the lattice about them.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`. A line is every exposure under one light and velocity:
it rises by 45 degrees, or lies on the floor at rest. Motion in opposite directions shares a plane; any other
direction has a plane of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise._core.checks import in_range
from blurnoise_eval.answers import plane
from blurnoise_eval.answers.plane import DIGITS, STILL_PX, direction_of

STEP = 0.5
"""Stops between nodes."""
FLOOR = math.log2(STILL_PX)
"""w of all that stands still."""
Array = NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """All exposures under one light, lux above 0, and one velocity (x, y), px/s. Raises ``ValueError``."""

    illuminance_lux: float
    velocity_px_s: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.illuminance_lux) and self.illuminance_lux > 0):
            raise ValueError(f"illuminance_lux = {self.illuminance_lux:g}: must be finite and above 0")
        if not math.isfinite(self.speed_px_s):
            raise ValueError(f"velocity_px_s = {self.velocity_px_s}: must be finite")

    @property
    def speed_px_s(self) -> float:
        """Length of the velocity."""
        return math.hypot(*self.velocity_px_s)

    @property
    def direction(self) -> tuple[float, float] | None:
        """Unit vector of the motion's axis, x >= 0; None at rest."""
        return direction_of(self.velocity_px_s)


def by_direction(lines: Sequence[Line]) -> list[tuple[tuple[float, float], list[Line]]]:
    """The lines of each plane, and the direction of its motion; those at rest are in the first.

    Lines that are all at rest have a plane with motion along x.
    """
    found: dict[tuple[float, float], list[Line]] = {}
    for line in lines:
        if line.direction is not None:
            found.setdefault(line.direction, [])
    first = next(iter(found), (1.0, 0.0))
    for line in lines:
        found.setdefault(line.direction or first, []).append(line)
    return list(found.items())


def place_of(exposure_s: float, line: Line) -> tuple[float, float]:
    """(u, w) of an exposure, s above 0, on the line."""
    return tuple(places_of([exposure_s], line)[0].tolist())


def places_of(exposures_s: ArrayLike, line: Line) -> Array:
    """:func:`place_of` of N exposures, (N, 2)."""
    return plane.places_of(exposures_s, line.illuminance_lux, line.speed_px_s)


def exposures_on(exposures: Range, per_stop: float) -> Array:
    """Exposures from end to end, both with it, at least ``per_stop`` to a stop. Raises ``ValueError``."""
    low, high = exposures
    in_range("exposures: shortest", low, 1e-9, 1e4)
    in_range("exposures: longest", high, low, 1e4)
    count = 1 + math.ceil(per_stop * math.log2(high / low) - 1e-9)
    return np.geomspace(low, high, max(count, 1))


def lattice(lines: Sequence[Line], exposures: Range, step: float = STEP) -> Array:
    """Places (N, 2) of a lattice of this step within half a step of any line, from end to end of the exposures.

    By u, then w; multiples of the step from u = 0 and from the floor, so lattices of other lines share their places.
    Raises ``ValueError`` without lines, or for exposures that are no range.
    """
    if not lines:
        raise ValueError("lines = []: must hold at least one")
    times = exposures_on(exposures, 16 / step)
    on_lines = np.concatenate([places_of(times, line) for line in lines])
    index = (on_lines - (0.0, FLOOR)) / step
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
