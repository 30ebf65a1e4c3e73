"""YOLOv8, YOLOv9 and YOLO11: [1, 4 + nc, A], boxes decoded to px, classes in [0, 1], no objectness.

Some exporters turn it to [1, A, 4 + nc]; which it is, is the axis that has A entries, never the longer one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, from_centres
from blurnoise_eval.detectors.formats.grids import STRIDES, STRIDES_64, cells, layout_by_cells
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "yolov8"
UNKNOWN = ""
SEVERAL_CLASSES = True  # DetectionValidator: multi_label
_STRIDES = ((8,), STRIDES, STRIDES_64)


def describe(signature: Signature) -> Layout | None:
    """[batch, 4 + nc, A] or [batch, A, 4 + nc], with stride 8 alone, or strides up to 32 or 64."""
    output = signature.outputs[0]
    if signature.size_px is None or len(signature.outputs) != 1 or len(output.shape) != 3:
        return None
    _, rows, columns = output.shape
    counts = [cells(signature.size_px, strides) for strides in _STRIDES]
    if columns not in counts:
        return layout_by_cells(signature, columns=4, strides=_STRIDES)
    if not isinstance(rows, int) or rows < 5:
        return None
    strides = ", ".join(map(str, _STRIDES[counts.index(int(str(columns)))]))
    return Layout.of(output, f"{columns} = the cells of strides {strides}; 4 + {rows - 4} rows", rows - 4)


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = class; (centre x, y, width, height) in px."""
    columns = outputs[0][0]
    if columns.shape[1] not in [cells(size_px, strides) for strides in _STRIDES]:
        columns = columns.T
    # The largest class score decides; a NaN in a column makes its maximum NaN, which drops the column.
    kept = columns[:, np.flatnonzero(columns[4:].max(axis=0) >= min_score)].T
    return from_centres(kept[:, :4], *best_class(kept[:, 4:]), kept[:, 4:])
