"""Motion as light effects: of objects, of the whole picture, of each pixel, and of rows that are exposed in turn.

One effect applies all motion of a frame; :func:`motion_effect` decides which. Each describes the motion by a
:class:`.displacement.Displacement`, which decides how it is computed. The read-out of a picture with fewer rows than
the sensor takes as long as the sensor's.

With layers, one effect applies all motion, because occlusion changes during the exposure. It precedes the lens blur,
and so do shake and read-out then, but follows the distortion, in whose px motion is.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import Border, Window, folded
from blurnoise._core.threads import differentiable
from blurnoise.blur import layers
from blurnoise.blur.displacement import Displacement, Floats, Readout
from blurnoise.blur.layer import Layer, ObjectMotion
from blurnoise.blur.sub_exposures import SPACING_PX
from blurnoise.camera import Camera, transfer
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.light.resolved import Number, Resolved


def motion_effect(at: Resolved[Any]) -> LightEffect:
    """The effect that applies the motion of frames under these conditions; the only place that decides it.

    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, displacement_px=(8.0, 0.0))
    >>> motion_effect(at).name, motion_effect(replace(at, camera=Camera.preset("ar0237"))).name
    ('motion', 'rolling shutter')
    """
    if at.objects:  # what covers what changes during the exposure: everything moves in one computation
        return OBJECTS
    if at.camera.sensor.row_time_s:  # each row is exposed in a window of time of its own
        return ROLLING_SHUTTER
    if at.flow_px is not None:  # each pixel moves by a displacement of its own
        return MOTION_VARIATION
    return MOTION  # one motion in one window of time: a transfer function


def readout_of(camera: Camera, exposure_s: float, size: tuple[int, int]) -> Readout:
    """Row timing of a picture (H, W), which is the largest part of the sensor that has its shape.

    >>> rolling = Camera.preset("imx250").with_figures(
    ...     shutter="rolling", row_time_s=10e-6, width_px=1280, height_px=960
    ... )
    >>> readout_of(rolling, 0.005, (480, 640)).row_s  # half the rows, read out in the same time
    2e-05
    """
    row_s = (
        camera.sensor.row_time_s
        / camera.field.per_sensor_px(size)
        * (1 if camera.sensor.scan == "down" else -1)
    )
    reset = camera.sensor.row_time_s > 0 and camera.sensor.shutter == "global-reset"
    return Readout(size[0], row_s, exposure_s, reset)


def displacement(at: Resolved[float]) -> Displacement:
    """The motion of a frame without its flow.

    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, displacement_px=(8.0, 0.0))
    >>> displacement(at).velocity_px_s
    (800.0, 0.0)
    """
    even = torch.tensor(at.displacement_px, dtype=torch.float64)
    readout = readout_of(at.camera, at.exposure_s, at.size or at.camera.field.size)
    return Displacement(even, even.new_tensor(at.exposure_s), readout, at.trajectory)


def displacements(at: Resolved[Tensor], size: tuple[int, int]) -> Iterator[Displacement]:
    """The motion of every frame, of pictures (H, W).

    >>> two = torch.ones(2)
    >>> moved = torch.tensor([[8.0, 0.0], [0.0, 0.0]])
    >>> at = Resolved(Camera.preset("imx250"), 0.01 * two, 25 * two, 1000 * two, moved)
    >>> [each.still for each in displacements(at, (480, 640))]
    [False, True]
    """
    moved = torch.as_tensor(at.displacement_px) if at.flow_px is None else at.flow_px
    for by, lasting, one in zip(moved, at.exposure_s, at.each(), strict=True):
        yield Displacement(by, lasting, readout_of(at.camera, one.exposure_s, size), one.trajectory)


def exposed(
    light: Tensor, at: Resolved[Tensor], objects: tuple[tuple[Layer, ...], ...], border: Border
) -> Tensor:
    """Pictures (B, C, H, W) with their layers as exposures see them, rows as bright as they are exposed long.

    >>> edge, one = (torch.arange(64.0) >= 32).expand(1, 1, 8, 64).float(), torch.ones(1)
    >>> at = Resolved(Camera.preset("imx250"), 0.01 * one, 25 * one, 1000 * one, torch.tensor([[8.0, 0.0]]))
    >>> [round(float(exposed(edge, at, ((),), "reflect")[0, 0, 4, x]), 1) for x in (24, 30, 40)]
    [0.0, 0.3, 1.0]
    """
    size = (light.shape[-2], light.shape[-1])
    pictures = []
    for picture, some, moves in zip(torch.split(light, 1), objects, displacements(at, size), strict=True):
        picture = layers.exposed(picture, some, moves, border)
        # With global reset, rows that are read later are exposed longer, and brighter.
        if moves.readout.reset:
            light_of_rows = torch.from_numpy(moves.readout.light)
            if differentiable(moves.exposure_s):
                light_of_rows = 1 + (light_of_rows - 1) * moves.readout.exposure_s / moves.exposure_s
            picture = picture * light_of_rows.to(picture)[:, None]
        pictures.append(picture)
    return pictures[0] if len(pictures) == 1 else torch.cat(pictures)


class _Motion(LightEffect):
    """An effect that applies motion, where :func:`motion_effect` chooses it: picture by picture, by default."""

    def acts(self, at: Resolved[Number]) -> bool:
        return motion_effect(at) is self

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        return exposed(light, at, ((),) * len(light), border)


class Objects(_Motion):
    """Layers by :mod:`blurnoise.blur.layers`. Where there are some it stays, as they are part of the picture.

    >>> post = ObjectMotion(displacement_px=(8.0, 0.0), share=0.01)
    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, objects=(post,))
    >>> OBJECTS.how(at), round(OBJECTS.bound(at), 2)  # a hundredth of the picture: .1 RMS at most
    ('1 in layers, up to 8 px: matte formula, in their windows', 0.1)
    """

    name = "objects"
    essential = True

    def bound(self, at: Resolved[float]) -> float:
        """Change if everything moved as the background does.

        The mean over the exposure of a product of waves f (of the matte or its light) and g (of what is behind)
        is sinc(f . d_F + g . d_B), so that a difference D of the motions changes it by at most 1.3703 |f . D|; f is
        at most 1 / sqrt(2), a checkerboard's, and black and white differ by 1. All in the object's window.
        """
        squares = 0.0
        for each in _objects(at):
            apart = math.dist(each.displacement_px, cast(tuple[float, float], at.displacement_px))
            squares += min(1.0, 1.3703 / math.sqrt(2) * apart) ** 2 * each.share
        return min(1.0, math.sqrt(squares))

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        return exposed(light, at, at.layers, border)

    def how(self, at: Resolved[float]) -> str:
        moving = _objects(at)
        if not moving:
            return "none here"
        longest = max(math.hypot(*each.displacement_px) for each in moving)
        apart = any(any(each.displacement_px) for each in moving) and any(at.displacement_px)
        way = f"parts of {SPACING_PX:g} px" if apart or len(moving) > 1 else "matte formula"
        return f"{len(moving)} in layers, up to {longest:.3g} px: {way}, in their windows"

    def key(self, at: Resolved[float]) -> Hashable:
        return at.objects


class Motion(_Motion):
    """Motion by its transfer function: straight of any length and angle, or a path of straight segments.

    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, displacement_px=(3.0, 4.0))
    >>> MOTION.how(at)
    'transfer function, 5 px'
    """

    name = "motion"

    def bound(self, at: Resolved[float]) -> float:
        """:func:`blurnoise.camera.transfer.motion_error`, or :attr:`blurnoise.motion.trajectory.Polyline.error`."""
        moves = displacement(at)
        if moves.polyline is not None:
            return moves.polyline.error
        return 0.0 if moves.each_row_differs else transfer.motion_error(*at.displacement_px)

    def blur(self, at: Resolved[Tensor]) -> Blur:
        moved = torch.as_tensor(at.displacement_px)
        if not at.trajectories:
            return Blur(displacement_px=moved)
        each = displacements(at, at.size or at.camera.field.size)
        return Blur(displacement_px=moved, paths=tuple(one.polyline for one in each))

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Resolved[float]) -> Tensor:
        """Grown by half the displacement to either side, or by what the path covers; of rows, the effect of these."""
        if at.camera.sensor.row_time_s:
            return boxes_xyxy
        if at.trajectories and (along := displacement(at).polyline) is not None:
            return boxes_xyxy + boxes_xyxy.new_tensor(along.box)
        half = boxes_xyxy.new_tensor(at.displacement_px).abs() / 2
        return boxes_xyxy + torch.cat([-half, half])

    def how(self, at: Resolved[float]) -> str:
        length = f"{math.hypot(*at.displacement_px):.3g} px"
        if at.objects:
            return f"with the objects, {length}"
        if (along := displacement(at).polyline) is not None:
            left, top, right, bottom = along.box
            extent = f"{right - left:.3g}x{bottom - top:.3g} px"
            return f"transfer function of {len(along.shares)} segments over {extent}"
        if at.variation_px:
            return f"{length} in the middle; by transfer function where its variation is not modelled"
        return f"transfer function, {length}"

    def key(self, at: Resolved[float]) -> Hashable:
        # How far a path leads during the exposure depends on its time, whatever the displacement.
        return at.displacement_px, at.trajectories, at.exposure_s if at.trajectories else None


class MotionVariation(_Motion):
    """Motion that differs from pixel to pixel, as a moving camera's; left out, one motion serves the picture.

    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, variation_px=0.1)
    >>> round(MOTION_VARIATION.bound(at), 3)
    0.048
    """

    name = "motion variation"

    def bound(self, at: Resolved[float]) -> float:
        """:func:`blurnoise.camera.transfer.motion_variation_error` of the pixel that differs most from the mean."""
        return transfer.motion_variation_error(float(at.variation_px))

    def how(self, at: Resolved[float]) -> str:
        return f"sub-exposures along each pixel's path, up to {at.variation_px:.3g} px from the middle one"

    def key(self, at: Resolved[float]) -> Hashable:
        return at.variation_px


class RollingShutter(_Motion):
    """Rows that are exposed one after another, or with global reset begin together and end one after another.

    >>> rolling = Camera.preset("imx250").with_figures(shutter="rolling", row_time_s=10e-6, height_px=1000)
    >>> at = Resolved(rolling, 0.01, 25.0, 1000.0, displacement_px=(10.0, 0.0))
    >>> ROLLING_SHUTTER.how(at)  # 1000 px/s for 10 us
    '10 ms from first row to last: +0.01, +0 px per row, after the blur'
    """

    name = "rolling shutter"
    figures = ("row_time_s",)

    def bound(self, at: Resolved[float]) -> float:
        """Bound from the largest displacement d, pi d / sqrt(2) RMS, and from the light that rows gain."""
        if not at.camera.sensor.row_time_s:
            return 0.0
        # Of the sensor's rows: a smaller picture is read out as long, so that no size changes the bound.
        moves = displacement(replace(at, size=None))
        readout, by_row = moves.readout, moves.each_row_differs
        farthest_px = math.hypot(*at.displacement_px) + float(at.variation_px)
        farthest_px = max(farthest_px, *(math.hypot(*each.displacement_px) for each in _objects(at)), 0.0)
        fastest = farthest_px / at.exposure_s if at.exposure_s else 0.0
        apart_s = abs(readout.row_s) * (readout.rows - 1) / 2
        farthest = fastest * (max(map(abs, readout.span_s)) if by_row else apart_s)
        farthest += float(np.hypot(*moves.path_track[1]).max())
        return min(1.0, math.pi * farthest / math.sqrt(2)) + float(readout.light.max()) - 1

    def how(self, at: Resolved[float]) -> str:
        if at.objects:
            return "with the objects, each thing by its own motion"
        moves = displacement(at)
        row_s = abs(moves.readout.row_s)
        took = f"{1e3 * row_s * moves.readout.rows:.3g} ms from first row to last"
        if moves.each_row_differs:
            return f"{took}: every row in its own window"
        x, y = (along * row_s for along in moves.velocity_px_s)
        return f"{took}: {x:+.3g}, {y:+.3g} px per row, after the blur"

    def key(self, at: Resolved[float]) -> Hashable:
        rows = at.camera.sensor.row_time_s, at.camera.sensor.shutter, at.camera.sensor.scan, at.exposure_s
        return (*rows, at.displacement_px, at.variation_px, at.trajectories) if rows[0] else None

    def move_boxes(self, boxes_xyxy: Tensor, at: Resolved[float]) -> Tensor:
        """Shift the upper and lower edge to their mean rows, and the box sideways as its middle row is."""
        if not at.camera.sensor.row_time_s or not len(boxes_xyxy):
            return boxes_xyxy
        moves = displacement(at)
        # Each edge is where the row that shows it is exposed: a box becomes longer, shorter, and leans.
        between = boxes_xyxy.detach().cpu().double().numpy() - 0.5  # pixels' centres
        left, top, right, bottom = between.T
        top, bottom = moves.seen_rows(top), moves.seen_rows(bottom)
        x, _ = moves.mean_px((top + bottom) / 2)
        return torch.from_numpy(np.stack([left + x, top, right + x, bottom], 1) + 0.5).to(boxes_xyxy)

    def origins(self, points: Floats, at: Resolved[float]) -> Floats:
        """Points less the mean motion in their rows; of points beyond the picture, those of its mirror image."""
        if not at.camera.sensor.row_time_s:
            return points
        moves = displacement(at)
        rows, size = np.arange(float(moves.readout.rows)), at.size or at.camera.field.size
        by = np.stack([np.interp(points[1], rows, along) for along in moves.mean_px(rows)])
        if at.flow_px is not None:
            flow, _ = replace(moves, even_px=at.flow_px[0]).even(Window(0, 0, *size))
            by = by + flow.numpy()
        at_rest = torch.from_numpy(points - by)
        return torch.stack([folded(at_rest[axis], size[1 - axis], "reflect") for axis in (0, 1)]).numpy()

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Resolved[float]) -> Tensor:
        """What boxes cover while their rows are exposed, one after another."""
        if not at.camera.sensor.row_time_s or not len(boxes_xyxy):
            return boxes_xyxy
        between = boxes_xyxy.detach().cpu().double().numpy() - 0.5
        return torch.from_numpy(displacement(at).covered(between) + 0.5).to(boxes_xyxy)


def _objects(at: Resolved[float]) -> tuple[ObjectMotion, ...]:
    return cast(tuple[ObjectMotion, ...], at.objects)


OBJECTS = Objects()
MOTION = Motion()
MOTION_VARIATION = MotionVariation()
ROLLING_SHUTTER = RollingShutter()
