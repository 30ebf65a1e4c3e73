"""A picture's frames under the conditions of a sweep's cells.

Domain: pictures in as (H, W, 3) RGB, 8 or 16 bit, sRGB-coded; out as the camera's 8-bit picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.camera import Camera
from blurnoise.exposure import ExposedScene, Exposure
from blurnoise_eval.datasets import Image, eight_bit
from blurnoise_eval.grid.conditions import Cell


class Frame(NamedTuple):
    """What the camera delivers for a cell, (H, W, 3) uint8 RGB, the ms it took, and where it moves boxes."""

    cell: Cell
    image: NDArray[np.uint8]
    simulate_ms: float
    move_boxes: Callable[[Tensor], Tensor] | None = None


class Scene:
    """A picture as light: what all its conditions share. ``image8``: the picture itself with 8 bits."""

    def __init__(self, image: Image) -> None:
        self.image8 = eight_bit(image)
        self.light = ExposedScene.of_picture(image)


def frames(scene: Scene, cells: Sequence[Cell], camera: Camera, temperature_c: float) -> Iterator[Frame]:
    """The picture of each cell; a cell without conditions is the picture as it is, and stands first."""
    exposed = [cell for cell in cells if cell.conditions is not None]
    yield from (Frame(cell, scene.image8, 0.0) for cell in cells if cell.conditions is None)
    exposures = [
        Exposure(
            camera,
            at.exposure_s,
            at.illuminance_lux,
            (at.velocity_x_px_s, at.velocity_y_px_s),
            temperature_c,
            seed=cell.seed,
        )
        for cell in exposed
        if (at := cell.conditions)
    ]
    for cell, frame in zip(exposed, scene.light.frames(exposures), strict=True):
        yield Frame(cell, frame.picture, frame.simulate_ms, frame.move_boxes)
