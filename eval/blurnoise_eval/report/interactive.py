"""The numbers behind the page's interactive curves, heat maps and chart of latency: indexes, never names.

Domain: confidences in [0, 1], exposures in s and ms, speeds in px/s, blur in px, latency in ms; values of other
axes in the units that figures have.
"""

from __future__ import annotations

import math
from typing import Any

from blurnoise_eval.grid.axes import EXPOSURE, SPEED, Axis, Coordinate, velocity_of, velocity_text
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import (
    clean_confidence,
    finite,
    line_colours,
    model_names,
    one_velocity_per_speed,
    points,
)
from blurnoise_eval.report.scores import CHOICES
from blurnoise_eval.report.settings import axis_label, word
from blurnoise_eval.report.tradeoff import ROBUSTNESS, comparable, trades
from blurnoise_eval.report.words import WORKS, title_text
from blurnoise_eval.scoring.registry import Score


def choices(data: RunData) -> list[Score]:
    """The scores that can be chosen on the page: those that this run has a value of."""
    kinds = {model["kind"] for model in data.manifest["models"]}
    return [
        score
        for score in CHOICES
        if kinds & score.kinds and any(finite(row[score.name]) is not None for row in data.scores)
    ]


def numbers(data: RunData, groups: list[str]) -> dict[str, Any]:
    """All that the page's script draws. Models, groups, settings, velocities, exposures are given by index.

    axes: exposure, speed, then light and what else varies: their words, texts and colours, and the numbers of
    those beyond speed. settings: the place of each setting on the axes beyond speed.
    points: model, group, setting, velocity, exposure, mean confidence, low, high, number of targets.
    scores: model, setting, velocity, exposure, number of pictures, a value per score, low and
    high of each. clean: per model,
    the same values when untouched. clean_confidence: per model and group. windows: model, group, setting,
    velocity, ends in s, whether it is sure to be there, and the intervals of both ends. failures, over blur:
    model, group, setting, exposure, px (None: never, or throughout), low, high, whether the curve had come back,
    last px tested.
    """
    models, settings, chosen = model_names(data), data.settings, choices(data)
    shown_s = set(data.exposures_s)
    measured = [each for each in points(data) if each.group in groups and each.exposure_s in shown_s]
    velocities, exposures = data.velocities_px_s, data.exposures_s
    m_of, g_of, s_of, v_of, e_of = (
        {key: place for place, key in enumerate(keys)}
        for keys in (models, groups, settings.every, velocities, exposures)
    )
    untouched = {row["model"]: row for row in data.scores if row["clean"]}
    values = [settings.values(axis) for axis in settings.axes]
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
        "settings": [
            [tested.index(value) for tested, value in zip(values, setting, strict=True)]
            for setting in settings.every
        ],
        "speeds_px_s": [math.hypot(*velocity) for velocity in velocities],
        "exposures_ms": [1e3 * exposure_s for exposure_s in exposures],
        "joined": one_velocity_per_speed(velocities),
        "predicted": bool(data.searched),
        "measures": [{"name": score.title, "more": score.better == "higher"} for score in chosen],
        "points": [
            [m_of[p.model], g_of[p.group], s_of[p.setting], v_of[p.velocity_px_s], e_of[p.exposure_s]]
            + [_short(value) for value in (p.confidence, p.low, p.high)]
            + [p.n_targets]
            for p in measured
        ],
        "scores": [
            [m_of[row["model"]], s_of[settings.of(row)], v_of[velocity_of(row)], e_of[row["exposure_s"]]]
            + [row["n_images"]]
            + [_short(row[score.name]) for score in chosen]
            + [_short(row.get(f"{score.name}_{end}")) for score in chosen for end in ("low", "high")]
            for row in data.scores
            if not row["clean"] and row["exposure_s"] in shown_s
        ],
        "clean": [[_short(untouched.get(model, {}).get(score.name)) for score in chosen] for model in models],
        "clean_confidence": [
            [_short(_untouched(data, model, group)) for group in groups] for model in models
        ],
        "windows": [
            [
                *(m_of[a["model"]], g_of[a["group"]], s_of[settings.of(a)], v_of[velocity_of(a)]),
                *(*window, a["verdict"] == WORKS, low, high),
            ]
            for a in data.answers
            if a["group"] in g_of
            for window, low, high in zip(a["windows_s"], a["windows_low_s"], a["windows_high_s"], strict=True)
        ],
        "failures": [
            [
                *(m_of[c["model"]], g_of[c["group"]], s_of[settings.of(c)], e_of[c["exposure_s"]]),
                None if c["fails_at"] == c["x"][0] else _short(c["fails_at"]),
                *(_short(c["fails_low"]), _short(c["fails_high"]), c["non_monotonic"], _short(c["x"][-1])),
            ]
            for c in data.endurances
            if c["axis"] == "blur_px" and c["group"] in g_of
        ],
        "trades": [
            {
                "name": ROBUSTNESS[measure],
                "points": [
                    [m_of[t.model], *map(_short, (t.latency_ms, t.p95_ms, t.robustness)), t.best]
                    for t in trades(data, measure)
                ],
            }
            for measure in comparable(data)
        ],
    }


def _axis(axis: Axis | Coordinate, texts: list[str], colours: str) -> dict[str, Any]:
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
    return finite(known[0]["clean_value"]) if known else clean_confidence(data, model, group)
