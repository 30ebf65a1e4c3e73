"""A picture's frames under the conditions of a sweep's cells.

Domain: pictures in as (H, W, 3) RGB, 8 or 16 bit, sRGB-coded; out as the camera's 8-bit picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise.exposure import ExposedScene, Exposure
from blurnoise.light import effects
from blurnoise.picture.develop import tones_8bit
from blurnoise_eval.datasets import Image, UnreadablePicture, eight_bit
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.scoring.matching import MoveBoxes


class Frame(NamedTuple):
    """What the camera delivers for a cell, (H, W, 3) uint8 RGB, the ms it took, where it moves boxes and what they
    sweep.

    saturated: the share of its values at a limit of well, converter or picture; None of the untouched picture.
    """

    cell: Cell
    image: NDArray[np.uint8]
    simulate_ms: float
    move_boxes: MoveBoxes | None = None
    sweep_boxes: MoveBoxes | None = None
    saturated: float | None = None


class Scene:
    """A picture as light: what all its conditions share. ``image8``: the picture itself with 8 bits.

    grey_anchor: what of it is 18 % reflectance (:mod:`blurnoise.grey_anchor`). Raises ``UnreadablePicture`` where the
    picture has no such place, or no light there.
    """

    def __init__(self, image: Image, grey_anchor: str | None = None) -> None:
        self.image8 = eight_bit(image)
        try:
            self.light = ExposedScene.of_picture(image, grey_anchor)
        except ValueError as error:
            if grey_anchor is None:
                raise
            raise UnreadablePicture(str(error)) from None


def frames(scene: Scene, cells: Sequence[Cell], camera: Camera) -> Iterator[Frame]:
    """The picture of each cell; a cell without conditions is the picture as it is, and stands first."""
    yield from (Frame(cell, scene.image8, 0.0) for cell in cells if cell.conditions is None)
    exposed = [(cell, cell.conditions) for cell in cells if cell.conditions is not None]
    exposures = [at.exposure(camera, cell.seed) for cell, at in exposed]
    taken = zip(exposed, exposures, scene.light.frames(exposures), strict=True)
    for (cell, _), exposure, frame in taken:
        saturated = np.count_nonzero(frame.picture >= brightest(exposure)) / frame.picture.size
        yield Frame(
            cell, frame.picture, frame.simulate_ms, box_mover(exposure), box_sweeper(exposure), saturated
        )


def brightest(exposure: Exposure) -> int:
    """The 8-bit value of what stands at the full well or at full scale, whichever is less; three times the read
    noise below it still counts."""
    camera = exposure.camera
    margin_dn = math.ceil(3 * camera.read_noise_e * camera.system_gain_dn_per_e)
    limit_dn = max(int(camera.clip_dn) - margin_dn, 1)
    return int(tones_8bit(camera, exposure.gain_db)[limit_dn])


def box_mover(exposure: Exposure) -> MoveBoxes | None:
    """Takes a scene's boxes (N, 4) to where they are in the picture at mid-exposure; None: they stay."""
    return _mover(exposure.move_boxes) if effects.displace() else None


def box_sweeper(exposure: Exposure) -> MoveBoxes:
    """Takes a scene's boxes (N, 4) to what they cover in the course of the exposure, beyond the picture too."""
    return _mover(exposure.sweep_boxes)


def _mover(boxes: Callable[[torch.Tensor], torch.Tensor]) -> MoveBoxes:
    return lambda boxes_xyxy: np.asarray(boxes(torch.from_numpy(boxes_xyxy)).numpy(), float)
