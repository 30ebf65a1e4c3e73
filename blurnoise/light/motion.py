"""Motion as light effects: of objects, of the picture, of each pixel, of what rows see one after another.

All are of one :class:`.displacement.Displacement`, which says how it is computed. A transfer function is shared with
the lens, as their order does not matter. A picture of other rows than the sensor's is read in as long.

With objects, the motion of everything, the background's included, is in their effect: what covers what changes during
the exposure. It comes before the lens, and so do shake and readout then, but after the distortion, in whose px
motion is.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import replace
from typing import cast

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import Border, Window, folded
from blurnoise._core.threads import differentiable
from blurnoise.blur import layers
from blurnoise.blur.displacement import Displacement, Floats, Readout
from blurnoise.blur.layers import Layer, ObjectMotion, plane_of
from blurnoise.blur.rows import translated
from blurnoise.blur.sub_exposures import SPACING_PX
from blurnoise.camera import transfer
from blurnoise.light.conditions import Conditions
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.light.lens import DISTORTION

_MARGIN_PX = 8  # of what a fraction of a pixel makes of an edge
_FAINT = 1e-3  # share of a pixel below which there is no colour


def readout_of(at: Conditions[float], size: tuple[int, int]) -> Readout:
    """Row timing of a picture (H, W), which is the largest part of the sensor that has its shape."""
    camera = at.camera
    row_s = (
        camera.sensor.row_time_s
        / camera.field.per_sensor_px(size)
        * (1 if camera.sensor.scan == "down" else -1)
    )
    reset = camera.sensor.row_time_s > 0 and camera.sensor.shutter == "global-reset"
    return Readout(size[0], row_s, at.exposure_s, reset)


def displacement(at: Conditions[float]) -> Displacement:
    """The motion of a frame without its flow."""
    even = torch.tensor(at.displacement_px, dtype=torch.float64)
    readout = readout_of(at, at.size or at.camera.field.size)
    return Displacement(even, even.new_tensor(at.exposure_s), readout, at.trajectory)


def displacements(at: Conditions[Tensor], size: tuple[int, int]) -> Iterator[Displacement]:
    """The motion of every frame, of pictures (H, W)."""
    moved = torch.as_tensor(at.displacement_px) if at.flow_px is None else at.flow_px
    for by, lasting, one in zip(moved, at.exposure_s, at.each(), strict=True):
        yield Displacement(by, lasting, readout_of(one, size), one.trajectory)


def exposed(
    light: Tensor, at: Conditions[Tensor], objects: tuple[tuple[Layer, ...], ...], border: Border
) -> Tensor:
    """Pictures (B, C, H, W) with their layers as exposures see them, rows as bright as they are exposed long."""
    size = (light.shape[-2], light.shape[-1])
    seen = []
    for picture, own, moves in zip(torch.split(light, 1), objects, displacements(at, size), strict=True):
        picture = layers.exposed(picture, own, moves, border)
        if moves.readout.reset:
            light_of_rows = torch.from_numpy(moves.readout.light)
            if differentiable(moves.exposure_s):
                light_of_rows = 1 + (light_of_rows - 1) * moves.readout.exposure_s / moves.exposure_s
            picture = picture * light_of_rows.to(picture)[:, None]
        seen.append(picture)
    return seen[0] if len(seen) == 1 else torch.cat(seen)


class _Moving(LightEffect):
    """Motion that is no transfer function, applied picture by picture."""

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        return exposed(light, at, ((),) * len(light), border)


class Objects(LightEffect):
    """Layers by :mod:`blurnoise.blur.layers`. Where there are some it stays, as they are part of the picture."""

    name = "objects"
    essential = True

    def bound(self, at: Conditions[float]) -> float:
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

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        return None if at.objects else Blur()

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        every = cast(tuple[tuple[Layer, ...], ...], at.objects)
        if at.camera.lens.displaces:
            every = tuple(
                tuple(_distorted(layer, light, at.part([place]), border) for layer in own)
                for place, own in enumerate(every)
            )
        return exposed(light, at, every, border)

    def how(self, at: Conditions[float]) -> str:
        found = _objects(at)
        if not found:
            return "none here"
        longest = max(math.hypot(*each.displacement_px) for each in found)
        apart = any(any(each.displacement_px) for each in found) and any(at.displacement_px)
        way = f"parts of {SPACING_PX:g} px" if apart or len(found) > 1 else "matte formula"
        return f"{len(found)} in layers, up to {longest:.3g} px: {way}, in their windows"

    def key(self, at: Conditions[float]) -> Hashable:
        return at.objects


class Motion(LightEffect):
    """Motion by its transfer function: straight of any length and angle, or a path of straight segments."""

    name = "motion"

    def bound(self, at: Conditions[float]) -> float:
        """:func:`blurnoise.camera.transfer.motion_error`, or :attr:`blurnoise.motion.trajectory.Polyline.error`."""
        moves = displacement(at)
        if moves.polyline is not None:
            return moves.polyline.error
        return 0.0 if moves.each_row_differs else transfer.motion_error(*at.displacement_px)

    def blur(self, at: Conditions[Tensor]) -> Blur:
        if at.objects or at.flow_px is not None:
            return Blur()
        moved = torch.as_tensor(at.displacement_px)
        if not at.trajectories and not at.camera.sensor.row_time_s:
            return Blur(displacement_px=moved)
        each = list(displacements(at, at.size or at.camera.field.size))
        elsewhere = torch.tensor([one.way != "transfer" for one in each], device=moved.device)
        paths = tuple(one.polyline for one in each)
        return Blur(displacement_px=moved.masked_fill(elsewhere[:, None], 0.0), paths=paths)

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Grown by half the displacement to either side, or by what the path covers; of rows, the effect of these."""
        if at.camera.sensor.row_time_s:
            return boxes_xyxy
        if (along := displacement(at).polyline) is not None:
            return boxes_xyxy + boxes_xyxy.new_tensor(along.box)
        half = boxes_xyxy.new_tensor(at.displacement_px).abs() / 2
        return boxes_xyxy + torch.cat([-half, half])

    def how(self, at: Conditions[float]) -> str:
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

    def key(self, at: Conditions[float]) -> Hashable:
        return at.displacement_px, at.trajectories


class MotionVariation(_Moving):
    """Motion that differs from pixel to pixel, as a moving camera's; left out, one motion serves the picture."""

    name = "motion variation"

    def bound(self, at: Conditions[float]) -> float:
        """:func:`blurnoise.camera.transfer.motion_variation_error` of what is farthest from the one motion."""
        return transfer.motion_variation_error(float(at.variation_px))

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        return Blur() if at.flow_px is None or at.objects or at.camera.sensor.row_time_s else None

    def how(self, at: Conditions[float]) -> str:
        return f"sub-exposures along each pixel's path, up to {at.variation_px:.3g} px from the middle one"

    def key(self, at: Conditions[float]) -> Hashable:
        return at.variation_px


class RollingShutter(_Moving):
    """Rows that are exposed one after another, or with global reset begin together and end one after another."""

    name = "rolling shutter"
    figures = ("row_time_s",)

    def bound(self, at: Conditions[float]) -> float:
        """Bound from the largest displacement d, pi d / sqrt(2) RMS, and from the light that rows gain."""
        if not at.camera.sensor.row_time_s:
            return 0.0
        moves = displacement(replace(at, size=None))
        readout, by_row = moves.readout, moves.each_row_differs
        farthest_px = math.hypot(*at.displacement_px) + float(at.variation_px)
        farthest_px = max(farthest_px, *(math.hypot(*each.displacement_px) for each in _objects(at)), 0.0)
        fastest = farthest_px / at.exposure_s if at.exposure_s else 0.0
        apart_s = abs(readout.row_s) * (readout.rows - 1) / 2
        farthest = fastest * (max(map(abs, readout.span_s)) if by_row else apart_s)
        farthest += float(np.hypot(*moves.path_track[1]).max())
        return min(1.0, math.pi * farthest / math.sqrt(2)) + float(readout.light.max()) - 1

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        return None if at.camera.sensor.row_time_s and not at.objects else Blur()

    def how(self, at: Conditions[float]) -> str:
        if at.objects:
            return "with the objects, each thing by its own motion"
        moves = displacement(at)
        row_s = abs(moves.readout.row_s)
        took = f"{1e3 * row_s * moves.readout.rows:.3g} ms from first row to last"
        if moves.each_row_differs:
            return f"{took}: every row in its own window"
        x, y = (along * row_s for along in moves.velocity_px_s)
        return f"{took}: {x:+.3g}, {y:+.3g} px per row, after the blur"

    def key(self, at: Conditions[float]) -> Hashable:
        rows = at.camera.sensor.row_time_s, at.camera.sensor.shutter, at.camera.sensor.scan, at.exposure_s
        return (*rows, at.displacement_px, at.variation_px, at.trajectories) if rows[0] else None

    def move_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Shift the upper and lower edge to their mean rows, and the box sideways as its middle row is."""
        if not at.camera.sensor.row_time_s or not len(boxes_xyxy):
            return boxes_xyxy
        moves = displacement(at)
        between = boxes_xyxy.detach().cpu().double().numpy() - 0.5  # pixels' centres
        left, top, right, bottom = between.T
        top, bottom = moves.seen_rows(top), moves.seen_rows(bottom)
        x, _ = moves.mean_px((top + bottom) / 2)
        return torch.from_numpy(np.stack([left + x, top, right + x, bottom], 1) + 0.5).to(boxes_xyxy)

    def origins(self, points: Floats, at: Conditions[float]) -> Floats:
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

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """What boxes cover while their rows are exposed, one after another."""
        if not at.camera.sensor.row_time_s or not len(boxes_xyxy):
            return boxes_xyxy
        between = boxes_xyxy.detach().cpu().double().numpy() - 0.5
        return torch.from_numpy(displacement(at).covered(between) + 0.5).to(boxes_xyxy)


def _objects(at: Conditions[float]) -> tuple[ObjectMotion, ...]:
    return cast(tuple[ObjectMotion, ...], at.objects)


def displaced(layer: Layer, shift_px: Tensor) -> Layer:
    """The layer displaced by (x, y) px, whole or not; nothing is beyond its sides."""
    shift = shift_px.detach()
    if not bool((shift != 0).any()):
        return layer
    whole = shift.round()
    plane = torch.cat([layer.light * layer.alpha, layer.alpha[None]])
    plane = torch.nn.functional.pad(plane, (_MARGIN_PX,) * 4)[None]
    light, alpha = _coloured(translated(plane, shift - whole, "constant")[0])
    left, top = (start + int(steps) - _MARGIN_PX for start, steps in zip(layer.place_px, whole, strict=True))
    return replace(layer, light=light, alpha=alpha, place_px=(left, top))


def _distorted(layer: Layer, like: Tensor, at: Conditions[Tensor], border: Border) -> Layer:
    """The layer as the lens shows it, in a window as large as the picture."""
    plane = plane_of([layer], Window(0, 0, like.shape[-2], like.shape[-1]), like, "constant")
    light, alpha = _coloured(DISTORTION.apply(plane, at, border)[0])
    return replace(layer, light=light, alpha=alpha, place_px=(0, 0))


def _coloured(plane: Tensor) -> tuple[Tensor, Tensor]:
    """Light and matte of a plane (C + 1, h, w) of light times matte, and the matte."""
    alpha = plane[-1].clamp(0, 1)
    seen = alpha > _FAINT  # what rings about it is not of the object
    return torch.where(seen, plane[:-1] / alpha.clamp_min(_FAINT), 0.0), torch.where(seen, alpha, 0.0)


OBJECTS = Objects()
MOTION = Motion()
MOTION_VARIATION = MotionVariation()
ROLLING_SHUTTER = RollingShutter()
