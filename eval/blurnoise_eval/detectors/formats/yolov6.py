"""YOLOv6: [1, A, 5 + nc], boxes decoded to px, the objectness column always 1.

YOLOX exported with its boxes decoded reads the same, with YOLOX's pre-processing.
"""

from __future__ import annotations

from blurnoise_eval.detectors.formats.grids import STRIDES, STRIDES_64, layout_by_cells
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.formats.yolov5 import decode

__all__ = ["NAME", "SEVERAL_CLASSES", "UNKNOWN", "decode", "describe"]

NAME = "yolov6"
UNKNOWN = ""
SEVERAL_CLASSES = True  # Evaler: multi_label


def describe(signature: Signature) -> Layout | None:
    """[batch, A, 5 + nc], with strides up to 32 or, for the P6 models, 64."""
    if len(signature.outputs) != 1:
        return None
    return layout_by_cells(signature, columns=5, strides=(STRIDES, STRIDES_64))
