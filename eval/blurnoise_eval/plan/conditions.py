"""What a sweep computes, as plain descriptors: conditions, their grid, and cells.

A cell (picture, repeat, conditions, seed) says all that a worker needs. Conditions of one picture and repeat
share their seed, so they see the same noise field and differ by physics, not by luck (common random numbers).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

from blurnoise_eval.plan.axes import (
    AUTOMATIC,
    AXES,
    CORE,
    EGO,
    NAMES,
    axis,
    blur_px,
    velocity_of,
)

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.exposure import Exposure

DIFFRACTION_UM = 0.55
"""Wavelength at which a stated f-number spreads the light, where the camera names none: green, the eye's peak."""
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
        import numpy as np

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
        from blurnoise.motion.ego import USUAL_VEHICLE
        from blurnoise.scene.exposure import Exposure

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


def reflectance_text(anchor: str | None, setting: str) -> str:
    """How a plan relates the brightness of photographs to reflectance, in half a line. setting: of the anchor."""
    from blurnoise.scene.metering import GreyAnchor

    if anchor is None:
        return f"brightness is used as reflectance; with {setting}, a part of the picture reflects 18 %"
    of = GreyAnchor.parse(anchor)
    words = "the mean" if of.percentile is None else f"the {of.percentile:g} % percentile"
    if of.region_px is not None:
        words = f"the mean of the region {of}"
    return f"{words} of each picture reflects 18 % ({setting.split()[0]} {anchor})"
