"""What a model makes of a picture, target by target: a detector by class and overlap, a reader by its text.

Domain: 8-bit RGB pictures (H, W, 3); confidences in [0, 1]; boxes (left, top, right, bottom) px.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets import Picture, Target, size_group
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector, OwnScores
from blurnoise_eval.detectors.ocr import Reading, character_error_rate
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.boxes import MoveBoxes, swept_within
from blurnoise_eval.scoring.matching import FOUND_SCORE, target_confidences

Picture8 = NDArray[np.uint8]
Box = tuple[float, float, float, float]
NOTHING = Detections(np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.int64))


class Reader(Protocol):
    """A text recogniser, or detection and recognition: reads known boxes of a picture."""

    name: str
    path: Path
    sha256: str

    @property
    def non_finite_values_here(self) -> int:
        """NaN and infinite output values that the calling thread has seen so far."""

    @property
    def contract(self) -> Any:
        """How pictures enter it."""

    def read(self, image: Picture8, boxes_xyxy: Sequence[Sequence[float]]) -> list[Reading]:
        """The text in each box."""


Model = Detector | Reader


class Sight(NamedTuple):
    """A model's answer to one picture: its detections, a row per target, ms, and what went wrong if it did.

    non_finite_values: NaN and infinite values among the model's outputs.
    """

    detections: Detections
    targets: tuple[dict[str, Any], ...]
    infer_ms: float
    error: str | None
    non_finite_values: int


class View(ABC):
    """One model before one picture in all its conditions. ``clean``: its answer to the untouched picture."""

    def __init__(self, model: Model, image8: Picture8) -> None:
        self.model = model
        self.clean = self.look(image8)

    def look(
        self, image: Picture8, move_boxes: MoveBoxes | None = None, sweep_boxes: MoveBoxes | None = None
    ) -> Sight:
        """The model's answer to a picture, held against its targets where ``move_boxes`` puts them.

        A detector's also against what they cover in the course of the exposure, ``sweep_boxes``; None: the same.
        One on which the model fails gives no rows, and the reason.
        """
        before = self.model.non_finite_values_here
        started = time.perf_counter()
        detections, rows, wrong = NOTHING, list[dict[str, Any]](), None
        try:
            detections, rows = self._answer(image, move_boxes, sweep_boxes)
        except ModelError as error:
            wrong = str(error)
        infer_ms = 1e3 * (time.perf_counter() - started)
        return Sight(detections, tuple(rows), infer_ms, wrong, self.model.non_finite_values_here - before)

    @abstractmethod
    def _answer(
        self, image: Picture8, move_boxes: MoveBoxes | None, sweep_boxes: MoveBoxes | None
    ) -> tuple[Detections, list[dict[str, Any]]]: ...


class _Placed(NamedTuple):
    """A detector's N targets in pictures of one motion. by: what placed them there. rows: what of theirs stays.

    boxes_xyxy: (N, 4), where they are, or (2 N, 4), then what they cover; class_ids of these.
    """

    by: tuple[object, ...]
    rows: Sequence[dict[str, Any]]
    boxes_xyxy: NDArray[np.float32]
    class_ids: NDArray[np.int64]


class DetectorView(View):
    """Confidence in a target: the highest score of its class that overlaps it, whichever class leads. No crowds.

    ``confidence``: with the target's box at mid-exposure; ``confidence_swept``: with all that it covers during the
    exposure. Without labels, what the detector finds in the untouched picture at FOUND_SCORE or above is the target.
    """

    def __init__(self, model: Detector, picture: Picture, image8: Picture8) -> None:
        self._look = model.look
        self._classes = model.contract.classes
        ids = {name: index for index, name in enumerate(self._classes)}
        self._asked: list[tuple[int, Target, int]] | None = None
        self._last = threading.local()  # placed: of the thread's last picture
        if picture.targets is not None:
            self._asked = [
                (index, target, ids[target.label])
                for index, target in enumerate(picture.targets)
                if target.label in ids and not target.crowd
            ]
        super().__init__(model, image8)

    def _answer(
        self, image: Picture8, move_boxes: MoveBoxes | None, sweep_boxes: MoveBoxes | None
    ) -> tuple[Detections, list[dict[str, Any]]]:
        found, own = self._look(image)
        if self._asked is None:
            self._asked = self._own_targets(found.leading)
        placed: _Placed | None = getattr(self._last, "placed", None)
        if placed is None or placed.by != (move_boxes, sweep_boxes):
            placed = self._last.placed = self._placed(self._asked, move_boxes, sweep_boxes, image)
        of_places, count = _confidences(found, own, placed).tolist(), len(placed.rows)
        confidences, swept = of_places[:count], of_places[-count:]
        return found, [
            {**row, "confidence": confidence, "confidence_swept": of_swept}
            for row, confidence, of_swept in zip(placed.rows, confidences, swept, strict=True)
        ]

    def _placed(
        self,
        asked: Sequence[tuple[int, Target, int]],
        move_boxes: MoveBoxes | None,
        sweep_boxes: MoveBoxes | None,
        image: Picture8,
    ) -> _Placed:
        targets, ids = [target for _, target, _ in asked], [number for *_, number in asked]
        boxes = _boxes(targets, move_boxes, image)
        places = [np.array(boxes).reshape(-1, 4)]
        if sweep_boxes is not None and boxes:
            size_px = image.shape[1], image.shape[0]
            covered = swept_within(_boxes(targets, sweep_boxes, image), boxes, size_px)
            if not np.array_equal(covered, places[0]):
                places.append(covered)
        rows = [_row(index, target, box) for (index, target, _), box in zip(asked, boxes, strict=True)]
        of_places = np.concatenate(places).astype(np.float32)
        return _Placed((move_boxes, sweep_boxes), rows, of_places, np.array(ids * len(places), np.int64))

    def _own_targets(self, clean: Detections) -> list[tuple[int, Target, int]]:
        own = []
        found = zip(clean.boxes_xyxy.tolist(), clean.scores, clean.class_ids.tolist(), strict=True)
        for index, ((x0, y0, x1, y1), score, class_id) in enumerate(found):
            if score >= FOUND_SCORE:
                group = size_group(x1 - x0, y1 - y0, "found when clean")
                own.append((index, Target(self._classes[class_id], group, (x0, y0, x1, y1)), class_id))
        return own


class ReaderView(View):
    """Confidence in a target: that of the reading where it is the target's text, else 0.

    Without labels, what is read in the untouched picture, all of it one box, is the text.
    """

    def __init__(self, model: Reader, picture: Picture, image8: Picture8) -> None:
        self._read = model.read
        if picture.targets is None:
            whole = (0.0, 0.0, float(image8.shape[1]), float(image8.shape[0]))
            self._asked = [(0, Target("text", "read when clean", whole))]
        else:
            self._asked = [
                (index, target)
                for index, target in enumerate(picture.targets)
                if target.text is not None and not target.crowd
            ]
        self._truths = [target.text for _, target in self._asked]
        super().__init__(model, image8)

    def _answer(
        self, image: Picture8, move_boxes: MoveBoxes | None, sweep_boxes: MoveBoxes | None
    ) -> tuple[Detections, list[dict[str, Any]]]:
        boxes = _boxes((target for _, target in self._asked), move_boxes, image)
        readings = self._read(image, boxes)
        rows = []
        for place, ((index, target), box, reading) in enumerate(
            zip(self._asked, boxes, readings, strict=True)
        ):
            if (truth := self._truths[place]) is None:
                truth = self._truths[place] = reading.text
            right = reading.confidence if reading.text == truth else 0.0
            row = _row(index, target, box) | {"confidence": right}
            row |= {"truth": truth, "text": reading.text, "read_confidence": reading.confidence}
            rows.append(row | {"character_error_rate": character_error_rate(reading.text, truth)})
        return NOTHING, rows


def view(model: Model, picture: Picture, image8: Picture8) -> View:
    """The model before the picture; what it says of the untouched picture is known from then on."""
    kind = DetectorView if isinstance(model, Detector) else ReaderView
    return kind(model, picture, image8)  # type: ignore[arg-type]  # each its own kind of model


def _confidences(found: Detections, own: OwnScores | None, placed: _Placed) -> NDArray[np.float32]:
    """In each target at each of its places: of what was found, or of the classes' own scores where others lead."""
    boxes, ids = placed.boxes_xyxy, placed.class_ids
    confidences = target_confidences(found, boxes, ids)
    if own is not None and len(ids) and len(others := own(ids, confidences)):
        confidences = np.maximum(confidences, target_confidences(others, boxes, ids))
    return confidences


def _boxes(targets: Iterable[Target], move_boxes: MoveBoxes | None, image: Picture8) -> list[Box]:
    """Where the targets stand in a picture."""
    targets = list(targets)
    boxes = [target.box_xyxy for target in targets]
    if move_boxes is None or not boxes:
        return boxes
    sizes = np.full((len(boxes), 2), image.shape[1::-1], float)
    moved = move_boxes(np.array(boxes, float), sizes, [target.label for target in targets])
    return [(x0, y0, x1, y1) for x0, y0, x1, y1 in moved.tolist()]


def _row(index: int, target: Target, box: Box) -> dict[str, Any]:
    x0, y0, x1, y1 = box
    row: dict[str, Any] = {"target_id": index, "group": target.group, "label": target.label}
    return row | {"x0": x0, "y0": y0, "x1": x1, "y1": y1, "width_px": x1 - x0, "height_px": y1 - y0}
