"""The tables of the page: models, answers, failure points.

Domain: fractions in [0, 1], exposures in s, velocities in px/s or km/h. Texts are plain, never markup.
"""

from __future__ import annotations

import math
from typing import Any

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.grid.axes import EXPOSURE, velocity_of
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report import words
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import Setting
from blurnoise_eval.scoring.scores import Score, of_models
from blurnoise_eval.system.tables import finite

MAX_SETTINGS = 24  # rows of one target group
MIN_BAR_PERCENT = 1.5  # of a window in its track, to be seen
Row = dict[str, Any]


def model_rows(data: RunData) -> list[Row]:
    """A row per score: its name and meaning, and per model its text, whether it is the best, why it is missing."""
    untouched = {row["model"]: row for row in data.scores if row["clean"]}
    models = [{**untouched.get(row["model"], {}), **row} for row in data.models]
    kind = "reader" if models and all(row["kind"] == "reader" for row in models) else "detector"
    rows = []
    for score in of_models(kind):
        known = {value for row in models if (value := finite(row.get(score.name))) is not None}
        pick = max if score.better == "higher" else min
        best = pick(known) if score.better and len(known) > 1 else None
        cells = [_model_cell(row, score, best) for row in models]
        title = f"{score.title}, untouched" if score.of_pictures else score.title
        rows.append({"name": title, "meaning": score.meaning, "cells": cells})
    return rows


def _model_cell(row: Row, score: Score, best: float | None) -> Row:
    value, low, high = (finite(row.get(f"{score.name}{end}")) for end in ("", "_low", "_high"))
    if value is None:
        return {"text": None, "why": score.missing, "best": False}
    text = format(int(value) if score.digits == "d" else value, score.digits)
    unit = " ms" if score.name.endswith("_ms") else ""
    interval = "" if low is None or high is None else f" ({low:.3f}–{high:.3f})"
    return {"text": text + unit + interval, "why": "", "best": value == best}


def shown_settings(data: RunData) -> list[Setting]:
    """The settings that the tables have a row of."""
    return spread(data.settings.every, MAX_SETTINGS)


def model_answers(data: RunData, groups: list[str]) -> list[Row]:
    """The answer tables, one per model that has answers: in how many an exposure works, and for each target group a
    row per setting, with the answer (None: not tested) and its bars for each velocity."""
    tables = []
    for model in data.model_names:
        own = [answer for answer in data.answers if answer["model"] == model]
        parts = []
        for group in groups:
            answers = [answer for answer in own if answer["group"] == group]
            cells = {(data.settings.of(each), velocity_of(each)): {**each, **_bars(each)} for each in answers}
            rows = [
                (data.settings.text(setting), [cells.get((setting, each)) for each in data.velocities_px_s])
                for setting in shown_settings(data)
            ]
            if answers:
                counts = {name: max(each[name] for each in answers) for name in ("n_targets", "n_pictures")}
                parts.append(
                    {"group": group, **counts, "rows": rows, "clean": finite(answers[0]["clean_value"])}
                )
        if own:
            working = sum(answer["verdict"] == WORKS for answer in own)
            tables.append({"model": model, "working": working, "of": len(own), "parts": parts})
    return tables


def _bars(answer: Row) -> Row:
    """Left and width of the windows, and the place of the recommended exposure, in percent of the tested range."""
    low, high = math.log(min(answer["exposures_s"])), math.log(max(answer["exposures_s"]))
    if not low < high:
        return {"bars": None, "tick": None}

    def percent(exposure_s: float) -> float:
        return 100 * (math.log(exposure_s) - low) / (high - low)

    bars = [
        (min(percent(a), 100 - MIN_BAR_PERCENT), max(MIN_BAR_PERCENT, percent(b) - percent(a)))
        for a, b in answer["windows_s"]
    ]
    recommended = answer["recommended_s"]
    return {"bars": bars, "tick": None if recommended is None else percent(recommended)}


def failures(data: RunData, groups: list[str]) -> list[Row]:
    """Failure points over blur: per model and group a table of settings (rows) and exposures (columns)."""
    curves = [curve for curve in data.endurances if curve["axis"] == "blur_px"]
    exposures = sorted({curve["exposure_s"] for curve in curves})
    tables = []
    for model in data.model_names:
        for group in groups:
            own = {
                (data.settings.of(curve), curve["exposure_s"]): words.failure_texts(curve)
                for curve in curves
                if (curve["model"], curve["group"]) == (model, group)
            }
            rows = [
                (data.settings.text(setting), [own.get((setting, exposure)) for exposure in exposures])
                for setting in shown_settings(data)
            ]
            if own:
                heads = [EXPOSURE.text(exposure_s) for exposure_s in exposures]
                tables.append({"model": model, "group": group, "rows": rows, "exposures": heads})
    return tables
