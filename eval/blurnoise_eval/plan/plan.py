"""The plan of a sweep: the grid of conditions, and how pictures are exposed under all of them.

The same record in Python, in a plan's file and in the options of the command line. It travels whole: to the workers,
into a run's identity, and back out of a run's folder.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from annotated_types import Ge, Le
from pydantic import BeforeValidator

from blurnoise._core import usual
from blurnoise.light.lights import Light, names_of_lights
from blurnoise_eval.plan.axes import (
    AXES,
    CORE,
    EGO,
    EXPOSURE,
    HEADLAMP,
    LIGHT,
    LIT,
    MOVES,
    OWN_SPECTRUM,
    SPECTRUM,
    VELOCITY,
    Axis,
    axis,
    setting_of,
)
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.lamps import Lamps
from blurnoise_eval.plan.lit_targets import LitTargets
from blurnoise_eval.plan.reading import (
    anchor_of,
    curve_of,
    named_lights_of,
    spectra_of,
    tone_of,
    trajectory_of,
)
from blurnoise_eval.plan.settings import SettingInfo, Settings, default_text, late, nested, setting
from blurnoise_eval.plan.typed import AUTOMATIC

if TYPE_CHECKING:
    from blurnoise.camera.colour import PictureTone
    from blurnoise.camera.spectra import Curve
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.metering import AutoExposure
    from blurnoise_eval.plan.objects import ObjectSettings
    from blurnoise_eval.plan.trajectory_spec import TrajectorySpec

    Anchor = str
else:
    Vehicle = late("blurnoise.motion.ego", "Vehicle")
    AutoExposure = late("blurnoise.scene.metering", "AutoExposure")
    ObjectSettings = late("blurnoise_eval.plan.objects", "ObjectSettings")
    PictureTone = Annotated[Any, BeforeValidator(tone_of)]
    Anchor = Annotated[Any, BeforeValidator(anchor_of)]
    Curve = Any
    TrajectorySpec = Annotated[Any, BeforeValidator(trajectory_of)]

MOST_CONDITIONS = 1_000_000
"""Of a plan; a picture of each takes hours."""
_MOST_EXAMPLES = 12
"""Conditions of which pictures are kept."""


@dataclass(frozen=True, kw_only=True)
class ExposureSettings(Settings):
    """Conditions, and how pictures are exposed under all of them: what a sweep and a single picture share.

    grid: by axis, values in SI units. In files and options each axis of ``AXES`` is a setting of its own, in the
    option's unit, with the axis's default. light: named lights, in place of values of ``illuminance_lux``: the grid
    has theirs, and conditions of each have its spectrum (and headlamps), unless the grid has these. own_spectrum: the
    illuminant "own", which a CSV file among the illuminants becomes. lit: targets in headlamps. vehicle: drives at
    the speeds on the axis ``ego_speed_m_s``, and carries camera and headlamps.
    auto_exposure: sets gain and exposure where they are automatic. trajectory: motion in addition to the velocity.
    grey_anchor: the part of a picture that reflects 18 %; None: brightness is reflectance. picture_tone: the curve
    that codes pictures. hdr_white: the light that is white in the merged picture of a camera of several captures.
    """

    AXES: ClassVar[tuple[Axis, ...]] = AXES
    LIGHTS: ClassVar[tuple[str, ...]] = ()
    """Names of the lights where neither these nor lux are chosen."""
    PANEL: ClassVar[str] = "Conditions: numbers such as 1,5,10, or a range low:high"
    METAVAR: ClassVar[str] = "LIST"

    grid: Mapping[str, Iterable[float]] = field(default_factory=dict, kw_only=False)
    lit: LitTargets = nested(LitTargets)
    light: tuple[Light, ...] = ()
    own_spectrum: Curve | None = None
    vehicle: Vehicle | None = setting(
        None, "position and orientation of the camera on a vehicle that drives (ego_kmh), or has headlamps"
    )
    auto_exposure: AutoExposure = setting(None, "limits of exposure time and gain where these are auto")
    trajectory: TrajectorySpec | None = setting(
        None,
        "camera motion in addition to dx and dy: a file of positions or rotation rates, a random shake, or a "
        "sinusoidal vibration",
        "FILE.csv|shake:PX|sine:PX,HZ[,DEG]",
    )
    grey_anchor: Anchor | None = setting(
        None,
        "part of a picture that reflects 18 %: its mean, a percentile, or a region in px (default: none; brightness "
        "is used as reflectance)",
        "mean|pNN|x0,y0,x1,y1",
    )
    picture_tone: PictureTone = setting(
        "srgb",
        "tone curve of the input pictures, which is removed first; linear: values are proportional to light "
        "(default: srgb)",
        "srgb|linear|filmic|FILE.yaml|POINTS",
    )
    hdr_white: Annotated[float, Ge(1e-6), Le(1e6)] = setting(
        1.0,
        "light that is white in the merged picture of a camera with several captures, in multiples of white",
    )
    seed: int = setting(0, "seed of the noise, and of the order of pictures in decide (default: 0)", "N")

    def __post_init__(self) -> None:
        from blurnoise._core.checks import integer
        from blurnoise._core.rng import LAST_SEED

        integer("seed", self.seed, 0, LAST_SEED)
        super().__post_init__()
        object.__setattr__(self, "light", named_lights_of(self.light))
        object.__setattr__(self, "own_spectrum", curve_of(self.own_spectrum))
        self._check_light()
        if self.auto_exposure is None:  # its module is heavy, so that no field can have it as default
            from blurnoise.scene.metering import USUAL

            object.__setattr__(self, "auto_exposure", USUAL)

    @classmethod
    def _settings(cls) -> Iterator[SettingInfo]:
        for each in cls.AXES:
            names = f": {', '.join(each.default_names)}" if each.default_names else ""
            default = default_text(each.default_text, names)
            if cls.LIGHTS and each.name == LIGHT.name:
                default = ""  # that of light
            metavar = f"auto|{cls.METAVAR}" if each.automatic else "|".join(each.choices) or cls.METAVAR
            metavar = "NAME,..." if each.prefix else metavar  # of many names, which its line lists
            yield SettingInfo(each.key, str, None, f"{each.about}{default}", metavar, cls.PANEL)
            if each.name != LIGHT.name:
                continue
            about = f"named lights, each with its spectrum, in place of lux: {', '.join(names_of_lights())}"
            about += f"; see 'blurnoise lights'{default_text(','.join(cls.LIGHTS))}"
            yield SettingInfo("light", str, None, about, "NAME,...", cls.PANEL)
        yield from super()._settings()

    @classmethod
    def _arguments(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        curve = None
        if SPECTRUM.key in values:
            stated, curve = spectra_of(values[SPECTRUM.key])
            values = {**values, SPECTRUM.key: stated}
        chosen = {each: _values(each, values[each.key]) for each in cls.AXES if each.key in values}
        replaced = {name for each in chosen for name in each.without}
        light = values.get("light") or ()
        if values.get("light") == "":
            raise ValueError("light = '': must be names, such as street,dusk")
        if light and LIGHT.key in values:
            raise ValueError("light, lux: must not be combined; a light has its own lux")
        if not light and LIGHT.key not in values and cls.LIGHTS:
            light = cls.LIGHTS
            if values.get("emitters"):  # which light the targets
                chosen.setdefault(HEADLAMP, (0.0,))
        if light:
            replaced.add(LIGHT.name)
        usual = {each: each.default for each in cls.AXES if each.default and each.name not in replaced}
        grid = {each.name: (usual | chosen)[each] for each in cls.AXES if each in usual | chosen}
        return {"grid": grid, "light": light, "own_spectrum": curve, **super()._arguments(values)}

    def values(self, name: str) -> tuple[float, ...]:
        """The values on an axis, increasing; none where the camera has its own."""
        return tuple(self.grid.get(name, ()))

    @property
    def beams(self) -> tuple[str, ...]:
        """The beams that light its pictures under some of its conditions."""
        names = [HEADLAMP.choice(value) for value in self.spanned.get(HEADLAMP.name, ())]
        return tuple(beam for beam in HEADLAMP.choices[1:] if beam in names)

    def check_headlamps(self, emitters: str | None) -> None:
        """Raise ``ValueError`` for settings that headlamps lack, or exclude. emitters: targets that are lamps."""
        if not self.beams:
            if stated := self.lit.to_dict():
                raise ValueError(f"{', '.join(stated)}: needs headlamp, low or high")
            return
        if emitters is not None:
            raise ValueError("headlamp, emitters: must not both light the targets")
        if self.values(LIGHT.name)[:1] == (0.0,):
            raise ValueError("headlamp: needs lux > 0; moonlight is 0.3")

    def _check_light(self) -> None:
        """Give the grid the lux of the lights. Raises ``ValueError`` where it has others."""
        if self.light:
            lux = tuple(light.lux for light in self.light)
            if not set(self.values(LIGHT.name)) <= set(lux):
                raise ValueError("light, illuminance_lux: must not be combined; a light has its own lux")
            object.__setattr__(self, "grid", {**self.grid, LIGHT.name: lux})
        if self.own_spectrum is None and self._own_index in self.values(SPECTRUM.name):
            raise ValueError(f"illuminant = {OWN_SPECTRUM}: needs a CSV file of nm and power, by its path")

    @property
    def _own_index(self) -> float:
        return SPECTRUM.choice_index(OWN_SPECTRUM)

    def light_at(self, illuminance_lux: float) -> Light | None:
        """The named light of that lux; None where the plan names none."""
        return next((light for light in self.light if light.lux == illuminance_lux), None)

    def of_light(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of a condition by axis, with those that its named light has on axes which the grid leaves out."""
        light = self.light_at(values[LIGHT.name]) if self.light else None
        if light is None:
            return dict(values)
        own = {name: getattr(light, name) for name in LIT if name not in self.grid}
        return {**{name: axis(name).choice_index(value) for name, value in own.items()}, **values}

    @property
    def spanned(self) -> dict[str, tuple[float, ...]]:
        """The grid, with the values that its named lights have on axes which it leaves out."""
        of_lights = [self.of_light({LIGHT.name: light.lux}) for light in self.light]
        names = dict.fromkeys(name for each in of_lights for name in each if name != LIGHT.name)
        further = {name: tuple(sorted({each[name] for each in of_lights})) for name in names}
        return {name: self.values(name) for name in self.grid} | further


def _values(of: Axis, given: Any) -> tuple[float, ...]:
    """The values of a setting. Raises ``ValueError`` that names it."""
    try:
        return of.values(given)
    except (TypeError, ValueError) as error:
        from blurnoise._core.checks import shown

        if not str(error).startswith("must"):
            raise
        raise ValueError(f"{of.key} = {shown(given)}: {error}") from None


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

    @property
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
        if self.picture_tone != "srgb":
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
