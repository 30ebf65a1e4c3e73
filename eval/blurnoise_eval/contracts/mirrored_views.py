"""What a detector finds in a picture and in its mirrored crop, and how well the two agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU
from blurnoise_eval.scoring.on_picture import NOTHING

Image = NDArray[np.uint8]
# Different on opposite sides, so that a wrong offset cannot cancel by the mirroring.
_CUT = (0.04, 0.08, 0.08, 0.04)  # shares of a picture that its mirrored view lacks: left, top, right, bottom
_FEWEST_SHIFTED = 8  # labelled objects, found by their boxes, from which their classes say something


def detected(detector: Detector, image: Image) -> tuple[Detections, str]:
    """Detections, and why contract or export are wrong, whatever the picture shows, or ""."""
    blob, placement = detector.prepare(image)
    outputs = detector.run(blob)
    if count := sum(int(output.size - np.isfinite(output).sum()) for output in outputs):
        return NOTHING, f"the outputs contain {count} NaN or infinite values"
    # Graphs that suppress double answers themselves pad with zeros, or answer nothing.
    text = detector.contract.outputs
    dense = detector.contract.nms_iou is not None and (text is None or "scores" in text)
    if dense and detector.top_score(outputs) == 0:
        return NOTHING, "every score is exactly 0, as in an int8 export that rounds all scores to 0"
    try:
        return detector.decode(outputs, placement, min_score=FOUND_SCORE).leading, ""
    except ModelError as error:
        return NOTHING, str(error)


def mirrored_view(image: Image, found: Detections) -> tuple[Image, Detections]:
    """Mirrored crop, and the detections at least half visible in it.

    >>> found = Detections([[40.0, 40.0, 60.0, 60.0]], [0.9], [0])
    >>> view, mirrored = mirrored_view(np.zeros((100, 100, 3), np.uint8), found)
    >>> view.shape[:2], mirrored.boxes_xyxy.tolist()
    ((88, 88), [[32.0, 32.0, 52.0, 52.0]])
    """
    height, width = image.shape[:2]
    left, top, right, bottom = np.round(np.multiply(_CUT, (width, height) * 2)).astype(int).tolist()
    right, bottom = width - right, height - bottom
    boxes = np.clip(found.boxes_xyxy, (left, top) * 2, (right, bottom) * 2)
    areas, own = ((each[:, 2:] - each[:, :2]).prod(axis=1) for each in (boxes, found.boxes_xyxy))
    boxes[:, [1, 3]] -= top
    boxes[:, [0, 2]] = right - boxes[:, [2, 0]]
    seen = Detections(boxes, found.scores, found.class_ids)[2 * areas >= own]
    return np.ascontiguousarray(image[top:bottom, left:right][:, ::-1]), seen


def agreement(one: Detections, other: Detections) -> float:
    """The sum over pairs of one class, the best first, of the lower score times the overlap, from a half on.

    >>> one = Detections([[0.0, 0.0, 10.0, 10.0]], [0.9], [0])
    >>> round(agreement(one, Detections([[0.0, 0.0, 10.0, 10.0]], [0.5], [0])), 3)  # the lower score, full overlap
    0.5
    """
    overlap = iou(one.boxes_xyxy, other.boxes_xyxy)
    overlap[(one.class_ids[:, None] != other.class_ids) | (overlap < MATCH_IOU)] = 0
    total = 0.0
    while overlap.size and overlap.max() > 0:
        row, column = np.unravel_index(overlap.argmax(), overlap.shape)
        total += float(min(one.scores[row], other.scores[column]) * overlap[row, column])
        overlap[row], overlap[:, column] = 0, 0
    return total


def shifted_classes(found: Sequence[Detections], labelled: Sequence[Detections | None]) -> str:
    """A doubt where most labelled objects are found with the class number after or before their own, or "".

    Boxes fit then, and the mirrored view agrees, too: only labels show that numbers begin with 1, or that the
    background comes first. Each object counts with the likeliest detection that overlaps it by half.

    >>> of_eight = [[20.0 * number, 0.0, 20.0 * number + 10, 10.0] for number in range(8)]
    >>> found, labels = (Detections(of_eight, [0.9] * 8, [number] * 8) for number in (3, 2))
    >>> shifted_classes([found], [labels])[:54]
    'outputs or classes may be wrong: 8 of 8 labelled objec'
    """
    steps = Counter[int]()
    for seen, labels in zip(found, labelled, strict=True):
        if labels is None or not len(seen.scores):
            continue
        scores = np.where(iou(seen.boxes_xyxy, labels.boxes_xyxy) >= MATCH_IOU, seen.scores[:, None], 0)
        there = scores.max(axis=0) > 0
        steps.update((seen.class_ids[scores.argmax(axis=0)] - labels.class_ids)[there].tolist())
    for step, which in ((1, "after"), (-1, "before")):
        if steps.total() >= _FEWEST_SHIFTED and 2 * steps[step] > steps.total():
            return (
                f"outputs or classes may be wrong: {steps[step]} of {steps.total()} labelled objects are found as "
                f"the class {which} their own; outputs state 'class from 1' where numbers begin with 1, and "
                "'background, scores' where the background comes first"
            )
    return ""
