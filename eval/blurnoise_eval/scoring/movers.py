"""Where an exposure takes the boxes of a scene: the truth in its picture, and what boxes sweep in its course."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.light import effects
from blurnoise.scene.exposure import Exposure
from blurnoise_eval.plan.objects import USUAL_OBJECTS, ObjectSettings
from blurnoise_eval.scoring.boxes import MoveBoxes, swept_within

BoxesIn = Callable[[torch.Tensor, tuple[int, int] | None], torch.Tensor]


def box_mover(exposure: Exposure, objects: ObjectSettings = USUAL_OBJECTS) -> MoveBoxes | None:
    """Takes a scene's boxes (N, 4) to the truth in the picture: where they are at mid-exposure, or all that they pass
    within it; None: they stay."""
    moves = any(exposure.velocity_px_s) or exposure.drives or exposure.trajectory is not None
    if objects.boxes == "swept" and moves:
        return _mover(lambda of: of.sweep_boxes, exposure, objects, within=True)
    return _mover(lambda of: of.move_boxes, exposure, objects) if effects.displace(exposure.camera) else None


def box_sweeper(exposure: Exposure, objects: ObjectSettings = USUAL_OBJECTS) -> MoveBoxes:
    """Takes a scene's boxes (N, 4) to what they cover in the course of the exposure, beyond the picture too."""
    return _mover(lambda of: of.sweep_boxes, exposure, objects)


def _mover(
    how: Callable[[Exposure], BoxesIn], exposure: Exposure, objects: ObjectSettings, within: bool = False
) -> MoveBoxes:
    """within: not beyond the picture's border. Boxes are moved once, however many lights a motion is seen in."""
    found: dict[tuple[bytes, bytes, tuple[str, ...]], NDArray[np.float64]] = {}

    def move(
        boxes_xyxy: NDArray[np.float64], sizes_px: NDArray[np.float64], labels: Sequence[str] = ()
    ) -> NDArray[np.float64]:
        key = boxes_xyxy.tobytes(), sizes_px.tobytes(), tuple(labels)
        if key in found:
            return found[key]
        moved = np.empty_like(boxes_xyxy)
        speed = [objects.speed_of(label) for label in labels] or [1.0]
        sizes = np.where(np.isnan(sizes_px), 0.0, sizes_px)
        kinds = np.column_stack([sizes, np.broadcast_to(speed, len(boxes_xyxy))])
        for width, height, factor in dict.fromkeys(map(tuple, kinds.tolist())):  # mostly one for all targets
            size_px = (int(height), int(width)) if width else None
            alike = (kinds == (width, height, factor)).all(axis=1)
            move_alike = how(exposure.of_targets(factor))
            moved[alike] = move_alike(torch.from_numpy(boxes_xyxy[alike]), size_px).numpy()
        if within:
            moved = swept_within(moved, boxes_xyxy, np.where(np.isnan(sizes_px), np.inf, sizes_px))
        moved.flags.writeable = False  # it is given again
        found[key] = moved
        return moved

    return move
