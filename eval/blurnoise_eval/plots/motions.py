"""Kinds of motion side by side: one picture, one camera, exposure and light, and what moves how.

Domain: sRGB-coded pictures, (H, W) or (H, W, 3), in [0, 1]; a matte (H, W) is what moves for itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.motion.ego import Vehicle, View
from blurnoise.motion.trajectory import Trajectory, path_duration_s, shake
from blurnoise.optics.camera import Camera
from blurnoise.picture.develop import develop, in_channels
from blurnoise.scene.cutting import Matte
from blurnoise.scene.scene import simulate
from blurnoise.training.augmentation import expose_pictures
from blurnoise_eval.datasets import segmentation
from blurnoise_eval.plots.gallery import Tile, as_shown
from blurnoise_eval.plots.speed_bumps import speed_bump

READOUT_S = 0.03
"""From first row to last, as slow rolling shutters take."""
_VIBRATION_HZ = 100.0
_BUMP_M, _BUMP_LENGTH_M, _BUMP_KM_H = 0.1, 3.7, 30.0
_ROAD_KM_H, _HFOV_DEG = 50.0, 60.0
_VEHICLE = Vehicle(height_m=1.4, hfov_deg=_HFOV_DEG)


@dataclass(frozen=True)
class Kind:
    """A tile: what it says of itself, what moves how fast in which direction, and what else is special."""

    name: str
    share: float = 1.0  # of the speed
    direction_deg: float = 0.0
    moves: str = "all"
    rolls: bool = False
    path: str | None = None


KINDS = (
    Kind("all moves, as before a camera that turns"),
    Kind("targets move, the camera stands", moves="targets"),
    Kind("the camera follows the targets", moves="background"),
    Kind(f"vibration, {_VIBRATION_HZ:g} Hz", 0.0, path="sine"),
    Kind("held by hand", 0.0, path="shake"),
    Kind(f"a bump of {100 * _BUMP_M:g} cm at {_BUMP_KM_H:g} km/h", 0.0, path="bump"),
    Kind(f"rolling shutter, {1e3 * READOUT_S:g} ms, to the right", rolls=True),
    Kind(f"rolling shutter, {1e3 * READOUT_S:g} ms, downwards", direction_deg=-90.0, rolls=True),
    Kind(f"driving at {_ROAD_KM_H:g} km/h, {_HFOV_DEG:g}° wide, on a road", 0.0, path="road"),
)


def middle_box(size: tuple[int, int]) -> Matte:
    """The matte of a box in the middle of a picture (H, W), a third of it wide and high."""
    height, width = size
    return segmentation.of_box(width / 3, height / 3, width / 3, height / 3, size)


def tiles(
    coded: NDArray[np.float32],
    matte: Matte,
    camera: Camera,
    *,
    exposure_s: float,
    illuminance_lux: float,
    speed_px_s: float,
    seed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Tile]:
    """A tile for each of ``KINDS``; paths are as long as what moves at ``speed_px_s`` is, but for bump and road.

    progress is told of each.
    """
    planes = torch.from_numpy(coded if coded.ndim == 3 else coded[..., None]).permute(2, 0, 1)[None]
    size = (planes.shape[-2], planes.shape[-1])
    stands = replace(camera, row_time_s=0.0, shutter="global")
    rolls = replace(camera, row_time_s=READOUT_S / camera.height_px, shutter="rolling")
    view = View(size[1], size[0], _HFOV_DEG)
    paths = {
        "sine": Trajectory.sinusoid(
            speed_px_s * exposure_s / 2,
            _VIBRATION_HZ,
            path_duration_s(stands, exposure_s),
            direction_deg=90.0,
        ),
        "shake": shake(seed, speed_px_s * exposure_s, exposure_s),
        "bump": speed_bump(
            _BUMP_M, _BUMP_LENGTH_M, _BUMP_KM_H / 3.6, focal_px=view.focal_px, duration_s=2 * exposure_s
        ),
    }
    own: list[dict[str, Any]] = [
        {"camera": rolls if kind.rolls else stands, "path": paths.get(kind.path or "")} for kind in KINDS
    ]
    speeds = [kind.share * speed_px_s for kind in KINDS]
    light: dict[str, Any] = {
        "exposure_s": exposure_s,
        "illuminance_lux": illuminance_lux,
        "generator": [seed],
    }
    made = []
    for kind, each, speed in zip(KINDS, own, speeds, strict=True):
        if kind.path == "road":
            flow_px_s = _VEHICLE.flow_px_s(stands, size, _ROAD_KM_H / 3.6)
            dn = simulate(planes, stands, velocity_px_s=flow_px_s, **light)
            exposed = in_channels(develop(dn, stands), planes.shape[1])
        else:
            exposed = expose_pictures(
                planes,
                each["camera"],
                speed_px_s=speed,
                direction_deg=kind.direction_deg,
                masks=torch.from_numpy(matte).expand(1, 1, *size),
                moves=kind.moves,
                trajectory=each["path"],
                **light,
            )
        seen = as_shown(exposed, coded.ndim)
        path = each["path"].seen(exposure_s).box if each["path"] else None
        goes = f"{math.dist(path[:2], path[2:]):.3g} px" if path else f"{speed * exposure_s:.3g} px"
        note = kind.name if kind.path == "road" else f"{kind.name}: {goes}"
        made.append(
            Tile(seen, each["camera"], exposure_s, illuminance_lux, speed, kind.direction_deg, motion=note)
        )
        progress(1)
    return made
