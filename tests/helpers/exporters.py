"""What exporters write behind a network, by their codes: outputs for boxes (N, 4), px, and scores (N, classes)."""

from typing import Any

import torch
from made_exporters import ROWS, SIZE_PX
from torch import Tensor

HEIGHT, WIDTH = SIZE_PX
WHWH = torch.tensor([WIDTH, HEIGHT, WIDTH, HEIGHT]).float()
CELLS = HEIGHT * WIDTH * (8**-2 + 16**-2 + 32**-2)
IMAGENET: dict[str, Any] = {"mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}
BYTES: dict[str, Any] = {"dtype": torch.uint8, "value_range": "0-255"}


def centred(boxes: Tensor) -> Tensor:
    return torch.cat([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]], dim=1)


def turned(boxes: Tensor) -> Tensor:
    return boxes[:, [1, 0, 3, 2]]


def with_nothing(scores: Tensor) -> Tensor:
    """Logits whose softmax is these scores, the last column for none."""
    rest = (1 - scores.sum(dim=1, keepdim=True)).clamp(min=1e-4)
    return torch.log(torch.cat([scores, rest], dim=1)) + 3


def rows(*order: str, least: float = 0.0):
    """An output with a row for each box: p(icture), b(ox), s(core), c(lass) and others, in this order."""

    def write(boxes: Tensor, scores: Tensor) -> tuple[Tensor, ...]:
        kept = scores.max(dim=1).values > least
        boxes, scores = boxes[kept], scores[kept]
        best, number = scores.max(dim=1, keepdim=True)
        parts = {
            "picture": best * 0, "box": boxes, "score": best, "class": number.float(), "yxyx": turned(boxes),
            "shares": boxes / WHWH, "centred shares": centred(boxes) / WHWH, "centred": centred(boxes),
            "classes": scores, "sure": 1 + best * 0,
        }  # fmt: skip
        return (torch.cat([parts[name] for name in order], dim=1),)

    return write


def batched(write):
    return lambda boxes, scores: tuple(output[None] for output in write(boxes, scores))


def queries(boxes: Tensor, scores: Tensor) -> tuple[Tensor, ...]:
    return torch.logit(scores)[None], (centred(boxes) / WHWH)[None]


def detr(boxes: Tensor, scores: Tensor) -> tuple[Tensor, ...]:
    return with_nothing(scores)[None], (centred(boxes) / WHWH)[None]


def padded(boxes: Tensor, scores: Tensor) -> tuple[Tensor, ...]:
    """A count, and -1 where it ends."""
    best, number = scores.max(dim=1)
    live, none = best > 0.05, -torch.ones(1)
    count = live.sum().reshape(1, 1)
    boxes = torch.where(live[:, None], boxes, none)
    best, number = torch.where(live, best, none), torch.where(live, number.float(), none)
    return count, boxes[None], best[None], number.long()[None]


def cells(boxes: Tensor, scores: Tensor) -> tuple[Tensor, Tensor]:
    """As many rows as an input of strides 8, 16 and 32 has cells."""
    left = int(CELLS) - ROWS
    boxes = torch.cat([boxes, boxes[:1].repeat(left, 1) * 0 + torch.tensor([4.0, 4, 8, 8])])
    return boxes, torch.cat([scores, scores[:1].repeat(left, 1) * 0 + 0.002])


def separate(boxes: Tensor, scores: Tensor, *, first: int = 0) -> tuple[Tensor, ...]:
    best, number = scores.max(dim=1)
    kept = best > 0.05
    return (boxes / WHWH)[kept][None], number[kept][None] + first, best[kept][None]


Writer = Any
EXPORTERS: dict[str, tuple[str, Writer, list[str], dict[str, Any]]] = {
    "transformers' RT-DETR": ("hfrtdetr", queries, ["logits", "pred_boxes"], {}),
    "transformers' Deformable DETR": (
        "deformabledetr", queries, ["logits", "pred_boxes"], {"classes": 91, **IMAGENET}
    ),
    "transformers' DETR": ("detr", detr, ["logits", "pred_boxes"], {"classes": 91, **IMAGENET}),
    "Ultralytics RT-DETR 8.3": ("ultralyticsrtdetr", batched(rows("centred shares", "classes")), ["output0"], {}),
    "Ultralytics RT-DETR 8.4": (
        "ultralyticsrtdetr84", batched(rows("centred shares", "score", "class")), ["output0"], {}
    ),
    "YOLOv10": ("yolov10", batched(rows("box", "score", "class")), ["output0"], {}),
    "YOLOv7": ("yolov7", rows("picture", "box", "class", "score", least=0.05), ["output"], {}),
    "YOLO-NAS flat": (
        "yolov7", rows("picture", "box", "score", "class", least=0.05), ["graph2_flat_predictions"], BYTES
    ),
    "YOLO-NAS batch": (
        "yolonas", padded, [f"graph2_{n}" for n in ("num_predictions", "pred_boxes", "pred_scores", "pred_classes")],
        BYTES,
    ),
    "YOLO-NAS raw": ("yolonasraw", lambda b, s: tuple(x[None] for x in cells(b, s)), ["n885", "n877"], {}),
    "DAMO-YOLO": (
        "damoyolo", lambda b, s: tuple(x[None] for x in cells(b, s)[::-1]), ["output", "n952"],
        {"value_range": "0-255"},
    ),
    "EfficientDet of AutoML": (
        "efficientdet", batched(rows("picture", "yxyx", "score", "class", least=0.05)), ["detections:0"],
        {"classes": 91, "nhwc": True, **BYTES},
    ),
    "SSD-12": (
        "ssd", lambda b, s: separate(b, s, first=1), ["bboxes", "labels", "scores"], IMAGENET
    ),
    "OpenVINO": (
        "detectionoutput", batched(batched(rows("picture", "class", "score", "shares", least=0.05))), ["out"],
        {"classes": 91, "colour": "bgr", "value_range": "0-255"},
    ),
    "pytorch-YOLOv4": (
        "yolov4", lambda b, s: ((b / WHWH)[None, :, None], s[None]), ["boxes", "confs"], {}
    ),
    "one channel": ("yolov10", batched(rows("box", "score", "class")), ["out"], {"colour": "grey"}),
}  # fmt: skip
UNKNOWN: dict[str, tuple[str, Writer, list[str], dict[str, Any]]] = {
    "class, score, xyxy": ("", batched(rows("class", "score", "box")), ["out"], {}),
    "xyxy, class, score": ("", batched(rows("box", "class", "score")), ["out"], {}),
    "yxyx, score, class": ("", batched(rows("yxyx", "score", "class")), ["out"], {}),
    "xyxy in shares, score, class": ("", batched(rows("shares", "score", "class")), ["out"], {}),
    "xyxy; scores": ("", lambda b, s: (b[None], s[None]), ["b", "s"], {}),
    "b: cxcywh in shares; s: scores by sigmoid": (
        "", lambda b, s: queries(b, s)[::-1], ["b", "s"], {}
    ),
    "b: xyxy in shares; s: scores, background": (
        "", lambda b, s: ((b / WHWH)[None], torch.softmax(with_nothing(s), dim=1)[None]), ["b", "s"], {}
    ),
    "b: xyxy in shares; s: score; c: class": (
        "", lambda b, s: (separate(b, s)[1], separate(b, s)[2], separate(b, s)[0]), ["c", "s", "b"], {}
    ),
    "cxcywh, objectness, scores": ("", batched(rows("centred", "sure", "classes")), ["out"], {}),
    "xyxy, scores": (
        "", lambda b, s: (torch.cat(cells(b, s), dim=1)[None].transpose(1, 2),), ["output0"], {}
    ),
}  # fmt: skip
"""By their outputs."""
