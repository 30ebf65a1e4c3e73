"""Motion as light effects: of the picture, of each pixel, of what rows see one after another; boxes follow.

All three, and the objects' (:mod:`.objects`), are of one :class:`.displacement.Displacement`,
which says how it is computed. A transfer function is shared with the lens, as their order does not matter. A picture
of other rows than the sensor's is read in as long.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import convolution, layered
from blurnoise.blur.displacement import Displacement, Readout
from blurnoise.blur.layers import Layer, Passing
from blurnoise.light.conditions import Conditions
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.motion.trajectory import Polyline
from blurnoise.optics import transfer
from blurnoise.optics.camera import Camera


def readout_of(at: Conditions[float], size: tuple[int, int]) -> Readout:
    """Of a picture (H, W), which stands for the largest part of the sensor that has its shape."""
    camera = at.camera
    row_s = camera.row_time_s / camera.field.per_sensor_px(size) * (1 if camera.scan == "down" else -1)
    return Readout(
        size[0], row_s, at.exposure_s, reset=camera.row_time_s > 0 and camera.shutter == "global-reset"
    )


def displacement(at: Conditions[float]) -> Displacement:
    """The one motion of a frame, its flow left out."""
    even = torch.tensor(at.displacement_px, dtype=torch.float64)
    lasting = even.new_tensor(at.exposure_s)
    return Displacement(even, lasting, readout_of(at, at.size or at.camera.field.size), at.trajectory)


def displacements(at: Conditions[Tensor], size: tuple[int, int]) -> Iterator[Displacement]:
    """The motion of every frame, of pictures (H, W)."""
    moved = torch.as_tensor(at.displacement_px) if at.flow_px is None else at.flow_px
    for by, lasting, one in zip(moved, at.exposure_s, at.each(), strict=True):
        yield Displacement(by, lasting, readout_of(one, size), one.trajectory)


def exposed(
    light: Tensor, at: Conditions[Tensor], layers: tuple[tuple[Layer, ...], ...], border: Border
) -> Tensor:
    """Pictures (B, C, H, W) with their layers as exposures see them, rows as bright as they are exposed long."""
    size = (light.shape[-2], light.shape[-1])
    seen = []
    for picture, own, moves in zip(torch.split(light, 1), layers, displacements(at, size), strict=True):
        picture = layered.exposed(picture, own, moves, border)
        if moves.readout.reset:
            picture = picture * torch.from_numpy(moves.readout.light).to(picture)[:, None]
        seen.append(picture)
    return seen[0] if len(seen) == 1 else torch.cat(seen)


class _Moving(LightEffect):
    """What is no transfer function, each picture by its own displacement."""

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        """Every picture by its displacement, those that have been blurred by their transfer function as they are."""
        return exposed(light, at, ((),) * len(light), border)


@dataclass(frozen=True)
class Motion(LightEffect):
    """Motion by its transfer function: straight of any length and angle, or a path of straight segments."""

    name = "motion"

    def bound(self, at: Conditions[float]) -> float:
        """:func:`blurnoise.optics.transfer.motion_error`, or :attr:`blurnoise.motion.trajectory.Polyline.error`."""
        if (along := _path(at)) is not None:
            return along.error
        if _row_by_row(at):
            return 0.0
        return transfer.motion_error(*at.displacement_px)

    def blur(self, at: Conditions[Tensor]) -> Blur:
        """Shared with the lens; nothing where there are objects or a flow, nor of pictures that go another way."""
        if at.objects or at.flow_px is not None:
            return Blur()
        moved = torch.as_tensor(at.displacement_px)
        if not at.trajectories and not at.camera.row_time_s:
            return Blur(displacement_px=moved)
        each = list(displacements(at, at.size or at.camera.field.size))
        elsewhere = torch.tensor([one.way != "transfer" for one in each], device=moved.device)
        paths = tuple(one.polyline if one.way == "transfer" else None for one in each)
        return Blur(displacement_px=moved.masked_fill(elsewhere[:, None], 0.0), paths=paths)

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        """By its transfer function."""
        own = self.blur(at)
        return convolution.exposure_blur(light, at.displacement_px, own.optics, own.paths, border=border)

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Grown by half the displacement to either side, or by what the path covers."""
        if (along := _path(at)) is not None:
            return boxes_xyxy + boxes_xyxy.new_tensor(along.box)
        if _row_by_row(at):
            return boxes_xyxy
        half = swept_half_px(boxes_xyxy.new_tensor(at.displacement_px))
        return boxes_xyxy + torch.cat([-half, half])

    def how(self, at: Conditions[float]) -> str:
        """The length, or the path's extent and segments."""
        if at.objects:
            return f"with the objects, {math.hypot(*at.displacement_px):.3g} px"
        camera, lens = at.camera, at.camera.lens
        apart = camera.defocus_counts_pixel or lens.field_curvature_px
        shares = (camera.defocus_radius_px and not apart) or camera.diffraction_wavelength_um or lens.mtf
        together = ", with the lens's" if shares else ""
        if (along := _path(at)) is not None:
            left, top, right, bottom = along.box
            extent = f"{right - left:.3g}x{bottom - top:.3g} px"
            return f"transfer function of {len(along.shares)} segments over {extent}{together}"
        length = f"{math.hypot(*at.displacement_px):.3g} px"
        if at.variation_px:
            return f"{length} in the middle; by transfer function where its variation is not modelled"
        return f"transfer function, {length}{together}"

    def key(self, at: Conditions[float]) -> Hashable:
        """The displacement and the trajectory."""
        return at.displacement_px, at.trajectories


@dataclass(frozen=True)
class MotionVariation(_Moving):
    """Motion that differs from pixel to pixel, as a moving camera's; left out, one motion serves the picture."""

    name = "motion variation"

    def bound(self, at: Conditions[float]) -> float:
        """:func:`blurnoise.optics.transfer.motion_variation_error` of what is farthest from the one motion."""
        return transfer.motion_variation_error(float(at.variation_px))

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        """Nothing to share, unless there is a flow that neither objects have met nor rows will meet."""
        return Blur() if at.flow_px is None or at.objects or at.camera.row_time_s else None

    def how(self, at: Conditions[float]) -> str:
        """How far displacements differ."""
        return f"sub-exposures along each pixel's path, up to {at.variation_px:.3g} px from the middle one"

    def key(self, at: Conditions[float]) -> Hashable:
        """Of its own: exposures that share their light have one motion for the picture."""
        return at.variation_px


@dataclass(frozen=True)
class RollingShutter(_Moving):
    """Rows that are exposed one after another, or with global reset begin together and end one after another."""

    name = "rolling shutter"
    figures = ("row_time_s",)

    def bound(self, at: Conditions[float]) -> float:
        """Of the largest displacement, pi d / sqrt(2) RMS as of a lens's, and of the light that rows gain."""
        if not at.camera.row_time_s:
            return 0.0
        readout = readout_of(at, at.camera.field.size)
        passing = cast(tuple[Passing, ...], at.objects)
        farthest_px = math.hypot(*at.displacement_px) + float(at.variation_px)
        farthest_px = max(farthest_px, *(math.hypot(*each.displacement_px) for each in passing), 0.0)
        fastest = farthest_px / at.exposure_s if at.exposure_s else 0.0
        if not _row_by_row(at):
            farthest = fastest * abs(readout.row_s) * (readout.rows - 1) / 2
        else:
            farthest = fastest * max(map(abs, readout.span_s))
        if at.trajectory is not None:
            x, y = at.trajectory.origin_px(at.exposure_s)
            knots, _ = at.trajectory.window(*readout.span_s)
            farthest += float(np.hypot(knots[0] - x, knots[1] - y).max())
        return min(1.0, math.pi * farthest / math.sqrt(2)) + float(readout.light.max()) - 1

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        """None that is shared, unless rows are exposed together, or objects have been with them."""
        return None if at.camera.row_time_s and not at.objects else Blur()

    def how(self, at: Conditions[float]) -> str:
        """Which of the ways, and how long the rows take of a picture of the point's size."""
        if at.objects:
            return "with the objects, each thing by its own motion"
        rows, row_s = at.camera.height_px, at.camera.row_time_s
        if at.size is not None:
            rows, row_s = at.size[0], row_s / at.camera.field.per_sensor_px(at.size)
        took = f"{1e3 * row_s * rows:.3g} ms from first row to last"
        if not _row_by_row(at):
            x, y = (along * row_s for along in displacement(at).velocity_px_s)
            return f"{took}: {x:+.3g}, {y:+.3g} px per row, after the blur"
        return f"{took}: every row in its own window"

    def key(self, at: Conditions[float]) -> Hashable:
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

    def move_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Upper and lower edge where rows have them on average, sideways by where the box's middle row has it."""
        return self._moved(boxes_xyxy, at, swept=False)

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """The same, and what the middle row's window of a path covers; what is grown already is only moved."""
        return self._moved(boxes_xyxy, at, swept=_row_by_row(at))

    def _moved(self, boxes_xyxy: Tensor, at: Conditions[float], *, swept: bool) -> Tensor:
        if not at.camera.row_time_s or not len(boxes_xyxy):
            return boxes_xyxy
        moves = displacement(at)
        # from between the pixels' edges to their centres
        boxes = boxes_xyxy.detach().cpu().double().numpy() - 0.5
        moved = boxes.copy()
        for box in moved:
            left, top, right, bottom = box
            top, bottom = (moves.seen_row(row) for row in (top, bottom))
            mean, low, high = moves.during((top + bottom) / 2)
            least, largest = (low - mean, high - mean) if swept else (0 * mean, 0 * mean)
            x = float(mean[0])
            box[:] = left + x + least[0], top + least[1], right + x + largest[0], bottom + largest[1]
        return torch.from_numpy(moved + 0.5).to(boxes_xyxy)


def _row_by_row(at: Conditions[float]) -> bool:
    """Whether each row sees another part of the motion."""
    return at.camera.row_time_s > 0 and (at.trajectory is not None or at.camera.shutter == "global-reset")


def _path(at: Conditions[float]) -> Polyline | None:
    """What a frame sees of its trajectory and its uniform motion where that is a transfer function."""
    return None if at.trajectory is None or _row_by_row(at) else displacement(at).polyline


def swept_half_px(displacement_px: Tensor) -> Tensor:
    """What displacements (..., 2), px, sweep to either side of a place at mid-exposure, (..., 2), >= 0."""
    return displacement_px.abs() / 2


MOTION = Motion()
MOTION_VARIATION = MotionVariation()
ROLLING_SHUTTER = RollingShutter()
