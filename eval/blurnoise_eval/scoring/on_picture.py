"""A model before a picture, target by target: a detector by class and overlap, a reader by its text.

Domain: 8-bit RGB pictures (H, W, 3); confidences in [0, 1]; boxes (left, top, right, bottom) px.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets import Picture, Target, size_group
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Reading, character_error_rate
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.boxes import Array, MoveBoxes, swept_within
from blurnoise_eval.scoring.matching import FOUND_SCORE, target_confidences
from blurnoise_eval.store.rows import TargetAnswer

Picture8 = NDArray[np.uint8]
NOTHING = Detections(np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.int64))


class Reader(Protocol):
    """A text recogniser, or detection and recognition: reads known boxes of a picture."""

    name: str
    path: Path
    sha256: str

    @property
    def non_finite_values_here(self) -> int:
        """NaN and infinite output values among its outputs so far, in the calling thread."""

    @property
    def contract(self) -> Any:
        """How pictures enter it."""

    def read(self, image: Picture8, boxes_xyxy: Sequence[Sequence[float]]) -> list[Reading]:
        """The text in each box."""


Model = Detector | Reader


class ModelOutput(NamedTuple):
    """A model's answer to one picture: its detections, a row per target, ms, and what went wrong if it did.

    non_finite_values: NaN and infinite values among the model's outputs.
    """

    detections: Detections
    targets: tuple[TargetAnswer, ...]
    infer_ms: float
    error: str | None
    non_finite_values: int


class ModelOnPicture:
    """One model before one picture in all its conditions. ``clean``: its answer to the original picture.

    A detector's ``confidence`` in a target: the highest score of its class that overlaps the target's box at
    mid-exposure, whichever class leads; ``confidence_swept``: that overlaps all that the box covers during the
    exposure. Without labels, what it finds in the original picture at ``FOUND_SCORE`` or above is the target. A
    reader's: that of the reading where it is the target's text, else 0; without labels, what is read in the original
    picture, all of it one box, is the text. Crowds are no targets.
    """

    def __init__(self, model: Model, picture: Picture, image8: Picture8) -> None:
        self.model = model
        every = [(place, each) for place, each in enumerate(picture.targets or ()) if not each.crowd]
        if reads := hasattr(model, "read"):
            whole = (0.0, 0.0, float(image8.shape[1]), float(image8.shape[0]))
            known = [each for each in every if each[1].text is not None]
            text = Target("text", "read when clean", whole)
            self._targets = [(0, text)] if picture.targets is None else known
            self._texts = [target.text for _, target in self._targets]
        else:
            number = {name: place for place, name in enumerate(model.contract.classes)}
            self._targets = [each for each in every if each[1].label in number]
            self._ids = np.array([number[target.label] for _, target in self._targets], np.int64)
        self._answer = self._read if reads else self._detect
        self._labelled = picture.targets is not None
        self.clean = self.evaluate(image8)

    def evaluate(
        self,
        image: Picture8,
        move_boxes: MoveBoxes | None = None,
        sweep_boxes: MoveBoxes | None = None,
        invented: Mapping[int, float] | None = None,
    ) -> ModelOutput:
        """The model's answer to a picture, compared with its targets where ``move_boxes`` puts them, and with what
        they cover, ``sweep_boxes``; None: they stay. One on which the model fails gives no rows, and the reason.
        invented: by the place of a target, the share of its background that was; None of the original picture."""
        before = self.model.non_finite_values_here
        started = time.perf_counter()
        detections, rows, wrong = NOTHING, list[TargetAnswer](), None
        try:
            detections, rows = self._answer(self.model, image, move_boxes, sweep_boxes, invented)
        except ModelError as error:
            wrong = str(error)
        infer_ms = 1e3 * (time.perf_counter() - started)
        return ModelOutput(
            detections, tuple(rows), infer_ms, wrong, self.model.non_finite_values_here - before
        )

    def _detect(
        self,
        model: Any,
        image: Picture8,
        move_boxes: MoveBoxes | None,
        sweep_boxes: MoveBoxes | None,
        invented: Mapping[int, float] | None,
    ) -> tuple[Detections, list[TargetAnswer]]:
        found, own = model.detect_all(image)
        if not self._labelled:
            clean = found.leading[found.leading.scores >= FOUND_SCORE]
            self._targets, self._ids = _found_targets(clean, model.contract.classes), clean.class_ids
            self._labelled = True
        boxes = places = self._boxes(move_boxes, image)
        if sweep_boxes is not None and len(boxes):
            covered = swept_within(self._boxes(sweep_boxes, image), boxes, image.shape[1::-1])
            # At rest both are the same boxes, and one comparison does.
            if not np.array_equal(covered, boxes):
                places = np.concatenate([boxes, covered])
        of, at = np.resize(self._ids, len(places)), places.astype(np.float32)
        confidences = target_confidences(found, at, of)
        # Scores of classes that lead no box count as well: a target may be found as the second-likeliest class.
        if own is not None and len(of) and len(others := own(of, confidences)):
            confidences = np.maximum(confidences, target_confidences(others, at, of))
        every = confidences.tolist()
        swept = every[-len(boxes) :]  # of what the boxes cover, which follows them where it is more than they
        return found, [
            self._answered(index, box, invented, confidence=every[index], confidence_swept=swept[index])
            for index, box in enumerate(boxes.tolist())
        ]

    def _read(
        self,
        model: Any,
        image: Picture8,
        move_boxes: MoveBoxes | None,
        sweep_boxes: MoveBoxes | None,
        invented: Mapping[int, float] | None,
    ) -> tuple[Detections, list[TargetAnswer]]:
        boxes = self._boxes(move_boxes, image)
        rows = []
        for index, (box, reading) in enumerate(
            zip(boxes.tolist(), model.read(image, boxes.tolist()), strict=True)
        ):
            if (truth := self._texts[index]) is None:
                # Without a label the first picture, which is the original, says what the text is.
                truth = self._texts[index] = reading.text
            row = self._answered(
                index,
                box,
                invented,
                confidence=reading.confidence if reading.text == truth else 0.0,
                truth=truth,
                text=reading.text,
                read_confidence=reading.confidence,
                character_error_rate=character_error_rate(reading.text, truth),
            )
            rows.append(row)
        return NOTHING, rows

    def _boxes(self, move_boxes: MoveBoxes | None, image: Picture8) -> Array:
        """(N, 4) of the targets in a picture."""
        boxes = np.array([target.box_xyxy for _, target in self._targets], float).reshape(-1, 4)
        if move_boxes is None or not len(boxes):
            return boxes
        sizes = np.full((len(boxes), 2), image.shape[1::-1], float)
        return move_boxes(boxes, sizes, [target.label for _, target in self._targets])

    def _answered(
        self, index: int, box_xyxy: Sequence[float], invented: Mapping[int, float] | None, **answer: Any
    ) -> TargetAnswer:
        """The model's answer for one of the targets."""
        (number, target), (x0, y0, x1, y1) = self._targets[index], box_xyxy
        about = number, target.group, target.label, x0, y0, x1, y1, x1 - x0, y1 - y0
        share = None if invented is None else invented.get(number, 0.0)
        return TargetAnswer(*about, inpainted_share=share, **answer)


def _found_targets(clean: Detections, classes: Sequence[str]) -> list[tuple[int, Target]]:
    """What a detector finds in the original picture, taken for targets."""
    found = enumerate(zip(clean.boxes_xyxy.tolist(), clean.class_ids.tolist(), strict=True))
    return [
        (place, Target(classes[number], size_group(x1 - x0, y1 - y0, "found when clean"), (x0, y0, x1, y1)))
        for place, ((x0, y0, x1, y1), number) in found
    ]
