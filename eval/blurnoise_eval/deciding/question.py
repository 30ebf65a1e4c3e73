"""A question: which exposures work, under which lights and at which speeds, and whether a plane answers it.

Domain: values on the axes of :mod:`blurnoise_eval.grid.axes`. On the plane of lux-seconds and pixels conditions with
the same light on the sensor and the same motion during the exposure are one experiment. So nothing that a picture
shows may go with the exposure time in another way, as dark charge does. What the error budget of
:mod:`blurnoise.scene.plan` leaves out does not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

from blurnoise.light.conditions import Conditions
from blurnoise.optics.camera import Camera
from blurnoise.scene.plan import Contribution, plan_at
from blurnoise.sensor.stages import DARK_CURRENT
from blurnoise_eval.answers.plane import direction_of
from blurnoise_eval.deciding.lines import Line
from blurnoise_eval.grid.axes import AUTOMATIC, EXPOSURE, FURTHER, LIGHT, VELOCITY, axis
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec


@dataclass(frozen=True)
class Question:
    """Every exposure from the shortest to the longest of a grid, with every combination of its other values.

    grid: by axis, as :class:`~blurnoise_eval.grid.conditions.SweepPlan` has it. because: why the plane does not hold;
    cheaper: why the grid costs less than a search.
    """

    grid: Mapping[str, Sequence[float]]
    because: Sequence[str] = ()
    cheaper: Sequence[str] = ()

    @property
    def searched(self) -> bool:
        """Whether a search answers it, not the grid."""
        return not self.because and not self.cheaper

    @property
    def exposures_s(self) -> tuple[float, float]:
        """The shortest and the longest, s."""
        tested = self.grid[EXPOSURE.name]
        return min(tested), max(tested)

    @property
    def not_on_a_plane(self) -> list[str]:
        """Why only a grid answers, whatever the camera, a reason each."""
        reasons = []
        low, high = self.exposures_s
        if high == AUTOMATIC:
            reasons.append("the camera sets the exposure itself")
        elif low == high:
            reasons.append("there is one exposure")
        if 0 in self.grid[LIGHT.name]:
            reasons.append("without light there is no lux x seconds")
        several = [name for name in FURTHER if len(self.grid.get(name, ())) > 1]
        return reasons + [f"{axis(name).title.lower()} has several values" for name in several]

    @property
    def further(self) -> dict[str, float]:
        """Values of the other axes, the first of several; the camera's own stand on those that are not named."""
        return {name: self.grid[name][0] for name in FURTHER if name in self.grid}

    @cached_property
    def lines(self) -> tuple[Line, ...]:
        """A line of the plane for each light above 0 and velocity, the darkest first."""
        lights, *velocity = (self.grid[name] for name in (LIGHT.name, *VELOCITY))
        return tuple(Line(lux, (x, y)) for lux, x, y in product(filter(None, lights), *velocity))

    @property
    def grid_conditions(self) -> int:
        """How many conditions the grid has."""
        return math.prod(map(len, self.grid.values()))


def what_breaks(
    camera: Camera,
    exposures_s: tuple[float, float],
    lines: Sequence[Line],
    temperature_c: float = 25.0,
    trajectory: str | TrajectorySpec | None = None,
    drives: bool = False,
) -> list[str]:
    """Why the plane does not hold between two exposures, a reason each; empty where it holds.

    drives: whether the camera does. Asked at gain 0 dB: gain raises the dark charge and the noise that hides it
    alike. Raises ``ValueError`` for a camera of several captures.
    """
    longest_s = max(exposures_s)
    reasons = [
        f"{name} goes with the exposure time alone ({dn:.2g} DN in {1e3 * longest_s:g} ms at {temperature_c:g} °C)"
        for name, dn in _of_time_alone(camera, min(exposures_s), longest_s, temperature_c).items()
    ]
    directions = {direction_of(line.velocity_px_s) for line in lines} - {None}
    if len(directions) > 1:
        reasons.append(f"motion has {len(directions)} directions, and blurs differently in each")
    if trajectory is not None:
        text = trajectory if isinstance(trajectory, str) else trajectory.text
        reasons.append(f"along {text} another exposure sees another part of the path")
    if drives:
        reasons.append(
            "before a camera that drives each place has a blur of its own, in any exposure another"
        )
    return reasons


def _of_time_alone(
    camera: Camera, shortest_s: float, longest_s: float, temperature_c: float
) -> dict[str, float]:
    """DN RMS of what the budget keeps at the longest exposure, and would not be the same at the shortest."""

    def budget(of: Camera, exposure_s: float, white_e: float) -> tuple[Contribution, ...]:
        return plan_at(Conditions(of, exposure_s, temperature_c, white_e, (1.0, 0.0))).stages

    in_the_dark = budget(camera, longest_s, 0.0)
    found = {each.name: each for each in in_the_dark if each.name == DARK_CURRENT.name}
    cold, bright_e = replace(camera, dark_current_e_s=0.0), camera.full_well_e
    both = zip(budget(cold, shortest_s, bright_e), budget(cold, longest_s, bright_e), strict=True)
    found |= {long.name: long for short, long in both if long.contribution_dn != short.contribution_dn}
    return {name: each.contribution_dn for name, each in found.items() if each.kept}
