"""A question: which exposures work, under which lights and at which speeds; its lines and nodes on the plane.

Domain: values on the axes of :mod:`blurnoise_eval.plan.axes`; places (u, w) of
:mod:`blurnoise_eval.answers.plane`. A line is every exposure under one light and velocity: it rises by 45 degrees, or
lies on the floor at rest.

On the plane conditions with the same light on the sensor and the same motion during the exposure are one experiment.
So nothing that a picture shows may go with the exposure time in another way, as dark charge does. What the error
budget of :mod:`blurnoise.scene.plan` leaves out does not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise.camera import Camera
from blurnoise.light.motion import ROLLING_SHUTTER
from blurnoise.light.resolved import Resolved
from blurnoise.scene.plan import Contribution, plan_at
from blurnoise.sensor.stages import DARK_CURRENT
from blurnoise_eval.answers.plane import AT_REST, DIGITS, STILL_PX, direction_of, places_of
from blurnoise_eval.plan.axes import EGO, EXPOSURE, FURTHER, LIGHT, VELOCITY, axis
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.trajectory_spec import TrajectorySpec
from blurnoise_eval.plan.typed import AUTOMATIC

STEP = 0.5
"""Stops between nodes."""
FLOOR = math.log2(STILL_PX)
"""w of all that is at rest."""
_ROUNDED = 6  # significant digits of the conditions of a node: they move the place by less than 1e-5 stops
Array = NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True)
class SearchLine:
    """All exposures under one light, lux above 0, and one velocity (x, y), px/s.

    >>> SearchLine(100.0, (240.0, 320.0)).places([0.01]).tolist()  # 1 lux s and 4 px, in stops
    [[0.0, 2.0]]
    """

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


@dataclass(frozen=True)
class SearchSpace:
    """Every exposure from the shortest to the longest of a grid, with every combination of its other values.

    grid: by axis, as :class:`~blurnoise_eval.plan.conditions.SweepPlan` has it. because: why the full grid is
    computed in place of a search; none of a search.

    >>> exposures_and_lights = {"exposure_s": (0.001, 0.01), "illuminance_lux": (0.0, 50.0)}
    >>> space = SearchSpace({**exposures_and_lights, "velocity_x_px_s": (0.0,), "velocity_y_px_s": (0.0,)})
    >>> space.exposures_s, len(space.lines), space.grid_conditions  # no line without light
    ((0.001, 0.01), 1, 4)
    """

    grid: Mapping[str, Sequence[float]]
    because: Sequence[str] = ()

    @property
    def exposures_s(self) -> Range:
        """The shortest and the longest, s."""
        tested = self.grid[EXPOSURE.name]
        return min(tested), max(tested)

    @property
    def further(self) -> dict[str, float]:
        """The values on the other axes, the first of several. Axes that are left out have the camera's own values."""
        return {name: self.grid[name][0] for name in FURTHER if name in self.grid}

    @cached_property
    def lines(self) -> tuple[SearchLine, ...]:
        """A line of the plane for each light above 0 and velocity, the darkest first."""
        lights, *velocity = (self.grid[name] for name in (LIGHT.name, *VELOCITY))
        return tuple(SearchLine(lux, (x, y)) for lux, x, y in product(filter(None, lights), *velocity))

    @property
    def grid_conditions(self) -> int:
        """How many conditions the grid has."""
        return math.prod(map(len, self.grid.values()))


def what_breaks(
    camera: Camera,
    space: SearchSpace,
    trajectory: str | TrajectorySpec | None = None,
    *,
    pulsed: bool = False,
) -> list[str]:
    """The reasons why conditions of equal light and motion do not give equal pictures; empty where they do.

    pulsed: whether there is a pulsed lamp.
    """
    low, high = space.exposures_s
    directions = {direction_of(line.velocity_px_s) for line in space.lines} - {None}
    path = trajectory if isinstance(trajectory, str | None) else trajectory.text
    reasons = {
        "the camera sets the exposure itself": high == AUTOMATIC,
        "there is one exposure": low == high != AUTOMATIC,
        "without light there is no lux x seconds": 0 in space.grid[LIGHT.name],
        f"the motion has {len(directions)} directions, with another blur in each": len(directions) > 1,
        f"along {path} each exposure sees another part of the path": path is not None,
        "the camera drives, and blur differs across the picture": space.further.get(EGO.name, 0) > 0,
        "headlamps add to the light what depends on the distance, whatever its lux": space.further.get(
            "headlamp", 0
        )
        > 0,
        "a longer exposure misses fewer pulses of the lamp": pulsed,
        "a capture starts at a fixed time, whatever the exposure": any(
            capture.start_s for capture in camera.sensor.captures
        ),
    }
    for name in FURTHER:
        reasons[f"{axis(name).title.lower()} has several values"] = len(space.grid.get(name, ())) > 1
    return [reason for reason, holds in reasons.items() if holds] or _of_time_alone(
        camera, space, moving=bool(directions)
    )


def _of_time_alone(camera: Camera, space: SearchSpace, *, moving: bool) -> list[str]:
    """Effects that the error budget keeps at the longest exposure and whose size depends on the exposure time itself.

    moving: whether anything does; at rest a rolling shutter changes nothing. In DN RMS at a gain of 0 dB: gain
    raises the dark charge and the noise that hides it alike.
    """
    camera = camera.with_figures(captures=())  # later ones are shorter
    (shortest_s, longest_s), temperature_c = space.exposures_s, space.further.get("temperature_c", 25.0)

    def budget(of: Camera, exposure_s: float, white_e: float) -> tuple[Contribution, ...]:
        return plan_at(Resolved(of, exposure_s, temperature_c, white_e, (float(moving), 0.0))).stages

    effects = [effect for effect in budget(camera, longest_s, 0.0) if effect.name == DARK_CURRENT.name]
    cold, bright_e = camera.with_figures(dark_current_e_s=0.0), camera.sensor.full_well_e
    both = zip(budget(cold, shortest_s, bright_e), budget(cold, longest_s, bright_e), strict=True)
    # A rolling shutter's bound ends at full scale, where it may be the same for the shortest and the longest.
    effects += [
        long
        for short, long in both
        if long.contribution_dn != short.contribution_dn or long.name == ROLLING_SHUTTER.name
    ]
    at = f"in {1e3 * longest_s:g} ms at {temperature_c:g} °C"
    kept = {effect.name: effect.contribution_dn for effect in effects if effect.kept}
    return [
        f"{name} depends on the exposure time alone ({float(f'{dn:.2g}'):g} DN {at})"
        for name, dn in kept.items()
    ]


def direction_of_all(lines: Sequence[SearchLine]) -> tuple[float, float]:
    """The direction of motion of the first line that moves, a unit vector.

    >>> direction_of_all([SearchLine(50.0), SearchLine(50.0, (300.0, 400.0))])
    (0.6, 0.8)
    """
    directions = (direction_of(line.velocity_px_s) for line in lines)
    return next((direction for direction in directions if direction is not None), AT_REST)


def exposures_on(exposures: Range, per_stop: float) -> Array:
    """Exposures from end to end, both included, at least ``per_stop`` to a stop.

    >>> exposures_on((0.001, 0.008), 1).round(4).tolist()
    [0.001, 0.002, 0.004, 0.008]
    """
    low, high = exposures
    count = 1 + math.ceil(per_stop * math.log2(high / low) - 1e-9)
    return np.geomspace(low, high, max(count, 1))


def lattice(lines: Sequence[SearchLine], exposures: Range, step: float = STEP) -> Array:
    """Places (N, 2) of a lattice of this step within half a step of any line, from end to end of the exposures.

    By u, then w; multiples of the step from u = 0 and from the floor, so lattices of other lines share their places.

    >>> len(lattice([SearchLine(100.0)], (0.01, 0.02), step=0.5))  # a stop at rest, in steps of a half
    3
    """
    times = exposures_on(exposures, 16 / step)
    index = (np.concatenate([line.places(times) for line in lines]) - (0.0, FLOOR)) / step
    # Both neighbours where a line passes half-way between two nodes, so that rounding decides nothing.
    low, high = np.ceil(index - 0.5 - 1e-9), np.floor(index + 0.5 + 1e-9)
    corners = [np.stack([u, w], axis=1) for u in (low[:, 0], high[:, 0]) for w in (low[:, 1], high[:, 1])]
    near = np.unique(np.concatenate(corners), axis=0)
    return near[near[:, 1] >= 0] * step + (0.0, FLOOR)


def spread(places: Array, count: int, taken: Array | None = None) -> NDArray[np.int64]:
    """Which ``count`` of the places (N, 2) lie farthest apart, one after the other, and from those taken (M, 2).

    The first, where nothing is taken, is the one nearest to the middle; of equals it is the first in order.

    >>> spread(np.array([[0.0, 0.0], [1.0, 0.0], [4.0, 0.0]]), 2).tolist()  # the middle, then the farthest
    [1, 2]
    """

    def distances(to: Array) -> Array:
        return np.asarray(np.sqrt(((places[:, None] - to) ** 2).sum(axis=-1)).min(axis=1))

    chosen: list[int] = []
    if taken is None or not len(taken):
        middle = np.abs(places - (places.min(axis=0) + places.max(axis=0)) / 2).max(axis=1)
        chosen = [int(np.argmin(middle.round(DIGITS)))]
        taken = places[chosen]
    away = distances(taken)
    while len(chosen) < min(count, len(places)) and away.max() > 0:
        chosen.append(int(np.argmax(away.round(DIGITS))))
        away = np.minimum(away, distances(places[chosen[-1:]]))
    return np.array(chosen, np.int64)


def conditions_at(
    place: tuple[float, float],
    lines: Sequence[SearchLine],
    exposures_s: Range,
    further: Mapping[str, float] = {},
) -> Conditions:
    """The conditions of a place, on lines of one direction; of infinitely many, all the same experiment.

    The exposure is the one, within the shortest and the longest, at which a line passes nearest; of equal ones the
    nearest to their middle, then by the order of the lines. further: values of the other axes.
    """
    low, high = np.log2(exposures_s)
    with np.errstate(divide="ignore"):
        lights, speeds = np.log2([(line.illuminance_lux, line.speed_px_s) for line in lines]).T
    by_light, by_motion = place[0] - lights, place[1] - speeds
    # where a line may be nearest, in stops of exposure: in light, in both, and where its motion begins
    stops = np.stack([by_light, (by_light + by_motion) / 2, FLOOR - speeds], axis=1).clip(low, high)
    motion = np.maximum(stops + speeds[:, None], FLOOR)
    away = np.hypot(stops - by_light[:, None], motion - place[1]).round(DIGITS)
    from_middle = np.abs(stops - (low + high) / 2).round(DIGITS)
    nearest = np.lexsort((from_middle.ravel(), away.ravel()))[0]
    exposure_s = float(np.clip(_rounded(2.0 ** stops.ravel()[nearest]), *exposures_s))
    speed = 2.0 ** place[1] / exposure_s if place[1] > FLOOR else 0.0
    x, y = direction_of_all(lines)
    line = SearchLine(_rounded(2.0 ** place[0] / exposure_s), (_rounded(speed * x), _rounded(speed * y)))
    return Conditions(exposure_s=exposure_s, **line.axes, **further)


def _rounded(value: float) -> float:
    return float(f"{value:.{_ROUNDED}g}")
