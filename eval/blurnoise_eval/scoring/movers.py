"""Where an exposure takes the boxes of a scene: the truth in its picture, and what boxes sweep in its course."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.light import effects
from blurnoise.scene.scene import Exposure
from blurnoise_eval.plan.objects import USUAL_OBJECTS, Objects
from blurnoise_eval.scoring.boxes import MoveBoxes, swept_within

BoxesIn = Callable[[torch.Tensor, tuple[int, int] | None], torch.Tensor]


def box_mover(taken: Exposure, objects: Objects = USUAL_OBJECTS) -> MoveBoxes | None:
    """Takes a scene's boxes (N, 4) to the truth in the picture: where they are at mid-exposure, or what else
    ``objects.boxes`` says; None: they stay."""
    along_path = objects.boxes == "swept" and taken.trajectory is not None
    crosses = taken.moves != "all" and objects.crosses()
    if objects.boxes == "object" or not (any(taken.velocity_px_s) or taken.drives or along_path or crosses):
        return _mover(lambda of: of.move_boxes, taken, objects) if effects.displace(taken.camera) else None
    if objects.boxes == "swept":
        return _mover(lambda of: of.sweep_boxes, taken, objects, within=True)
    return _mover(_half, taken, objects)


def box_sweeper(taken: Exposure, objects: Objects = USUAL_OBJECTS) -> MoveBoxes:
    """Takes a scene's boxes (N, 4) to what they cover in the course of the exposure, beyond the picture too."""
    return _mover(lambda of: of.sweep_boxes, taken, objects)


def _half(taken: Exposure) -> BoxesIn:
    """Where boxes are for half of the exposure or more: the objects' own, up to a motion of twice their size along
    either axis. Of those that are nowhere so long the middle, no area."""

    def boxes_in(boxes_xyxy: torch.Tensor, size: tuple[int, int] | None) -> torch.Tensor:
        middle = (boxes_xyxy[:, :2] + boxes_xyxy[:, 2:]) / 2
        moved_px = taken.displacements_px(middle, size).abs().to(boxes_xyxy)
        own = taken.move_boxes(boxes_xyxy, size)
        there = (moved_px <= 2 * (own[:, 2:] - own[:, :2])).all(1, keepdim=True)
        return torch.where(there, own, middle.repeat(1, 2))

    return boxes_in


def _mover(
    how: Callable[[Exposure], BoxesIn], taken: Exposure, objects: Objects, within: bool = False
) -> MoveBoxes:
    """within: not beyond the picture's border."""

    def move(
        boxes_xyxy: NDArray[np.float64], sizes_px: NDArray[np.float64], labels: Sequence[str] = ()
    ) -> NDArray[np.float64]:
        moved = np.empty_like(boxes_xyxy)
        speeds = {label: objects.speed_of(label) for label in set(labels)}
        speed = [speeds[label] for label in labels] or [1.0]
        sizes = np.where(np.isnan(sizes_px), 0.0, sizes_px)
        own = np.zeros((len(boxes_xyxy), 2))
        if taken.moves != "all" and objects.crosses():
            for place, label in enumerate(labels):
                own[place] = objects.own_px_s(label, boxes_xyxy[place].tolist())
        each = np.column_stack([sizes, np.broadcast_to(speed, len(boxes_xyxy)), own])
        for kind in dict.fromkeys(map(tuple, each.tolist())):  # of one picture's targets mostly one
            width, height, factor, *own_px_s = kind
            size_px = (int(height), int(width)) if width else None
            of = (each == kind).all(axis=1)
            move_kind = how(taken.of_targets(factor, (own_px_s[0], own_px_s[1])))
            moved[of] = move_kind(torch.from_numpy(boxes_xyxy[of]), size_px).numpy()
        if within:
            return swept_within(moved, boxes_xyxy, np.where(np.isnan(sizes_px), np.inf, sizes_px))
        return moved

    return move
