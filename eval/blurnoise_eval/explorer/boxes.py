"""Boxes over a picture, as SVG: targets found and missed, and what else is found. Texts from files are escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from blurnoise_eval.plots.annotate import MOST_BOXES, OTHER_SCORE
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import MATCH_IOU
from blurnoise_eval.scoring.on_picture import Sight


def boxes(sight: Sight | None, size: tuple[int, int], found_from: float, classes: Sequence[str] = ()) -> str:
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
        read = row.get("text")
        text = f"{row['confidence']:.2f}" if read is None else f'"{read[:24]}"'
        drawn.append(_box(place, kind, text, size))
    height, width = size  # of its own, since a smaller picture may lie below
    return (
        f'<svg class="boxes" viewBox="0 0 {width} {height}" width="100%" height="100%" preserveAspectRatio="none">'
        f"{''.join(drawn)}</svg>"
    )


def _box(box: Sequence[float], kind: str, text: str, size: tuple[int, int]) -> str:
    height, width = size
    scale = max(width, height) / 420
    x0, y0, x1, y1 = (min(max(edge, -1e5), 1e5) for edge in box)
    font, wide = 12 * scale, (len(text) * 6.7 + 7) * scale
    x = min(max(0.0, x0), max(0.0, width - wide))
    y = y0 - font * 1.35 if y0 >= font * 1.4 else min(y1, height - font * 1.35)
    return (
        f'<g class="{kind}"><rect class="frame" x="{x0:.1f}" y="{y0:.1f}" width="{max(0.0, x1 - x0):.1f}" '
        f'height="{max(0.0, y1 - y0):.1f}" vector-effect="non-scaling-stroke"/>'
        f'<rect class="tag" x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{font * 1.35:.1f}" rx="{scale:.1f}"/>'
        f'<text x="{x + 3.5 * scale:.1f}" y="{y + font:.1f}" font-size="{font:.1f}">{escape(text)}</text></g>'
    )
