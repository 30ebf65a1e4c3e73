"""The explorer's drawings, as SVG and HTML of their own size: boxes over a picture, histogram, strip, heat map.

Colours are the page's variables, so that light and dark need no other drawing. Everything that comes from files is
escaped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from blurnoise.scene.plan import Plan
from blurnoise_eval.drawing.annotate import MOST_BOXES, OTHER_SCORE
from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Stop
from blurnoise_eval.explorer.runs import HeatMap
from blurnoise_eval.grid.axes import Axis
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import MATCH_IOU
from blurnoise_eval.scoring.on_picture import Sight

_WIDE, _HIGH = 640, 150
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 10, 10, 24
Curve = Sequence[Stop]


def boxes(sight: Sight | None, size: tuple[int, int], threshold: float, classes: Sequence[str] = ()) -> str:
    """Targets as found or missed, with their confidence, and what else is found, for a picture (H, W)."""
    if sight is None:
        return ""
    height, width = size
    drawn = []
    scale = max(width, height) / 420
    targets = sorted(sight.targets, key=lambda row: -row["width_px"] * row["height_px"])[:MOST_BOXES]
    places = [[row["x0"], row["y0"], row["x1"], row["y1"]] for row in targets]
    leading = sight.detections.leading
    rows = zip(leading.boxes_xyxy.tolist(), leading.scores.tolist(), leading.class_ids.tolist(), strict=True)
    others = [row for row in rows if row[1] >= OTHER_SCORE][:MOST_BOXES]
    for box, score, class_id in others:
        if not (iou([box], places) >= MATCH_IOU).any():
            label = classes[class_id] if class_id < len(classes) else str(class_id)
            drawn.append(_box(box, "other", f"{label[:24]} {score:.2f}", scale, size))
    for row, place in zip(targets, places, strict=True):
        found = row["confidence"] >= threshold
        read = row.get("text")
        text = f"{row['confidence']:.2f}" if read is None else f'"{read[:24]}"'
        drawn.append(_box(place, "found" if found else "missed", text, scale, size))
    return f'<svg viewBox="0 0 {width} {height}" preserveAspectRatio="none" aria-hidden="true">{"".join(drawn)}</svg>'


def _box(box: Sequence[float], kind: str, text: str, scale: float, size: tuple[int, int]) -> str:
    x0, y0, x1, y1 = (min(max(edge, -1e5), 1e5) for edge in box)
    font, wide = 12 * scale, (len(text) * 6.7 + 7) * scale
    x = min(max(0.0, x0), max(0.0, size[1] - wide))
    above = y0 >= font * 1.4
    y = y0 - font * 1.35 if above else min(y1, size[0] - font * 1.35)
    return (
        f'<g class="{kind}"><rect class="frame" x="{x0:.1f}" y="{y0:.1f}" width="{max(0.0, x1 - x0):.1f}" '
        f'height="{max(0.0, y1 - y0):.1f}" vector-effect="non-scaling-stroke"/>'
        f'<rect class="tag" x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{font * 1.35:.1f}" rx="{scale:.1f}"/>'
        f'<text x="{x + 3.5 * scale:.1f}" y="{y + font:.1f}" font-size="{font:.1f}">{escape(text)}</text></g>'
    )


def histogram(shares: NDArray[np.float64], clipped: tuple[float, float]) -> str:
    """Three colours' shares over the values 0-255, as roots, and what is clipped at either end."""
    wide, high = 256, 72
    top = max(float(np.sqrt(shares).max()), 1e-9)
    paths = []
    for colour, row in zip(("red", "green", "blue"), np.sqrt(shares) / top, strict=True):
        step = wide / len(row)
        line = " ".join(
            f"H{(place + 1) * step:.1f}V{high - high * float(value):.1f}" for place, value in enumerate(row)
        )
        first = high - high * float(row[0])
        body = line.split(" ", 1)[1] if len(row) > 1 else ""
        paths.append(f'<path class="{colour}" d="M0 {high}V{first:.1f}H{step:.1f} {body} V{high}Z"/>')
    ends = []
    for side, share in (("low", clipped[0]), ("high", clipped[1])):
        x = 0 if side == "low" else wide - 3
        lit = " lit" if share > 1e-4 else ""
        ends.append(f'<rect class="end{lit}" x="{x}" y="0" width="3" height="{high}"/>')
    told = f"{_percent(clipped[0])} at black, {_percent(clipped[1])} clipped"
    return (
        f'<svg class="histogram" viewBox="0 0 {wide} {high}" preserveAspectRatio="none" role="img" '
        f'aria-label="Histogram: {told}">{"".join(paths)}{"".join(ends)}</svg>'
        f'<div class="ends"><span>{_percent(clipped[0])} black</span>'
        f"<span>{_percent(clipped[1])} clipped</span></div>"
    )


def strip(curve: Curve, along: Control, at: float, enough: float, kept: tuple[float, float] | None) -> str:
    """Scores along a control, with what is enough, where that is reached, and where the slider stands; clicked, it
    goes there."""
    wide, high = _WIDE - _LEFT - _RIGHT, _HIGH - _TOP - _BOTTOM

    def x(value: float) -> float:
        if along.choices:
            return _LEFT + wide * (value + 0.5) / len(along.choices)
        return _LEFT + wide * along.position(value) / along.position(along.high)

    def y(share: float) -> float:
        return _TOP + high * (1 - share)

    parts = [
        f'<line class="grid" x1="{_LEFT}" x2="{_LEFT + wide}" y1="{y(s):.1f}" y2="{y(s):.1f}"/>'
        for s in (0, 0.5, 1)
    ]
    parts += [
        f'<text class="tick" x="{_LEFT - 6}" y="{y(s) + 4:.1f}" text-anchor="end">{s:g}</text>'
        for s in (0, 0.5, 1)
    ]
    ticks = (
        [(float(place), name) for place, name in enumerate(along.choices)]
        if along.choices
        else [(value, f"{value:g}") for value in _ticks(along)]
    )
    parts += [
        f'<text class="tick" x="{min(x(value), _WIDE - 14):.1f}" y="{_HIGH - 7}" text-anchor="middle">'
        f"{escape(text)}</text>"
        for value, text in ticks
    ]
    if kept:
        left, right = x(kept[0]), x(kept[1])
        parts.append(
            f'<rect class="kept" x="{left - 3:.1f}" y="{_TOP}" width="{right - left + 6:.1f}" height="{high}"/>'
        )
    parts.append(
        f'<line class="threshold" x1="{_LEFT}" x2="{_LEFT + wide}" y1="{y(enough):.1f}" y2="{y(enough):.1f}"/>'
    )
    for target in zip(*(stop.scores for stop in curve if stop.scores), strict=False):
        values = [stop.value for stop in curve if stop.scores]
        if not along.choices and len(curve[0].scores) > 1:
            line = " ".join(
                f"{x(value):.1f},{y(held):.1f}" for value, held in zip(values, target, strict=True)
            )
            parts.append(f'<polyline class="target" points="{line}"/>')
    told = [(stop.value, stop.mean) for stop in curve if stop.mean is not None]
    if told and not along.choices:
        line = " ".join(f"{x(value):.1f},{y(held):.1f}" for value, held in told)
        parts.append(f'<polyline class="curve" points="{line}"/>')
    for value, held in told:
        kind = "dot" if held >= enough else "dot under"
        title = f"<title>{escape(along.text(value))}: {held:.2f}</title>"
        parts.append(
            f'<circle class="{kind}" cx="{x(value):.1f}" cy="{y(held):.1f}" r="3.4">{title}</circle>'
        )
    if math.isfinite(at):
        parts.append(
            f'<line class="here" x1="{x(at):.1f}" x2="{x(at):.1f}" y1="{_TOP - 4}" y2="{_TOP + high + 4}"/>'
        )
    label = f"Confidence along {along.title}"
    return (
        f'<svg class="strip" viewBox="0 0 {_WIDE} {_HIGH}" role="img" aria-label="{escape(label)}" '
        f'data-left="{_LEFT / _WIDE:.4f}" data-right="{(_LEFT + wide) / _WIDE:.4f}">{"".join(parts)}</svg>'
    )


def _ticks(along: Control) -> list[float]:
    """Round numbers: decades, or six even ones."""
    if along.logarithmic:
        first, last = math.ceil(math.log10(along.low) - 1e-9), math.floor(math.log10(along.high) + 1e-9)
        if last - first >= 2:
            return [10.0**power for power in range(first, last + 1)]
        return along.stops(5)
    rough = (along.high - along.low) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(each * power for each in (1, 2, 2.5, 5, 10) if each * power >= rough * 0.999)
    first = math.ceil(along.low / step)
    return [round(place * step, 9) for place in range(first, math.floor(along.high / step + 1e-9) + 1)]


def heat_map(found: HeatMap, chosen: str = "") -> str:
    """A run's mean confidences as buttons; each has its place, "row,column". chosen: of the cell that is seen."""
    head = "".join(f'<th scope="col">{escape(_plain(found.across, value))}</th>' for value in found.columns)
    rows = []
    for row, (value, line) in enumerate(zip(found.rows, found.values, strict=True)):
        name = _plain(found.down, value) if found.down else ""
        cells = []
        for column, held in enumerate(line):
            place = f"{row},{column}"
            if held is None:
                cells.append("<td></td>")
                continue
            at = found.across.text(found.columns[column]) + (
                f", {found.down.text(value)}" if found.down else ""
            )
            pressed = ' aria-pressed="true"' if place == chosen else ""
            dark = " deep" if held > 0.55 else ""
            cells.append(
                f'<td><button type="button" class="cell{dark}" data-place="{place}" style="--held:{held:.3f}"'
                f"{pressed} "
                f'aria-label="{escape(at)}: {held:.2f}" title="{escape(at)}">{held:.2f}</button></td>'
            )
        rows.append(f'<tr><th scope="row">{escape(name)}</th>{"".join(cells)}</tr>')
    across = escape(f"{found.across.title}{_unit(found.across)}")
    down = f"down: {escape(found.down.title)}{_unit(found.down)}; " if found.down else ""
    return (
        f'<table class="heat"><caption>{down}across: {across}</caption>'
        f"<thead><tr><td></td>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    )


def _plain(axis: Axis | None, value: float) -> str:
    if axis is None:
        return ""
    return axis.text(value) if axis.choices or math.isinf(value) else f"{axis.shown(value):.4g}"


def _unit(axis: Axis) -> str:
    return escape(f", {axis.unit}") if axis.unit else ""


def plan_table(plan: Plan) -> str:
    """What every part of the chain would contribute, and whether it is modelled, and how or why not."""
    rows = "".join(
        f'<tr class="{"kept" if each.kept else "left"}"><th scope="row">{escape(each.name)}</th>'
        f"<td>{_dn(each.contribution_dn)}</td><td>{escape(each.how)}</td></tr>"
        for each in plan.stages
    )
    return (
        '<table class="plan"><thead><tr><th>part of the chain</th><th>DN RMS, at most</th><th>what is done</th></tr>'
        f"</thead><tbody>{rows}</tbody></table>"
        f"<p>Left out in all: {_dn(plan.left_out_dn)} of {plan.tolerance_dn:.3g} DN RMS allowed.</p>"
    )


def _dn(value: float) -> str:
    return "0" if value == 0 else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _percent(share: float) -> str:
    return "0 %" if share == 0 else "< 0.01 %" if share < 1e-4 else f"{100 * share:.2g} %"
