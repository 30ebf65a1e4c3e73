"""The output families by what shows them in a graph. A new one is a row of a table, or a file, and a line here."""

from __future__ import annotations

from blurnoise_eval.detectors.formats import exporters as ex
from blurnoise_eval.detectors.formats import grids
from blurnoise_eval.detectors.formats.family import Family

BY_EVIDENCE: tuple[tuple[Family, ...], ...] = (
    (ex.PPYOLOE, ex.RTDETR, ex.TORCHVISION),  # inputs beside the picture, answers without a batch
    (ex.HF_RTDETR, ex.HF_DEFORMABLE, ex.DETR, ex.RFDETR),  # names of outputs
    (ex.MMDEPLOY, ex.YOLOV6E2E, ex.YOLONAS, ex.SSD, ex.YOLOV4),
    (ex.TFOD,),  # the picture's own form: bytes with the channels last
    (ex.YOLOV5, ex.YOLOV8, ex.YOLOV6, ex.DAMOYOLO, ex.YOLONAS_RAW, *grids.FAMILIES),  # numbers of grid cells
    (ex.DETECTION_OUTPUT,),
    (ex.YOLOV10, ex.RTDETR_V84, ex.YOLOV7, ex.YOLONAS_FLAT, ex.EFFICIENTDET),  # rows of six or seven
    (ex.RTDETR_V83,),
    (grids.ANCHORS, ex.COLUMNS),  # none: the contract tells
)
"""Families by their evidence, the surest first. If families of one kind match, later kinds are not tried."""

FAMILIES = {each.name: each for group in BY_EVIDENCE for each in group}
PRESETS = {name: each.preset for name, each in FAMILIES.items()}
"""Contracts by the name of their family."""
