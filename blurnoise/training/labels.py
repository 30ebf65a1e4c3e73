"""Labels of training pictures: where boxes, keypoints and masks are under the conditions of each picture.

Convention: a label is where its target is at mid-exposure, in the middle of its blur; where rows are exposed in turn,
at mid-exposure of the rows that show it. So a pixel of a mask has the label of what stands there at mid-exposure, the
nearest one. A rolling shutter and a lens's distortion move it; a blur about its place does not. Where the lens sees
beyond the picture, masks are 0. Boxes are px from the corner of the picture, keypoints from the centre of its first
pixel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import Numbers, limited_per_image, shown
from blurnoise._core.threads import no_torch_compile
from blurnoise.light import effects
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.scene.cutting import matte_of
from blurnoise.scene.exposure import Exposure
from blurnoise.training.ranges import Cameras, Draws, Params, cameras_of

_STILL = {
    "illuminance_lux", "temperature_c", "gain_db", "lamp", "lamp_lights", "generator", "encoding", "fidelity",
}  # fmt: skip
"""Arguments that move nothing."""
T = TypeVar("T")
Size = tuple[int, int]
Pixels = tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]


def for_each(name: str, given: Sequence[T], batch: int) -> list[T]:
    """Broadcast to one per picture. Raises ``ValueError`` for another number."""
    if len(given) not in (1, batch):
        raise ValueError(f"{name}: got {len(given)}; must be one, or {batch}, one for each picture")
    return [*given] * (batch if len(given) == 1 else 1)


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, from speeds (B,) and directions (B,), counter-clockwise as displayed."""
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def taken(params: Params, ranges: Draws) -> list[Exposure]:
    """The exposures of each picture's targets under drawn conditions, without light and gain."""
    return list(of_targets(len(params["camera_index"]), **ranges.arguments(params)))


def of_targets(
    batch: int,
    camera: Cameras,
    *,
    exposure_s: Numbers,
    speed_px_s: Numbers = 0.0,
    direction_deg: Numbers = 0.0,
    masks: Tensor | None = None,
    moves: str | Sequence[str] = "all",
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    ego_kmh: Numbers | None = None,
    vehicle: Vehicle = USUAL_VEHICLE,
    **others: Any,
) -> Iterator[Exposure]:
    """The exposures of each picture's targets, of arguments of :func:`.augmentation.expose_pictures`."""
    for name in others.keys() - _STILL:
        raise TypeError(f"{name} = {shown(others[name])}: is no condition of expose_pictures")
    numbers = {"exposure_s": exposure_s, "speed_px_s": speed_px_s, "direction_deg": direction_deg}
    like = torch.empty((), dtype=torch.float64)
    each = {name: limited_per_image(name, given, batch, like) for name, given in numbers.items()}
    velocities = velocity_px_s(each["speed_px_s"], each["direction_deg"]).tolist()
    ego = [None] * batch if ego_kmh is None else limited_per_image("ego_kmh", ego_kmh, batch, like).tolist()
    names = for_each("moves", [moves] if isinstance(moves, str) else moves, batch)
    paths = per_picture(trajectory, batch) or [None] * batch
    columns = for_each("camera", cameras_of(camera), batch), each["exposure_s"].tolist(), paths
    for item, (own, lasting_s, path) in enumerate(zip(*columns, strict=True)):
        exposure = Exposure(own, lasting_s, 0.0, trajectory=path)
        kmh = ego[item]
        if names[item] == "background" and masks is not None and matte_of(masks[item]) is not None:
            yield exposure  # the camera follows them
        elif kmh is None:
            yield replace(exposure, velocity_px_s=tuple(velocities[item]))
        else:
            yield replace(exposure, ego_speed_m_s=kmh / 3.6, vehicle=vehicle)


@no_torch_compile
def boxes_after(boxes_xyxy: Tensor, by: Sequence[Exposure], size: Size, *, grow: bool = False) -> Tensor:
    """Boxes (B, N, 4), float64, of pictures (H, W), as they are at mid-exposure.

    grow: with what they sweep, as :meth:`Exposure.sweep_boxes` has it, but no further than the picture.
    """
    moved, swept = boxes_xyxy.clone(), boxes_xyxy.clone()
    for boxes, out, covered, exposure in zip(boxes_xyxy, moved, swept, by, strict=True):
        out[:] = exposure.move_boxes(boxes, size) if effects.displace(exposure.camera) else boxes
        if grow:
            path = exposure.trajectory if exposure.drives else None
            covered[:] = (replace(exposure, trajectory=None) if path else exposure).sweep_boxes(boxes, size)
            if path:  # flow and shake each by itself: a bound, found for all places at once
                covered += boxes.new_tensor(path.seen(exposure.exposure_s).box)
    if not grow:
        return moved
    end = torch.maximum(moved[..., 2:], moved.new_tensor([size[1], size[0]]))
    first = torch.maximum(swept[..., :2], moved[..., :2].clamp(max=0))
    return torch.cat([first, torch.minimum(swept[..., 2:], end)], -1)


@no_torch_compile
def keypoints_after(points: Tensor, by: Sequence[Exposure], size: Size) -> Tensor:
    """Keypoints (B, N, 2) of pictures (H, W) at mid-exposure, in their dtype; NaN and infinity stay."""
    moved = points.clone()
    for own, out, exposure in zip(points, moved, by, strict=True):
        known = own.isfinite().all(-1)
        if effects.displace(exposure.camera) and bool(known.any()):
            places = own[known].detach().double().cpu() + 0.5
            out[known] = (exposure.move_points(places, size) - 0.5).to(out)
    return moved


def masks_after(masks: Tensor, by: Sequence[Exposure]) -> Tensor:
    """Masks (B, ..., H, W) of any dtype at mid-exposure."""
    moved = [own if (of := pixels_after(exposure, own.shape[-2:])) is None else _picked(own, of)
             for own, exposure in zip(masks, by, strict=True)]  # fmt: skip
    return torch.stack(moved) if moved else masks


@no_torch_compile
def pixels_after(exposure: Exposure, size: Sequence[int]) -> Pixels | None:
    """Row and column of a mask that each pixel takes its label from, (H, W), and whether there is one.

    None where masks stay as they are.
    """
    height, width = size
    if not effects.displace(exposure.camera) or not height * width:
        return None
    column, row = np.floor(exposure.origins((height, width)) + 0.5).astype(np.intp)  # halves all to one side
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return row.clip(0, height - 1), column.clip(0, width - 1), inside


def _picked(mask: Tensor, of: Pixels) -> Tensor:
    row, column, inside = (torch.from_numpy(each).to(mask.device) for each in of)
    return torch.where(inside, mask[..., row, column], mask.new_zeros(()))
