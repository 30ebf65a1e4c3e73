"""Detection and recognition: finds the lines of text in a picture, and reads them.

Regions come from a map of probabilities (H, W), float32 in [0, 1], by differentiable binarisation (DB): Liao et al.
(2020), thresholds and offset as in PP-OCR. There the outline is rounded to whole px before and after it is moved
outwards; here it is not. Convention: x right, y down, edges at integers; a region's corners (4, 2) are those of a
turned rectangle, from the upper left one clockwise as displayed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.contract_files import Given, stated_contract
from blurnoise_eval.detectors.formats.boxes import lay_in, picture_size
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.ocr.recogniser import (
    REGION_PRESETS,
    Reading,
    Recogniser,
    RegionContract,
    SpottingContract,
    TextNetwork,
    joined,
)
from blurnoise_eval.detectors.records import FloatArray
from blurnoise_eval.system.urls import Location

_STRIDE_PX = 32  # the network halves the picture five times
_LEAST_SIDE_PX = 3  # of the map
_MOST_REGIONS = 1000
_UPRIGHT = 1.5  # height / width from which a region holds a line that runs downwards


class TextSpotter(TextNetwork):
    """An ONNX text detector (DB) before a recogniser. Threads and errors: see :class:`OnnxModel`.

    ``contract``: a :class:`RegionContract`, a mapping, a contract file or "db", for the detector; None looks
    beside it and into its metadata, then assumes PP-OCR's. Raises :class:`ModelError` for a file that is no such
    detector or a contract that does not fit it. ``name`` and ``sha256`` are those of both.
    """

    contract: SpottingContract

    def __init__(
        self,
        detection_path: str | Location,
        recogniser: Recogniser,
        *,
        contract: RegionContract | Given | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        super().__init__(detection_path, timeout_s)
        again = partial(TextSpotter, self.source, recogniser, contract=contract, timeout_s=timeout_s)
        self._opened_again = again
        self.recogniser = recogniser
        self.name = f"{self.path.stem}+{recogniser.name}"
        self.sha256 = hashlib.sha256((self.sha256 + recogniser.sha256).encode()).hexdigest()
        regions = stated_contract(REGION_PRESETS, self.path, self.metadata, contract)
        self.contract = SpottingContract(regions or RegionContract.assumed("preset db"), recogniser.contract)
        height, width = (side or _STRIDE_PX for side in self.fixed_size_px)
        self._probabilities(np.zeros((1, 3, height, width), np.float32))  # a graph of another form fails here

    @property
    def non_finite_values_here(self) -> int:
        """NaN and infinite output values of both networks that the calling thread has seen so far."""
        return super().non_finite_values_here + self.recogniser.non_finite_values_here

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        super().interrupt()
        self.recogniser.interrupt()

    def read(
        self, image: NDArray[np.uint8], boxes_xyxy: ArrayLike | Sequence[Sequence[float]]
    ) -> list[Reading]:
        """Return the text in each box (left, top, right, bottom), px, of an RGB picture (h, w, 3), uint8.

        A box has all the lines whose centre lies in it, joined by spaces in reading order. By centres and not by
        overlap, since a box may be drawn around a word, a line or a whole sign, and a detector may break a word in
        two.
        """
        regions = self._regions(image)
        centres = np.array([corners.mean(axis=0) for corners in regions]).reshape(-1, 2)
        read: dict[int, Reading] = {}
        readings = []
        for x0, y0, x1, y1 in np.asarray(boxes_xyxy, np.float64).reshape(-1, 4):
            inside = (centres >= (x0, y0)).all(axis=1) & (centres < (x1, y1)).all(axis=1)
            order = in_reading_order(regions, np.flatnonzero(inside).tolist())
            for index in order:
                if index not in read:
                    read[index] = self.recogniser.read_crop(straighten(image, regions[index]))
            readings.append(joined([read[index] for index in order]))
        return readings

    def input_size_px(self, height_px: int, width_px: int) -> tuple[int, int]:
        """Return the size (height, width) at which a picture enters the detector: multiples of 32."""
        contract = self.contract.regions
        scale = max(1.0, contract.min_side_px / min(height_px, width_px))
        scale = min(scale, contract.max_side_px / max(height_px, width_px)) / _STRIDE_PX
        height, width = (max(1, round(side * scale)) * _STRIDE_PX for side in (height_px, width_px))
        return self.fixed_size_px[0] or height, self.fixed_size_px[1] or width

    def _regions(self, image: NDArray[np.uint8]) -> list[FloatArray]:
        """Corners of each region in px of the picture, best first."""
        height, width = picture_size(image)
        blob, _ = lay_in(image, self.contract.regions.stretched(), self.input_size_px(height, width))
        probabilities = self._probabilities(blob)
        scale = np.array([width, height], np.float32) / probabilities.shape[::-1]
        regions = find_regions(probabilities, self.contract.regions)
        return [(corners * scale).astype(np.float32) for corners in regions]

    def _probabilities(self, blob: FloatArray) -> FloatArray:
        """The network's map (h, w) for its input (1, 3, H, W); values that are not finite are no text."""
        probabilities = np.nan_to_num(self._answer(blob), nan=0.0, posinf=0.0, neginf=0.0)
        least, most = probabilities.min(initial=0.0), probabilities.max(initial=0.0)
        if probabilities.ndim != 3 or len(probabilities) != 1 or least < -0.01 or most > 1.01:
            answer = f"its output is {list(probabilities.shape)}, {least:g} to {most:g}"
            must = "must be [1, height, width], a map of probabilities >= 0 and <= 1"
            raise ModelError(f"{self.path.name}: {answer}; {must}")
        return np.asarray(probabilities[0], np.float32)


def in_reading_order(regions: Sequence[FloatArray], indices: Sequence[int]) -> list[int]:
    """Return places among regions, from the top down and, where one's middle is above another's lower edge, from the
    left."""
    low = {index: regions[index].min(axis=0) for index in indices}
    high = {index: regions[index].max(axis=0) for index in indices}
    rows: list[list[int]] = []
    for index in sorted(indices, key=lambda index: low[index][1] + high[index][1]):
        if rows and (low[index][1] + high[index][1]) / 2 < high[rows[-1][0]][1]:
            rows[-1].append(index)
        else:
            rows.append([index])
    return [index for row in rows for index in sorted(row, key=lambda index: low[index][0])]


def find_regions(probabilities: FloatArray, contract: RegionContract) -> list[FloatArray]:
    """Return the corners of the regions of a map (H, W), in its px, best first; at most a thousand.

    Best is the highest mean probability. NaN is no text.
    """
    text = (probabilities > contract.threshold).astype(np.uint8)
    contours, _ = cv2.findContours(text, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    regions: list[tuple[float, FloatArray]] = []
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
        regions.append((score, _ordered(cv2.boxPoints(turned))))
    return [corners for _, corners in sorted(regions, key=lambda pair: -pair[0])[:_MOST_REGIONS]]


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
    how = {"flags": cv2.INTER_CUBIC, "borderMode": cv2.BORDER_REPLICATE}
    crop = cv2.warpAffine(image, cv2.getAffineTransform(turned, upright), (width, height), **how)
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
