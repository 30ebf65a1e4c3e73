"""What the page draws: boxes over a picture as SVG, and the curve as options of Apache ECharts.

Texts from files are escaped. Colours are readable on light and dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from blurnoise_eval.explorer.rendered import Point, Rendered, window
from blurnoise_eval.plots.annotate import MOST_BOXES, OTHER_SCORE
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU
from blurnoise_eval.scoring.on_picture import ModelOutput

_INK, _ACCENT, _GOOD = "#7c8894", "#2584ad", "#12803f2b"


def boxes(found: Rendered, sight: ModelOutput | None) -> str:
    """Targets with their confidence, found and missed, and what else a detector finds in the picture or, where
    ``sight`` is of that, in the original."""
    if sight is None:
        return ""
    size = height, width = found.frame.image.shape[:2]  # of its own, since a smaller picture may lie below
    targets = sorted(sight.targets, key=lambda row: -row["width_px"] * row["height_px"])[:MOST_BOXES]
    places = [[row["x0"], row["y0"], row["x1"], row["y1"]] for row in targets]
    leading = sight.detections.leading
    rows = zip(leading.boxes_xyxy.tolist(), leading.scores.tolist(), leading.class_ids.tolist(), strict=True)
    drawn = [
        _box(box, "other", f"{found.classes[class_id][:24]} {score:.2f}", size)
        for box, score, class_id in [row for row in rows if row[1] >= OTHER_SCORE][:MOST_BOXES]
        if not (iou([box], places) >= MATCH_IOU).any()
    ]
    for row, place in zip(targets, places, strict=True):
        kind = "found" if row["confidence"] >= FOUND_SCORE else "missed"
        drawn.append(_box(place, kind, f"{row['confidence']:.2f}", size))
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


def confidences(curve: Sequence[Point], at_ms: float, required: float) -> dict[str, Any]:
    """Mean confidences along the exposure. at_ms: of the picture; required: the level."""
    works = window(curve, required, at_ms)
    lines = [
        {"yAxis": required, "lineStyle": {"type": "dashed"}},
        {"xAxis": at_ms, "lineStyle": {"type": "solid", "width": 2}},
    ]
    area = [[{"xAxis": works[0]}, {"xAxis": works[1]}]] if works else []
    mean = {
        "type": "line",
        "data": [[point.exposure_ms, point.mean] for point in curve],
        "symbolSize": 7,
        "color": _ACCENT,
        "markLine": {"symbol": "none", "label": {"show": False}, "lineStyle": {"color": _INK}, "data": lines},
        "markArea": {"itemStyle": {"color": _GOOD}, "data": area},
    }
    ends = {"min": curve[0].exposure_ms, "max": curve[-1].exposure_ms}
    return {
        "animation": False,
        "textStyle": {"color": _INK},
        "grid": {"left": 34, "right": 16, "top": 8, "bottom": 24},
        "tooltip": {"trigger": "item"},
        "xAxis": {"type": "log", **ends, "splitLine": {"show": False}, "axisLabel": {"hideOverlap": True}},
        "yAxis": {"min": 0, "max": 1, "interval": 0.5},
        "series": [mean],
    }
