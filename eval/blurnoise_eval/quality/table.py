"""The measured quality of charts on disk, and the exposure at which the picture tells most."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.quality.measure import (
    ACROSS_PX,
    ALONG_PX,
    BRIGHT,
    DARK,
    METRICS,
    PATCH_PX,
    SIGN_PX,
    TILT_DEG,
    Row,
)
from blurnoise_eval.system.files import write_records


def most_information(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """For every setting and velocity the exposure with the highest capacity of the square, if any is told."""
    best: dict[tuple[float, ...], dict[str, Any]] = {}
    for row in sorted(rows, key=lambda row: row.at["exposure_s"]):
        if row.metric != "sic_square":
            continue
        record = row.record()
        told = {name: record[name] for name in ("exposure_s", "blur_px", "value", "low", "high")}
        where = {name: record[name] for name in NAMES if name != "exposure_s"}
        key = tuple(where.values())
        if key not in best or (row.estimate.told and row.estimate.value > (best[key]["value"] or -1)):
            best[key] = where | (told if row.estimate.told else dict.fromkeys(told))
    return [best[key] for key in sorted(best)]


def write(rows: Sequence[Row], camera: Camera, plan: SweepPlan, folder: Path) -> None:
    """Write quality.csv, a row per condition and metric, and quality.json, that and what it means; ``OSError``."""
    records = [row.record() for row in rows]
    document = {
        "camera": camera.to_dict(),
        "plan": plan.to_dict(),
        "charts": {
            "dark": DARK,
            "bright": BRIGHT,
            "edge_tilt_deg": TILT_DEG,
            "edge_region_px": [ACROSS_PX, ALONG_PX],
            "patch_px": PATCH_PX,
            "sign_px": SIGN_PX,
        },
        "metrics": {metric.name: metric.facts() for metric in METRICS},
        "most_information": most_information(rows),
        "rows": records,
    }
    write_records("quality", records, document, folder)
