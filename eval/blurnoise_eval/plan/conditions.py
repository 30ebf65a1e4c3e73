"""What a sweep computes, as plain descriptors: conditions, their grid, and cells.

A cell (picture, repeat, conditions, seed) says all that a worker needs. Conditions of one picture and repeat
share their seed, so they see the same noise field and differ by physics, not by luck (common random numbers).
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import numpy as np

from blurnoise._core import rng
from blurnoise._core.checks import in_range, integer, limited
from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone, picture_tone
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import USUAL, AutoExposure, GreyAnchor
from blurnoise_eval.plan.axes import (
    AUTOMATIC,
    AXES,
    CORE,
    EGO,
    MOVES,
    NAMES,
    VELOCITY,
    axis,
    blur_px,
    setting_of,
    velocity_of,
)
from blurnoise_eval.plan.lamps import Lamps
from blurnoise_eval.plan.objects import USUAL_OBJECTS, Objects
from blurnoise_eval.plan.trajectory_spec import TrajectorySpec

DIFFRACTION_UM = 0.55
"""Wavelength at which a stated f-number spreads the light, where the camera names none: green, the eye's peak."""
MOST_CONDITIONS = 1_000_000
"""Of a plan; a picture of each takes hours."""
_STAND_INS: Mapping[str, float] = {"exposure_s": 1e-3, "gain_db": 0.0}
_PLACE = {name: place for place, name in enumerate(NAMES)}
_LENS = tuple(each.name for each in AXES if each.into.startswith("camera."))


class Conditions(Mapping[str, float | None]):
    """A value on every axis of ``AXES``; None: where the camera has it. Immutable and hashable.

    Conditions(exposure_s=0.01, illuminance_lux=50.0): velocities are 0 unless stated. Raises ``ValueError`` for
    an axis that is unknown, or that must be stated and is not.
    """

    __slots__ = ("_values",)

    def __init__(self, **stated: float | None) -> None:
        for name in stated:
            axis(name)
        values = {name: CORE.get(name) if stated.get(name) is None else stated[name] for name in NAMES}
        missing = [name for name in CORE if values[name] is None]
        if missing:
            raise ValueError(f"{missing[0]}: must be specified")
        self._values = tuple(None if value is None else float(value) + 0.0 for value in values.values())

    def __getitem__(self, name: str) -> float | None:
        return self._values[_PLACE[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(NAMES)

    def __len__(self) -> int:
        return len(NAMES)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Conditions) and self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    def __repr__(self) -> str:
        """What is stated; ids of cells are made of it, so that it never changes."""
        return f"Conditions({', '.join(f'{name}={value!r}' for name, value in self.stated.items())})"

    @property
    def stated(self) -> dict[str, float]:
        """The values that are not the camera's own."""
        values = zip(NAMES, self._values, strict=True)
        return {name: value for name, value in values if value is not None}

    @property
    def exposure_s(self) -> float:
        """Exposure time."""
        return self.stated["exposure_s"]

    @property
    def illuminance_lux(self) -> float:
        """Light on the scene."""
        return self.stated["illuminance_lux"]

    @property
    def displacement_px(self) -> tuple[float, float]:
        """Motion during the exposure, px, in single precision as :func:`blurnoise.simulate` computes it; during a
        second where the camera sets the exposure."""
        exposure_s = np.float32(1.0 if self.exposure_s == AUTOMATIC else self.exposure_s)
        x, y = (float(np.float32(v) * exposure_s) for v in velocity_of(self.stated))
        return x, y

    @property
    def blur_px(self) -> float:
        """Length of the motion blur, px, where the exposure is stated."""
        return blur_px(self.stated)

    @property
    def blurs_as(self) -> tuple[tuple[float, float], tuple[float | None, ...]]:
        """Motion, what moves, and lens: conditions of which these are equal can share one blurred picture."""
        return self.displacement_px, (self["moves"], self[EGO.name], *(self[name] for name in _LENS))

    def on(self, camera: Camera) -> dict[str, float]:
        """The actual number of every axis, the camera's own where none is stated: the columns of tables."""
        return {
            each.name: each.own(camera) if value is None else value
            for each, value in zip(AXES, self._values, strict=True)
        }

    @property
    def automatic(self) -> frozenset[str]:
        """The axes on which the camera sets the value itself."""
        return frozenset(name for name, value in self.stated.items() if value == AUTOMATIC)

    def exposure(self, camera: Camera, seed: int = 0, *, vehicle: Vehicle | None = None) -> Exposure:
        """The simulator's exposure: ``camera`` with the lens that is specified, and everything else beside it.

        Axes that are left to the camera have stand-ins, 0 dB and 1 ms. vehicle: which drives at the ego speed, by
        default the usual one.
        """
        fields: dict[str, Any] = {}
        lens: dict[str, float] = {}
        for each, value in zip(AXES, self._values, strict=True):
            if value is None:
                continue
            place, _, part = each.into.partition(".")
            value = _STAND_INS[each.name] if each.automatic and value == AUTOMATIC else value
            if each.choices:
                fields[place] = each.choices[int(value)]
            elif place == "camera":
                lens[part] = value
            else:  # components stand in order in AXES
                fields[place] = (*fields.get(place, ()), value) if part else value
        return Exposure(with_lens(camera, **lens), **fields, seed=seed, vehicle=vehicle or USUAL_VEHICLE)


@lru_cache(maxsize=256)
def with_lens(camera: Camera, **figures: float) -> Camera:
    """The camera with other figures of its lens; a stated ``f_number`` brings diffraction, not light alone."""
    if "f_number" in figures and camera.lens.diffraction_wavelength_um == 0:
        figures["diffraction_wavelength_um"] = DIFFRACTION_UM
    return camera.with_figures(**figures) if figures else camera


@dataclass(frozen=True)
class SweepPlan:
    """What a sweep computes: values per axis, ``repeats`` noise fields per picture, base ``seed``.

    grid: axis name -> values; further axes that are left out have the camera's own, velocities are 0.
    examples: whether some pictures are kept. grey_anchor: what of a picture is 18 % reflectance
    (``blurnoise.scene.metering``); None: its brightness is reflectance. picture_tone: the curve that codes pictures.
    auto_exposure: sets gain and exposure where they are left to the camera. objects: how objects move where not all
    of a picture does, and the boxes that are the truth. lamps: of every picture. hdr_white: the
    light that is white in the merged picture of a camera of several captures, times white.
    trajectory: motion beside the velocity, as :mod:`blurnoise.motion.trajectory` has it. A shake is each picture's
    own, by its cells' seed, and goes so far in ``longest_s``; a shorter exposure sees a part of that.
    ego: the vehicle that drives at the speeds on the axis ``ego_speed_m_s``, by default the usual one.
    only: conditions that are computed in place of the grid's, such as more exposures of some lights and speeds.
    direction: of a search, which chooses conditions, ``only``, a few at a time: unit vector of all motion in them.
    Its grid has a value for some further axes alone; its runs are told apart by all but the conditions.

    Raises ``ValueError`` for an unknown axis, no value, or one that is not allowed on its axis.
    """

    grid: Mapping[str, Iterable[float]]
    repeats: int = 1
    seed: int = 0
    examples: bool = True
    grey_anchor: str | None = None
    picture_tone: PictureTone = "srgb"
    auto_exposure: AutoExposure = USUAL
    objects: Objects = USUAL_OBJECTS
    lamps: Lamps | None = None
    hdr_white: float = 1.0
    trajectory: str | TrajectorySpec | None = None
    ego: Vehicle | None = None
    only: tuple[Conditions, ...] = ()
    direction: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        kinds = {"ego": Vehicle, "auto_exposure": AutoExposure, "objects": Objects, "lamps": Lamps}
        for name, kind in kinds.items():
            if isinstance(value := getattr(self, name), Mapping):  # as :meth:`to_dict` has it
                object.__setattr__(self, name, kind(**value))
        if isinstance(self.trajectory, str):
            object.__setattr__(self, "trajectory", TrajectorySpec.parse(self.trajectory))
        if self.grey_anchor is not None:
            object.__setattr__(self, "grey_anchor", str(GreyAnchor.parse(self.grey_anchor)))
        object.__setattr__(self, "picture_tone", picture_tone(self.picture_tone, "picture_tone"))
        for name in self.grid:
            axis(name)
        core = CORE.items() if self.direction is None else ()
        stated = {name: () if value is None else (value,) for name, value in core} | {**self.grid}
        checked = {each.name: each.checked(stated[each.name]) for each in AXES if each.name in stated}
        object.__setattr__(self, "grid", checked)
        if (count := math.prod(map(len, checked.values()))) > MOST_CONDITIONS:
            raise ValueError(f"grid: has {count} conditions; must have at most {MOST_CONDITIONS}")
        in_range("hdr_white", self.hdr_white, 1e-6, 1e6)
        integer("repeats", self.repeats, 1, 1_000_000)
        integer("seed", self.seed, 0, rng.LAST_SEED)
        if self.lamps and self.repeats % max(1, len(self.lamps.phases)):
            n_phases = len(self.lamps.phases)
            raise ValueError(f"repeats = {self.repeats}: must be a multiple of the {n_phases} of pwm_phase")
        if not self.cuts and (moving := self.objects.to_dict().keys() - {"boxes"}):
            raise ValueError(
                f"{', '.join(sorted(moving))}: settings of objects need moves = targets or background"
            )
        if AUTOMATIC in checked.get("exposure_s", ()):
            if len(checked["exposure_s"]) > 1:
                raise ValueError("exposure_s: must be auto or times, not both; use two sweeps")
            if checked.get("gain_db", (AUTOMATIC,)) != (AUTOMATIC,):
                raise ValueError(
                    "exposure_s = auto: the camera then sets the gain, too; gain_db must be auto or left out"
                )
            checked["gain_db"] = (AUTOMATIC,)
        for name in VELOCITY if self.direction is None else ():  # here, before anything is computed
            fastest = max(map(abs, checked[name]))
            limited(f"{name}: {fastest:g} times exposure_s", fastest * self.longest_s, "displacement_px")
        if not self.values(EGO.name):
            if self.ego is not None:
                raise ValueError(f"ego: needs {EGO.name}, the speed of the vehicle")
            return
        object.__setattr__(self, "ego", self.ego or USUAL_VEHICLE)
        if others := [name for name in (*VELOCITY, MOVES.name) if any(self.values(name))]:
            raise ValueError(
                f"{EGO.name}: ego-motion moves each part of the picture differently; it excludes {', '.join(others)}"
            )

    @property
    def longest_s(self) -> float:
        """The longest exposure, or the longest that the camera may set."""
        longest = self.values("exposure_s")[-1]
        return self.auto_exposure.limit_s if longest == AUTOMATIC else longest

    @property
    def path(self) -> tuple[TrajectorySpec, float] | None:
        """The trajectory and the longest exposure along it."""
        return (self.trajectory, self.longest_s) if isinstance(self.trajectory, TrajectorySpec) else None

    def values(self, name: str) -> tuple[float, ...]:
        """The values on an axis, increasing; none where the camera has its own."""
        return tuple(self.grid.get(name, ()))

    @property
    def cuts(self) -> bool:
        """Whether targets or background move alone."""
        return any(self.values(MOVES.name))

    @property
    def pulsed(self) -> bool:
        """Whether there is a pulsed lamp."""
        return self.lamps is not None and self.lamps.pwm is not None

    def conditions(self) -> list[Conditions]:
        """Each once; those that share a blur stand next to each other, in them those of one exposure."""
        conditions = dict.fromkeys(self.only)
        if not self.only and self.direction is None:
            combined = product(*(self.values(name) for name in self.grid))
            conditions = {
                Conditions(**dict(zip(self.grid, values, strict=True))): None for values in combined
            }
        return sorted(conditions, key=lambda at: (at.blurs_as, at.exposure_s, setting_of(at)))

    def example_conditions(self) -> set[Conditions]:
        """At most twelve conditions whose pictures are kept, evenly from no blur and no light to much."""
        every = self.conditions()
        every.sort(key=lambda at: (np.hypot(*at.displacement_px), at.exposure_s * at.illuminance_lux))
        return {every[round(place)] for place in np.linspace(0, len(every) - 1, min(12, len(every)))}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, of what is not as usual; of a trajectory its identity."""
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
        if self.hdr_white != 1:
            values["hdr_white"] = self.hdr_white
        if self.direction is not None:
            further = {name: self.values(name)[0] for name in self.grid}
            return values | {"further": further, "direction": self.direction}
        values |= {} if self.ego is None else {"ego": asdict(self.ego)}
        values |= {"trajectory": self.path[0].identity} if self.path else {}
        return values | {"grid": dict(self.grid), "examples": self.examples}


@dataclass(frozen=True)
class Cell:
    """One picture under one condition; None: the original picture."""

    image: str
    repeat: int
    conditions: Conditions | None
    seed: int

    @cached_property
    def cell_id(self) -> str:
        """A name made of everything that sets the cell apart within its run."""
        text = repr((self.image, self.repeat, self.conditions))
        return hashlib.blake2b(text.encode(), digest_size=10).hexdigest()


def cell_seed(base_seed: int, image: str, repeat: int) -> int:
    """The seed of a picture's noise field: a hash, so that neither order nor number of pictures matters."""
    digest = hashlib.blake2b(repr((base_seed, image, repeat)).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1


@dataclass(frozen=True)
class Part:
    """The ``number``th of ``count`` parts of a set of pictures, from 1 on: the same on every machine."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Of "1/4". Raises ``ValueError`` for anything else."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise ValueError(f"part = {text!r}: must be K/N with 1 <= K <= N, such as 1/4")
        return cls(int(found[1]), int(found[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def has(self, picture: str) -> bool:
        """Whether a picture of this name belongs to it, by the name's hash."""
        digest = hashlib.blake2b(picture.encode("utf-8", "surrogatepass"), digest_size=8).digest()
        return int.from_bytes(digest, "little") % self.count == self.number - 1


def reflectance_text(anchor: str | None, setting: str) -> str:
    """How a plan relates the brightness of photographs to reflectance, in half a line. setting: of the anchor."""
    if anchor is None:
        return f"brightness is used as reflectance; with {setting}, a part of the picture reflects 18 %"
    of = GreyAnchor.parse(anchor)
    words = "the mean" if of.percentile is None else f"the {of.percentile:g} % percentile"
    if of.region_px is not None:
        words = f"the mean of the region {of}"
    return f"{words} of each picture reflects 18 % ({setting.split()[0]} {anchor})"
