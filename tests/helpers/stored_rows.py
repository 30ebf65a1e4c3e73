"""Rows as the store takes them, one cell each."""

from dataclasses import replace

import numpy as np
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.store.columns import ORIGINAL, AxisValues
from blurnoise_eval.store.rows import CellRow, TargetAnswer, TargetRow
from blurnoise_eval.store.store import CellResult
from plans import OWN

NOTHING = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0))
AT = AxisValues.of({"illuminance_lux": 50.0, "velocity_x_px_s": 0.0, "velocity_y_px_s": 0.0, **OWN})
BOX = {"x0": 0.0, "y0": 1.0, "x1": 2.0, "y1": 3.0, "width_px": 2.0, "height_px": 2.0}
_OF_KEY = ("cell_id", "model", "camera", "image", "repeat", "conditions", "blur_px")


def answer(number=0, **found):
    """A target, found with a confidence of 0.5 unless something else is given."""
    about = {"group": "g", "label": "stop sign", **BOX, "confidence": 0.5}
    return TargetAnswer(target_id=number, **(about | found))


def cell(cell_id, answers=(), found=NOTHING, **changes):
    """A cell; changes: its columns, axes among them."""
    at = AT.but(exposure_s=0.01, **{name: changes.pop(name) for name in NAMES if name in changes})
    key = {"model": "m", "camera": "imx250", "image": "p", "repeat": 0, "conditions": at, "blur_px": 0.0}
    key |= {"cell_id": cell_id, **{name: changes.pop(name) for name in _OF_KEY if name in changes}}
    row = CellRow(**key, **({"seed": 1, "n_targets": len(answers)} | changes))
    return CellResult(row, tuple(TargetRow(**key, target=each) for each in answers), found)


def result(index, *, detections=NOTHING, targets=1, **changes):
    """The cell of number ``index``, in full."""
    at = AT.but(exposure_s=0.001 * (index + 1))
    at = at.but(**{name: changes.pop(name) for name in NAMES if name in changes})
    about = {
        "image": f'picture {index}, "quoted" λ.png',
        "conditions": at,
        "seed": 2**63 - 1 - index,
        "target_confidence": 0.5,
        "detection_rate": 1.0,
        "n_detections": len(detections),
        "saturated_share": 0.25,
        "applied_exposure_s": 0.01,
        "applied_gain_db": 6.0,
        "snr_db": 20.0,
        "brightness": 0.4,
        "simulate_ms": 1.5,
        "infer_ms": 2.5,
    }
    answers = [
        answer(number, confidence=0.1 * (index + 1), confidence_swept=0.05) for number in range(targets)
    ]
    return cell(answers=answers, found=detections, **({"cell_id": f"cell{index}"} | about | changes))


def with_cell(of, **changes):
    """The result with other values in the cell's columns."""
    return replace(of, cell=replace(of.cell, **changes))


def clean_result(index, **changes):
    """The original picture of a cell."""
    return result(index, conditions=ORIGINAL, blur_px=None, **changes)
