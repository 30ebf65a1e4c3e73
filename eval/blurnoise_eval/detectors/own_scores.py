"""Boxes with their own scores of any class, where another one leads, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurnoise_eval.detectors.formats.candidates import Candidates, FloatArray, best, suppress
from blurnoise_eval.detectors.formats.placement import Placement
from blurnoise_eval.detectors.records import Detections

MOST_OF_CLASS, OWN_SCORE = 100, 0.01
"""Of one class that need not lead: how many boxes are looked at for a target, as COCO counts, and from what score."""


@dataclass(frozen=True, eq=False)
class OwnScores:
    """What a graph told of one picture, for questions about single classes. nms_iou: as of the contract.

    Questions are class ids and what the scores must exceed, one for each; answers begin at ``OWN_SCORE``, whatever
    the family's evaluator counts.
    """

    candidates: Candidates
    placement: Placement
    nms_iou: float | None

    def every(self, class_ids: Sequence[int], above: FloatArray) -> Detections:
        """All boxes, those that doubles suppress included: a bound on what :meth:`kept` tells, in less time."""
        return in_picture(self._asked(class_ids, above), self.placement)

    def kept(self, class_ids: Sequence[int], above: FloatArray) -> Detections:
        """Those that remain after suppression within each class, at most ``MOST_OF_CLASS`` of each."""
        most = MOST_OF_CLASS * len(class_ids)
        # Boxes that are left out here are weaker than those asked for: they suppress none of them.
        return kept(self._asked(class_ids, above), self.placement, self.nms_iou, most, MOST_OF_CLASS)

    def _asked(self, class_ids: Sequence[int], above: FloatArray) -> Candidates:
        asked, whose = np.unique(np.asarray(class_ids, np.int64), return_inverse=True)
        least = np.full(len(asked), np.inf, np.float32)
        np.minimum.at(least, whose, above)
        return self.candidates.with_classes(OWN_SCORE, asked, least)


def kept(
    candidates: Candidates,
    placement: Placement,
    nms_iou: float | None,
    most: int,
    per_class: int | None = None,
) -> Detections:
    """At most ``most`` detections, and ``per_class`` of one class, after suppression, in the picture's px."""
    if nms_iou is None:
        return in_picture(best(candidates, most), placement)
    return in_picture(suppress(candidates, nms_iou, most, per_class=per_class), placement)


def in_picture(candidates: Candidates, placement: Placement) -> Detections:
    """Detections in the picture's px, without those wholly in the padding."""
    boxes = placement.to_picture(candidates.boxes_xyxy)
    inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    leads = None if candidates.leads is None else candidates.leads[inside]
    return Detections(
        boxes[inside], np.minimum(candidates.scores[inside], 1), candidates.class_ids[inside], leads
    )
