"""Steadiness of a bracket: how far each picture is displaced, by comparing the light of neighbours in exposure.

Domain: luma (H, W) of 8 bits; displacements in px, right and down. Both pictures of a pair are turned into the
logarithm of light and compared, by the enhanced correlation coefficient, where neither clips: Evangelidis and
Psarakis, Parametric Image Alignment Using Enhanced Correlation Coefficient Maximization, IEEE PAMI 30, 2008.
Phase correlation (:mod:`.bracket`), which finds larger moves, takes the equal steps of a grey scale for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.response import ToneResponse

MOST_PX = 2.0
"""Displacement in px above which a picture has moved; on a tripod, pictures 1600 px wide were found within 1.6 px."""
_WIDTH = 480  # px to which pictures are reduced
_DARKEST = 8  # below, rounding hides edges
_LEAST = 0.03  # share of the pixels that a comparison needs


def displacements_px(pictures: Sequence[NDArray[np.uint8]], response: ToneResponse) -> Floats:
    """Displacement (J, 2) of pictures (H, W[, 3]), exposures in rising order, from where most of them are.

    Pairs that have too little in common, or no edges, count as still.

    >>> from blurnoise_eval.calibration.response import fit_response
    >>> edges = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, (90, 120)), (0, 0), 3)
    >>> one = np.clip(20 * (edges - 121), 20, 120).astype(np.uint8)
    >>> pictures = [one, one * 1.4, np.roll(one, 3, 1) * 2.0]
    >>> pictures = [picture.astype(np.uint8) for picture in pictures]
    >>> response = fit_response(np.stack([picture.ravel() for picture in pictures[:2]]), np.log([1.0, 2.0]))
    >>> displacements_px(pictures, response).round().astype(int).tolist()
    [[0, 0], [0, 0], [3, 0]]
    """
    scale = max(1.0, pictures[0].shape[1] / _WIDTH)
    small = [_small(picture, scale) for picture in pictures]
    steps = [_step(*pair, response) for pair in pairwise(small)]
    moved = np.cumsum([(0.0, 0.0), *steps], axis=0) * scale
    places: Floats = moved - np.median(moved, axis=0)
    return places


def _small(picture: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    luma = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    size = (round(luma.shape[1] / scale), round(luma.shape[0] / scale))
    reduced: NDArray[np.uint8] = cv2.resize(luma, size, interpolation=cv2.INTER_AREA)
    return reduced


def _step(one: NDArray[np.uint8], other: NDArray[np.uint8], response: ToneResponse) -> tuple[float, float]:
    """Displacement of the other picture relative to the one."""
    seen = [(picture >= _DARKEST) & (picture <= response.top) for picture in (one, other)]
    both = (seen[0] & seen[1]).astype(np.uint8)
    if both.mean() < _LEAST:
        return 0.0, 0.0
    light = [response.logs.astype(np.float32)[np.clip(each, _DARKEST, response.top)] for each in (one, other)]
    light = [each - each[both > 0].mean() for each in light]
    warp = np.eye(2, 3, dtype=np.float32)
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
    try:
        _, warp = cv2.findTransformECC(light[0], light[1], warp, cv2.MOTION_TRANSLATION, until, both, 5)
    except cv2.error:  # nothing that correlates
        return 0.0, 0.0
    return float(warp[0, 2]), float(warp[1, 2])
