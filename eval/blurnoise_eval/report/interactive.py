"""The numbers behind the page's interactive curves and heat maps: indexes, never names.

Domain: confidences in [0, 1], exposures in s and ms, speeds in px/s, blur in px; values of other axes in the units
that figures have.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from blurnoise_eval.grid.axes import EXPOSURE, SPEED, Axis, Coordinate, velocity_of, velocity_text
from blurnoise_eval.plots.style import line_colours
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import Setting, axis_label, word
from blurnoise_eval.report.words import WORKS, title_text
from blurnoise_eval.scoring.scores import Score, of_conditions
from blurnoise_eval.system.tables import finite

Row = dict[str, Any]
_ENDS = ("", "_low", "_high")  # of a score's columns


def choices(data: RunData) -> list[Score]:
    """The scores that can be chosen on the page: those that this run has a value of."""
    kinds = {model["kind"] for model in data.manifest["models"]}
    return [
        score
        for score in of_conditions()
        if score.charted
        and kinds & score.kinds
        and any(finite(row.get(score.name)) is not None for row in data.scores)
    ]


def numbers(data: RunData, groups: list[str]) -> Row:
    """All that the page's script draws. Models and groups are given by index, a row's place by ``at``: its index on
    each of the axes, exposure, velocity, then light and what else varies; None where it has no place.

    points: mean confidence y with its interval, over n targets. scores: a value per measure, with intervals, over n
    pictures. windows: both ends in s, whether it is sure, and the intervals of the ends. failures, over blur: px
    (None: never, or throughout), interval, whether the curve had come back, last px tested. clean: per model the same
    measures in the untouched pictures; clean_confidence: per model and group.
    """
    models, settings, chosen = data.model_names, data.settings, choices(data)
    velocities, exposures = data.velocities_px_s, data.exposures_s
    values = [settings.values(axis) for axis in settings.axes]
    m_of, g_of = ({key: place for place, key in enumerate(keys)} for keys in (models, groups))
    e_of: dict[float | None, int] = {exposure_s: place for place, exposure_s in enumerate(exposures)}
    v_of: dict[tuple[float, float] | None, int] = {each: place for place, each in enumerate(velocities)}
    untouched = {row["model"]: row for row in data.scores if row["clean"]}

    def at(exposure_s: float | None, velocity: tuple[float, float] | None, setting: Setting) -> list[Any]:
        on_axes = [tested.index(value) for tested, value in zip(values, setting, strict=True)]
        return [e_of.get(exposure_s), v_of.get(velocity), *on_axes]

    return {
        "threshold": data.criterion.level,
        "shown": title_text(data.criterion),
        "highest": data.highest,
        "axes": [
            _axis(EXPOSURE, [EXPOSURE.text(exposure_s) for exposure_s in exposures], "plasma"),
            _axis(SPEED, [velocity_text(velocity) for velocity in velocities], "viridis"),
            *(
                _axis(axis, [axis.text(value) for value in tested], "viridis")
                | {"values": _places(axis, tested)}
                | {"logarithmic": axis.logarithmic and tested[0] > 0, "named": bool(axis.choices)}
                for axis, tested in zip(settings.axes, values, strict=True)
                if tested
            ),
        ],
        "speeds_px_s": [math.hypot(*velocity) for velocity in velocities],
        "exposures_ms": [1e3 * exposure_s for exposure_s in exposures],
        "joined": data.one_velocity_per_speed,
        "predicted": bool(data.searched),
        "measures": [{"name": score.title, "more": score.better == "higher"} for score in chosen],
        "points": _records(
            {"model": m_of[p.model], "group": g_of[p.group]}
            | {"at": at(p.exposure_s, p.velocity_px_s, p.setting)}
            | {"y": _short(p.confidence), "low": _short(p.low), "high": _short(p.high), "n": p.n_targets}
            for p in data.points
            if p.group in g_of and p.exposure_s in e_of
        ),
        "scores": _records(
            {"model": m_of[row["model"]], "at": at(row["exposure_s"], velocity_of(row), settings.of(row))}
            | {"n": row["n_images"]}
            | {f"y{end}": [_short(row.get(f"{score.name}{end}")) for score in chosen] for end in _ENDS}
            for row in data.scores
            if not row["clean"] and row["exposure_s"] in e_of
        ),
        "clean": [[_short(untouched.get(model, {}).get(score.name)) for score in chosen] for model in models],
        "clean_confidence": [
            [_short(_untouched(data, model, group)) for group in groups] for model in models
        ],
        "windows": _records(
            {"model": m_of[a["model"]], "group": g_of[a["group"]]}
            | {"at": at(None, velocity_of(a), settings.of(a)), "low": low, "high": high}
            | {"sure": a["verdict"] == WORKS, "bounds": bounds}
            for a in data.answers
            if a["group"] in g_of
            for (low, high), *bounds in zip(
                a["windows_s"], a["windows_low_s"], a["windows_high_s"], strict=True
            )
        ),
        "failures": _records(
            {"model": m_of[c["model"]], "group": g_of[c["group"]]}
            | {"at": at(c["exposure_s"], None, settings.of(c))}
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
    return {"word": word(axis), "title": axis_label(axis), "unit": axis.unit, "texts": texts} | {
        "colours": line_colours(colours, len(texts))
    }


def _places(axis: Axis, tested: list[float]) -> list[float | None]:
    """Where values stand on their axis; side by side where the camera sets one of them itself, or they are names."""
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
