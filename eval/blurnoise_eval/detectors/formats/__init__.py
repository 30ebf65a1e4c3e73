"""The output families by what shows them in a graph. A new one is a file, or a row of one, and a line here."""

from __future__ import annotations

from blurnoise_eval.detectors.formats import end_to_end as ends
from blurnoise_eval.detectors.formats import grids
from blurnoise_eval.detectors.formats.family import Family

BY_EVIDENCE: tuple[tuple[Family, ...], ...] = (
    (ends.PPYOLOE, ends.RTDETR, ends.TORCHVISION),  # inputs beside the picture, answers without a batch
    (ends.DETR, ends.RFDETR, ends.MMDEPLOY, ends.YOLOV6E2E),  # names of outputs
    (ends.TFOD,),  # the picture's own form: bytes with the channels last
    grids.FAMILIES,  # numbers of grid cells
    (ends.YOLOV10, ends.YOLOV7),  # rows of six or seven
    (grids.ANCHORS,),  # none: the contract's head tells
)
"""Families by their evidence, the surest first. If families of one kind match, later kinds are not tried."""

FAMILIES = {each.name: each for group in BY_EVIDENCE for each in group}
PRESETS = {name: each.preset for name, each in FAMILIES.items()}
"""Contracts by the name of their family."""
