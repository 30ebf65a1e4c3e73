"""Scenes of the benches, and the truth of how they move: means of many moments of a picture rendered finer.

Domain: linear light in [0, 1], float32 (H, W, C), C = 3. Convention: px, x right, y down, s from mid-exposure.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.optics.colour import linear_from_srgb

Picture = NDArray[np.float32]
Where = Callable[[Picture, Picture, Picture], tuple[Picture, Picture]]
"""Where what pixels x, y show at a time was at mid-exposure."""
FINE = 4
"""Samples to a pixel's side of the truth's pictures."""
_LENS_PX = 0.6  # sigma of a Gaussian: with the pixel's own area 0.24 of 0.4 cycles/px is left
_TEXT = "Speed limit 50 km/h, keep RIGHT & yield. " * 8


@lru_cache(maxsize=2)
def leaves(height: int, width: int, seed: int = 0) -> Picture:
    """Dead leaves with text on them, ``FINE`` times finer than (H, W); not to be written to.

    Discs that cover one another, their radii of density r^-3, have the spectrum and the edges of photographs (Lee,
    Mumford and Huang, Int. J. Computer Vision 41, 2001).
    """
    drawn = np.random.default_rng(seed)
    sheet = np.full((height * FINE, width * FINE, 3), 90, np.uint8)
    least, largest = 1.5 * FINE, height * FINE / 4
    count = round(9 * sheet[..., 0].size / (2 * np.pi * np.log(largest / least) / (least**-2 - largest**-2)))
    radii = (least**-2 - drawn.random(count) * (least**-2 - largest**-2)) ** -0.5
    x, y = drawn.random((2, count)) * np.array([[sheet.shape[1]], [sheet.shape[0]]])
    colours = np.clip(drawn.uniform(10, 235, (count, 1)) + drawn.uniform(-20, 20, (count, 3)), 0, 255)
    for radius, left, top, colour in zip(radii, x, y, colours, strict=True):
        cv2.circle(sheet, (round(left), round(top)), round(radius), colour.tolist(), -1)
    for line in range(16):
        capital = (10, 14, 20, 28)[line % 4] * FINE
        place = -10 * FINE * line, round(sheet.shape[0] * (line + 0.8) / 16)
        ink = (15, 15, 15) if line % 2 else (240, 240, 240)
        cv2.putText(sheet, _TEXT, place, cv2.FONT_HERSHEY_SIMPLEX, capital / 21, ink, round(capital / 8))
    fine = linear_from_srgb(torch.arange(256) / 255).numpy()[sheet]
    blurred = cv2.GaussianBlur(fine, (0, 0), _LENS_PX * FINE, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(blurred, np.float32)


def pixels(fine: Picture) -> Picture:
    """The mean of each ``FINE`` x ``FINE`` samples."""
    height, width = (side // FINE for side in fine.shape[:2])
    return np.asarray(fine.reshape(height, FINE, width, FINE, -1).mean((1, 3)))


def truth(fine: Picture, where: Where, times_s: Picture) -> Picture:
    """The mean of moments of what pixels see, (H, W, C): ``FINE`` times finer than they, averaged over their area.

    times_s: (n, H, 1), for every row its own moments. What lies beyond the picture is reflected.
    """
    averaged = cv2.blur(fine, (FINE, FINE))  # sample i is the mean about i - 1/2
    x, y = places(fine.shape[0] // FINE, fine.shape[1] // FINE)
    total = np.zeros((*x.shape, fine.shape[2]))
    for times in times_s:
        across, down = where(x, y, times)
        total += remapped(averaged, FINE * (across + 0.5), FINE * (down + 0.5), cv2.INTER_CUBIC)
    return np.asarray(total / len(times_s), np.float32)


def places(height: int, width: int) -> tuple[Picture, Picture]:
    """x and y of all pixels, (H, W) each."""
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return x, y


def remapped(picture: Picture, x: Picture, y: Picture, how: int = cv2.INTER_LINEAR) -> Picture:
    """What a picture shows at x, y."""
    x, y = (np.ascontiguousarray(along, np.float32) for along in np.broadcast_arrays(x, y))
    return np.asarray(cv2.remap(picture, x, y, how, borderMode=cv2.BORDER_REFLECT_101), np.float32)
