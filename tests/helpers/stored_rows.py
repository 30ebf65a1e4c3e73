"""Rows as the store takes them, one cell each."""

import numpy as np
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.store.store import CellResult
from plans import OWN

NOTHING = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0))


def row(index, **changes):
    """The columns that cells and targets share."""
    return {
        "cell_id": f"cell{index}",
        "model": "m",
        "camera": "imx250",
        "image": f"picture {index}, \"quoted\" λ.png",
        "repeat": 0,
        "clean": False,
        "exposure_s": 0.001 * (index + 1),
        "illuminance_lux": 50.0,
        "velocity_x_px_s": 0.0,
        "velocity_y_px_s": 0.0,
        **OWN,
        "blur_px": 0.0,
        **changes,
    }  # fmt: skip


def result(index, *, detections=NOTHING, targets=1, **changes):
    shared = row(index, **changes)
    cell = {"seed": 2**63 - 1 - index, "n_targets": targets, "target_confidence": 0.5, "detection_rate": 1.0}
    cell |= {
        "n_detections": len(detections),
        "saturated_share": 0.25,
        "applied_exposure_s": 0.01,
        "applied_gain_db": 6.0,
        "snr_db": 20.0,
        "brightness": 0.4,
        "inpainted_share": None,
        "simulate_ms": 1.5,
        "infer_ms": 2.5,
        "error": None,
    }
    target = {"group": "g", "label": "stop sign", "x0": 0.0, "y0": 1.0, "x1": 2.0, "y1": 3.0}
    target |= {"width_px": 2.0, "height_px": 2.0, "confidence": 0.1 * (index + 1), "truth": None}
    target |= {"confidence_swept": 0.05, "inpainted_share": None}
    target |= dict.fromkeys(("text", "read_confidence", "character_error_rate"))
    rows = tuple({**shared, **target, "target_id": number} for number in range(targets))
    return CellResult({**shared, **cell, "example": None}, rows, detections)


def clean_result(index, **changes):
    nothing = dict.fromkeys((*NAMES, "blur_px"))
    return result(index, clean=True, **nothing, **changes)
