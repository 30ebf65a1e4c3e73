"""What the page draws: boxes over a picture as SVG, and charts as options of Apache ECharts.

Texts from files are escaped. Colours are readable on light and dark.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from blurnoise_eval.explorer.rendered import Point
from blurnoise_eval.explorer.run import HeatMap
from blurnoise_eval.explorer.state import Control
from blurnoise_eval.grid.axes import Axis
from blurnoise_eval.plots.annotate import MOST_BOXES, OTHER_SCORE
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import MATCH_IOU
from blurnoise_eval.scoring.on_picture import ModelOutput

_INK, _ACCENT, _GOOD = "#7c8894", "#2584ad", "#12803f2b"
_QUIET: dict[str, Any] = {"animation": False, "textStyle": {"color": _INK}}


def boxes(
    sight: ModelOutput | None, size: tuple[int, int], found_from: float, classes: Sequence[str] = ()
) -> str:
    """Targets with their confidence, found from ``found_from`` on, and what else is found, for a picture (H, W)."""
    if sight is None:
        return ""
    targets = sorted(sight.targets, key=lambda row: -row["width_px"] * row["height_px"])[:MOST_BOXES]
    places = [[row["x0"], row["y0"], row["x1"], row["y1"]] for row in targets]
    leading = sight.detections.leading
    rows = zip(leading.boxes_xyxy.tolist(), leading.scores.tolist(), leading.class_ids.tolist(), strict=True)
    drawn = []
    for box, score, class_id in [row for row in rows if row[1] >= OTHER_SCORE][:MOST_BOXES]:
        if not (iou([box], places) >= MATCH_IOU).any():
            label = classes[class_id] if class_id < len(classes) else str(class_id)
            drawn.append(_box(box, "other", f"{label[:24]} {score:.2f}", size))
    for row, place in zip(targets, places, strict=True):
        kind = "found" if row["confidence"] >= found_from else "missed"
        text = f"{row['confidence']:.2f}" if row.get("text") is None else f'"{row["text"][:24]}"'
        drawn.append(_box(place, kind, text, size))
    height, width = size  # of its own, since a smaller picture may lie below
    return (
        f'<svg class="boxes" viewBox="0 0 {width} {height}" width="100%" height="100%" preserveAspectRatio="none">'
        f"{''.join(drawn)}</svg>"
    )


def _box(box: Sequence[float], kind: str, text: str, size: tuple[int, int]) -> str:
    font = max(size) / 32
    x0, y0, x1, y1 = (min(max(edge, -1e5), 1e5) for edge in box)
    y = y0 - 0.3 * font if y0 > 1.3 * font else y1 + font
    return (
        f'<g class="{kind}"><rect x="{x0:.1f}" y="{y0:.1f}" width="{max(0.0, x1 - x0):.1f}" '
        f'height="{max(0.0, y1 - y0):.1f}" vector-effect="non-scaling-stroke"/>'
        f'<text x="{max(0.0, x0):.1f}" y="{y:.1f}" font-size="{font:.1f}">{escape(text)}</text></g>'
    )


def scores(
    curve: Sequence[Point], along: Control, at: float, enough: float, window: tuple[float, float] | None
) -> dict[str, Any]:
    """Mean scores along a control. at: where the control stands; enough: the level; window: where the mean is
    enough."""
    lines: list[dict[str, Any]] = [{"yAxis": enough, "lineStyle": {"type": "dashed"}}]
    lines += [{"xAxis": at, "lineStyle": {"type": "solid", "width": 2}}] if math.isfinite(at) else []
    mean = {
        "type": "scatter" if along.choices else "line",
        "data": [[point.value, point.mean] for point in curve],
        "symbolSize": 7,
        "color": _ACCENT,
        "markLine": {"symbol": "none", "label": {"show": False}, "lineStyle": {"color": _INK}, "data": lines},
        "markArea": {
            "itemStyle": {"color": _GOOD},
            "data": [[{"xAxis": window[0]}, {"xAxis": window[1]}]] if window else [],
        },
    }
    x: dict[str, Any] = {"type": "category", "data": list(along.choices)}
    if not along.choices:
        x = {"type": "log" if along.logarithmic else "value", "min": along.low, "max": along.high}
    return {
        **_QUIET,
        "grid": {"left": 34, "right": 16, "top": 8, "bottom": 24},
        "tooltip": {"trigger": "item"},
        "xAxis": {**x, "splitLine": {"show": False}},
        "yAxis": {"min": 0, "max": 1, "interval": 0.5},
        "series": [mean],
    }


def heat_map(found: HeatMap, at: Mapping[str, float | None] | None) -> dict[str, Any]:
    """Mean confidences of a run as cells to click. at: the conditions of the cell that is shown."""
    data = []
    for place, mean in found.cells.items():
        there = at and all(at[name] in (None, value) for name, value in found.condition(*place).items())
        border = {"borderColor": "#d4622a", "borderWidth": 3} if there else {}
        data.append({"value": [*place, round(mean, 3)], "itemStyle": border})
    return {
        **_QUIET,
        "grid": {"left": 90, "right": 16, "top": 8, "bottom": 44},
        "tooltip": {},
        "xAxis": _ticks(found.across, found.columns, 28),
        "yAxis": _ticks(found.down, found.rows, 66),
        "visualMap": {"min": 0, "max": 1, "show": False, "inRange": {"color": ["#eef4f8", "#0b6e99"]}},
        "series": [{"type": "heatmap", "data": data, "label": {"show": True}}],
    }


def _ticks(axis: Axis | None, values: Sequence[float], gap: int) -> dict[str, Any]:
    names = [axis.text(value) for value in values] if axis else [""]
    title = axis.title if axis else ""
    return {"type": "category", "data": names, "name": title, "nameLocation": "middle", "nameGap": gap}
