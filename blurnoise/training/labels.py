"""Labels of training pictures: where boxes, keypoints and masks are under the exposure of each picture.

Convention: a label is where its target is at mid-exposure, in the middle of its blur; where rows are exposed in turn,
at mid-exposure of the rows that show it. So a pixel of a mask has the label of what is there at mid-exposure, and no
label between two others. A rolling shutter and a lens's distortion move it; a blur about its place does not. Where
the lens sees beyond the picture, masks are 0. Boxes are px from the corner of the picture, keypoints from the centre
of its first pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.threads import no_torch_compile
from blurnoise.light import effects
from blurnoise.scene.cutting import matte_of
from blurnoise.scene.exposure import Exposure

Size = tuple[int, int]
Pixels = tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]


def of_targets(exposures: Sequence[Exposure], masks: Tensor | None = None) -> list[Exposure]:
    """The exposures of the pictures' targets, with the motion of these alone. masks: (B, N, H, W) of the targets.

    A picture without targets, or with nothing else, moves as a whole.

    >>> from blurnoise import Camera
    >>> tracking = Exposure(Camera.preset("imx250"), 0.01, 50.0, velocity_px_s=(800.0, 0.0), moves="background")
    >>> target = torch.zeros(1, 1, 40, 60)
    >>> target[..., 10:20, 10:30] = 1.0
    >>> of_targets([tracking], target)[0].velocity_px_s  # the camera follows the target
    (0.0, 0.0)
    """
    targets = []
    for item, exposure in enumerate(exposures):
        if exposure.moves != "all" and (masks is None or matte_of(masks[item]) is None):
            exposure = replace(exposure, moves="all")
        targets.append(exposure.of_targets())
    return targets


@no_torch_compile
def boxes_after(
    boxes_xyxy: Tensor, exposures: Sequence[Exposure], size: Size, *, grow: bool = False
) -> Tensor:
    """Boxes (B, N, 4), float64, of pictures (H, W) at mid-exposure. exposures: of the targets, B.

    grow: extended to the swept boxes, see :meth:`Exposure.sweep_boxes`, but at most to the border of the picture.

    >>> from blurnoise import Camera
    >>> exposure = Exposure(Camera.preset("imx250"), 0.01, 50.0, velocity_px_s=(800.0, 0.0))
    >>> box = torch.tensor([[[100.0, 50.0, 120.0, 70.0]]], dtype=torch.float64)
    >>> boxes_after(box, [exposure], (240, 320), grow=True).tolist()  # by half of 8 px to either side
    [[[96.0, 50.0, 124.0, 70.0]]]
    """
    moved, swept = boxes_xyxy.clone(), boxes_xyxy.clone()
    for boxes, out, covered, exposure in zip(boxes_xyxy, moved, swept, exposures, strict=True):
        out[:] = exposure.move_boxes(boxes, size) if effects.displace(exposure.camera) else boxes
        if grow:
            path: Any = exposure.trajectory if exposure.drives else None
            covered[:] = (replace(exposure, trajectory=None) if path else exposure).sweep_boxes(boxes, size)
            if path:  # Flow and shake separately: their sum is a bound, and takes one pass instead of one per point.
                covered += boxes.new_tensor(path.seen(exposure.exposure_s).box)
    if not grow:
        return moved
    # A box that reaches beyond the picture already keeps its edge there.
    end = torch.maximum(moved[..., 2:], moved.new_tensor([size[1], size[0]]))
    first = torch.maximum(swept[..., :2], moved[..., :2].clamp(max=0))
    return torch.cat([first, torch.minimum(swept[..., 2:], end)], -1)


@no_torch_compile
def keypoints_after(points: Tensor, exposures: Sequence[Exposure], size: Size) -> Tensor:
    """Keypoints (B, N, 2) of pictures (H, W) at mid-exposure, in their dtype; NaN and infinity stay.

    >>> from blurnoise import Camera
    >>> rolling = Exposure(Camera.preset("ar0237"), 0.01, 50.0, velocity_px_s=(1000.0, 0.0))
    >>> points = torch.tensor([[[160.0, 10.0], [160.0, 119.5]]])  # near the top, and in the middle row
    >>> keypoints_after(points, [rolling], (240, 320)).round()
    tensor([[[152.,  10.],
             [160., 120.]]])
    """
    moved = points.clone()
    for before, out, exposure in zip(points, moved, exposures, strict=True):
        known = before.isfinite().all(-1)
        if effects.displace(exposure.camera) and bool(known.any()):
            from_corner = before[known].detach().double().cpu() + 0.5
            out[known] = (exposure.move_points(from_corner, size) - 0.5).to(out)
    return moved


def masks_after(masks: Tensor, exposures: Sequence[Exposure]) -> Tensor:
    """Masks (B, ..., H, W) of any dtype at mid-exposure.

    >>> from blurnoise import Camera
    >>> rolling = Exposure(Camera.preset("ar0237"), 0.01, 50.0, velocity_px_s=(1000.0, 0.0))
    >>> mask = torch.zeros(1, 240, 320, dtype=torch.bool)
    >>> mask[..., 160] = True  # an upright post
    >>> moved = masks_after(mask, [rolling])
    >>> [int(moved[0, row].nonzero()) for row in (0, 120, 239)]  # leans
    [152, 160, 168]
    """
    moved = []
    for mask, exposure in zip(masks, exposures, strict=True):
        pixels = pixels_after(exposure, mask.shape[-2:])
        moved.append(mask if pixels is None else _picked(mask, pixels))
    return torch.stack(moved) if moved else masks


@no_torch_compile
def pixels_after(exposure: Exposure, size: Sequence[int]) -> Pixels | None:
    """Row and column (H, W) of the pixel that each pixel takes its label from, and whether that is in the picture.

    None where masks do not change.

    >>> from blurnoise import Camera
    >>> pixels_after(Exposure(Camera.preset("imx250"), 0.01, 50.0), (240, 320)) is None  # its labels stay
    True
    """
    height, width = size
    if not effects.displace(exposure.camera) or not height * width:
        return None
    # Nearest, never interpolated: between labels 3 and 7 there is no label 5.
    column, row = np.floor(exposure.origins((height, width)) + 0.5).astype(np.intp)  # rounds all halves up
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return row.clip(0, height - 1), column.clip(0, width - 1), inside


def _picked(mask: Tensor, pixels: Pixels) -> Tensor:
    row, column, inside = (torch.from_numpy(each).to(mask.device) for each in pixels)
    return torch.where(inside, mask[..., row, column], mask.new_zeros(()))
