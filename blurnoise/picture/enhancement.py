"""Enhancement of developed pictures, as cameras deliver them: noise reduction, local tone mapping, sharpening.

Domain: numbers of 8 bits behind the tone curve, (H, W) grey or (H, W, 3) colours, red first; Y'CbCr is that of JPEG
(BT.601, full range). Cameras often reduce noise before demosaicing, where it is white; ours runs behind the tone
curve, where demosaicing has spread it over neighbours and the curve has made it alike at all levels. By OpenCV,
which has no derivatives; its bits depend neither on threads nor on the batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.threads import side_by_side
from blurnoise.camera.isp import LocalTone, NoiseReduction, Sharpening

Image = NDArray[np.uint8]


def by_image(picture: Tensor, work: Callable[[Image], Image]) -> Tensor:
    """``work`` on each image of (..., 3, H, W), colours, or else (..., H, W), grey: uint8, or floats in [0, 1].

    Floats are rounded to 8 bits before. Returns the same kind, channels last in memory.

    >>> by_image(torch.tensor([[[0.2, 0.4]]]), lambda image: 255 - image)
    tensor([[[0.8000, 0.6000]]])
    """
    codes = picture.detach()
    if codes.dtype != torch.uint8:
        codes = (codes * 255).round().clamp(0, 255).to(torch.uint8)
    numbers: Image = codes.cpu().numpy()
    planes = (3,) if numbers.shape[-3] == 3 else ()
    each = numbers.reshape(-1, *planes, *numbers.shape[-2:])
    out = np.empty((len(each), *numbers.shape[-2:], *planes), np.uint8)

    def one(index: int) -> None:
        image = each[index]
        if planes:
            last = image.transpose(1, 2, 0)
            image = last if last.flags.c_contiguous else cv2.merge(list(image))  # faster than NumPy's copy
        out[index] = work(image)

    side_by_side(one, range(len(each)), torch.get_num_threads())
    found = torch.from_numpy(out)
    found = (found.movedim(-1, 1) if planes else found).reshape(picture.shape).to(picture.device)
    return found if picture.dtype == torch.uint8 else found.to(picture.dtype) / 255


def denoised(image: Image, at: NoiseReduction) -> Image:
    """Noise reduction: OpenCV's bilateral filter on luma and on each chroma, mixed with the image by ``strength``.

    Each value becomes the mean of its window, weighted by exp(-d^2 / (2 sigma^2)) of difference d, and likewise of
    distance (Tomasi and Manduchi, ICCV 1998).

    >>> noisy = np.random.default_rng(1).normal(128, 5, (200, 200)).astype(np.uint8)
    >>> float(noisy.std() / denoised(noisy, NoiseReduction(luma_sigma_dn=3.2 * 5)).std()) > 2.8
    True
    """
    # In floats: OpenCV 5.0 cuts the means of 8 bits to whole numbers, half a DN too dark.
    exact = image.astype(np.float32)
    planes = [exact] if image.ndim == 2 else list(cv2.split(cv2.cvtColor(exact, cv2.COLOR_RGB2YCrCb)))
    for index, sigma_dn in enumerate(
        (at.luma_sigma_dn, at.chroma_sigma_dn, at.chroma_sigma_dn)[: len(planes)]
    ):
        if sigma_dn:  # of which OpenCV makes 1
            planes[index] = cv2.bilateralFilter(planes[index], 2 * at.reach_px + 1, sigma_dn, at.sigma_px)
    filtered = planes[0] if image.ndim == 2 else cv2.cvtColor(cv2.merge(planes), cv2.COLOR_YCrCb2RGB)
    mixed: Image = cv2.addWeighted(filtered, at.strength, exact, 1 - at.strength, 0, dtype=cv2.CV_8U)
    return mixed


@lru_cache(maxsize=256)
def steepest(at: NoiseReduction) -> float:
    """Bound on the slope of noise reduction, rounded up to tenths.

    Where a value between two groups of neighbours, u sigma^2 away in squares, moves to one of them, the slope is
    (1 + n u e^(-u/2)) / (1 + n e^(-u/2)); n: their weights by distance.

    >>> steepest(NoiseReduction()), steepest(NoiseReduction(sigma_px=3.0))
    (2.6, 4.1)
    """
    reach = at.reach_px
    squares = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) ** 2
    n = np.exp(-squares / (2 * at.sigma_px**2))[squares <= reach**2].sum() - 1
    u = np.linspace(0.0, 40.0, 4001)
    weight = n * np.exp(-u / 2)
    return math.ceil(10 * float(((1 + u * weight) / (1 + weight)).max())) / 10


def locally_toned(image: Image, at: LocalTone) -> Image:
    """Local tone mapping: OpenCV's CLAHE of luma; colours keep their chroma (Zuiderveld, Graphics Gems IV, 1994).

    >>> ramp = np.tile(np.arange(100, 164, dtype=np.uint8), (64, 1))
    >>> bool(np.ptp(locally_toned(ramp, LocalTone(clip_limit=4.0, tiles=1))) > 2 * np.ptp(ramp))
    True
    """
    clahe = cv2.createCLAHE(at.clip_limit, (at.tiles, at.tiles))
    if image.ndim == 2:
        grey: Image = clahe.apply(image)
        return grey
    luma, *chroma = cv2.split(cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb))
    toned: Image = cv2.cvtColor(cv2.merge([clahe.apply(luma), *chroma]), cv2.COLOR_YCrCb2RGB)
    return toned


def sharpened(image: Image, at: Sharpening) -> Image:
    """Unsharp masking: to each colour, the detail D of luma Y beyond a threshold t is added, up to a limit.

    D = Y - G * Y by a Gaussian G; added is strength sign(D) max(|D| - t, 0), between -limit and limit.

    >>> step = np.repeat(np.uint8([[100] * 8 + [150] * 8]), 9, axis=0)
    >>> sharpened(step, Sharpening(strength=1.0, limit_dn=10.0))[4, 6:10].tolist()
    [97, 90, 160, 153]
    """
    luma = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    exact = luma.astype(np.float32)
    detail = exact - cv2.GaussianBlur(exact, (0, 0), at.sigma_px)
    if at.threshold_dn:
        detail -= np.clip(detail, -at.threshold_dn, at.threshold_dn)
    change = np.clip(detail * np.float32(at.strength), -at.limit_dn, at.limit_dn).round().astype(np.int16)
    every = change if image.ndim == 2 else cv2.merge([change] * 3)
    result: Image = cv2.add(image, every, dtype=cv2.CV_8U)
    return result
