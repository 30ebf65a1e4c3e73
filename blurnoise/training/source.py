"""Sources of exposures for training pictures: conditions drawn for each picture, and the exposure that they are.

Convention: conditions follow from uniform values in [0, 1), so that each library draws these by its own generator;
directions run counter-clockwise as displayed, 0 to the right.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from blurnoise.camera import Camera
from blurnoise.camera.spectra import Curve, check_illuminant
from blurnoise.light.lamp import Pwm
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory, path_duration_s, shake
from blurnoise.scene.exposure import Exposure, Moves
from blurnoise.scene.metering import AutoExposure

Range = float | Sequence[float]
"""A number, or the bounds (low, high) to draw between."""
Cameras = Camera | str | Sequence[Camera | str]
Illuminants = str | Curve | Sequence[str | Curve]
"""One or several spectra of the light, by name or as curves."""
Params = dict[str, Tensor]
Gain = Range | Literal["auto"] | AutoExposure
"""dB, or the gain that auto-exposure sets."""
Lights = Literal["all", "targets"]
DRAWN = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c")
"""Conditions that are drawn for every picture."""
LAMP = ("lamp_hz", "lamp_duty", "lamp_phase")
"""Conditions of pictures with a lamp."""
BEAMS_OF = ("off", "low", "high")
_OF_EACH = (
    *DRAWN, *LAMP, "camera_index", "gain_db", "gain_auto", "moves_index", "illuminant_index", "ego_kmh", "shake_px",
    "noise_seed",
)  # fmt: skip


class ExposureSource(ABC):
    """A source of exposures for training pictures: :class:`ExposureRanges`, or a table of conditions.

    gain_db: of pictures for which none is drawn. vehicle: drives at the ``ego_kmh`` that are drawn. lamp_lights: what
    a pulsed lamp lights. illuminants: the spectra of the light to choose from.

    >>> from blurnoise.training.ranges import ExposureRanges
    >>> source = ExposureRanges("imx250", exposure_s=(0.001, 0.016), illuminance_lux=50.0)
    >>> half_way = source.conditions(torch.full((1, source.draws), 0.5))
    >>> round(float(half_way["exposure_s"]), 6)  # half-way between 1 and 16 ms in the logarithm
    0.004
    """

    vehicle: Vehicle = USUAL_VEHICLE
    illuminants: tuple[str | Curve, ...] = ("D55",)
    camera: Cameras
    gain_db: Gain
    moves: Moves | Sequence[Moves]
    lamp_lights: Lights = "all"

    @property
    def uses_masks(self) -> bool:
        """Whether masks change the pictures."""
        return self.moves != ("all",) or self.lamp_lights == "targets"

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras to choose from."""
        return cameras_of(self.camera)

    @property
    @abstractmethod
    def draws(self) -> int:
        """Number of uniform values drawn for the conditions of one picture."""

    @abstractmethod
    def conditions(self, uniform: Tensor) -> Params:
        """The conditions at ``uniform`` (B, ``draws``), values in [0, 1): (B,) each.

        ``DRAWN``, and where they are drawn ``gain_db``, ``gain_auto``, ``shake_px``, ``ego_kmh``, ``lamp_hz``,
        ``lamp_duty`` and ``lamp_phase``; int64 indices of the cameras, ``camera_index``, of moves,
        ``moves_index``, of spectra, ``illuminant_index``, and of ``BEAMS_OF``, ``beam_index``.
        """

    def exposures(
        self,
        params: Params,
        items: Sequence[int] | None = None,
        seeds: Sequence[int] | None = None,
        dtype: torch.dtype = torch.float64,
    ) -> list[Exposure]:
        """The exposure of each picture, or of the pictures ``items``, under drawn conditions.

        params: those of :meth:`conditions`, and ``noise_seed`` where shakes are drawn. seeds: of the noise; 0 for
        labels, which do not depend on it. dtype: of the pictures, in which velocities are computed.
        """
        chosen = list(range(len(params["camera_index"])) if items is None else items)
        drawn = {name: value[chosen] for name, value in params.items() if name in _OF_EACH}
        drawn = {
            name: value.to(dtype) if value.is_floating_point() else value for name, value in drawn.items()
        }
        velocities = velocity_px_s(drawn["speed_px_s"], drawn["direction_deg"]).tolist()
        columns = {name: drawn[name].tolist() for name in ("exposure_s", "illuminance_lux", "temperature_c")}
        known = self.cameras
        cameras = [known[index] for index in drawn["camera_index"].tolist()]
        columns |= {
            "camera": cameras,
            "velocity_px_s": list(map(tuple, velocities)),
            "gain_db": self._gains(drawn, len(chosen)),
            "seed": list(seeds or [0] * len(chosen)),
            "trajectory": _shakes(drawn, cameras),
        }
        if "moves_index" in drawn:
            columns["moves"] = [self.moves[index] for index in drawn["moves_index"].tolist()]
        spectra = [0] * len(chosen)
        if "illuminant_index" in drawn:
            spectra = drawn["illuminant_index"].tolist()
        columns["illuminant"] = [self.illuminants[index] for index in spectra]
        if "ego_kmh" in drawn:
            columns["ego_speed_m_s"] = (drawn["ego_kmh"] / 3.6).tolist()
            columns["vehicle"] = [self.vehicle] * len(chosen)
        if "lamp_hz" in drawn:
            columns["lamp"] = [
                Pwm(*row) for row in zip(*(drawn[name].tolist() for name in LAMP), strict=True)
            ]
        return [
            Exposure(**dict(zip(columns, values, strict=True)))
            for values in zip(*columns.values(), strict=True)
        ]

    def beams(self, params: Params, items: Sequence[int]) -> list[str]:
        """The beam of the headlamps of each picture of ``items`` whose headlamp light is known: that of its drawn
        light, else low beam."""
        if "beam_index" not in params:
            return ["low"] * len(items)
        return [BEAMS_OF[index] for index in params["beam_index"][list(items)].tolist()]

    def _gains(self, drawn: Params, count: int) -> list[float | AutoExposure]:
        """The gain of each picture: drawn, or else that of the source, a number or an auto-exposure."""
        fallback: Any = self.gain_db
        if "gain_db" not in drawn:
            return [fallback] * count
        gains = drawn["gain_db"].tolist()
        automatic = drawn["gain_auto"].tolist() if "gain_auto" in drawn else [False] * count
        return [fallback if auto else gain for auto, gain in zip(automatic, gains, strict=True)]


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, from speeds (B,) and directions (B,), counter-clockwise as displayed.

    >>> velocity_px_s(torch.tensor([100.0]), torch.tensor([90.0])).round().tolist()
    [[-0.0, -100.0]]
    """
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def _shakes(drawn: Params, cameras: Sequence[Camera]) -> list[Trajectory | None]:
    """The shake of each picture, by its noise seed; None without shake."""
    if "shake_px" not in drawn:
        return [None] * len(cameras)
    columns = (drawn[name].tolist() for name in ("noise_seed", "shake_px", "exposure_s"))
    return [
        shake(seed, extent_px, exposure_s, duration_s=path_duration_s(camera, exposure_s))
        if extent_px
        else None
        for seed, extent_px, exposure_s, camera in zip(*columns, cameras, strict=True)
    ]


def illuminants_of(illuminant: Illuminants) -> tuple[str | Curve, ...]:
    """The spectra, names as the table has them. Raises ``TypeError`` or ``ValueError``.

    >>> illuminants_of(["d65", "Sodium"])
    ('D65', 'sodium')
    """
    several = isinstance(illuminant, Sequence) and not isinstance(illuminant, str)
    given = list(illuminant) if several else [illuminant]  # type: ignore[arg-type]
    if not given:
        raise ValueError("illuminant = []: must be at least one spectrum")
    return tuple(map(check_illuminant, given))


def cameras_of(camera: Cameras) -> tuple[Camera, ...]:
    """The cameras, presets opened. Raises ``TypeError`` or ``ValueError``.

    >>> [camera.name for camera in cameras_of(["imx250", "imx250c"])]
    ['imx250', 'imx250c']
    """
    given = camera if isinstance(camera, Sequence) and not isinstance(camera, str) else [camera]
    for one in given:
        if not isinstance(one, (Camera, str)):
            raise TypeError(f"camera: must be cameras or names of presets, got {type(one).__name__}")
    if not given:
        raise ValueError("camera = []: must be at least one camera")
    return tuple(Camera.preset(one) if isinstance(one, str) else one for one in given)
