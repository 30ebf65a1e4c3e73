"""A picture's frames under the conditions of a sweep's cells.

Domain: pictures in as (H, W, 3) RGB, 8 or 16 bit, sRGB-coded; out as the camera's 8-bit picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.auto_exposure import USUAL, AutoExposure, mean_luma
from blurnoise.camera import Camera
from blurnoise.exposure import ExposedScene, Exposure
from blurnoise.light import effects
from blurnoise.picture.develop import tones_8bit
from blurnoise.radiometry import dark_electrons, photoelectrons
from blurnoise.stated_trajectory import StatedTrajectory
from blurnoise_eval.datasets import Image, UnreadablePicture, eight_bit
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.scoring.matching import MoveBoxes


class Frame(NamedTuple):
    """What the camera delivers for a cell, (H, W, 3) uint8 RGB, the ms it took, how it was taken, where that moves
    boxes and what they sweep.

    saturated: the share of its values at a limit of well, converter or picture. snr_db: of a pixel with the
    picture's mean light. brightness: its mean value, 0-1. None of the untouched picture.
    """

    cell: Cell
    image: NDArray[np.uint8]
    simulate_ms: float
    exposure: Exposure | None = None
    move_boxes: MoveBoxes | None = None
    sweep_boxes: MoveBoxes | None = None
    saturated: float | None = None
    snr_db: float | None = None
    brightness: float | None = None


class Scene:
    """A picture as light: what all its conditions share. ``image8``: the picture itself with 8 bits.

    grey_anchor: what of it is 18 % reflectance (:mod:`blurnoise.grey_anchor`). Raises ``UnreadablePicture`` where the
    picture has no such place, or no light there.
    """

    def __init__(self, image: Image, grey_anchor: str | None = None) -> None:
        self.image8 = eight_bit(image)
        self._means: dict[Camera, float] = {}
        try:
            self.light = ExposedScene.of_picture(image, grey_anchor)
        except ValueError as error:
            if grey_anchor is None:
                raise
            raise UnreadablePicture(str(error)) from None

    def mean_light(self, camera: Camera) -> float:
        """As the camera meters it: by luma, or by what its pixels make of the colours."""
        if camera not in self._means:
            self._means[camera] = float(mean_luma(self.light.light, camera)[0])
        return self._means[camera]


def frames(
    scene: Scene,
    cells: Sequence[Cell],
    camera: Camera,
    auto_exposure: AutoExposure = USUAL,
    path: tuple[StatedTrajectory, float] | None = None,
) -> Iterator[Frame]:
    """The picture of each cell; a cell without conditions is the picture as it is, and stands first.

    auto_exposure: what sets the gain where a cell leaves it to the camera, by the scene's mean light. path: what the
    picture does beside its velocity, and the longest exposure along it; a shake is that of the cell's seed.
    """
    yield from (Frame(cell, scene.image8, 0.0) for cell in cells if cell.conditions is None)
    exposed = [(cell, cell.conditions) for cell in cells if cell.conditions is not None]
    exposures = []
    for cell, at in exposed:
        exposure = _set(at, cell.seed, scene.mean_light(camera), camera, auto_exposure)
        if path is not None:
            stated, longest_s = path
            size = (scene.image8.shape[0], scene.image8.shape[1])
            exposure = replace(exposure, trajectory=stated.of(camera, size, longest_s, cell.seed))
        exposures.append(exposure)
    taken = zip(exposed, exposures, scene.light.frames(exposures), strict=True)
    for (cell, _), exposure, frame in taken:
        yield Frame(
            cell,
            frame.picture,
            frame.simulate_ms,
            exposure,
            box_mover(exposure),
            box_sweeper(exposure),
            saturated=np.count_nonzero(frame.picture >= brightest(exposure)) / frame.picture.size,
            snr_db=snr_db(exposure, scene.mean_light(camera)),
            brightness=cv2.mean(frame.picture.reshape(-1))[0] / 255,
        )


def _set(
    at: Conditions, seed: int, mean_light: float, camera: Camera, auto_exposure: AutoExposure
) -> Exposure:
    """How a picture of ``mean_light`` is taken: as stated, and as the camera sets what is left to it."""
    exposure = at.exposure(camera, seed)
    if not at.automatic:
        return exposure
    if "exposure_s" in at.automatic:
        setting = auto_exposure.setting(
            exposure.camera,
            mean_light=mean_light,
            illuminance_lux=exposure.illuminance_lux,
            temperature_c=exposure.temperature_c,
        )
        return replace(exposure, exposure_s=setting.exposure_s, gain_db=setting.gain_db)
    gain_db = auto_exposure.gain_db(
        exposure.camera,
        mean_light=mean_light,
        illuminance_lux=exposure.illuminance_lux,
        exposure_s=exposure.exposure_s,
        temperature_c=exposure.temperature_c,
    )
    return replace(exposure, gain_db=gain_db)


def brightest(exposure: Exposure) -> int:
    """The 8-bit value from which on a pixel counts as saturated, see :attr:`blurnoise.Camera.saturated_dn`."""
    camera, digital_db = exposure.amplified
    return int(tones_8bit(camera, digital_db)[int(camera.saturated_dn)])


def snr_db(exposure: Exposure, light: float) -> float | None:
    """Temporal signal to noise of a pixel with so much light, EMVA 1288: signal by the noise of signal, dark charge,
    read-out and rounding, 20 log10; None without light. Of a pixel below saturation."""
    camera = exposure.amplified.camera
    signal_e = light * photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s)
    dark_e = dark_electrons(camera, exposure.exposure_s, exposure.temperature_c)
    noise_e = math.sqrt(signal_e + camera.dark_variance_dn2(dark_e) / camera.system_gain_dn_per_e**2)
    return 20 * math.log10(signal_e / noise_e) if signal_e > 0 else None


def box_mover(exposure: Exposure) -> MoveBoxes | None:
    """Takes a scene's boxes (N, 4) to where they are in the picture at mid-exposure; None: they stay."""
    return _mover(exposure.move_boxes) if effects.displace(exposure.camera) else None


def box_sweeper(exposure: Exposure) -> MoveBoxes:
    """Takes a scene's boxes (N, 4) to what they cover in the course of the exposure, beyond the picture too."""
    return _mover(exposure.sweep_boxes)


def _mover(boxes_in: Callable[[torch.Tensor, tuple[int, int] | None], torch.Tensor]) -> MoveBoxes:
    def move(boxes_xyxy: NDArray[np.float64], sizes_px: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = np.empty_like(boxes_xyxy)
        for width, height in np.unique(sizes_px, axis=0):
            alike = (np.array_equal(each, (width, height), equal_nan=True) for each in sizes_px)
            of = np.fromiter(alike, bool, len(sizes_px))
            size = None if np.isnan(width) else (int(height), int(width))
            moved[of] = boxes_in(torch.from_numpy(boxes_xyxy[of]), size).numpy()
        return moved

    return move
