"""The tables of the page: models, answers, failure points.

Domain: fractions in [0, 1], exposures in s, velocities in px/s or km/h. Texts are plain, never markup.
"""

from __future__ import annotations

import math
from typing import Any

from blurnoise_eval.grid.axes import EXPOSURE, velocity_of
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report import words
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import Setting
from blurnoise_eval.scoring.scores import of_models
from blurnoise_eval.system.tables import finite

MAX_SETTINGS = 24  # rows of one target group
MIN_BAR_PERCENT = 1.5  # of a window in its track, to be seen


def model_rows(data: RunData) -> list[dict[str, Any]]:
    """A row per score: its name and meaning, and per model its text, whether it is the best, why it is missing."""
    untouched = {row["model"]: row for row in data.scores if row["clean"]}
    models = [{**untouched.get(row["model"], {}), **row} for row in data.models]
    kind = "reader" if models and all(row["kind"] == "reader" for row in models) else "detector"
    rows = []
    for score in of_models(kind):
        values = [finite(row.get(score.name)) for row in models]
        known = [value for value in values if value is not None]
        pick = max if score.better == "higher" else min
        best = pick(known) if score.better and len(set(known)) > 1 else None
        unit = " ms" if score.name.endswith("_ms") else ""
        cells = [
            {"text": None, "why": score.missing, "best": False}
            if value is None
            else {
                "text": _number(value, score.digits) + unit + _interval(row, score.name),
                "why": "",
                "best": value == best,
            }
            for value, row in zip(values, models, strict=True)
        ]
        title = score.title if score.of is None else f"{score.title}, untouched"
        rows.append({"name": title, "meaning": score.meaning, "cells": cells})
    return rows


def shown_settings(data: RunData) -> list[Setting]:
    """The settings that the tables have a row of."""
    return spread(data.settings.every, MAX_SETTINGS)


def model_answers(data: RunData, groups: list[str]) -> list[dict[str, Any]]:
    """The answer tables, one per model that has answers: its name, in how many an exposure works, its groups."""
    tables = []
    for model in data.model_names:
        own = [answer for answer in data.answers if answer["model"] == model]
        parts = [
            _group_answers(data, [answer for answer in own if answer["group"] == group]) | {"group": group}
            for group in groups
            if any(answer["group"] == group for answer in own)
        ]
        if own:
            tables.append(
                {
                    "model": model,
                    "working": sum(answer["verdict"] == words.WORKS for answer in own),
                    "of": len(own),
                    "parts": parts,
                }
            )
    return tables


def failures(data: RunData, groups: list[str]) -> list[dict[str, Any]]:
    """Failure points over blur: per model and group a table of settings (rows) and exposures (columns)."""
    settings = data.settings
    curves = [curve for curve in data.endurances if curve["axis"] == "blur_px"]
    exposures = sorted({curve["exposure_s"] for curve in curves})
    tables = []
    for model in data.model_names:
        for group in groups:
            own = {
                (settings.of(curve), curve["exposure_s"]): _failure_cell(curve)
                for curve in curves
                if (curve["model"], curve["group"]) == (model, group)
            }
            if own:
                rows = [
                    (settings.text(setting), [own.get((setting, exposure)) for exposure in exposures])
                    for setting in shown_settings(data)
                ]
                heads = [EXPOSURE.text(exposure_s) for exposure_s in exposures]
                tables.append({"model": model, "group": group, "rows": rows, "exposures": heads})
    return tables


def _failure_cell(curve: dict[str, Any]) -> dict[str, Any]:
    auc = finite(curve["auc"])
    notes = (
        words.interval_text(curve),
        None if auc is None else f"AUC {words.value_text(auc, curve['auc_low'], curve['auc_high'])}",
        "non-monotonic" if curve["non_monotonic"] else None,
    )
    return {"text": words.failure_text(curve), "notes": [note for note in notes if note]}


def _group_answers(data: RunData, answers: list[dict[str, Any]]) -> dict[str, Any]:
    """One model's answers for one target group: a row per setting, a cell per velocity."""
    settings = data.settings
    cells = {(settings.of(answer), velocity_of(answer)): _answer_cell(answer) for answer in answers}
    rows = [
        (settings.text(setting), [cells.get((setting, velocity)) for velocity in data.velocities_px_s])
        for setting in shown_settings(data)
    ]
    counts = {name: max(answer[name] for answer in answers) for name in ("n_targets", "n_pictures")}
    return {**counts, "rows": rows, "clean": finite(answers[0]["clean_value"])}


def _answer_cell(answer: dict[str, Any]) -> dict[str, Any]:
    exposures = answer["exposures_s"]
    low, high = math.log(min(exposures)), math.log(max(exposures))

    def percent(exposure_s: float) -> float:
        return 100 * (math.log(exposure_s) - low) / (high - low)

    def bar(a: float, b: float) -> tuple[float, float]:
        return min(percent(a), 100 - MIN_BAR_PERCENT), max(MIN_BAR_PERCENT, percent(b) - percent(a))

    recommended = answer["recommended_s"]
    return {
        "verdict": answer["verdict"],
        "told": words.verdict_text(answer),
        "window": words.window_text(answer) if answer["windows_s"] else None,
        "recommended": None if recommended is None else EXPOSURE.text(recommended),
        "confidence": None if recommended is None else words.confidence_text(answer),
        "regret": None if answer["regret_95"] is None else f"loses at most {answer['regret_95']:.3f}",
        "reservations": words.reservations(answer),
        "best": words.best_text(answer),
        "bars": [bar(a, b) for a, b in answer["windows_s"]] if low < high else None,
        "tick": percent(recommended) if recommended is not None and low < high else None,
    }


def _interval(row: dict[str, Any], name: str) -> str:
    low, high = finite(row.get(f"{name}_low")), finite(row.get(f"{name}_high"))
    return "" if low is None or high is None else f" ({low:.3f}–{high:.3f})"


def _number(value: float, digits: str) -> str:
    return format(int(value) if digits == "d" else value, digits)
