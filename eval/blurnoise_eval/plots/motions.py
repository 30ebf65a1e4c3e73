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
from blurnoise_eval.plots.gallery import Tile, as_shown, planes_of
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

    progress is called for each.
    """
    planes, longest_px = planes_of(coded), speed_px_s * exposure_s
    size = (planes.shape[-2], planes.shape[-1])
    still = replace(camera, row_time_s=0.0, shutter="global")
    rolls = replace(camera, row_time_s=READOUT_S / camera.height_px, shutter="rolling")
    focal_px, duration_s = View(size[1], size[0], _HFOV_DEG).focal_px, path_duration_s(still, exposure_s)
    bump = _BUMP_M, _BUMP_LENGTH_M, _BUMP_KM_H / 3.6
    paths = {
        "sine": Trajectory.sinusoid(longest_px / 2, _VIBRATION_HZ, duration_s, direction_deg=90.0),
        "shake": shake(seed, longest_px, exposure_s),
        "bump": speed_bump(*bump, focal_px=focal_px, duration_s=2 * exposure_s),
    }
    light: dict[str, Any] = {
        "exposure_s": exposure_s,
        "illuminance_lux": illuminance_lux,
        "generator": [seed],
    }
    made = []
    for kind in KINDS:
        speed, path, own = kind.share * speed_px_s, paths.get(kind.path or ""), rolls if kind.rolls else still
        if kind.path == "road":
            flow_px_s = _VEHICLE.flow_px_s(still, size, _ROAD_KM_H / 3.6)
            dn = simulate(planes, still, velocity_px_s=flow_px_s, **light)
            exposed, note = in_channels(develop(dn, still), planes.shape[1]), kind.name
        else:
            exposed = expose_pictures(
                planes,
                own,
                speed_px_s=speed,
                direction_deg=kind.direction_deg,
                masks=torch.from_numpy(matte).expand(1, 1, *size),
                moves=kind.moves,
                trajectory=path,
                **light,
            )
            box = path.seen(exposure_s).box if path else (0.0, 0.0, speed * exposure_s, 0.0)
            note = f"{kind.name}: {math.dist(box[:2], box[2:]):.3g} px"
        seen = as_shown(exposed, coded.ndim)
        made.append(Tile(seen, own, exposure_s, illuminance_lux, speed, kind.direction_deg, motion=note))
        progress(1)
    return made
