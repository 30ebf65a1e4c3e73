"""Text regions from a map of probabilities: differentiable binarisation (DB).

Domain: (H, W) float32 in [0, 1]. Convention: x right, y down, edges at integers; a region's corners are those
of a turned rectangle, from the upper left one clockwise as displayed.
Source: Liao et al. (2020), thresholds and offset as in PP-OCR. There the outline is rounded to whole px before and
after it is moved outwards; here it is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.ocr.contract import RegionContract
from blurnoise_eval.detectors.records import FloatArray

_LEAST_SIDE_PX = 3  # of the map
_MOST_REGIONS = 1000
_UPRIGHT = 1.5  # height / width from which a region holds a line that runs downwards


@dataclass(frozen=True, eq=False)
class Region:
    """A turned rectangle, (4, 2) px of the map or the picture, and the mean probability in it."""

    corners: FloatArray
    score: float


def find_regions(probabilities: FloatArray, contract: RegionContract) -> list[Region]:
    """Return the regions of a map (H, W), best first, in its px; at most a thousand. NaN is no text."""
    text = (probabilities > contract.threshold).astype(np.uint8)
    contours, _ = cv2.findContours(text, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    found = []
    for contour in contours:
        centre, (width, height), angle_deg = cv2.minAreaRect(contour)
        if min(width, height) < _LEAST_SIDE_PX:
            continue
        score = _mean_inside(probabilities, cv2.boxPoints((centre, (width, height), angle_deg)))
        if score < contract.box_threshold:
            continue
        # A rectangle whose outline moves outwards by d, rounded at its corners, fits one larger by 2d. The
        # sides are those through the outermost pixels' centres, which the ratio is made for.
        grown = contract.unclip * width * height / (width + height)
        middle = (centre[0] + 0.5, centre[1] + 0.5)
        turned = (middle, (width + grown, height + grown), angle_deg)
        found.append(Region(_ordered(cv2.boxPoints(turned)), score))
    return sorted(found, key=lambda region: -region.score)[:_MOST_REGIONS]


def straighten(image: NDArray[np.uint8], corners: FloatArray) -> NDArray[np.uint8]:
    """Return the part of a picture (h, w, 3) that a region covers, turned upright.

    A region at least 1.5 times as high as wide is taken for a line that runs downwards, and laid on its side,
    as in PP-OCR; one that runs upwards comes out upside down. Outside the picture its border repeats.
    """
    upper_left, upper_right, _, lower_left = corners
    width = max(1, round(float(np.linalg.norm(upper_right - upper_left))))
    height = max(1, round(float(np.linalg.norm(lower_left - upper_left))))
    half = np.float32(0.5)  # OpenCV has pixel centres at integers
    upright = np.array([[0, 0], [width, 0], [0, height]], np.float32) - half
    turned = np.stack([upper_left, upper_right, lower_left]).astype(np.float32) - half
    crop = cv2.warpAffine(
        image,
        cv2.getAffineTransform(turned, upright),
        (width, height),
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.rot90(crop) if height >= _UPRIGHT * width else crop


def _mean_inside(probabilities: FloatArray, corners: FloatArray) -> float:
    """Mean over the pixels of a rectangle whose corners (4, 2) count pixel centres as integers."""
    limit = np.array(probabilities.shape[::-1]) - 1
    left, top = np.clip(np.floor(corners.min(axis=0)), 0, limit).astype(int)
    right, bottom = np.clip(np.ceil(corners.max(axis=0)), 0, limit).astype(int)
    inside = np.zeros((bottom - top + 1, right - left + 1), np.uint8)
    cv2.fillPoly(inside, [np.round(corners - (left, top)).astype(np.int32)], 1)
    window = probabilities[top : bottom + 1, left : right + 1]
    return float(cv2.mean(window, inside)[0])


def _ordered(corners: FloatArray) -> FloatArray:
    """Return four corners from the upper left one clockwise: of the two leftmost, the upper one is the first."""
    by_x = corners[np.argsort(corners[:, 0], kind="stable")]
    (upper_left, lower_left), (upper_right, lower_right) = (
        pair[np.argsort(pair[:, 1], kind="stable")] for pair in (by_x[:2], by_x[2:])
    )
    return np.stack([upper_left, upper_right, lower_right, lower_left])
