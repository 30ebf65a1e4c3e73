"""The data that crosses the harness's walls, validated where it is made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Detections:
    """What a detector found in one picture, highest score first.

    boxes_xyxy: (N, 4) px in the picture's own coordinates, x right, y down, corners (left, top, right,
    bottom). scores: (N,) in [0, 1]. class_ids: (N,) index into the contract's classes. leads: (N,) whether the class
    is the first of its box, where a box may have several; None: all are.
    Raises ``ValueError`` when shapes disagree or a value is not finite.
    """

    boxes_xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    class_ids: NDArray[np.int64]
    leads: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        boxes = np.asarray(self.boxes_xyxy, np.float32).reshape(-1, 4)
        scores = np.asarray(self.scores, np.float32).reshape(-1)
        class_ids = np.asarray(self.class_ids, np.int64).reshape(-1)
        leads = None if self.leads is None else np.asarray(self.leads, bool).reshape(-1)
        if not len(boxes) == len(scores) == len(class_ids) or (
            leads is not None and len(leads) != len(boxes)
        ):
            raise ValueError(
                f"detections: {len(boxes)} boxes, {len(scores)} scores and {len(class_ids)} classes; "
                "must be equally many"
            )
        if not (np.isfinite(boxes).all() and np.isfinite(scores).all()):
            raise ValueError("detections: boxes and scores must be finite")
        order = np.argsort(-scores, kind="stable")
        object.__setattr__(self, "boxes_xyxy", boxes[order])
        object.__setattr__(self, "scores", scores[order])
        object.__setattr__(self, "class_ids", class_ids[order])
        object.__setattr__(self, "leads", None if leads is None else leads[order])

    @property
    def leading(self) -> Detections:
        """Those whose class is the first of its box: one answer per box, which is what a user is shown."""
        return self if self.leads is None else self[self.leads]

    def __len__(self) -> int:
        return len(self.scores)

    def __getitem__(self, index: NDArray[np.bool_] | slice) -> Detections:
        leads = None if self.leads is None else self.leads[index]
        return Detections(self.boxes_xyxy[index], self.scores[index], self.class_ids[index], leads)
