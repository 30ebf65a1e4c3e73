"""Ranges of the conditions of training pictures, from which an exposure is drawn for each picture."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from numbers import Real
from typing import Any

import numpy as np
import torch
from torch import Tensor

from blurnoise._core import usual
from blurnoise._core.checks import DRAWN_FROM, LIMITS, an_instance, dense, limited, one_of, shown
from blurnoise.camera import Camera
from blurnoise.camera.captures import windows
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.camera.spectra import Curve
from blurnoise.light.lights import Light, each_light
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import LONGEST_SHAKE, path_duration_s
from blurnoise.picture.fusion import amplified, readers
from blurnoise.scene.exposure import MOVES, Moves
from blurnoise.scene.metering import AutoExposure
from blurnoise.training.source import (
    BEAMS_OF,
    DRAWN,
    LAMP,
    Cameras,
    ExposureSource,
    Gain,
    Illuminants,
    Lights,
    Params,
    Range,
    cameras_of,
    illuminants_of,
)

_LONGEST_USUAL_S = 1.0  # a longer exposure was probably meant in milliseconds: there is a warning
_USUAL_LUX = (min(usual.ILLUMINANCE_LUX), max(usual.ILLUMINANCE_LUX))
_INDICES = ("camera_index", "moves_index", "illuminant_index", "light_index")
_INSTEAD = {"white_e": "illuminance_lux", "blur_px": "speed_px_s", "ego_kmh": "speed_px_s"}
"""Ranges, and the one of ``DRAWN`` that each replaces."""


@dataclass(frozen=True)
class ExposureRanges(ExposureSource):
    """Ranges of conditions; each a number or (low, high). Defaults: those of sweeps, :mod:`blurnoise._core.usual`.

    camera: one or several, presets by name, equally likely. exposure_s and illuminance_lux, from 1e-9 s and 1e-6 lux
    on, are log-uniform: they multiply the light, so that each doubling is as likely as the next. speed_px_s >= 0,
    direction_deg and temperature_c (-273.15 to 300) are uniform, as is gain_db; "auto", or an
    :class:`blurnoise.AutoExposure`, sets it for each picture. The motion during an exposure is 1e5 px at most.
    shake_px, uniform: the extent of a hand's shake during the exposure, in addition to that motion. moves: the part
    of pictures with masks that moves, "all", "targets" or "background"; one or several, equally likely.

    white_e, log-uniform, in place of illuminance_lux: mean electrons of white. blur_px, uniform, in place of
    speed_px_s: length of the motion blur. ego_kmh, uniform, in place of speed_px_s: a camera that drives over a flat
    road on ``vehicle``. The flow follows from its focal length and the picture's size; the picture is the camera's
    whole field of view. Masks mark targets that drive along: moves must be "all" or "background".

    lamp_hz, lamp_duty, uniform: frequency and duty cycle of a pulsed LED lamp (:class:`blurnoise.light.lamp.Pwm`);
    each picture begins at a random phase. None: no lamp. lamp_lights: "all", or the "targets" of pictures with masks:
    then the targets are the lamps, and dark in exposures that fall between pulses.

    illuminant: the light's spectrum, one or several names or curves, equally likely. light: in place of
    illuminance_lux and illuminant, named lights (:mod:`blurnoise.light.lights`), "street,dusk" or a list, equally
    likely, each with its lux and spectrum; what its headlamps add depends on the picture, see
    :class:`blurnoise.RandomExposure`.

    Raises ``ValueError`` or ``TypeError`` naming the range, its value and what is allowed; warns of exposures of more
    than a second.

    >>> ranges = ExposureRanges("imx250", exposure_s=0.01, illuminance_lux=50.0, speed_px_s=800.0, direction_deg=0.0)
    >>> (exposure,) = ranges.exposures(ranges.conditions(torch.rand(1, ranges.draws)))
    >>> exposure.velocity_px_s[0]
    800.0
    """

    camera: Cameras = usual.COLOUR
    exposure_s: Range = (min(usual.EXPOSURE_S), max(usual.EXPOSURE_S))
    illuminance_lux: Range = _USUAL_LUX
    speed_px_s: Range = (min(usual.SPEED_PX_S.values()), max(usual.SPEED_PX_S.values()))
    direction_deg: Range = (0.0, 360.0)
    temperature_c: Range = usual.TEMPERATURE_C
    gain_db: Gain = usual.GAIN
    shake_px: Range = 0.0
    moves: Moves | Sequence[Moves] = "all"
    white_e: Range | None = None
    blur_px: Range | None = None
    ego_kmh: Range | None = None
    vehicle: Vehicle = USUAL_VEHICLE
    lamp_hz: Range | None = None
    lamp_duty: Range = (0.1, 0.5)
    lamp_lights: Lights = "all"
    illuminant: Illuminants = "D55"
    light: str | Light | Sequence[str | Light] | None = None

    def __post_init__(self) -> None:
        moves = (self.moves,) if isinstance(self.moves, str) else tuple(self.moves) or ("",)
        checked: dict[str, Any] = {
            "camera": (cameras := cameras_of(self.camera)),
            "gain_db": _gain(self.gain_db, cameras),
            "moves": tuple(one_of("moves", each, MOVES) for each in moves),
        }
        for name in (*DRAWN, "shake_px", "lamp_duty", *_INSTEAD, "lamp_hz"):
            if getattr(self, name) is not None or name not in (*_INSTEAD, "lamp_hz"):
                checked[name] = bounds(name, getattr(self, name))
        checked["illuminant"] = illuminants_of(self.illuminant)
        if self.light is not None:
            checked["light"] = each_light(self.light)
            unset = {"illuminance_lux": _USUAL_LUX, "white_e": None, "illuminant": ("D55",)}
            if stated := [name for name, usually in unset.items() if checked.get(name) != usually]:
                must = "must not be combined; a light has its own lux and spectrum"
                raise ValueError(f"light, {stated[0]}: {must}")
            if not checked["light"]:
                raise ValueError("light = []: must be at least one light")
        vars(self).update(checked)
        an_instance("vehicle", self.vehicle, Vehicle)
        if self.ego_kmh is None and self.vehicle != USUAL_VEHICLE:
            raise ValueError("vehicle: needs ego_kmh, its speed")
        one_of("lamp_lights", self.lamp_lights, ("all", "targets"))
        for camera, exposure_s in product(cameras, checked["exposure_s"]):
            windows(camera.sensor.captures, exposure_s)
        warn_of_milliseconds(*checked["exposure_s"])
        if self.ego_kmh is not None and self.blur_px is not None:
            raise ValueError(f"blur_px = {self.blur_px!r}: must be None with ego_kmh, whose blur varies")
        if self.ego_kmh is not None and "targets" in self.moves:
            raise ValueError(f"moves = {self.moves!r}: must be 'all' or 'background' with ego_kmh")
        for reached in self._reached():
            limited(*reached)
        # A shake has a fixed number of steps during the exposure, so a read-out 500 times as long has too many.
        shortest, _ = checked["exposure_s"]
        for camera in cameras if "shake_px" in self._drawn else ():
            if path_duration_s(camera, shortest) > LONGEST_SHAKE * shortest:
                readout = f"a shake over the readout of {camera.name!r}"
                raise ValueError(f"exposure_s = {shortest:g}: too short for {readout}")

    @property
    def illuminants(self) -> tuple[str | Curve, ...]:  # type: ignore[override]
        """The spectra to choose from; of named lights theirs, one for each."""
        own = vars(self)
        lights = own["light"] or ()
        return tuple(light.illuminant for light in lights) or own["illuminant"]

    def _reached(self) -> Iterator[tuple[str, float, str]]:
        """Quantities that follow from several ranges: description, largest value, and the name of its limit."""
        most = {name: vars(self)[name][1] for name in self._drawn[: len(DRAWN)] if name not in _INDICES}
        shortest, longest = vars(self)["exposure_s"]
        moved, within = "the motion during the exposure in px", f"within {shortest:g} s asks for"
        if "white_e" in most:
            least_e = (
                min(electrons_per_lux_s(*lit) for lit in product(self.cameras, self.illuminants)) * shortest
            )
            lux = most["white_e"] / least_e if least_e > 0 else math.inf
            yield f"white_e = {self.white_e}: {within} illuminance_lux", lux, "illuminance_lux"
        if "blur_px" in most:
            yield f"blur_px = {self.blur_px}: {within} speed_px_s", most["blur_px"] / shortest, "speed_px_s"
        elif "speed_px_s" in most:
            both = f"exposure_s, speed_px_s = {longest:g}, {most['speed_px_s']:g} at most"
            yield f"{both}: {moved}", longest * most["speed_px_s"], "displacement_px"
        else:
            both = f"ego_kmh, exposure_s = {most['ego_kmh']:g}, {longest:g} at most"
            for camera in self.cameras:
                height, width = camera.field.size
                edges = np.array([[0, (width - 1) / 2, width - 1] * 2, [0] * 3 + [height - 1] * 3])
                flow = self.vehicle.flow_at(edges, camera, (height, width), most["ego_kmh"] / 3.6)
                far = float(np.abs(flow).max()) * longest
                yield f"{both}: {moved}, before {camera.name!r},", far, "displacement_px"

    @cached_property
    def _drawn(self) -> tuple[str, ...]:
        """The quantities that are drawn for a picture: ``DRAWN``, or those in their place, and others that vary."""
        instead = {_INSTEAD[name]: name for name in _INSTEAD if vars(self)[name] is not None}
        if self.light is not None:
            instead["illuminance_lux"] = "light_index"
        further = {
            "camera_index": True,
            "gain_db": isinstance(self.gain_db, tuple),
            "shake_px": vars(self)["shake_px"][1] > 0,
            "moves_index": len(self.moves) > 1,
            "illuminant_index": len(self.illuminants) > 1 and self.light is None,
            **dict.fromkeys(LAMP, self.lamp_hz is not None),
        }
        varying = (name for name, varies in further.items() if varies)
        return (*(instead.get(name, name) for name in DRAWN), *varying)

    @property
    def draws(self) -> int:
        """As of all :class:`ExposureSource`."""
        return len(self._drawn)

    def conditions(self, uniform: Tensor) -> Params:
        """As of all :class:`ExposureSource`."""
        drawn: Params = {}
        of_each: Any = self.cameras, self.moves, self.illuminants, self.light or ()
        counts = dict(zip(_INDICES, map(len, of_each), strict=True))
        for name, share in zip(self._drawn, uniform.unbind(-1), strict=True):
            if name in counts:
                drawn[name] = chosen(share, counts[name])
                continue
            low, high = vars(self).get(name, (0.0, 1.0))  # the phase of a lamp has no range: it is random
            # Rounding of the power may pass the ends, hence the clamp.
            value = low * (high / low) ** share if name in DRAWN_FROM else low + (high - low) * share
            drawn[name] = value.clamp(low, high)
        exposure_s, index = drawn["exposure_s"], drawn["camera_index"]
        if "white_e" in drawn:
            lit = product(self.cameras, self.illuminants)
            per_lux_s = exposure_s.new_tensor([electrons_per_lux_s(*each) for each in lit])
            place = index * len(self.illuminants) + drawn.get("illuminant_index", 0)
            lux = drawn.pop("white_e") / (per_lux_s[place] * exposure_s)
            drawn["illuminance_lux"] = lux.clamp_max(LIMITS["illuminance_lux"].high)
        if "blur_px" in drawn:
            drawn["speed_px_s"] = (drawn.pop("blur_px") / exposure_s).clamp_max(LIMITS["speed_px_s"].high)
        if "light_index" in drawn:
            lights, of_light = vars(self)["light"], drawn.pop("light_index")
            drawn["illuminance_lux"] = exposure_s.new_tensor([light.lux for light in lights])[of_light]
            drawn["illuminant_index"] = of_light
            drawn["beam_index"] = of_light.new_tensor([BEAMS_OF.index(each.headlamp) for each in lights])[
                of_light
            ]
        if "ego_kmh" in drawn:
            drawn["speed_px_s"] = torch.zeros_like(exposure_s)
        if self.moves != ("all",):
            drawn.setdefault("moves_index", torch.zeros_like(index))
        return drawn

    def __str__(self) -> str:
        cameras = ", ".join(camera.name for camera in self.cameras)
        further = {
            "shake_px": "shake_px" in self._drawn,
            "moves": self.moves != ("all",),
            "vehicle": self.ego_kmh is not None,
            **dict.fromkeys(("lamp_hz", "lamp_duty", "lamp_lights"), self.lamp_hz is not None),
            "illuminant": self.illuminants != ("D55",) and self.light is None,
        }
        used = (name for name, uses in further.items() if uses)
        ranges = ("light" if name == "light_index" else name for name in self._drawn[: len(DRAWN)])
        named = (*ranges, "gain_db", *used)
        return ", ".join([f"camera=({cameras})", *(f"{name}={getattr(self, name)}" for name in named)])


def chosen(share: Tensor, count: int) -> Tensor:
    """Indices (int64) below ``count``, all equally likely, from shares in [0, 1).

    >>> chosen(torch.tensor([0.0, 0.49, 0.5, 0.99]), 2).tolist()
    [0, 0, 1, 1]
    """
    return (share * count).long().clamp_max(count - 1)


def warn_of_milliseconds(*exposure_s: float) -> None:
    """Warn of an exposure of more than a second.

    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     warn_of_milliseconds(5.0)
    >>> str(caught[0].message)
    'exposure_s = (5): is in seconds; must be (0.005) if milliseconds are meant'
    """
    if max(exposure_s, default=0.0) > _LONGEST_USUAL_S:
        different = dict.fromkeys(exposure_s)
        given, meant = (", ".join(f"{seconds * factor:g}" for seconds in different) for factor in (1, 1e-3))
        text = f"exposure_s = ({given}): is in seconds; must be ({meant}) if milliseconds are meant"
        warnings.warn(text, stacklevel=4)


def bounds(name: str, value: Range) -> tuple[float, float]:
    """The two ends of a range. Raises ``TypeError`` or ``ValueError`` outside the limits of its name.

    >>> bounds("speed_px_s", 800), bounds("exposure_s", (0.001, 0.02))
    ((800.0, 800.0), (0.001, 0.02))
    """
    value = _plain(name, value)
    ends = (value, value) if isinstance(value, Real) else value
    if not isinstance(ends, Sequence) or isinstance(ends, str) or len(ends) != 2:
        raise TypeError(f"{name} = {shown(value)}: must be a number or (low, high)")
    # blur_px may be 0, which the limit of roads excludes
    entry = "displacement_px" if name == "blur_px" else name
    first, last = (limited(name, _plain(name, each), entry) for each in ends)
    if first < 0 and name == "blur_px":
        raise ValueError(f"blur_px = {shown(value)}: must be >= 0")
    if first > last:
        raise ValueError(f"{name} = {shown(value)}: must be (low, high), low <= high")
    least = DRAWN_FROM.get(name, first)
    if first < least:
        above = "> 0" if first == 0 else f">= {least:g}"
        raise ValueError(f"{name} = {shown(value)}: must be {above}, as it is drawn log-uniformly")
    return first, last


def _plain(name: str, value: Any) -> Any:
    """A tensor or array of one number as a number. Raises ``TypeError`` for a sparse tensor and one without data."""
    if isinstance(value, Tensor):
        dense(name, value)
    return value.item() if isinstance(value, (Tensor, np.ndarray)) and value.ndim == 0 else value


def _gain(gain_db: Gain, cameras: Sequence[Camera]) -> float | tuple[float, float] | AutoExposure:
    """A number, a range or an auto-exposure. Raises ``ValueError`` for a gain that a camera or its captures lack."""
    if isinstance(gain_db, AutoExposure) or (isinstance(gain_db, str) and gain_db == "auto"):
        for camera in cameras:
            readers(amplified(camera, 0.0).camera)
        return gain_db if isinstance(gain_db, AutoExposure) else AutoExposure()
    gain_db = _plain("gain_db", gain_db)
    if not isinstance(gain_db, (Real, Sequence)) or isinstance(gain_db, str):
        must = "must be a number, (low, high), 'auto' or an AutoExposure"
        raise TypeError(f"gain_db = {shown(gain_db)}: {must}")
    low, high = bounds("gain_db", gain_db)
    for camera, gain in product(cameras, (low, high)):
        readers(amplified(camera, gain).camera)  # raises for a gain that the camera lacks
    return low if low == high else (low, high)
