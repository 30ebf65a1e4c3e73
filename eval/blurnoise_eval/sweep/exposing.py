"""A picture under many conditions: what :func:`blurnoise.simulate` gives for each, computed with what they share.

Domain: pictures in as (H, W, 3) RGB, 8 or 16 bit, sRGB-coded; out as the camera's 8-bit picture.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Hashable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise.camera import Camera
from blurnoise.exposure import Exposure
from blurnoise.plan import plan as needs_of
from blurnoise.sensor import readout as sensor
from blurnoise.simulate import frame_pattern, lens_and_motion, scene_reflectance
from blurnoise_eval.datasets import Image, eight_bit
from blurnoise_eval.grid.conditions import Cell


class Frame(NamedTuple):
    """What the camera delivers for a cell, (H, W, 3) uint8 RGB, and the ms that took."""

    cell: Cell
    image: NDArray[np.uint8]
    simulate_ms: float


class Scene:
    """A picture as light: what all its conditions share. Any number of threads may use it.

    ``image8``: the picture itself with 8 bits. ``sharp``: its reflectance, (1, 3, H, W).
    """

    def __init__(self, image: Image) -> None:
        self.image8 = eight_bit(image)
        self.sharp = _reflectance(image).contiguous()
        self._fields: OrderedDict[tuple[int, str], Tensor] = OrderedDict()
        self._lock = threading.Lock()

    def normal(self, seed: int, stream: str = "frame") -> Tensor:
        """The N(0, 1) field of a seed and stream of ``rng``, (1, 3, H, W); the last two are kept."""
        with self._lock:
            if (seed, stream) not in self._fields:
                self._fields[seed, stream] = rng.standard_normal([seed], self.sharp, stream)
                while len(self._fields) > 2:
                    self._fields.popitem(last=False)
            return self._fields[seed, stream]


class _Shared(NamedTuple):
    """What exposures must have in common to be read out together."""

    camera: Camera
    noisy: bool
    motion_px: tuple[float, float]
    gain_db: float
    seed: int


def frames(scene: Scene, cells: Sequence[Cell], camera: Camera) -> Iterator[Frame]:
    """The picture of each cell. The lines below are ``simulate``, what neighbours have in common done once.

    A cell without conditions is the picture as it is.
    """
    on_sensor: dict[Hashable, Tensor] = {}  # by lens and motion
    needed = [(cell, _needed(cell, camera)) for cell in cells]
    for shared, group in groupby(needed, key=lambda pair: pair[1] and pair[1][0]):
        alike, exposures = [], []
        for cell, found in group:
            alike.append(cell)
            exposures += [found[1]] if found else []
        if shared is None:
            yield from (Frame(cell, scene.image8, 0.0) for cell in alike)
            continue
        started = time.perf_counter()
        through = (shared.camera.optics, shared.camera.defocus_radius_px, shared.motion_px)
        if through not in on_sensor:
            on_sensor[through] = lens_and_motion(scene.sharp, shared.camera, shared.motion_px)
        count, (_, colours, height, width) = len(exposures), scene.sharp.shape
        seen = torch.empty((count, height, width, colours), dtype=torch.uint8)
        own_read_noise = 0 < shared.camera.read_noise_e < sensor.MERGE_READ_NOISE_E
        sensor.read_out(
            on_sensor[through].expand(count, -1, -1, -1),
            shared.camera,
            white_e=[_white_e(at) for at in exposures],
            exposure_s=[at.exposure_s for at in exposures],
            temperature_c=[at.temperature_c for at in exposures],
            generator=[shared.seed] * count,
            fixed_pattern=frame_pattern(shared.camera, scene.sharp, 0),
            noise=shared.noisy,
            normal=scene.normal(shared.seed).expand(count, -1, -1, -1),
            read=scene.normal(shared.seed, "read").expand(count, -1, -1, -1) if own_read_noise else None,
            tones=sensor.tones_8bit(exposures[0].camera, shared.gain_db),
            out=seen.permute(0, 3, 1, 2),
        )
        simulate_ms = 1e3 * (time.perf_counter() - started) / count
        for cell, image in zip(alike, seen.numpy(), strict=True):
            yield Frame(cell, image, simulate_ms)


def _white_e(at: Exposure) -> float:
    """Electrons of white, as float32 and in this order, as simulate computes it."""
    per_lux_s = np.float32(sensor.electrons_per_lux_s(at.camera))
    return float(np.float32(at.illuminance_lux) * np.float32(at.exposure_s) * per_lux_s)


def _needed(cell: Cell, camera: Camera) -> tuple[_Shared, Exposure] | None:
    if cell.conditions is None:
        return None
    at = cell.conditions.exposure(camera, cell.seed)
    displacement = cell.conditions.displacement_px
    needs = needs_of(
        at.camera,
        exposure_s=float(np.float32(at.exposure_s)),
        illuminance_lux=float(np.float32(at.illuminance_lux)),
        displacement_px=displacement,
        temperature_c=float(np.float32(at.temperature_c)),
    )
    motion_px = displacement if needs.moves else (0.0, 0.0)
    return _Shared(needs.camera, needs.noisy, motion_px, at.gain_db, cell.seed), at


def _reflectance(image: Image) -> Tensor:
    """``scene_reflectance`` of a picture (H, W, 3), (1, 3, H, W): looked up, since its codes are integers."""
    codes = torch.arange(np.iinfo(image.dtype).max + 1, dtype=torch.float32) / float(
        np.iinfo(image.dtype).max
    )
    table = scene_reflectance(codes[None, None, None], "srgb").flatten()
    planes = [torch.from_numpy(plane.astype(np.int32)).flatten() for plane in cv2.split(image)]
    looked_up = torch.stack([table.index_select(0, plane) for plane in planes])
    return looked_up.view(1, 3, *image.shape[:2])
