"""A question: over which exposures, under which lights and at which speeds it is asked what works.

Domain: values on the axes of :mod:`blurnoise_eval.grid.axes`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

from blurnoise_eval.deciding.nodes import Line, exposures_on
from blurnoise_eval.grid.axes import AUTOMATIC, EXPOSURE, FURTHER, LIGHT, VELOCITY, axis
from blurnoise_eval.grid.conditions import SweepPlan

_GRID_PER_STOP = 2  # exposures of the grid where the plane does not hold


@dataclass(frozen=True)
class Question:
    """Every exposure between two, s, with every combination of the values on the other axes.

    values: by the axis's name, as :class:`SweepPlan` takes them. tested_s: the exposures of the grid, if it is
    computed, by default half a stop apart. Raises ``ValueError`` for exposures that are no range, unless they are
    listed, and for what is not allowed on an axis.
    """

    exposures_s: tuple[float, float]
    values: Mapping[str, tuple[float, ...]]
    tested_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        low, high = self.exposures_s
        if not (low < high or self.tested_s):
            raise ValueError(f"{EXPOSURE.name} = {low:g} to {high:g}: must be a range, the shortest first")
        checked = SweepPlan({**self.values, EXPOSURE.name: self.tested_s or self.exposures_s}).grid
        object.__setattr__(self, "values", {name: checked[name] for name in checked if name != EXPOSURE.name})

    @classmethod
    def of_grid(cls, grid: Mapping[str, tuple[float, ...]]) -> Question:
        """The question that a sweep over this grid answers."""
        exposures = tuple(sorted(set(grid[EXPOSURE.name])))
        rest = {name: values for name, values in grid.items() if name != EXPOSURE.name}
        return cls((exposures[0], exposures[-1]), rest, exposures)

    @property
    def not_on_a_plane(self) -> list[str]:
        """Why only a grid answers, whatever the camera, a reason each."""
        reasons = []
        if self.exposures_s[1] == AUTOMATIC:
            reasons.append("the camera sets the exposure itself")
        elif self.exposures_s[0] == self.exposures_s[1]:
            reasons.append("there is one exposure")
        if self.lights_lux[0] == 0:
            reasons.append("without light there is no lux x seconds")
        several = [name for name in FURTHER if len(self.values.get(name, ())) > 1]
        return reasons + [f"{axis(name).title.lower()} has several values" for name in several]

    @property
    def further(self) -> dict[str, float]:
        """Where the other axes stand, at the first of several values; those that are not named stand where the camera
        has them."""
        return {name: self.values[name][0] for name in FURTHER if name in self.values}

    @property
    def lights_lux(self) -> tuple[float, ...]:
        """Increasing."""
        return self.values[LIGHT.name]

    @property
    def velocities_px_s(self) -> tuple[tuple[float, float], ...]:
        """Every combination of motion to the right and down."""
        x, y = (self.values[name] for name in VELOCITY)
        return tuple(product(x, y))

    @cached_property
    def lines(self) -> tuple[Line, ...]:
        """A line of the plane for each light above 0 and velocity, the darkest first."""
        lights = filter(None, self.lights_lux)
        return tuple(Line(lux, velocity) for lux, velocity in product(lights, self.velocities_px_s))

    @property
    def grid(self) -> dict[str, tuple[float, ...]]:
        """The same as a grid of conditions."""
        exposures = self.tested_s or exposures_on(self.exposures_s, _GRID_PER_STOP).tolist()
        return {**self.values, EXPOSURE.name: tuple(exposures)}

    @property
    def grid_conditions(self) -> int:
        """How many conditions the grid has."""
        return math.prod(map(len, self.grid.values()))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; :meth:`from_dict` reads them."""
        tested = {"tested_s": self.tested_s} if self.tested_s else {}
        return {"exposures_s": self.exposures_s, "values": dict(self.values), **tested}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Question:
        """The question of :meth:`to_dict`."""
        low, high = values["exposures_s"]
        tested = tuple(values.get("tested_s", ()))
        return cls((low, high), {name: tuple(each) for name, each in values["values"].items()}, tested)
