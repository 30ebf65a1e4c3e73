"""Scenes of the bench of moving things: rendered, finer than their pixels, through a lens.

Domain: linear light in [0, 1], float64 (C, H, W), three channels. No photographs: dead leaves, discs that cover one
another with radii of density r^-3, have the spectrum and the edges of such (Lee, Mumford & Huang, Int. J. Computer
Vision 41, 2001), and lines of text over them have the finest detail that is read.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise import charts
from blurnoise.optics.colour import linear_from_srgb
from blurnoise_eval.bench.motion_truth import Floats

_FINE = 4  # samples to a pixel's side
_LENS_PX = 0.6  # sigma of a Gaussian: with the pixel's own area 0.24 of 0.4 cycles/px is left
_LEAST_PX, _LARGEST = 1.5, 0.25  # radii: px, and of the picture's height
_LAYERS = 9.0  # the discs' areas by the picture's
_MARGIN_PX = 6  # of a sign
_TEXT = "Speed limit 50 km/h, keep RIGHT & yield. " * 8


@lru_cache(maxsize=1)
def leaves(height: int, width: int, seed: int = 0) -> Floats:
    """Dead leaves with text on them, their levels even in sRGB; not to be written to."""
    drawn = np.random.default_rng(seed)
    sheet = np.full((height * _FINE, width * _FINE, 3), 90, np.uint8)
    least, largest = _LEAST_PX * _FINE, _LARGEST * height * _FINE
    mean_area = 2 * np.pi * np.log(largest / least) / (least**-2 - largest**-2)
    count = round(_LAYERS * sheet[..., 0].size / mean_area)
    share = drawn.random(count)
    radii = (least**-2 - share * (least**-2 - largest**-2)) ** -0.5
    x, y = drawn.random((2, count)) * np.array([[sheet.shape[1]], [sheet.shape[0]]])
    grey, tint = drawn.uniform(10, 235, (count, 1)), drawn.uniform(-20, 20, (count, 3))
    for radius, left, top, colour in zip(radii, x, y, np.clip(grey + tint, 0, 255), strict=True):
        cv2.circle(sheet, (round(left), round(top)), round(radius), colour.tolist(), -1)
    for line, capital in enumerate((10, 14, 20, 28)):
        scale = capital * _FINE / 21.0  # Hershey capitals are 21 units high
        for row in range(4):
            place = (-round(40 * _FINE * row), round(sheet.shape[0] * (4 * row + line + 0.8) / 16))
            ink = (15, 15, 15) if row % 2 else (240, 240, 240)
            cv2.putText(sheet, _TEXT, place, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, round(capital * _FINE / 8))
    light = linear_from_srgb(torch.arange(256, dtype=torch.float64) / 255).numpy().astype(np.float32)
    return _seen(light[sheet])


def sign(size_px: int) -> tuple[Floats, Floats]:
    """A stop sign: its light (C, h, w), its own wherever it covers, and matte (h, w), with a margin for the lens."""
    side = size_px + 2 * _MARGIN_PX
    on_black, on_white = (
        _seen(_pixels(size_px * _FINE, side * _FINE, level).astype(np.float64)) for level in (0.0, 1.0)
    )
    alpha = (1 - (on_white - on_black).mean(0)).clip(0, 1)
    return np.where(alpha > 1e-6, on_black / np.maximum(alpha, 1e-6), 0.0).clip(0, 1), alpha


def _pixels(size: int, side: int, background: float) -> Floats:
    drawn = charts.stop_sign(size, height_px=side, width_px=side, background=background, supersample=2)
    return np.ascontiguousarray(drawn[0].permute(1, 2, 0).numpy())


def _seen(fine: NDArray[Any]) -> Floats:
    """Through the lens, on pixels: (H _FINE, W _FINE, C) -> (C, H, W)."""
    blurred = cv2.GaussianBlur(fine, (0, 0), _LENS_PX * _FINE, borderType=cv2.BORDER_REFLECT_101)
    height, width = (side // _FINE for side in fine.shape[:2])
    return np.moveaxis(
        blurred.reshape(height, _FINE, width, _FINE, -1).mean(axis=(1, 3), dtype=np.float64), -1, 0
    )
