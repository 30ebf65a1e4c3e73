"""The first figure of a page: what is kept against exposure, a line per speed, as SVG in the page's colours.

Domain: exposures in s, drawn logarithmically in ms; values in the criterion's unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from markupsafe import Markup, escape

from blurnoise_eval.answers.crossings import windows
from blurnoise_eval.grid.axes import EXPOSURE, milliseconds
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.words import title_text

MAX_LINES, MAX_TICKS = 4, 9
WIDTH, HEIGHT = 560, 340
LEFT, RIGHT, TOP, BASE = 44, WIDTH - 14, 40, HEIGHT - 46  # the axes' frame
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
    of_speeds = [row for row in rows if row["speed"] is not None]
    lines = [of_speeds[place] for place in spread(range(len(of_speeds)), MAX_LINES)]
    room = _ROOM * math.log(x[-1] / x[0])
    frame = _Frame(
        math.log(x[0]) - room,
        math.log(x[-1]) + room,
        1.04 * max(1.0, *(max(row["values"]) for row in lines)),
    )
    title, level = title_text(data.criterion), frame.up(data.criterion.level)
    chosen = next(
        (r["exposure_s"] for r in data.recommendations if (r["model"], r["scope"]) == (model, "all")), None
    )
    parts = [_text(LEFT - 30, 14, f"{title}, mean over lights and targets", "start", "strong")]
    for place, row in enumerate(lines):
        at = LEFT + place * (RIGHT - LEFT) / MAX_LINES
        parts.append(_line(f"line c{place}", at, 28, at + 18, 28))
        parts.append(
            _text(at + 24, 32, data.speed.text(row["speed"]) if row["speed"] else "at rest", "start")
        )
    for low, high in windows(x, whole["values"], data.criterion.level):
        start, width = frame.across(low), max(frame.across(high) - frame.across(low), 2.0)
        parts.append(
            f'<rect class="window" x="{start:.1f}" y="{TOP}" width="{width:.1f}" height="{BASE - TOP}"/>'
        )
    for value in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        parts.append(_line("grid", LEFT, frame.up(value), RIGHT, frame.up(value)))
        parts.append(_text(LEFT - 6, frame.up(value) + 4, f"{value:g}", "end"))
    parts += [_text(frame.across(each), BASE + 18, milliseconds(each), "middle") for each in _ticks(x)]
    parts.append(_line("level", LEFT, level, RIGHT, level))
    for place, row in enumerate(lines):
        if all(map(math.isfinite, (*row["low"], *row["high"]))):
            there, back = frame.places(row, "low"), frame.places(row, "high")[::-1]
            parts.append(f'<polygon class="band c{place}" points="{_points(there + back)}"/>')
    for place, row in enumerate(lines):
        there = frame.places(row, "values")
        parts.append(f'<polyline class="line c{place}" points="{_points(there)}"/>')
        parts += [f'<circle class="dot c{place}" cx="{a:.1f}" cy="{b:.1f}" r="2.6"/>' for a, b in there]
    if chosen is not None:
        at, right = frame.across(chosen), frame.across(chosen) > WIDTH / 2
        parts.append(_line("chosen", at, TOP, at, BASE))
        beside, anchor = (at - 5, "end") if right else (at + 5, "start")
        parts.append(_text(beside, BASE - 8, EXPOSURE.text(chosen), anchor, "strong"))
    parts.append(_text((LEFT + RIGHT) / 2, HEIGHT - 8, "Exposure / ms", "middle"))
    head = f'<svg class="kept" viewBox="0 0 {WIDTH} {HEIGHT}" role="img"'
    return Markup(f"""{head} aria-label="{escape(title)} against exposure">{"".join(parts)}</svg>""")


@dataclass(frozen=True)
class _Frame:
    """The axes: logarithms of s from ``first`` to ``last`` across, values from 0 to ``top`` upwards."""

    first: float
    last: float
    top: float

    def across(self, exposure_s: float) -> float:
        return LEFT + (math.log(exposure_s) - self.first) / (self.last - self.first) * (RIGHT - LEFT)

    def up(self, value: float) -> float:
        return BASE - value / self.top * (BASE - TOP)

    def places(self, row: dict[str, Any], name: str) -> list[tuple[float, float]]:
        return [(self.across(e), self.up(v)) for e, v in zip(row["exposures_s"], row[name], strict=True)]


def _points(places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def _line(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" x2="{x2:.1f}" y1="{y1:.1f}" y2="{y2:.1f}"/>'


def _text(x: float, y: float, text: str, anchor: str, kind: str = "") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _ticks(exposures_s: Sequence[float]) -> list[float]:
    """Tested exposures with room between their labels: neighbours at least a ninth of the range apart."""
    least = math.log(exposures_s[-1] / exposures_s[0]) / MAX_TICKS
    kept = [exposures_s[0]]
    for before, here in pairwise(exposures_s):
        if math.log(here / kept[-1]) >= least and here > before:
            kept.append(here)
    return kept
