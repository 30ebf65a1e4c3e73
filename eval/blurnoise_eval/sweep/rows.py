"""Rows of the store: what a model answered to one cell's picture, in columns."""

from __future__ import annotations

import numpy as np
import torch

from blurnoise.optics.camera import Camera
from blurnoise_eval.grid.axes import NAMES, blur_px
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Sight
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.exposing import Frame


def cell_result(
    frame: Frame,
    model: str,
    camera: Camera,
    sight: Sight,
    example: str | None,
    example_png: bytes | None,
    source: tuple[str, str, int, int, str] | None = None,
) -> CellResult:
    """The rows of one cell and model. example: where the frame is kept in the run's folder, as PNG. source: what of
    the picture the store notes."""
    cell, at, taken = frame.cell, frame.cell.conditions, frame.exposure
    shared = {
        "cell_id": cell.cell_id,
        "model": model,
        "camera": camera.name,
        "image": cell.image,
        "repeat": cell.repeat,
        "clean": at is None,
        **(dict.fromkeys(NAMES) if at is None else at.on(camera)),
        "blur_px": taken and at and blur_px({**at.stated, "exposure_s": taken.exposure_s}),
    }
    rows = [{**shared, **row, "invented_share": None} for row in sight.targets]
    if taken is not None and taken.drives and rows:
        height, width = frame.image.shape[:2]
        middles = torch.tensor([[row["x0"] + row["x1"], row["y0"] + row["y1"]] for row in rows]).double() / 2
        blurs = torch.linalg.vector_norm(taken.displacements_px(middles, (height, width)), dim=1).tolist()
        rows = [{**row, "blur_px": blur} for row, blur in zip(rows, blurs, strict=True)]
    for row in rows if at is not None else ():
        row["invented_share"] = frame.invented.get(row["target_id"], 0.0)
        row["blur_px"] = frame.own_px.get(row["target_id"], row["blur_px"])
    invented = [row["invented_share"] for row in rows]
    confidences = np.array([row["confidence"] for row in rows])
    summary = {
        "seed": cell.seed,
        "n_targets": len(rows),
        "target_confidence": float(confidences.mean()) if rows else None,
        "detection_rate": float((confidences >= FOUND_SCORE).mean()) if rows else None,
        "n_detections": len(sight.detections.leading),
        "saturated": frame.saturated,
        "applied_exposure_s": taken and taken.exposure_s,
        "applied_gain_db": taken and taken.gain_db,
        "snr_db": frame.snr_db,
        "brightness": frame.brightness,
        "invented_share": (float(np.mean(invented)) if any(invented) else 0.0) if rows and at else None,
        "simulate_ms": frame.simulate_ms,
        "infer_ms": sight.infer_ms,
        "error": sight.error,
        "example": example,
    }
    values = sight.non_finite_values
    return CellResult({**shared, **summary}, tuple(rows), sight.detections, example_png, values, source)
