"""The first figure of a page: what is kept against exposure, a line per speed, as SVG in the page's colours.

Domain: exposures in s, drawn logarithmically in ms; values in the criterion's unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from markupsafe import Markup

from blurnoise_eval.grid.axes import EXPOSURE, milliseconds
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import spread
from blurnoise_eval.report.words import title_text
from blurnoise_eval.scoring.crossings import windows

MAX_LINES, MAX_TICKS = 4, 9
WIDTH, HEIGHT = 560, 340
Row = dict[str, Any]
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 14, 40, 46
_ROOM = 0.06  # of the log range, on either side


def kept_curve(data: RunData, model: str) -> Markup | None:
    """An ``<svg>`` of the mean over lights and targets, with the recommended exposure and its window.

    Shaded: where the mean over all speeds is at or above the level. Bands: 95 % intervals. None for fewer than two
    exposures on a scale.
    """
    rows = [row for row in data.averages if row["model"] == model]
    whole = next((row for row in rows if row["speed"] is None), None)
    x = [] if whole is None else whole["exposures_s"]
    if whole is None or len(x) < 2 or not all(map(math.isfinite, x)):
        return None
    lines = spread_rows([row for row in rows if row["speed"] is not None])
    top = max(1.0, *(max(row["values"]) for row in lines)) * 1.04
    first, last = math.log(x[0]), math.log(x[-1])
    room = _ROOM * (last - first)

    def across(exposure_s: float) -> float:
        share = (math.log(exposure_s) - first + room) / (last - first + 2 * room)
        return _LEFT + share * (WIDTH - _LEFT - _RIGHT)

    def up(value: float) -> float:
        return float(HEIGHT - _BOTTOM - value / top * (HEIGHT - _TOP - _BOTTOM))

    def points(exposures: Sequence[float], values: Sequence[float]) -> str:
        return " ".join(f"{across(e):.1f},{up(v):.1f}" for e, v in zip(exposures, values, strict=True))

    level, base = data.criterion.level, HEIGHT - _BOTTOM
    parts = []
    for low, high in windows(x, whole["values"], level):
        width = max(across(high) - across(low), 2.0)
        parts.append(
            f'<rect class="window" x="{across(low):.1f}" y="{_TOP}" width="{width:.1f}" height="{base - _TOP}"/>'
        )
    for value in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        parts.append(
            f'<line class="grid" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{up(value):.1f}" y2="{up(value):.1f}"/>'
            f'<text x="{_LEFT - 6}" y="{up(value) + 4:.1f}" text-anchor="end">{value:g}</text>'
        )
    for exposure in _ticks(x):
        parts.append(
            f'<text x="{across(exposure):.1f}" y="{base + 18}" text-anchor="middle">{milliseconds(exposure)}</text>'
        )
    parts.append(
        f'<line class="level" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{up(level):.1f}" y2="{up(level):.1f}"/>'
    )
    for place, row in enumerate(lines):
        known = [all(map(math.isfinite, ends)) for ends in zip(row["low"], row["high"], strict=True)]
        if all(known):
            there = points(row["exposures_s"], row["low"])
            back = points(row["exposures_s"][::-1], row["high"][::-1])
            parts.append(f'<polygon class="band c{place}" points="{there} {back}"/>')
    for place, row in enumerate(lines):
        parts.append(
            f'<polyline class="line c{place}" points="{points(row["exposures_s"], row["values"])}"/>'
        )
        parts += [
            f'<circle class="dot c{place}" cx="{across(e):.1f}" cy="{up(v):.1f}" r="2.6"/>'
            for e, v in zip(row["exposures_s"], row["values"], strict=True)
        ]
    chosen = next(
        (r["exposure_s"] for r in data.recommendations if (r["model"], r["scope"]) == (model, "all")), None
    )
    if chosen is not None:
        at = across(chosen)
        anchor = "end" if at > WIDTH / 2 else "start"
        beside = at - 5 if anchor == "end" else at + 5
        parts.append(
            f'<line class="chosen" x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP}" y2="{base}"/>'
            f'<text class="strong" x="{beside:.1f}" y="{base - 8}" text-anchor="{anchor}">'
            f"{EXPOSURE.text(chosen)}</text>"
        )
    parts.append(
        f'<text x="{(_LEFT + WIDTH - _RIGHT) / 2:.0f}" y="{HEIGHT - 8}" text-anchor="middle">Exposure / ms</text>'
    )
    return Markup(
        f'<svg class="kept" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{{}} against exposure">'
        f'<text class="strong" x="{_LEFT - 30}" y="14">{{}}, mean over lights and targets</text>'
        f"{_legend(data, lines)}{''.join(parts)}</svg>"
    ).format(title_text(data.criterion), title_text(data.criterion))


def spread_rows(rows: Sequence[Row]) -> list[Row]:
    """At most ``MAX_LINES`` of them, evenly spread."""
    return [rows[place] for place in spread(range(len(rows)), MAX_LINES)]


def _legend(data: RunData, lines: Sequence[Row]) -> str:
    parts = []
    for place, row in enumerate(lines):
        x = _LEFT + place * (WIDTH - _LEFT - _RIGHT) / MAX_LINES
        name = data.speed.text(row["speed"]) if row["speed"] else "at rest"
        parts.append(f'<line class="line c{place}" x1="{x:.0f}" x2="{x + 18:.0f}" y1="28" y2="28"/>')
        parts.append(f'<text x="{x + 24:.0f}" y="32">{name}</text>')
    return "".join(parts)


def _ticks(exposures_s: Sequence[float]) -> list[float]:
    """Tested exposures with room between their labels: neighbours at least a ninth of the range apart."""
    least = math.log(exposures_s[-1] / exposures_s[0]) / MAX_TICKS
    kept = [exposures_s[0]]
    for before, here in pairwise(exposures_s):
        if math.log(here / kept[-1]) >= least and here > before:
            kept.append(here)
    return kept
