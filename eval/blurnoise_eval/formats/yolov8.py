"""YOLOv8, YOLOv9 and YOLO11: [1, 4 + nc, A], boxes decoded to px, classes in [0, 1], no objectness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, best_class, select
from blurnoise_eval.formats.signature import Signature, cells

NAME = "yolov8"
OUTPUTS: tuple[str, ...] = ()
LOOKALIKES = ""


def class_count(signature: Signature) -> int | None:
    """Classes of [batch, 4 + nc, A], with stride 8 alone, or strides up to 32 or 64."""
    shape = signature.outputs[0].shape
    if signature.size_px is None or len(shape) != 3 or not isinstance(shape[1], int) or shape[1] < 5:
        return None
    counts = [cells(signature.size_px, strides) for strides in ((8,), (8, 16, 32), (8, 16, 32, 64))]
    return shape[1] - 4 if len(signature.outputs) == 1 and shape[2] in counts else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = class; (centre x, y, width, height) in px."""
    columns = outputs[0][0]
    # The largest class score decides; a NaN in a column makes its maximum NaN, which drops the column.
    kept = columns[:, columns[4:].max(axis=0) >= min_score].T
    class_scores, class_ids = best_class(kept[:, 4:])
    return select(kept[:, :4], class_scores, class_ids, min_score)
