"""Conditions of a sweep, and its cells: one picture under one condition.

A cell (picture, repeat, conditions, seed) is all that a worker needs. Conditions of one picture and repeat share
their seed: they have the same noise field and differ by physics, not by luck (common random numbers).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

from blurnoise_eval.plan.axes import (
    AXES,
    CORE,
    EGO,
    NAMES,
    OWN_SPECTRUM,
    SPECTRUM,
    OnAxes,
    axis,
    blur_px,
    velocity_of,
)
from blurnoise_eval.plan.typed import AUTOMATIC

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise.camera.spectra import Curve
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.exposure import Exposure

DIFFRACTION_UM = 0.55
"""Wavelength of the diffraction at a specified f-number, for cameras without one: green, the eye's peak."""
_STAND_INS: Mapping[str, float] = {"exposure_s": 1e-3, "gain_db": 0.0}  # until the picture is metered
_LENS = tuple(axis.name for axis in AXES if axis.into.startswith("camera."))


class Conditions(OnAxes):
    """A value on every axis of ``AXES``; None: the camera's. Immutable and hashable.

    Velocities are 0 by default. Raises ``ValueError`` for an unknown axis, or without exposure and illuminance.

    >>> at = Conditions(exposure_s=0.01, illuminance_lux=50, velocity_x_px_s=300)
    >>> at.blur_px, at["gain_db"]
    (3.0, None)
    >>> at
    Conditions(exposure_s=0.01, illuminance_lux=50.0, velocity_x_px_s=300.0, velocity_y_px_s=0.0)
    """

    __slots__ = ()

    def __init__(self, **given: float | None) -> None:
        for name in given:
            axis(name)
        values = {name: CORE.get(name) if given.get(name) is None else given[name] for name in NAMES}
        missing = [name for name in CORE if values[name] is None]
        if missing:
            raise ValueError(f"{missing[0]}: must be specified")
        super().__init__(None if value is None else float(value) + 0.0 for value in values.values())

    def __repr__(self) -> str:
        """The specified values. The ids of cells are made of this text, so it must never change."""
        return f"Conditions({', '.join(f'{name}={value!r}' for name, value in self.specified.items())})"

    @property
    def specified(self) -> dict[str, float]:
        """The values that are not left to the camera's figures."""
        values = zip(NAMES, self.numbers, strict=True)
        return {name: value for name, value in values if value is not None}

    @property
    def exposure_s(self) -> float:
        """Exposure time."""
        return self.specified["exposure_s"]

    @property
    def illuminance_lux(self) -> float:
        """Light on the scene."""
        return self.specified["illuminance_lux"]

    @property
    def displacement_px(self) -> tuple[float, float]:
        """Motion during the exposure (during a second where the camera sets it), px: x right, y down.

        In single precision, as :func:`blurnoise.simulate` computes it.
        """
        import numpy as np

        exposure_s = np.float32(1.0 if self.exposure_s == AUTOMATIC else self.exposure_s)
        x, y = (float(np.float32(v) * exposure_s) for v in velocity_of(self.specified))
        return x, y

    @property
    def blur_px(self) -> float:
        """Length of the motion blur, px; infinite where the camera sets the exposure."""
        return blur_px(self.specified)

    @property
    def blurs_as(self) -> tuple[tuple[float, float], tuple[float | None, ...]]:
        """Motion, moving part, lens and headlamps: conditions with equal ones can share one blurred picture."""
        return self.displacement_px, (
            self["moves"], self[EGO.name], *(self[name] for name in _LENS), self["headlamp"],
        )  # fmt: skip

    def on(self, camera: Camera) -> dict[str, float]:
        """The value on every axis, the camera's where none is specified: the columns of tables."""
        return {
            axis.name: axis.own(camera) if value is None else value
            for axis, value in zip(AXES, self.numbers, strict=True)
        }

    @property
    def automatic(self) -> frozenset[str]:
        """The axes on which the camera sets the value itself."""
        return frozenset(name for name, value in self.specified.items() if value == AUTOMATIC)

    def exposure(
        self,
        camera: Camera,
        seed: int = 0,
        *,
        vehicle: Vehicle | None = None,
        spectrum: Curve | None = None,
        infrared: str | None = None,
    ) -> Exposure:
        """The simulator's exposure, with ``camera`` changed where the conditions specify its lens.

        Automatic gain and exposure are 0 dB and 1 ms here, until the picture is metered. vehicle: the one that drives
        at the ego speed, by default the usual one. spectrum: of the illuminant "own". infrared: a lamp beside the
        light, see :func:`blurnoise.camera.spectra.with_infrared`. Raises ``ValueError`` where there is no spectrum,
        and for a camera that does not see the lamp.
        """
        from blurnoise.camera import radiometry
        from blurnoise.camera.spectra import with_infrared
        from blurnoise.motion.ego import USUAL_VEHICLE
        from blurnoise.scene.exposure import Exposure

        fields: dict[str, Any] = {}
        lens: dict[str, float] = {}
        for each, value in zip(AXES, self.numbers, strict=True):
            if value is None:
                continue
            field, _, part = each.into.partition(".")
            value = _STAND_INS[each.name] if each.automatic and value == AUTOMATIC else value
            if each.choices:
                fields[field] = each.choice(value)
            elif field == "camera":
                lens[part] = value
            else:  # components of a vector are in order in AXES
                fields[field] = (*fields.get(field, ()), value) if part else value
        if fields.get(SPECTRUM.into) == OWN_SPECTRUM:
            if spectrum is None:
                raise ValueError(f"illuminant = {OWN_SPECTRUM}: needs a CSV file of nm and power")
            fields[SPECTRUM.into] = spectrum
        if infrared:
            radiometry.check_sees(camera, infrared)
            lit = fields.get(SPECTRUM.into, "D55"), self["illuminance_lux"], infrared
            fields[SPECTRUM.into] = with_infrared(*lit)
        return Exposure(with_lens(camera, **lens), **fields, seed=seed, vehicle=vehicle or USUAL_VEHICLE)


@lru_cache(maxsize=256)
def with_lens(camera: Camera, **figures: float) -> Camera:
    """The camera with other figures of its lens. A specified ``f_number`` changes diffraction, not only the light."""
    if "f_number" in figures and camera.lens.diffraction_wavelength_um == 0:
        figures["diffraction_wavelength_um"] = DIFFRACTION_UM
    return camera.with_figures(**figures) if figures else camera


@dataclass(frozen=True)
class Cell:
    """One picture under one condition; without conditions, the original picture.

    >>> Cell("a.png", 0, None, seed=7).cell_id == Cell("a.png", 0, None, seed=8).cell_id
    True
    """

    image: str
    repeat: int
    conditions: Conditions | None
    seed: int

    @cached_property
    def cell_id(self) -> str:
        """A hash of all that distinguishes the cell from the others of its run."""
        text = repr((self.image, self.repeat, self.conditions))
        return hashlib.blake2b(text.encode(), digest_size=10).hexdigest()


def cell_seed(base_seed: int, image: str, repeat: int) -> int:
    """The seed of a picture's noise field: a hash of its name, so that it depends on no other picture."""
    digest = hashlib.blake2b(repr((base_seed, image, repeat)).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1


def reflectance_text(anchor: str | None, setting: str, spread_ev: float | None = None) -> str:
    """How the brightness of photographs relates to reflectance, in half a line.

    setting: the anchor's, as typed. spread_ev: standard deviation of the pictures' mean light.
    """
    from blurnoise.scene.metering import GreyAnchor

    if anchor is None:
        darker = "a photograph darker by 1 EV gets half of the light"
        spread = "" if spread_ev is None else f" (the pictures' light differs by {spread_ev:.2g} EV, SD)"
        return f"brightness is used as reflectance, so {darker}{spread}; with {setting}, a part of each reflects 18 %"
    of = GreyAnchor.parse(anchor)
    words = "the mean" if of.percentile is None else f"the {of.percentile:g} % percentile"
    if of.region_px is not None:
        words = f"the mean of the region {of}"
    return f"{words} of each picture reflects 18 % ({setting} {anchor})"
