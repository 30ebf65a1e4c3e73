"""Job of the bench of moving things: the road that a camera drives over, blurred by its own flow at every pixel."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from blurnoise import motion_blur
from blurnoise.blur.sub_exposures import flow_blur
from blurnoise.motion.ego import Mount, View
from blurnoise_eval.bench import motion_scenes, motion_truth
from blurnoise_eval.bench.contenders import Contender
from blurnoise_eval.bench.motion_job import EXPOSURE_S, OURS, Call, Case, Extent, Job, Method, Picture
from blurnoise_eval.bench.motion_peers import FRAMES, lines, mapped, mean_of_frames, straight

HFOV_DEG, HEIGHT_M, SPEED_M_S = 60.0, 1.4, 100 / 3.6
_ROOM_PX = 16


@dataclass(frozen=True)
class Road(Case):
    """displacement_px: (2, H, W), of the road during the exposure; 0 in the sky."""

    displacement_px: Tensor

    @property
    def mean_px(self) -> tuple[float, float]:
        """Over the picture."""
        x, y = self.displacement_px.mean((1, 2)).tolist()
        return x, y


def _case(extent: Extent) -> Road:
    light = motion_scenes.leaves(extent.height_px, extent.width_px)
    view, mount = View(extent.width_px, extent.height_px, HFOV_DEG, "rectilinear"), Mount(HEIGHT_M)
    pixels = view.pixels()
    flow = view.flow_px_s(pixels, mount.road_m(view.rays(pixels)), mount.driving(SPEED_M_S)) * EXPOSURE_S
    focal_px = extent.width_px / 2 / math.tan(math.radians(HFOV_DEG / 2))
    seen = motion_truth.over_road(light, focal_px, HEIGHT_M, SPEED_M_S * EXPOSURE_S, extent.moments // 2)
    across, down = (math.ceil(float(along.max()) / 2) + _ROOM_PX for along in np.abs(flow))
    rows, columns = slice(down, extent.height_px - down), slice(across, extent.width_px - across)
    picture = torch.from_numpy(light).float()[None]
    return Road(picture, seen[:, rows, columns], rows, columns, torch.from_numpy(flow).float())


def _ours(case: Road) -> Call:
    return lambda: flow_blur(case.picture, case.displacement_px)


def _one_blur(case: Road) -> Call:
    return lambda: motion_blur(case.picture, case.mean_px)


def _others(line: Contender) -> Callable[[Road], Call]:
    return lambda case: straight(line, case.picture, case.mean_px)


def _frames(number: int) -> Method:
    def of(case: Road) -> Call:
        dx, dy = case.displacement_px.numpy()
        height, width = dx.shape
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))

        def at(time: float) -> Picture:
            share = np.float32(time)
            return mapped(case.pixels, x - share * dx, y - share * dy)

        return lambda: mean_of_frames(number, at)

    return Method(
        f"{number} frames", FRAMES, f"mean of {number} pictures, cv2.remap by the flow", of, str(number)
    )


def job() -> Job:
    """Every pixel by its own flow; one blur for all; frames."""
    peers = [
        Method(f"{name}, one blur", name, f"{each.about}, by the mean", _others(each))
        for name, each in lines().items()
    ]
    ways = (
        Method(OURS, OURS, "blurnoise.blur.sub_exposures.flow_blur", _ours),
        Method("one blur", "one blur", "blurnoise.motion_blur by the mean", _one_blur),
        *peers,
        *(_frames(number) for number in (4, 8, 16, 32)),
    )
    return Job("road", "the road under a moving camera", _case, ways)
