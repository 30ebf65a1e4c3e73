"""YOLOs whose output holds a row, or a column, for each cell of their grids: YOLOv5, v6, v8 (v9, v11) and YOLOX."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from blurnoise_eval.detectors.class_names import COCO80
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, from_centres, select
from blurnoise_eval.detectors.formats.family import Family
from blurnoise_eval.detectors.formats.grids import STRIDES, STRIDES_64, cells, grid, layout_by_cells
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.records import FloatArray

_V8_STRIDES = ((8,), STRIDES, STRIDES_64)


def _describe_v5(signature: Signature) -> Layout | None:
    """[batch, 3A, 5 + nc], with strides up to 32 or 64; old exports add the raw 5-D heads."""
    if any(len(extra.shape) != 5 for extra in signature.outputs[1:]):
        return None
    return layout_by_cells(signature, columns=5, strides=(STRIDES, STRIDES_64), anchors=3)


def _decode_v5(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; (centre x, y, width, height) in px."""
    rows = outputs[0][0]
    rows = rows[rows[:, 4] >= min_score]
    class_scores = rows[:, 5:] * rows[:, 4:5]
    return select(rows[:, :4], *best_class(class_scores), min_score, class_scores)


def _describe_v6(signature: Signature) -> Layout | None:
    """[batch, A, 5 + nc], with strides up to 32 or, for the P6 models, 64; the objectness column is always 1."""
    if len(signature.outputs) != 1:
        return None
    return layout_by_cells(signature, columns=5, strides=(STRIDES, STRIDES_64))


def _describe_v8(signature: Signature) -> Layout | None:
    """[batch, 4 + nc, A] or [batch, A, 4 + nc], with stride 8 alone, or strides up to 32 or 64.

    Which of the two it is, is the axis that has A entries, never the longer one.
    """
    output = signature.outputs[0]
    if signature.size_px is None or len(signature.outputs) != 1 or len(output.shape) != 3:
        return None
    _, rows, columns = output.shape
    counts = [cells(signature.size_px, strides) for strides in _V8_STRIDES]
    if columns not in counts:
        return layout_by_cells(signature, columns=4, strides=_V8_STRIDES)
    if not isinstance(rows, int) or rows < 5:
        return None
    strides = ", ".join(map(str, _V8_STRIDES[counts.index(int(str(columns)))]))
    return Layout.of(output, f"{columns} = the cells of strides {strides}; 4 + {rows - 4} rows", rows - 4)


def _decode_v8(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = class; (centre x, y, width, height) in px."""
    columns = outputs[0][0]
    if columns.shape[1] not in [cells(size_px, strides) for strides in _V8_STRIDES]:
        columns = columns.T
    # The largest class score decides; a NaN in a column makes its maximum NaN, which drops the column.
    kept = columns[:, np.flatnonzero(columns[4:].max(axis=0) >= min_score)].T
    return from_centres(kept[:, :4], *best_class(kept[:, 4:]), kept[:, 4:])


def _describe_x(signature: Signature) -> Layout | None:
    """[batch, A, 5 + nc]."""
    if len(signature.outputs) != 1:
        return None
    return layout_by_cells(signature, columns=5, strides=(STRIDES,))


def _decode_x(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; centre = (offset + cell) · stride, size = exp(offset) · stride, px.

    Source: Ge et al., YOLOX (2021), as in the reference code's ``demo_postprocess``.
    """
    rows = outputs[0][0]
    kept = np.flatnonzero(rows[:, 4] >= min_score)
    class_scores = rows[kept, 5:]
    class_scores *= rows[kept, 4:5]
    scores, class_ids = best_class(class_scores)
    strong = np.flatnonzero(scores >= min_score)  # before anything is computed of the boxes
    kept = kept[strong]
    column_row, stride = (values[kept] for values in grid(size_px))
    boxes = rows[kept, :4]
    boxes[:, :2] += column_row
    with np.errstate(over="ignore"):  # an overflow gives an infinite box, which is dropped
        np.exp(boxes[:, 2:], out=boxes[:, 2:])
        boxes *= stride
    return from_centres(boxes, scores[strong], class_ids[strong], class_scores[strong])


# YOLOv7 exported with --grid has the same layout and the same pre-processing. Its val.py: multi_label.
YOLOV5 = Family(
    Contract("yolov5", COCO80, input_size_px=(640, 640), nms_iou=0.6),
    _describe_v5,
    _decode_v5,
    several_classes=True,
)
# YOLOX exported with its boxes decoded reads the same, with YOLOX's pre-processing. Its Evaler: multi_label.
YOLOV6 = Family(
    Contract("yolov6", COCO80, input_size_px=(640, 640), nms_iou=0.65),
    _describe_v6,
    _decode_v5,
    several_classes=True,
)
# DetectionValidator: multi_label.
YOLOV8 = Family(
    Contract("yolov8", COCO80, input_size_px=(640, 640), nms_iou=0.7),
    _describe_v8,
    _decode_v8,
    several_classes=True,
)
# Its postprocess: torch.max over the classes.
YOLOX = Family(
    Contract(
        "yolox",
        COCO80,
        colour="bgr",
        value_range="0-255",
        resize="letterbox-top-left",
        input_size_px=(416, 416),
        nms_iou=0.65,
    ),
    _describe_x,
    _decode_x,
    unknown="whether it is YOLOX 0.1.0, which shows the same but takes rgb, 0-1, mean and std of ImageNet",
)
