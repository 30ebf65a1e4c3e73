"""Job of the bench of moving things: a picture in uniform motion, seen by a rolling shutter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from blurnoise import Trajectory, motion_blur
from blurnoise.blur import rows, sub_exposures
from blurnoise.blur.displacement import Displacement, Readout
from blurnoise_eval.bench import motion_scenes, motion_truth
from blurnoise_eval.bench.motion_job import EXPOSURE_S, OURS, Call, Case, Extent, Job, Method, Picture
from blurnoise_eval.bench.motion_peers import FRAMES, mapped, mean_of_frames

VELOCITY_PX_S = (900.0, -500.0)
ROW_S = 24.098e-6  # of the AR0233, three exposures
_MOVED_PX = (VELOCITY_PX_S[0] * EXPOSURE_S, VELOCITY_PX_S[1] * EXPOSURE_S)
_ROOM_PX = 24


@dataclass(frozen=True)
class Rows(Case):
    """Read from the first row to the last."""

    @property
    def readout(self) -> Readout:
        """When its rows are exposed."""
        return Readout(self.picture.shape[-2], ROW_S, EXPOSURE_S)

    def places(self, later_s: float = 0.0) -> tuple[Picture, Picture]:
        """Where what each pixel sees, so long after its row's middle, is at time 0: x and y, (H, W)."""
        height, width = self.picture.shape[-2:]
        time = self.readout.middle_s(np.arange(height, dtype=np.float64))[:, None] + later_s
        vx, vy = VELOCITY_PX_S
        x = np.arange(width) - vx * time
        y = np.arange(height)[:, None] - vy * time
        return x.astype(np.float32), np.broadcast_to(y, x.shape).astype(np.float32)


def _case(extent: Extent) -> Rows:
    light = motion_scenes.leaves(extent.height_px, extent.width_px)
    seen = motion_truth.rolled(
        light, lambda time: (VELOCITY_PX_S[0] * time, VELOCITY_PX_S[1] * time), ROW_S, EXPOSURE_S, extent.moments
    )  # fmt: skip
    longest_s = (EXPOSURE_S + ROW_S * extent.height_px) / 2
    across, down = (math.ceil(abs(along) * longest_s) + _ROOM_PX for along in VELOCITY_PX_S)
    rows, columns = slice(down, extent.height_px - down), slice(across, extent.width_px - across)
    return Rows(torch.from_numpy(light).float()[None], seen[:, rows, columns], rows, columns)


def _ours(case: Rows) -> Call:
    moved, exposure = torch.tensor(_MOVED_PX), torch.tensor(EXPOSURE_S)
    return lambda: rows.rolled(case.picture, moved, exposure, ROW_S, "reflect")


def _one_by_one(case: Rows) -> Call:
    def call() -> Tensor:
        blurred = motion_blur(case.picture, _MOVED_PX)
        return rows.warped(blurred, VELOCITY_PX_S, ROW_S, "reflect")

    return call


def _row_by_row(case: Rows) -> Call:
    begin, end = case.readout.span_s
    path = Trajectory.straight(VELOCITY_PX_S, 2 * max(-begin, end) + 1e-6)
    still, exposure = torch.zeros(2), torch.tensor(EXPOSURE_S)
    moves = Displacement(still, exposure, case.readout, path)
    return lambda: sub_exposures.moved_picture(case.picture[0], moves, "reflect")[None]


def _remapped(flags: int) -> Callable[[Rows], Call]:
    def of(case: Rows) -> Call:
        def call() -> Picture:
            blurred = motion_blur(case.picture, _MOVED_PX)[0].permute(1, 2, 0).contiguous().numpy()
            return mapped(blurred, *case.places(), flags)

        return call

    return of


def _sheared(case: Rows) -> Call:
    return lambda: mapped(case.pixels, *case.places())


def _global(case: Rows) -> Call:
    return lambda: motion_blur(case.picture, _MOVED_PX)


def _frames(number: int) -> Method:
    def of(case: Rows) -> Call:
        return lambda: mean_of_frames(
            number, lambda time: mapped(case.pixels, *case.places(EXPOSURE_S * time))
        )

    return Method(f"{number} frames", FRAMES, f"mean of {number} pictures, cv2.remap", of, str(number))


def job() -> Job:
    """Blurred, then warped; row by row; OpenCV's interpolations; one of the two left out; frames."""
    remaps = [
        Method(f"blur, remap {how}", "cv2.remap", f"our blur, then cv2.remap, {how}", _remapped(flags), how)
        for how, flags in (("linear", cv2.INTER_LINEAR), ("cubic", cv2.INTER_CUBIC))
    ]
    ways = (
        Method(OURS, OURS, "rows.rolled", _ours),
        Method("ours, then warped", OURS, "motion_blur, then rows.warped", _one_by_one, "then warped"),
        Method("ours, any path", OURS, "sub_exposures, each row's own", _row_by_row, "any path"),
        *remaps,
        Method("sheared, no blur", "one of the two", "cv2.remap of the sharp picture", _sheared, "sheared"),
        Method("blurred, no shear", "one of the two", "a global shutter", _global, "blurred"),
        *(_frames(number) for number in (8, 16, 32)),
    )
    return Job("rolling shutter", "a rolling shutter", _case, ways)
