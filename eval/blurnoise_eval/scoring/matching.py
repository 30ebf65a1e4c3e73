"""How well detections answer for targets, and what a curve of that says. Boxes are (x0, y0, x1, y1) px."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.records import Detections

MATCH_IOU = 0.5
FOUND_SCORE = 0.25
"""From this score on a detection is one that somebody would act upon."""
MOST_DETECTIONS = 100
"""Of one class and picture, highest scores first, that count for average precision: COCO's rule."""
MoveBoxes = Callable[[NDArray[np.float64], NDArray[np.float64], Sequence[str]], NDArray[np.float64]]
"""From boxes (N, 4) of objects of N classes, in scenes of sizes (N, 2), width and height (NaN: the sensor's), to
others in pictures of these: at mid-exposure, or swept by the motion."""
_PAIRS = 1 << 14  # of boxes and targets held against each other at a time: few enough for a core's cache
RECALLS = np.linspace(0.0, 1.0, 101)  # at which COCO reads the precision


def iou(boxes_xyxy: ArrayLike, targets_xyxy: ArrayLike) -> NDArray[np.float32]:
    """Intersection over union of boxes (N, 4) with targets (M, 4), (N, M), in single precision."""
    a, b = (np.asarray(each, np.float32).reshape(-1, 4).T.copy() for each in (boxes_xyxy, targets_xyxy))
    a, b = a[:, :, None], b[:, None]  # four columns (N, 1) against four rows (1, M)
    width = np.minimum(a[2], b[2]) - np.maximum(a[0], b[0])
    height = np.minimum(a[3], b[3]) - np.maximum(a[1], b[1])
    shared = np.maximum(width, 0) * np.maximum(height, 0)
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - shared
    return np.asarray(shared / np.maximum(union, np.finfo(np.float32).tiny), np.float32)


def target_confidence(detections: Detections, box_xyxy: Sequence[float], class_id: int) -> float:
    """Highest score of the right class with an IoU of at least 0.5 with the target's box, else 0."""
    return float(target_confidences(detections, [box_xyxy], [class_id])[0])


def target_confidences(
    detections: Detections, boxes_xyxy: ArrayLike, class_ids: ArrayLike
) -> NDArray[np.float32]:
    """:func:`target_confidence` of each of N targets, (N,)."""
    ids, targets = np.asarray(class_ids, np.int64), np.asarray(boxes_xyxy, np.float32).reshape(-1, 4)
    confidences = np.zeros(len(targets), np.float32)
    step = max(1, _PAIRS // max(1, len(targets)))
    for some in (slice(first, first + step) for first in range(0, len(detections), step)):
        right = detections.class_ids[some, None] == ids
        right &= iou(detections.boxes_xyxy[some], targets) >= MATCH_IOU
        found, whose = np.nonzero(right)
        np.maximum.at(confidences, whose, detections.scores[some][found])
    return confidences


def swept_within(swept_xyxy: ArrayLike, moved_xyxy: ArrayLike, size_px: ArrayLike) -> NDArray[np.float64]:
    """What motion sweeps, boxes (N, 4), not beyond the border of pictures of ``size_px``, (width, height) or (N, 2).

    What of the boxes at mid-exposure, ``moved_xyxy``, lies beyond it stays.
    """
    swept, moved = (np.asarray(each, np.float64).reshape(-1, 4) for each in (swept_xyxy, moved_xyxy))
    low = np.maximum(swept[:, :2], np.minimum(moved[:, :2], 0.0))
    high = np.minimum(swept[:, 2:], np.maximum(moved[:, 2:], np.asarray(size_px, np.float64)))
    return np.concatenate([low, high], axis=1)


def hits(detections: Detections, targets_xyxy: ArrayLike, class_id: int) -> NDArray[np.bool_]:
    """Which of the detections of ``class_id``, highest score first, answer for a target of their own, (n,).

    targets_xyxy: (N, 4). A target takes one detection; a detection takes, of the targets still free, the one
    that it overlaps most, from an IoU of 0.5 on: COCO's matching.
    """
    right = detections.class_ids == class_id
    # Corners to sides and back as COCO does it, in double precision: an IoU of 0.5 falls on the same side.
    boxes = _far_corners(_xywh(detections.boxes_xyxy[right]))
    targets = _far_corners(_xywh(targets_xyxy))
    free = np.ones(len(targets), bool)
    found = np.zeros(len(boxes), bool)
    overlaps = _ious(boxes, targets)
    for index in np.flatnonzero((overlaps >= MATCH_IOU).any(axis=1)):
        open_to_it = np.where(free, overlaps[index], -1.0)
        best = len(targets) - 1 - int(open_to_it[::-1].argmax())  # of equals, COCO takes the last
        found[index] = open_to_it[best] >= MATCH_IOU
        free[best] &= not found[index]
    return found


def share_inside(boxes_xyxy: NDArray[np.float32], regions_xyxy: ArrayLike) -> NDArray[np.float64]:
    """The largest share of each box (N, 4) that lies in one of the regions (M, 4), (N,): COCO's crowd overlap."""
    boxes, regions = _far_corners(_xywh(boxes_xyxy)), _far_corners(_xywh(regions_xyxy))
    shares = _shared(boxes, regions) / np.maximum(boxes[:, None, 2:4].prod(axis=-1), 1e-12)
    return np.asarray(shares.max(axis=1, initial=0.0))


def overlaps(boxes_xyxy: ArrayLike, targets_xywh: ArrayLike, crowd: NDArray[np.bool_]) -> NDArray[np.float64]:
    """COCO's overlaps (n, N): intersection over union, with a crowd (N,) over the box's own area."""
    boxes = _far_corners(_xywh(boxes_xyxy))
    targets = _far_corners(np.asarray(targets_xywh, np.float64).reshape(-1, 4))
    inside = _shared(boxes, targets) / np.maximum(boxes[:, None, 2:4].prod(axis=-1), 1e-12)
    return np.where(crowd, inside, _ious(boxes, targets))


class AveragePrecision(NamedTuple):
    """COCO's averages of precision over recall: over IoUs of 0.5 to 0.95, at 0.5, at 0.75."""

    ap: float
    ap50: float
    ap75: float


def average_precision(
    detections: Sequence[Detections], targets_xyxy: Sequence[ArrayLike], class_id: int
) -> AveragePrecision:
    """COCO's average precision of one class over pictures, as the library ``faster-coco-eval`` computes it.

    detections, targets_xyxy: one entry per picture, boxes (N, 4); pictures without targets count by what is
    found in them. At most 100 detections per picture count. NaN where no picture has a target. Raises
    ``ValueError`` for unequal numbers of pictures.
    """
    from faster_coco_eval import COCO, COCOeval_faster  # takes 0.2 s

    boxes = [_xywh(each) for each in targets_xyxy]
    if len(detections) != len(boxes):
        raise ValueError(f"targets_xyxy: {len(boxes)} pictures; must be {len(detections)}, as of detections")
    if not any(map(len, boxes)):
        return AveragePrecision(np.nan, np.nan, np.nan)
    shared = {"category_id": 1, "iscrowd": 0}
    truth = [
        {**shared, "id": number, "image_id": picture, "bbox": box.tolist(), "area": float(box[2] * box[3])}
        for number, (picture, box) in enumerate(
            ((picture, box) for picture, of_picture in enumerate(boxes) for box in of_picture), start=1
        )
    ]
    answers = [
        {"image_id": picture, "category_id": 1, "bbox": box, "score": score}
        for picture, found in enumerate(detections)
        for box, score in zip(
            _xywh(found.boxes_xyxy[found.class_ids == class_id]).tolist(),
            found.scores[found.class_ids == class_id].tolist(),
            strict=True,
        )
    ]
    images = [{"id": picture} for picture in range(len(boxes))]
    coco = COCO({"images": images, "annotations": truth, "categories": [{"id": 1, "name": "target"}]})
    judge = COCOeval_faster(coco, coco.loadRes(answers), "bbox", print_function=lambda *_: None)
    judge.params.maxDets = [1, 10, MOST_DETECTIONS]
    judge.run()
    return AveragePrecision(*map(float, judge.stats[:3]))


@dataclass(frozen=True)
class Ranking:
    """What average precision at an IoU of 0.5 needs of P pictures, so that they can be weighted over and over.

    The T detections that answer for a target, highest score first. targets: (P,) per picture; right, wrong:
    (P, T) how many right and wrong detections of a picture stand in the ranking down to each of the T.
    """

    targets: NDArray[np.float64]
    right: NDArray[np.float64]
    wrong: NDArray[np.float64]

    @classmethod
    def of(
        cls, detections: Sequence[Detections], targets_xyxy: Sequence[ArrayLike], class_id: int
    ) -> Ranking:
        """Rank the detections of ``class_id`` of all pictures; arguments as of :func:`average_precision`."""
        scores, found, pictures = [], [], []
        for picture, (each, boxes) in enumerate(zip(detections, targets_xyxy, strict=True)):
            most = each.scores[each.class_ids == class_id][:MOST_DETECTIONS]
            scores.append(most)
            found.append(hits(each, boxes, class_id)[:MOST_DETECTIONS])
            pictures.append(np.full(len(most), picture))
        order = np.argsort(-np.concatenate([*scores, np.empty(0)]), kind="stable")
        right = np.concatenate([*found, np.empty(0, bool)])[order]
        whose = np.concatenate([*pictures, np.empty(0, int)])[order]
        numbers = np.array([len(_xywh(boxes)) for boxes in targets_xyxy], float)
        return cls.ranked(whose, right, numbers)

    @classmethod
    def ranked(
        cls, whose: NDArray[np.int64], right: NDArray[np.bool_], targets: NDArray[np.float64]
    ) -> Ranking:
        """Of detections with the highest score first: each one's picture and whether it is right; targets (P,)."""
        places = np.flatnonzero(right)
        one_per_hit = np.zeros((len(targets), len(places)))
        one_per_hit[whose[places], np.arange(len(places))] = 1
        between = np.zeros_like(one_per_hit)
        before = np.searchsorted(places, np.flatnonzero(~right))  # the next hit below each wrong detection
        counted = before < len(places)  # those below the last hit change nothing
        np.add.at(between, (whose[~right][counted], before[counted]), 1)
        return cls(targets, one_per_hit.cumsum(axis=1), between.cumsum(axis=1))

    def ap50(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Average precision at an IoU of 0.5 with picture p counted ``weights[..., p]`` times, (...).

        Equals COCO's for weights of 1, and for whole weights that of a set that repeats its pictures. NaN
        where no picture with a weight has a target.
        """
        right, every = weights @ self.right, weights @ self.targets
        shown = right + weights @ self.wrong
        precision = np.divide(right, shown, out=np.zeros_like(right), where=shown > 0)
        precision = np.maximum.accumulate(precision[..., ::-1], axis=-1)[..., ::-1]
        with np.errstate(invalid="ignore", divide="ignore"):
            recall = right / every[..., None]
        reached = np.searchsorted(RECALLS, recall, side="right")
        steps = np.diff(reached, axis=-1, prepend=0)
        return np.where(every > 0, (precision * steps).sum(axis=-1) / len(RECALLS), np.nan)


class FailurePoint(NamedTuple):
    """Where a curve falls below a threshold for good, and whether it had been below before and come back."""

    at: float | None
    returned: bool


def failure_point(x: Sequence[float], y: Sequence[float], threshold: float) -> FailurePoint:
    """Where y(x), straight between its points, falls below ``threshold`` and stays there to the end.

    x: increasing. ``at`` is None where y ends at or above the threshold (it never fails), and x[0] where y is
    below it throughout; ``returned`` tells of a curve that was below earlier and rose again, whose one number
    hides something. Raises ``ValueError`` for fewer than one point, unequal lengths or x that does not increase.
    """
    xs, ys = _curve(x, y)
    above = ys >= threshold
    if above[-1]:
        return FailurePoint(None, not above.all())
    if not above.any():
        return FailurePoint(float(xs[0]), False)
    last = int(np.flatnonzero(above)[-1])
    share = (ys[last] - threshold) / (ys[last] - ys[last + 1])
    return FailurePoint(float(xs[last] + share * (xs[last + 1] - xs[last])), not above[:last].all())


def mean_over(x: ArrayLike, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area under y (..., N), straight between its points, over x (N,) increasing, divided by the range of x.

    The mean of y over that range, hence in y's units. Raises ``ValueError`` below two points.
    """
    xs = np.asarray(x, float)
    if len(xs) < 2 or not (np.diff(xs) > 0).all():
        raise ValueError(f"x = {xs.tolist()}: must be at least two increasing values")
    return np.asarray(np.trapezoid(y, xs, axis=-1) / (xs[-1] - xs[0]))


def _curve(x: Sequence[float], y: Sequence[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    if xs.ndim != 1 or xs.shape != ys.shape or not len(xs) or not (np.diff(xs) > 0).all():
        raise ValueError(f"x = {xs.tolist()}, y: {ys.shape}; must be increasing, and y as many values")
    return xs, ys


def _xywh(boxes_xyxy: ArrayLike) -> NDArray[np.float64]:
    """Left, top, width, height of boxes (N, 4), which is how COCO holds them."""
    boxes = np.asarray(boxes_xyxy, np.float64).reshape(-1, 4)
    return np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)


def _far_corners(boxes_xywh: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners of COCO's boxes."""
    return np.concatenate([boxes_xywh, boxes_xywh[:, :2] + boxes_xywh[:, 2:]], axis=1)


def _ious(boxes: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Overlaps (n, N) of boxes (n, 6) and targets (N, 6): left, top, width, height, right, bottom."""
    shared = _shared(boxes, targets)
    union = boxes[:, None, 2:4].prod(axis=-1) + targets[None, :, 2:4].prod(axis=-1) - shared
    return np.asarray(np.divide(shared, union, out=np.zeros_like(shared), where=union > 0))


def _shared(boxes: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Areas (n, N) that boxes (n, 6) and targets (N, 6) share."""
    a, b = boxes[:, None], targets[None]
    sides = np.minimum(a[..., 4:], b[..., 4:]) - np.maximum(a[..., :2], b[..., :2])
    return np.asarray(np.clip(sides, 0, None).prod(axis=-1))
