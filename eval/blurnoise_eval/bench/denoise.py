"""The bench of noise reduction: ways to apply one bilateral filter to luma and chroma of a picture of 8 bits.

Errors are DN RMS of the truth, the filter's formula in double precision. Its result is rounded to 8 bits by all ways
but the truth, which alone is 0.29 DN. Pictures (H, W, 3), red first.
"""

from __future__ import annotations

from typing import Any

import cv2
import kornia
import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.camera.isp import NoiseReduction
from blurnoise.picture.enhancement import denoised
from blurnoise_eval.bench.contest import Case, Contender, Contest

SIZE = 640
SIGMA_DN = 20.0
NOISE_DN = 6.0
WINDOW_PX, WINDOW_SIGMA_PX = 2 * NoiseReduction().reach_px + 1, NoiseReduction().sigma_px
Picture = NDArray[Any]


def denoise(*, quick: bool) -> Contest:
    """Noise reduction of a noisy picture in colour."""
    side = SIZE // 4 if quick else SIZE
    return Contest(
        "denoise", "Noise reduction of luma and chroma", [lambda: noisy(side)], error_unit="DN RMS"
    )


def noisy(side: int) -> Case:
    """Patches of random colours with noise."""
    draws = np.random.default_rng(1)
    patches = cv2.resize(
        draws.integers(0, 256, (12, 12, 3), np.uint8), (side, side), interpolation=cv2.INTER_AREA
    )
    picture = (patches + draws.normal(0, NOISE_DN, patches.shape)).round().clip(0, 255).astype(np.uint8)
    planes = cv2.split(cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_RGB2YCrCb))
    expected = _joined([truth(plane.astype(float), SIGMA_DN) for plane in planes]).clip(0, 255)
    sigmas = NoiseReduction(luma_sigma_dn=SIGMA_DN, chroma_sigma_dn=SIGMA_DN)
    ways = [
        Contender("blurnoise", lambda: denoised(picture, sigmas), True),
        Contender("cv2.bilateralFilter, floats", lambda: _by_opencv(picture.astype(np.float32))),
        Contender("cv2.bilateralFilter, 8 bits", lambda: _by_opencv(picture)),
        Contender("Kornia, bilateral_blur", lambda: _by_kornia(picture)),
    ]

    def off_dn(seen: Picture) -> float:
        rounded = np.rint(seen.astype(float)).clip(0, 255)
        return float(np.sqrt(np.mean((rounded - expected) ** 2)))

    return Case(f"{side}x{side} px", ways, off_dn)


def truth(plane: Picture, sigma_dn: float) -> Picture:
    """The bilateral filter by its formula: pixels within 2, their weights by distance and by difference."""
    reach, (height, width) = WINDOW_PX // 2, plane.shape
    wide, total, weights = np.pad(plane, reach, mode="reflect"), np.zeros_like(plane), np.zeros_like(plane)
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            if x * x + y * y <= reach * reach:
                there = wide[reach + y :, reach + x :][:height, :width]
                distance2 = (x * x + y * y) / WINDOW_SIGMA_PX**2 + ((there - plane) / sigma_dn) ** 2
                total += np.exp(-distance2 / 2) * there
                weights += np.exp(-distance2 / 2)
    return np.asarray(total / weights)


def _by_opencv(picture: Picture) -> Picture:
    planes = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2YCrCb))
    filtered = [cv2.bilateralFilter(plane, WINDOW_PX, SIGMA_DN, WINDOW_SIGMA_PX) for plane in planes]
    return np.asarray(cv2.cvtColor(cv2.merge(filtered), cv2.COLOR_YCrCb2RGB))


def _by_kornia(picture: Picture) -> Picture:
    planes = cv2.split(cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_RGB2YCrCb))
    given = torch.from_numpy(np.stack(planes))[:, None]
    sigmas = (WINDOW_SIGMA_PX, WINDOW_SIGMA_PX)
    found = kornia.filters.bilateral_blur(given, (WINDOW_PX, WINDOW_PX), SIGMA_DN, sigmas)
    return _joined(list(found[:, 0].numpy()))


def _joined(planes: list[Picture]) -> Picture:
    merged = cv2.merge([plane.astype(np.float32) for plane in planes])
    return np.asarray(cv2.cvtColor(merged, cv2.COLOR_YCrCb2RGB))
