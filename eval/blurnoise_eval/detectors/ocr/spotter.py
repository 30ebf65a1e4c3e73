"""Detection and recognition: finds the lines of text in a picture, and reads them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.contract_files import Given, stated_contract
from blurnoise_eval.detectors.formats.placement import lay_in, picture_size
from blurnoise_eval.detectors.model import TIMEOUT_S, OnnxModel, PictureModel
from blurnoise_eval.detectors.ocr.contract import REGION_PRESETS, RegionContract, TextContract
from blurnoise_eval.detectors.ocr.ctc import NOTHING, Reading
from blurnoise_eval.detectors.ocr.network import answer, boxes_array, check_form, fixed_size_px
from blurnoise_eval.detectors.ocr.recogniser import Recogniser
from blurnoise_eval.detectors.ocr.regions import Region, find_regions, straighten
from blurnoise_eval.detectors.records import FloatArray
from blurnoise_eval.system.urls import Location

_STRIDE_PX = 32  # the network halves the picture five times

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Spotted:
    """A line of text: its box (left, top, right, bottom), px, its reading, and the region's score."""

    box_xyxy: Box
    reading: Reading
    score: float


@dataclass(frozen=True)
class SpottingContract:
    """The contracts of both networks; names and sources have "regions." or "text." before them."""

    regions: RegionContract
    text: TextContract

    @property
    def sources(self) -> dict[str, str]:
        """For each field where it came from."""
        sources: dict[str, str] = self.to_dict()["sources"]
        return sources

    @property
    def assumptions(self) -> list[str]:
        """One sentence per field that nothing stated."""
        return [*self.regions.assumptions, *self.text.assumptions]

    def to_dict(self) -> dict[str, Any]:
        """Every field in JSON's types, and ``sources``."""
        parts = {"regions": self.regions.to_dict(), "text": self.text.to_dict()}
        sources = {
            f"{part}.{name}": source
            for part, stated in parts.items()
            for name, source in stated.pop("sources").items()
        }
        values = {f"{part}.{name}": value for part, stated in parts.items() for name, value in stated.items()}
        return {**values, "sources": sources}


class TextSpotter(PictureModel):
    """An ONNX text detector (DB) before a recogniser. One instance serves any number of threads.

    It pickles as what opened it: in another process both files are opened again.

    ``contract``: a :class:`RegionContract`, a mapping, a contract file or "db", for the detector; None looks
    beside it and into its metadata, then assumes PP-OCR's. ``threads``: cores that one inference may use.
    ``timeout_s``: how long loading and the first answer may take. Raises :class:`ModelError` for a file that is no
    such detector or a contract that does not fit it, ``TimeoutError``.

    Attributes: ``name`` and ``sha256`` of both, ``path`` of the detector, ``recogniser``, ``contract``.
    """

    contract: SpottingContract

    def __init__(
        self,
        detection_path: str | Location,
        recogniser: Recogniser,
        *,
        contract: RegionContract | Given | None = None,
        threads: int = 1,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        model = OnnxModel(detection_path, threads, timeout_s)
        further: Any = {"contract": contract, "threads": threads, "timeout_s": timeout_s}
        super().__init__(model, partial(TextSpotter, model.source, recogniser, **further))
        check_form(model)
        self.recogniser = recogniser
        self.name = f"{self.path.stem}+{recogniser.name}"
        self.sha256 = hashlib.sha256((model.sha256 + recogniser.sha256).encode()).hexdigest()
        regions = stated_contract(REGION_PRESETS, model.path, model.metadata, contract)
        if regions is None:
            assumed = dict.fromkeys(RegionContract.names(), "assumed: preset db")
            regions = RegionContract(sources=assumed)
        self.contract = SpottingContract(regions, recogniser.contract)
        height, width = fixed_size_px(model)
        # A graph of another form fails here.
        self._probabilities(np.zeros((1, 3, height or _STRIDE_PX, width or _STRIDE_PX), np.float32))

    @property
    def non_finite_values(self) -> int:
        """NaN and infinite output values of both networks seen so far."""
        return self._non_finite.total + self.recogniser.non_finite_values

    @property
    def non_finite_values_here(self) -> int:
        """Those of the calling thread."""
        return self._non_finite.here + self.recogniser.non_finite_values_here

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        super().interrupt()
        self.recogniser.interrupt()

    def spot(self, image: NDArray[np.uint8]) -> list[Spotted]:
        """Return the lines of text in an RGB picture (h, w, 3), uint8: row by row, each from the left."""
        return in_reading_order([self._read(image, region) for region in self._regions(image)])

    def read(
        self, image: NDArray[np.uint8], boxes_xyxy: ArrayLike | Sequence[Sequence[float]]
    ) -> list[Reading]:
        """Return the text in each box (left, top, right, bottom), px, of an RGB picture (h, w, 3), uint8.

        A box has all the lines whose centre lies in it, joined by spaces in reading order, with the mean
        confidence of their characters; no text without any. By centres and not by overlap, since a box may be
        drawn around a word, a line or a whole sign, and a detector may break a word in two.
        """
        regions = self._regions(image)
        centres = np.array([region.corners.mean(axis=0) for region in regions]).reshape(-1, 2)
        spotted: dict[int, Spotted] = {}
        readings = []
        for x0, y0, x1, y1 in boxes_array(boxes_xyxy):
            inside = (centres >= (x0, y0)).all(axis=1) & (centres < (x1, y1)).all(axis=1)
            for index in np.flatnonzero(inside).tolist():
                if index not in spotted:
                    spotted[index] = self._read(image, regions[index])
            lines = in_reading_order([spotted[index] for index in np.flatnonzero(inside).tolist()])
            readings.append(_joined([line.reading for line in lines if line.reading.text]))
        return readings

    def input_size_px(self, height_px: int, width_px: int) -> tuple[int, int]:
        """Return the size (height, width) at which a picture enters the detector: multiples of 32."""
        contract = self.contract.regions
        scale = max(1.0, contract.min_side_px / min(height_px, width_px))
        scale = min(scale, contract.max_side_px / max(height_px, width_px))
        height, width = (
            max(_STRIDE_PX, round(side * scale / _STRIDE_PX) * _STRIDE_PX) for side in (height_px, width_px)
        )
        fixed_height, fixed_width = fixed_size_px(self._model)
        return fixed_height or height, fixed_width or width

    def _regions(self, image: NDArray[np.uint8]) -> list[Region]:
        """Regions in px of the picture, best first."""
        height, width = picture_size(image)
        blob, _ = lay_in(image, self.contract.regions.stretched(), self.input_size_px(height, width))
        probabilities = self._probabilities(blob)
        scale = np.array([width, height], np.float32) / probabilities.shape[::-1]
        found = find_regions(probabilities, self.contract.regions)
        return [replace(region, corners=(region.corners * scale).astype(np.float32)) for region in found]

    def _probabilities(self, blob: FloatArray) -> FloatArray:
        """The network's map (h, w) for its input (1, 3, H, W); values that are not finite are no text."""
        found = answer(self._model, blob)
        self._non_finite.count([found])
        if found.ndim != 3 or len(found) != 1:
            raise ModelError(
                f"{self.path.name}: answers {list(found.shape)} to a picture; a text detector "
                "answers [1, height, width], a map of probabilities"
            )
        if not np.isfinite(found).all():
            found = np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0)
        if found.min(initial=0.0) < -0.01 or found.max(initial=0.0) > 1.01:
            raise ModelError(
                f"{self.path.name}: answers {found.min():g} to {found.max():g}; "
                "a map of probabilities is within 0 and 1"
            )
        probabilities: FloatArray = found[0]
        return probabilities

    def _read(self, image: NDArray[np.uint8], region: Region) -> Spotted:
        height, width = image.shape[:2]
        low, high = (
            np.clip(edge, 0, (width, height)) for edge in (region.corners.min(0), region.corners.max(0))
        )
        box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        return Spotted(box, self.recogniser.read_crop(straighten(image, region.corners)), region.score)


def in_reading_order(lines: Sequence[Spotted]) -> list[Spotted]:
    """Return lines from the top down and, where one's middle is above the other's lower edge, from the left."""
    rows: list[list[Spotted]] = []
    for line in sorted(lines, key=lambda line: line.box_xyxy[1] + line.box_xyxy[3]):
        middle = (line.box_xyxy[1] + line.box_xyxy[3]) / 2
        if rows and middle < rows[-1][0].box_xyxy[3]:
            rows[-1].append(line)
        else:
            rows.append([line])
    return [line for row in rows for line in sorted(row, key=lambda line: line.box_xyxy[0])]


def _joined(readings: Sequence[Reading]) -> Reading:
    if not readings:
        return NOTHING
    characters = sum(len(reading.text) for reading in readings)
    confidence = sum(reading.confidence * len(reading.text) for reading in readings) / characters
    return Reading(" ".join(reading.text for reading in readings), confidence)
