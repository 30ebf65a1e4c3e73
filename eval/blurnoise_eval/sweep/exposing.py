"""A picture's frames under the conditions of a sweep's cells.

Domain: pictures in as (H, W, 3) RGB, 8 or 16 bit, sRGB-coded; out as the camera's 8-bit picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise.exposure import ExposedScene, Exposure
from blurnoise.light import effects
from blurnoise_eval.datasets import Image, eight_bit
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.scoring.matching import MoveBoxes


class Frame(NamedTuple):
    """What the camera delivers for a cell, (H, W, 3) uint8 RGB, the ms it took, and where it moves boxes."""

    cell: Cell
    image: NDArray[np.uint8]
    simulate_ms: float
    move_boxes: MoveBoxes | None = None


class Scene:
    """A picture as light: what all its conditions share. ``image8``: the picture itself with 8 bits."""

    def __init__(self, image: Image) -> None:
        self.image8 = eight_bit(image)
        self.light = ExposedScene.of_picture(image)


def frames(scene: Scene, cells: Sequence[Cell], camera: Camera) -> Iterator[Frame]:
    """The picture of each cell; a cell without conditions is the picture as it is, and stands first."""
    yield from (Frame(cell, scene.image8, 0.0) for cell in cells if cell.conditions is None)
    exposed = [(cell, cell.conditions) for cell in cells if cell.conditions is not None]
    exposures = [at.exposure(camera, cell.seed) for cell, at in exposed]
    taken = zip(exposed, exposures, scene.light.frames(exposures), strict=True)
    for (cell, _), exposure, frame in taken:
        yield Frame(cell, frame.picture, frame.simulate_ms, box_mover(exposure))


def box_mover(exposure: Exposure) -> MoveBoxes | None:
    """Takes a scene's boxes (N, 4) to where they are in the picture at mid-exposure; None: they stay."""
    if not effects.displace(exposure.camera):
        return None

    def move(boxes_xyxy: NDArray[np.float64], sizes_px: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = np.empty_like(boxes_xyxy)
        for width, height in np.unique(sizes_px, axis=0):
            alike = (np.array_equal(each, (width, height), equal_nan=True) for each in sizes_px)
            of = np.fromiter(alike, bool, len(sizes_px))
            size = None if np.isnan(width) else (int(height), int(width))
            moved[of] = exposure.move_boxes(torch.from_numpy(boxes_xyxy[of]), size).numpy()
        return moved

    return move
