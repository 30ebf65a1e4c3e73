"""The rolling shutter as a light effect: skew, stretch and wobble of what moves while rows are read; boxes follow.

Convention: as :mod:`blurnoise.rolling_shutter`; a picture of other rows than the sensor's is read in as long.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor

from blurnoise import rolled_motion, rolling_shutter
from blurnoise._core.borders import Border
from blurnoise.camera import Camera
from blurnoise.flow_blur import flow_warp
from blurnoise.layers import Passing
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.operating_point import OperatingPoint, each_of, in_rows, row_by_row, skewed
from blurnoise.rolling_shutter import Readout
from blurnoise.trajectory import Trajectory


@dataclass(frozen=True)
class RollingShutter(LightEffect):
    """Rows that are exposed one after another, or with global reset begin together and end one after another."""

    name = "rolling shutter"
    figures = ("row_time_s",)

    def bound(self, at: OperatingPoint[float]) -> float:
        """Of the largest displacement, pi d / sqrt(2) RMS as of a lens's, and of the light that rows gain."""
        if not at.camera.row_time_s:
            return 0.0
        readout = readout_of(at, at.camera.field.size)
        farthest = math.hypot(*_velocity(at)) * max(map(abs, readout.span_s))
        if not row_by_row(at):
            fastest = math.hypot(*_velocity(at)) + _per_s(float(at.variation_px), at.exposure_s)
            passing = cast(tuple[Passing, ...], at.objects)
            own = (_per_s(math.hypot(*each.displacement_px), at.exposure_s) for each in passing)
            fastest = max(fastest, *own, 0.0)
            farthest = fastest * abs(readout.row_s) * (readout.rows - 1) / 2
        elif at.trajectory is not None:
            x, y = at.trajectory.origin_px(at.exposure_s)
            knots, _ = at.trajectory.window(*readout.span_s)
            farthest += float(np.hypot(knots[0] - x, knots[1] - y).max())
        return min(1.0, math.pi * farthest / math.sqrt(2)) + float(readout.light.max()) - 1

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """None that is shared, unless rows are exposed together, or :mod:`blurnoise.light.objects` exposes them."""
        return None if at.camera.row_time_s and not at.objects else Blur()

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """Picture by picture: blurred pictures in uniform motion warped, others exposed row by row."""
        displaced = torch.as_tensor(at.displacement_px)
        parts = []
        for item, (picture, point) in enumerate(zip(torch.split(light, 1), each_of(at), strict=True)):
            readout = readout_of(point, (light.shape[-2], light.shape[-1]))
            if row_by_row(point):
                path = _whole_path(point, readout)
                origin = path.origin_px(point.exposure_s)
                parts.append(rolling_shutter.of_rows(picture, path, origin, readout, border))
            elif at.flow_px is not None and point.exposure_s:
                flow = at.flow_px[item : item + 1] / at.exposure_s[item]
                parts.append(_flowing(picture, flow, readout, border))
            elif in_rows(point):
                own = displaced[item], at.exposure_s[item]
                parts.append(rolled_motion.blurred_rows(picture, *own, readout.row_s, border))
            elif skewed(point):
                own = displaced[item], at.exposure_s[item]
                parts.append(rolled_motion.blurred_and_warped(picture, *own, readout.row_s, border))
            elif point.exposure_s:
                velocity = displaced[item] / at.exposure_s[item]
                parts.append(rolling_shutter.warped(picture, velocity, readout.row_s, border))
            else:
                parts.append(picture)
        return torch.cat(parts)

    def how(self, at: OperatingPoint[float]) -> str:
        """Which of the ways, and how long the rows take of a picture of the point's size."""
        if at.objects:
            return "with the objects, each thing by its own motion"
        rows, row_s = at.camera.height_px, at.camera.row_time_s
        if at.size is not None:
            rows, row_s = at.size[0], row_s / at.camera.field.per_sensor_px(at.size)
        took = f"{1e3 * row_s * rows:.3g} ms from first row to last"
        if not row_by_row(at):
            x, y = (along * row_s for along in _velocity(at))
            return f"{took}: {x:+.3g}, {y:+.3g} px per row, after the blur"
        return f"{took}: every row in its own window"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The readout and the motion, where rows are exposed one after another."""
        camera = at.camera
        if not camera.row_time_s:
            return None
        return (
            camera.row_time_s,
            camera.shutter,
            camera.scan,
            at.exposure_s,
            at.displacement_px,
            at.variation_px,
            at.trajectories,
        )

    def displaces(self, camera: Camera) -> bool:
        """Where the camera's rows are exposed one after another."""
        return camera.row_time_s > 0

    def move_boxes(self, boxes_xyxy: Tensor, at: OperatingPoint[float]) -> Tensor:
        """Upper and lower edge where rows have them on average, sideways by where the box's middle row has it."""
        return self._moved(boxes_xyxy, at, swept=False)

    def sweep_boxes(self, boxes_xyxy: Tensor, at: OperatingPoint[float]) -> Tensor:
        """The same, and what the middle row's window of a path covers; what is grown already is only moved."""
        return self._moved(boxes_xyxy, at, swept=True)

    def _moved(self, boxes_xyxy: Tensor, at: OperatingPoint[float], *, swept: bool) -> Tensor:
        if not at.camera.row_time_s or not len(boxes_xyxy):
            return boxes_xyxy
        readout = readout_of(at, at.size or at.camera.field.size)
        path = _whole_path(at, readout)
        origin = np.array(path.origin_px(at.exposure_s))
        boxes = (
            boxes_xyxy.detach().cpu().double().numpy() - 0.5
        )  # from between the pixels' edges to their centres
        moved = boxes.copy()
        for box in moved:
            left, top, right, bottom = box
            top, bottom = (_seen_row(row, path, origin, readout) for row in (top, bottom))
            (x, _), low, high = _during(path, origin, readout, (top + bottom) / 2)
            if swept and row_by_row(at):
                middle = _during(path, origin, readout, (top + bottom) / 2)[0]
                box[:] = (
                    left + low[0],
                    top + low[1] - middle[1],
                    right + high[0],
                    bottom + high[1] - middle[1],
                )
            else:
                box[:] = left + x, top, right + x, bottom
        return torch.from_numpy(moved + 0.5).to(boxes_xyxy)


def _velocity(at: OperatingPoint[float]) -> tuple[float, float]:
    x, y = at.displacement_px
    return _per_s(float(x), at.exposure_s), _per_s(float(y), at.exposure_s)


def _per_s(moved_px: float, exposure_s: float) -> float:
    return moved_px / exposure_s if exposure_s else 0.0


def _flowing(light: Tensor, flow_px_s: Tensor, readout: Readout, border: Border) -> Tensor:
    """A blurred picture of which row i shows what the flow has brought there by tau_i, the flow being steady.

    Where that was is found with the flow half-way, so that what accelerates on its way through the picture is right
    to second order.
    """
    tau = light.new_tensor(readout.middle_s(np.arange(readout.rows, dtype=np.float64)))[:, None]
    half_way = flow_warp(flow_px_s, flow_px_s * (tau / 2), border="replicate")
    return flow_warp(light, half_way * tau, border=border)


def readout_of(at: OperatingPoint[float], size: tuple[int, int]) -> Readout:
    """Of a picture (H, W), which stands for the largest part of the sensor that has its shape."""
    camera = at.camera
    row_s = camera.row_time_s / camera.field.per_sensor_px(size) * (1 if camera.scan == "down" else -1)
    return Readout(size[0], row_s, at.exposure_s, reset=camera.shutter == "global-reset")


def _whole_path(at: OperatingPoint[float], readout: Readout) -> Trajectory:
    return rolling_shutter.whole_path(at.trajectory, _velocity(at), readout)


def _during(
    path: Trajectory, origin: np.ndarray, readout: Readout, row: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, least and largest place (x, y), px, in the window of a row, or of the nearest in the picture."""
    starts, stops = readout.windows_s
    inside = np.arange(readout.rows)
    start, stop = (float(np.interp(row, inside, each)) for each in (starts, stops))
    knots, durations = path.window(start, stop)
    knots = knots - origin[:, None]
    if not len(durations):
        return knots[:, 0], knots[:, 0], knots[:, 0]
    mean = ((knots[:, 1:] + knots[:, :-1]) / 2 * durations).sum(1) / durations.sum()
    return mean, knots.min(1), knots.max(1)


def _seen_row(row: float, path: Trajectory, origin: np.ndarray, readout: Readout) -> float:
    """In which row a place of the scene's row is seen on average: where r - y(r) = row, by bisection."""
    reach = float(np.abs(np.array(path.y_px) - origin[1]).max()) + 1
    low, high = row - reach, row + reach
    for _ in range(60):
        middle = (low + high) / 2
        before = middle - _during(path, origin, readout, middle)[0][1] < row
        low, high = (middle, high) if before else (low, middle)
    return (low + high) / 2


ROLLING_SHUTTER = RollingShutter()
