"""The measured quality of charts on disk, and the exposure with the most information."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from blurnoise.optics.camera import Camera
from blurnoise_eval.grid.axes import NAMES, SETTING, axis, setting_of, velocity_of, velocity_text
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.quality import measure
from blurnoise_eval.quality.measure import METRICS, Row
from blurnoise_eval.system.files import write_records

_BEST = ("exposure_s", "blur_px", "value", "low", "high")


def write(rows: Sequence[Row], camera: Camera, plan: SweepPlan, folder: Path) -> None:
    """Write quality.csv, a row per condition and metric, and quality.json, that and its meaning; ``OSError``."""
    records = [row.record() for row in rows]
    document = {
        "camera": camera.to_dict(),
        "plan": plan.to_dict(),
        "charts": {
            "dark": measure.DARK,
            "bright": measure.BRIGHT,
            "edge_tilt_deg": measure.TILT_DEG,
            "edge_region_px": [measure.ACROSS_PX, measure.ALONG_PX],
            "patch_px": measure.PATCH_PX,
            "sign_px": measure.SIGN_PX,
        },
        "metrics": {
            metric.name: {name: getattr(metric, name) for name in ("name", "title", "unit", "about")}
            for metric in METRICS
        },
        "most_information": most_information(rows),
        "rows": records,
    }
    write_records("quality", records, document, folder)


def most_information(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """For every setting and velocity the exposure with the highest capacity of the square, if any is told."""
    best: dict[tuple[float, ...], dict[str, Any]] = {}
    of_square = [row for row in rows if row.metric == "sic_square"]
    for row in sorted(of_square, key=lambda row: row.at["exposure_s"]):
        where = {name: row.at[name] for name in NAMES if name != "exposure_s"}
        before = best.setdefault(tuple(where.values()), where | dict.fromkeys(_BEST))
        if row.estimate.told and row.estimate.value > (before["value"] or -1):
            record = row.record()
            before |= {name: record[name] for name in _BEST}
    return [best[key] for key in sorted(best)]


def as_table(best: Sequence[dict[str, Any]]) -> Table:
    """The rows of :func:`most_information` for the terminal."""
    table = Table(title="Exposure with the highest information capacity (square)", title_justify="left")
    named = varying(best)
    for name in named:
        unit = axis(name).unit
        head = "lux" if name == "illuminance_lux" else f"{axis(name).title}{unit and f', {unit}'}"
        table.add_column(head, justify="right")
    table.add_column("motion")
    for head in ("exposure, ms", "blur, px", "bits/px (95 %)"):
        table.add_column(head, justify="right")
    for row in best:
        told = ["none told", "-", "-"]
        if row["value"] is not None:
            bits = f"{row['value']:.2f} ({row['low']:.2f}-{row['high']:.2f})"
            told = [f"{1e3 * row['exposure_s']:g}", f"{row['blur_px']:.3g}", bits]
        setting = [f"{axis(name).shown(row[name]):g}" for name in named]
        table.add_row(*setting, velocity_text(velocity_of(row)), *told)
    return table


def varying(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """The light, and the other axes of a setting on which the rows differ."""
    columns = zip(SETTING, zip(*{setting_of(row) for row in rows}, strict=True), strict=False)
    return [name for name, column in columns if len(set(column)) > 1 or name == "illuminance_lux"]
