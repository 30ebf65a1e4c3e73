"""The plan of a sweep: the grid of conditions, and how pictures are exposed under all of them.

The same record in Python, in a plan's file and in the options of the command line. It travels whole: to the workers,
into a run's identity, and back out of a run's folder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar, Self

from blurnoise._core import usual
from blurnoise_eval.plan.axes import (
    AXES,
    CORE,
    EGO,
    EXPOSURE,
    MOVES,
    VELOCITY,
    axis,
    setting_of,
)
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.exposure_settings import ExposureSettings
from blurnoise_eval.plan.lamps import Lamps
from blurnoise_eval.plan.lit_targets import LitTargets
from blurnoise_eval.plan.settings import late, nested, setting
from blurnoise_eval.plan.typed import AUTOMATIC

if TYPE_CHECKING:
    from blurnoise_eval.plan.objects import ObjectSettings
    from blurnoise_eval.plan.trajectory_spec import TrajectorySpec
else:
    ObjectSettings = late("blurnoise_eval.plan.objects", "ObjectSettings")

MOST_CONDITIONS = 1_000_000
"""Of a plan; a picture of each takes hours."""
_MOST_EXAMPLES = 12
"""Conditions of which pictures are kept."""


@dataclass(frozen=True, kw_only=True)
class SweepPlan(ExposureSettings):
    """What a sweep computes: the conditions of a grid, for each picture with ``repeats`` noise fields.

    grid: by axis, values in SI units; further axes that are left out have the camera's own, velocities are 0.
    objects: how objects move where not all of a picture does, and the boxes that are the truth. lamps: of every
    picture. trajectory: a shake is each picture's own, by its cells' seed, and goes so far in ``longest_s``; a
    shorter exposure sees a part of that. examples: whether some pictures are kept.
    only: conditions that are computed in place of the grid's, such as more exposures of some lights and speeds.
    direction: of a search, which chooses conditions, ``only``, a few at a time: unit vector of all motion in them.
    Its grid has a value for some further axes alone; its runs are told apart by all but the conditions.

    Raises ``TypeError`` or ``ValueError`` of one line for an unknown axis, no value, or one that is not allowed.

    >>> plan = SweepPlan({"exposure_s": (0.002, 0.01), "illuminance_lux": (50.0,)}, repeats=2)
    >>> len(plan.conditions()), plan.cells_per_picture
    (2, 5)
    >>> plan == SweepPlan.of({"exposure_ms": "2,10", "lux": 50, "dx": 0, "gain": "0", "repeats": 2})
    False
    """

    LIGHTS: ClassVar[tuple[str, ...]] = usual.LIGHTS

    repeats: int = setting(1, "number of repeats with other noise (default: 1; 2 for charts)")
    objects: ObjectSettings = setting(None, "speeds and boxes of objects, where targets or background move")
    lamps: Lamps | None = nested(Lamps, optional=True)
    examples: bool = True
    only: tuple[Conditions, ...] = ()
    direction: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        from blurnoise._core.checks import integer

        integer("repeats", self.repeats, 1, 1_000_000)
        super().__post_init__()
        if self.objects is None:
            from blurnoise_eval.plan.objects import USUAL_OBJECTS

            object.__setattr__(self, "objects", USUAL_OBJECTS)
        self._check_grid()
        self._check_motion()
        self.check_headlamps(self.lamps.emitters if self.lamps else None)
        n_phases = len(self.lamps.phases) if self.lamps else 0
        if n_phases and self.repeats % n_phases:
            raise ValueError(f"repeats = {self.repeats}: must be a multiple of the {n_phases} of pwm_phase")

    @classmethod
    def _arguments(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """In a file ``repeats`` are those of each phase of a pulsed lamp."""
        arguments = super()._arguments(values)
        if lamps := arguments.get("lamps"):
            arguments["repeats"] = arguments.get("repeats", 1) * max(1, len(lamps.phases))
        return arguments

    def _check_grid(self) -> None:
        """Sort the values of each axis, and give axes of the core their own where they are left out."""
        for name in self.grid:
            axis(name)
        core = CORE.items() if self.direction is None else ()
        chosen = {name: () if value is None else (value,) for name, value in core} | {**self.grid}
        grid = {each.name: each.checked(chosen[each.name]) for each in AXES if each.name in chosen}
        if (count := math.prod(map(len, grid.values()))) > MOST_CONDITIONS:
            raise ValueError(f"grid: has {count} conditions; must have at most {MOST_CONDITIONS}")
        if AUTOMATIC in grid.get(EXPOSURE.name, ()):
            if len(grid[EXPOSURE.name]) > 1:
                raise ValueError("exposure_s: must be auto or times, not both; use two sweeps")
            if grid.get("gain_db", (AUTOMATIC,)) != (AUTOMATIC,):
                raise ValueError(
                    "exposure_s = auto: the camera then sets the gain, too; gain_db must be auto or left out"
                )
            grid["gain_db"] = (AUTOMATIC,)
        object.__setattr__(self, "grid", grid)

    def _check_motion(self) -> None:
        from blurnoise._core.checks import limited
        from blurnoise.motion.ego import USUAL_VEHICLE

        if not self.cuts and (moving := self.objects.to_dict().keys() - {"boxes"}):
            raise ValueError(
                f"{', '.join(sorted(moving))}: settings of objects need moves = targets or background"
            )
        for name in VELOCITY if self.direction is None else ():  # here, before anything is computed
            fastest = max(map(abs, self.values(name)))
            limited(f"{name}: {fastest:g} times exposure_s", fastest * self.longest_s, "displacement_px")
        if not self.values(EGO.name):
            if self.vehicle is not None and not self.beams:
                raise ValueError(f"vehicle: needs {EGO.name}, the speed of the vehicle, or headlamp")
            return
        object.__setattr__(self, "vehicle", self.vehicle or USUAL_VEHICLE)
        if others := [name for name in (*VELOCITY, MOVES.name) if any(self.values(name))]:
            raise ValueError(
                f"{EGO.name}: ego-motion moves each part of the picture differently; it excludes {', '.join(others)}"
            )

    def for_rendered(self) -> Self:
        """The plan for rendered signs, whose sizes in px say nothing of their distance.

        Headlamps light them as at :data:`.usual.DISTANCE_M`, unless the plan states another distance.
        """
        if not self.beams or self.lit.distance_m is not None:
            return self
        return replace(self, lit=replace(self.lit, distance_m=usual.DISTANCE_M))

    @property
    def longest_s(self) -> float:
        """The longest exposure, or the longest that the camera may set."""
        longest = self.values(EXPOSURE.name)[-1]
        return self.auto_exposure.limit_s if longest == AUTOMATIC else longest

    @property
    def path(self) -> tuple[TrajectorySpec, float] | None:
        """The trajectory and the longest exposure along it."""
        return None if self.trajectory is None else (self.trajectory, self.longest_s)

    @property
    def cuts(self) -> bool:
        """Whether targets or background move alone."""
        return any(self.values(MOVES.name))

    @property
    def pulsed(self) -> bool:
        """Whether there is a pulsed lamp."""
        return self.lamps is not None and self.lamps.pwm is not None

    @cached_property
    def cells_per_picture(self) -> int:
        """How many cells each picture has, that of the original picture included."""
        return 1 + self.repeats * len(self.conditions())

    @property
    def of_every_cell(self) -> Self:
        """The plan without what only chooses cells: equal for all batches of a run."""
        return replace(self, only=(), examples=False)

    def conditions(self) -> list[Conditions]:
        """Each once; those that share a blur stand next to each other, in them those of one exposure."""
        conditions = dict.fromkeys(self.only)
        if not self.only and self.direction is None:
            combined = product(*(self.values(name) for name in self.grid))
            conditions = dict.fromkeys(
                Conditions(**self.of_light(dict(zip(self.grid, values, strict=True)))) for values in combined
            )
        # Workers go through a picture's conditions in this order, and blur once for those that share it.
        return sorted(conditions, key=lambda at: (at.blurs_as, at.exposure_s, setting_of(at)))

    def example_conditions(self) -> set[Conditions]:
        """At most twelve conditions whose pictures are kept, evenly from no blur and no light to much."""
        every = self.conditions()
        every.sort(key=lambda at: (math.hypot(*at.displacement_px), at.exposure_s * at.illuminance_lux))
        count = min(_MOST_EXAMPLES, len(every))
        return {every[round(index * (len(every) - 1) / max(1, count - 1))] for index in range(count)}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, by which runs are told apart: what differs from the defaults; of a trajectory its
        identity."""
        # What has its default is left out: a run that was begun before a setting existed keeps its identity.
        values: dict[str, Any] = {"repeats": self.repeats, "seed": self.seed}
        if self.grey_anchor is not None:
            values["grey_anchor"] = self.grey_anchor
        if self.picture_tone not in (None, "srgb"):
            values["picture_tone"] = self.picture_tone
        if any(AUTOMATIC in self.values(name) for name in self.grid):
            values["auto_exposure"] = asdict(self.auto_exposure)
        if objects := self.objects.to_dict():
            values["objects"] = objects
        if self.lamps is not None:
            values["lamps"] = asdict(self.lamps)
        if lit := self.lit.to_dict():
            values["lit"] = lit
        if self.hdr_white != 1:
            values["hdr_white"] = self.hdr_white
        if self.own_spectrum is not None:
            values["own_spectrum"] = asdict(self.own_spectrum)
        if self.infrared is not None:
            values["infrared"] = self.infrared
        if self.light:
            values["light"] = [asdict(light) for light in self.light]
        if self.direction is not None:
            further = {name: self.values(name)[0] for name in self.grid}
            return values | {"further": further, "direction": self.direction}
        values |= {} if self.vehicle is None else {"ego": asdict(self.vehicle)}
        values |= {} if self.path is None else {"trajectory": self.path[0].identity}
        return values | {"grid": dict(self.grid), "examples": self.examples}

    @classmethod
    def from_dict(
        cls,
        values: Mapping[str, Any],
        trajectory: TrajectorySpec | None = None,
        only: Sequence[Conditions] = (),
    ) -> Self:
        """The plan of :meth:`to_dict`. trajectory: whose identity it has; only: conditions that a search chose.

        Raises ``TypeError``, ``ValueError`` or ``KeyError``: the values may be anybody's.
        """
        held = {name: value for name, value in values.items() if name not in ("ego", "further", "direction")}
        held |= {"trajectory": trajectory, "vehicle": values.get("ego")}
        held |= {"lamps": Lamps(**values["lamps"])} if "lamps" in values else {}
        held |= {"lit": LitTargets.of(values["lit"])} if "lit" in values else {}
        if "grid" in values:
            return cls(**held)
        further = {name: (value,) for name, value in values["further"].items()}
        return cls(further, **held, only=tuple(only), direction=tuple(values["direction"]))


@cache
def usual_plan() -> SweepPlan:
    """The conditions that a sweep of labelled pictures tests by default, with a noise field for each picture."""
    return SweepPlan.of({})
