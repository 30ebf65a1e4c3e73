"""The output families by what shows them in a graph. A new one is a file, or a row of one, and a line here."""

from __future__ import annotations

from blurnoise_eval.detectors.formats.anchors import ANCHORS, YOLOFASTESTV2
from blurnoise_eval.detectors.formats.end_to_end import (
    MMDEPLOY,
    PPYOLOE,
    RTDETR,
    TFOD,
    TORCHVISION,
    YOLOV6E2E,
    YOLOV7,
    YOLOV10,
)
from blurnoise_eval.detectors.formats.family import Family
from blurnoise_eval.detectors.formats.fastestdet import FASTESTDET
from blurnoise_eval.detectors.formats.grid_yolo import YOLOV5, YOLOV6, YOLOV8, YOLOX
from blurnoise_eval.detectors.formats.nanodet import NANODET, NANODETPLUS
from blurnoise_eval.detectors.formats.queries import DETR, RFDETR

BY_EVIDENCE: tuple[tuple[Family, ...], ...] = (
    (PPYOLOE, RTDETR, TORCHVISION),  # inputs beside the picture, answers without a batch
    (DETR, RFDETR, MMDEPLOY, YOLOV6E2E),  # names of outputs
    (TFOD,),  # the picture's own form: bytes with the channels last
    (YOLOV5, YOLOV8, YOLOX, YOLOV6, FASTESTDET, NANODET, NANODETPLUS, YOLOFASTESTV2),  # numbers of grid cells
    (YOLOV10, YOLOV7),  # rows of six or seven
    (ANCHORS,),  # none: the contract's head tells
)
"""The surest evidence first: where one kind of it is there, later ones are not asked."""

FAMILIES: tuple[Family, ...] = tuple(each for group in BY_EVIDENCE for each in group)
PRESETS = {each.name: each.preset for each in FAMILIES}
"""Contracts by the name of their family."""
