"""The cells of a search: the lines of a grid at its exposures, and at exposures between them.

Domain: N lines, each a light, speed and whatever else a grid combines, at E exposures, s. A cell (n, e) is a
condition, by its line and exposure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise, product

import numpy as np
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise_eval.answers.plane import direction_of, places_of
from blurnoise_eval.answers.recommendation import WIDE, Setting, Velocity
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import EGO, EXPOSURE, LIGHT, SETTING, setting_of, velocity_of
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan

_LEAST_LUX = 0.01
_PX_S_OF_KMH = 10.0  # a sign 5 m beside and 12.5 m ahead, in a picture of 1280 px over 60 degrees
_BESIDE = (
    0.25  # stops by which a stop of light counts that lux x seconds does not tell: cameras nearly obey it
)
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Places = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells that a search chooses from.

    settings, velocities_px_s: of the N lines. exposures_s: E, rising. of_grid: (E,) the exposures of the grid; those
    between them are for all conditions together. places: (N, E, D) for surfaces, in stops: light, motion, and what
    comes beside them. monotone: whether more motion can only hurt.
    """

    settings: tuple[Setting, ...]
    velocities_px_s: tuple[Velocity, ...]
    exposures_s: tuple[float, ...]
    of_grid: Flags
    places: Array
    monotone: bool = True

    @classmethod
    def of(
        cls, plan: SweepPlan, camera: Camera, tables: Iterable[ScoreTable], *, between: bool = True
    ) -> Cells:
        """Those of a plan's grid, of all exposures that were measured, and of others between those of the grid."""
        grid = plan.values(EXPOSURE.name)
        measured = chain.from_iterable(table.conditions[EXPOSURE.name].tolist() for table in tables)
        exposures = sorted({*grid, *(_between(grid) if between else ()), *measured})
        lines = lines_of(plan)
        rows = [Conditions(**line, exposure_s=grid[0]).on(camera) for line in lines]
        return cls(
            settings=tuple(map(setting_of, rows)),
            velocities_px_s=tuple(map(velocity_of, rows)),
            exposures_s=tuple(exposures),
            of_grid=np.isin(exposures, grid),
            places=_places(rows, exposures),
            # Where only a part of the picture moves, or the camera drives, a speed may undo another motion.
            monotone=not (plan.trajectory or plan.cuts or any(plan.values(EGO.name))),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """(N, E)."""
        return len(self.settings), len(self.exposures_s)

    @cached_property
    def lights(self) -> Places:
        """(N,) a number for each light, and whatever else but the speed."""
        others = [place for place, name in enumerate(SETTING) if name != EGO.name]
        of = [tuple(setting[place] for place in others) for setting in self.settings]
        numbers = {each: number for number, each in enumerate(dict.fromkeys(of))}
        return np.array([numbers[each] for each in of], np.int64)

    def lines(self, settings: Sequence[Setting], velocities: Sequence[Velocity]) -> Places:
        """The numbers of the lines of these settings and velocities, (K,) each."""
        numbers = {key: n for n, key in enumerate(zip(self.settings, self.velocities_px_s, strict=True))}
        return np.array([numbers[key] for key in zip(settings, velocities, strict=True)], np.int64)

    def measured(self, tables: Iterable[ScoreTable]) -> Flags:
        """(N, E), what any of the tables has."""
        flags = np.zeros(self.shape, bool)
        for table in tables:
            columns = np.searchsorted(self.exposures_s, table.conditions[EXPOSURE.name])
            flags[self.lines(table.settings, table.velocities_px_s), columns] = True
        return flags


def lines_of(plan: SweepPlan) -> list[dict[str, float]]:
    """Of each line its values by axis, those of its named light included."""
    names = [name for name in plan.grid if name != EXPOSURE.name]
    combined = product(*(plan.grid[name] for name in names))
    return [plan.of_light(dict(zip(names, values, strict=True))) for values in combined]


def _between(exposures_s: Sequence[float]) -> Iterator[float]:
    """Exposures that leave no gap wider than ``WIDE`` between those of a grid, to three digits.

    >>> list(_between((0.001, 0.002)))
    [0.00141]
    """
    for low, high in pairwise(exposures_s):
        parts = math.ceil(math.log2(high / low) / WIDE - 0.1)
        yield from (float(f"{low * (high / low) ** (k / parts):.3g}") for k in range(1, parts))


def _places(rows: Sequence[Mapping[str, float]], exposures_s: Sequence[float]) -> Array:
    """(N, E, D) in stops, of N lines at E exposures: light on the sensor, motion during the exposure, and beside them
    what may tell experiments of equal light and motion apart: the exposure time, and all other axes by rank."""
    lux = np.array([max(row[LIGHT.name], _LEAST_LUX) for row in rows])[:, None]
    speeds = [math.hypot(*velocity_of(row)) + _PX_S_OF_KMH * float(EGO.shown(row[EGO.name])) for row in rows]
    on_plane = places_of(np.array(exposures_s), lux, np.array(speeds)[:, None])
    beside = [_BESIDE * np.log2(lux[:, 0])]
    for name in SETTING:
        if name not in (LIGHT.name, EGO.name):
            beside.append(np.unique([row[name] for row in rows], return_inverse=True)[1].astype(float))
    directions = [direction_of(velocity_of(row)) for row in rows]
    if len(set(directions) - {None}) > 1:
        beside += np.array([each or (0.0, 0.0) for each in directions]).T.tolist()
    varied = np.array([each for each in beside if np.ptp(each) > 0] or [np.zeros(len(rows))]).T
    further = np.broadcast_to(varied[:, None], (*on_plane.shape[:2], varied.shape[1]))
    return np.concatenate([on_plane, further], axis=-1)
