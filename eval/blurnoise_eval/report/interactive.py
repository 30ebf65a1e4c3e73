"""The numbers behind the page's curves and heat maps: indexes, never names.

Domain: confidences in [0, 1], exposures in s and ms, speeds in px/s, blur in px; values of other axes in the units
that figures have.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.grid.axes import (
    EXPOSURE,
    SPEED,
    Axis,
    Coordinate,
    milliseconds,
    velocity_of,
    velocity_text,
)
from blurnoise_eval.plots.style import line_colours, spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import axis_label, word
from blurnoise_eval.report.words import title_text
from blurnoise_eval.scoring.scores import Score, of_conditions
from blurnoise_eval.system.tables import finite

MAX_LINES, MAX_TICKS = 4, 9  # of the first figure
WIDTH, HEIGHT = 560, 340
LEFT, RIGHT, TOP, BASE = 44, WIDTH - 14, 40, HEIGHT - 46  # the axes' frame
_ROOM = 0.06  # of the log range, on either side
_ENDS = ("", "_low", "_high")  # of a score's columns
Row = dict[str, Any]


def choices(data: RunData) -> list[Score]:
    """The scores that can be chosen on the page: those that this run has a value of."""
    kinds = {model["kind"] for model in data.manifest["models"]}
    charted = (score for score in of_conditions() if score.charted and kinds & score.kinds)
    return [score for score in charted if any(finite(row.get(score.name)) is not None for row in data.scores)]


def numbers(data: RunData, groups: list[str]) -> Row:
    """All that the page's script draws. Models and groups are given by index, a row's place by ``at``: its index on
    each of the axes, exposure, velocity, then light and what else varies; None where it has no place.

    points: mean confidence y with its interval, over n targets. scores: a value per measure, with intervals, over n
    pictures. windows: both ends in s, whether it is sure, and the intervals of the ends. failures, over blur: px
    (None: never, or throughout), interval, whether the curve had come back, last px tested. clean: per model the same
    measures in the untouched pictures; clean_confidence: per model and group.
    """
    models, settings, chosen = data.model_names, data.settings, choices(data)
    values = [settings.values(axis) for axis in settings.axes]
    coordinates: list[list[Any]] = [data.exposures_s, data.velocities_px_s, *values]
    places: list[dict[Any, int]] = [{value: n for n, value in enumerate(tested)} for tested in coordinates]
    m_of, g_of = ({key: place for place, key in enumerate(keys)} for keys in (models, groups))
    untouched = {row["model"]: row for row in data.scores if row["clean"]}

    def at(*place: Any) -> list[int | None]:
        return [of_axis.get(value) for of_axis, value in zip(places, place, strict=True)]

    def where(row: Mapping[str, Any], exposure_s: float | None, velocity: tuple[float, float] | None) -> Row:
        place = at(exposure_s, velocity, *settings.of(row))
        return {"model": m_of[row["model"]], "group": g_of.get(row.get("group", "")), "at": place}

    return {
        "threshold": data.criterion.level,
        "shown": title_text(data.criterion),
        "highest": data.highest,
        "axes": [
            _axis(EXPOSURE, [EXPOSURE.text(exposure_s) for exposure_s in data.exposures_s], "plasma"),
            _axis(SPEED, [velocity_text(velocity) for velocity in data.velocities_px_s], "viridis"),
            *(
                _axis(axis, [axis.text(value) for value in tested], "viridis")
                | {"values": _places(axis, tested), "named": bool(axis.choices)}
                | {"logarithmic": axis.logarithmic and tested[0] > 0}
                for axis, tested in zip(settings.axes, values, strict=True)
                if tested
            ),
        ],
        "speeds_px_s": [math.hypot(*velocity) for velocity in data.velocities_px_s],
        "exposures_ms": [1e3 * exposure_s for exposure_s in data.exposures_s],
        "joined": data.one_velocity_per_speed,
        "predicted": bool(data.searched),
        "measures": [{"name": score.title, "more": score.better == "higher"} for score in chosen],
        "points": _records(
            {
                "model": m_of[p.model],
                "group": g_of[p.group],
                "at": at(p.exposure_s, p.velocity_px_s, *p.setting),
            }
            | {"y": _short(p.confidence), "low": _short(p.low), "high": _short(p.high), "n": p.n_targets}
            for p in data.points
            if p.group in g_of and p.exposure_s in places[0]
        ),
        "scores": _records(
            where(row, row["exposure_s"], velocity_of(row))
            | {"n": row["n_images"]}
            | {f"y{end}": [_short(row.get(f"{score.name}{end}")) for score in chosen] for end in _ENDS}
            for row in data.exposed_scores
            if row["exposure_s"] in places[0]
        ),
        "clean": [[_short(untouched.get(model, {}).get(score.name)) for score in chosen] for model in models],
        "clean_confidence": [
            [_short(_untouched(data, model, group)) for group in groups] for model in models
        ],
        "windows": _records(
            where(a, None, velocity_of(a))
            | {"low": low, "high": high}
            | {"sure": a["verdict"] == WORKS, "bounds": bounds}
            for a in data.answers
            if a["group"] in g_of
            for (low, high), *bounds in zip(
                a["windows_s"], a["windows_low_s"], a["windows_high_s"], strict=True
            )
        ),
        "failures": _records(
            where(c, c["exposure_s"], None)
            | {"x": None if c["fails_at"] == c["x"][0] else _short(c["fails_at"])}
            | {"low": _short(c["fails_low"]), "high": _short(c["fails_high"])}
            | {"returned": c["non_monotonic"], "last": _short(c["x"][-1])}
            for c in data.endurances
            if c["axis"] == "blur_px" and c["group"] in g_of
        ),
    }


def _records(rows: Iterable[Row]) -> Row:
    """Rows of the same columns, whose names are written once."""
    every = list(rows)
    return {"columns": list(every[0]) if every else [], "rows": [list(row.values()) for row in every]}


def _axis(axis: Axis | Coordinate, texts: list[str], colours: str) -> Row:
    named = {"word": word(axis), "title": axis_label(axis), "unit": axis.unit}
    return named | {"texts": texts, "colours": line_colours(colours, len(texts))}


def _places(axis: Axis, tested: list[float]) -> list[float | None]:
    """The places of values on their axis; side by side where the camera sets one of them, or they are names."""
    if axis.choices or not all(map(math.isfinite, tested)):
        return [float(place) for place in range(len(tested))]
    return [_short(axis.shown(value)) for value in tested]


def _short(value: float | None) -> float | None:
    kept = finite(value)
    return None if kept is None else round(kept, 4)


def _untouched(data: RunData, model: str, group: str) -> float | None:
    """What the untouched pictures have in the unit of the answers: of what is kept, all."""
    known = [each for each in data.answers if (each["model"], each["group"]) == (model, group)]
    if data.criterion.kept:
        return 1.0 if known else None
    return finite(known[0]["clean_value"]) if known else data.clean_confidence(model, group)


def kept_curve(data: RunData, model: str) -> Row | None:
    """The page's first figure, in px: the mean over lights and targets against exposure, a line per speed.

    windows: where the mean over all speeds is at or above the level. None for fewer than two exposures on a scale.
    """
    rows = [row for row in data.averages if row["model"] == model]
    whole = next((row for row in rows if row["speed"] is None), None)
    x = [] if whole is None else whole["exposures_s"]
    if whole is None or len(x) < 2 or not all(map(math.isfinite, x)):
        return None
    of_speeds = [row for row in rows if row["speed"] is not None]
    lines = [of_speeds[place] for place in spread(range(len(of_speeds)), MAX_LINES)]
    room = _ROOM * math.log(x[-1] / x[0])
    first, last = math.log(x[0]) - room, math.log(x[-1]) + room
    top: float = 1.04 * max(1.0, *(max(row["values"]) for row in lines))

    def across(exposure_s: float) -> float:
        return LEFT + (math.log(exposure_s) - first) / (last - first) * (RIGHT - LEFT)

    def up(value: float) -> float:
        return BASE - value / top * (BASE - TOP)

    def places(row: Row, name: str) -> list[tuple[float, float]]:
        return [(across(e), up(v)) for e, v in zip(row["exposures_s"], row[name], strict=True)]

    found = windows(x, whole["values"], data.criterion.level)
    used = (r["exposure_s"] for r in data.recommendations if (r["model"], r["scope"]) == (model, "all"))
    return {
        "title": title_text(data.criterion),
        "level": up(data.criterion.level),
        "chosen": next(({"x": across(each), "text": EXPOSURE.text(each)} for each in used), None),
        "windows": [(across(low), max(across(high) - across(low), 2.0)) for low, high in found],
        "grid": [(up(value), f"{value:g}") for value in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)],
        "ticks": [(across(each), milliseconds(each)) for each in _ticks(x)],
        "lines": [
            {
                "x": LEFT + place * (RIGHT - LEFT) / MAX_LINES,
                "text": data.speed.text(row["speed"]) if row["speed"] else "at rest",
                "points": places(row, "values"),
                "band": places(row, "low") + places(row, "high")[::-1]
                if all(map(math.isfinite, (*row["low"], *row["high"])))
                else None,
            }
            for place, row in enumerate(lines)
        ],
        "frame": {"width": WIDTH, "height": HEIGHT, "left": LEFT, "right": RIGHT, "top": TOP, "base": BASE},
    }


def _ticks(exposures_s: Sequence[float]) -> list[float]:
    """Tested exposures with room between their labels: neighbours at least a ninth of the range apart."""
    least = math.log(exposures_s[-1] / exposures_s[0]) / MAX_TICKS
    kept = [exposures_s[0]]
    for before, here in pairwise(exposures_s):
        if math.log(here / kept[-1]) >= least and here > before:
            kept.append(here)
    return kept
