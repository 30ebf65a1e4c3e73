"""The tables of the page: models, answers, failure points.

Domain: fractions in [0, 1], exposures in s, light in lux, velocities in px/s. Texts are plain, never markup.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from blurnoise_eval.drawing.annotate import exposure_text, velocity_of
from blurnoise_eval.report import findings
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import clean_confidence, finite, model_names

MIN_BAR_PERCENT = 1.5  # of a window in its track, to be seen


class Measure(NamedTuple):
    """A row of the table of models: its name, what it means, its column, and why a value may be missing."""

    name: str
    meaning: str
    column: str
    missing: str
    digits: str = ".3f"
    better: Callable[..., float] | None = max


_CURVES = "needs targets at two or more of them"
_SHARED = (
    Measure(
        "mPC",
        "mean of the same over all conditions but the untouched, each weighted alike",
        "mpc",
        "no condition scored",
    ),
    Measure("rPC", "mPC / P", "rpc", "needs mPC, and P above 0"),
    Measure(
        "AUC over exposure",
        "mean over all curves of the area under mean confidence, divided by the range of exposures",
        "auc_exposure",
        _CURVES,
    ),
    Measure("AUC over blur", "the same over motion blur in px, at each exposure", "auc_blur", _CURVES),
)
_LATENCY = (
    Measure(
        "Latency, median",
        "one picture in, its answer out, nothing else running",
        "latency_ms",
        "not measured",
        ".3g",
        min,
    ),
    Measure("Latency, 95th percentile", "", "latency_p95_ms", "not measured", ".3g", min),
    Measure("Threads for the latency", "", "latency_threads", "not measured", "d", None),
)
_DETECTOR = (
    Measure(
        "P", "AP (IoU 0.50 to 0.95) on the untouched pictures", "p", "no labelled target that the model knows"
    ),
    *_SHARED,
    Measure("AP50, untouched", "", "ap50", "no labelled target that the model knows"),
    Measure(
        "AR100, untouched",
        "recall with 100 detections a picture",
        "ar100",
        "no labelled target that the model knows",
    ),
    Measure("Target confidence, untouched", "", "target_confidence", "no target"),
    Measure(
        "False positives per picture, untouched",
        "detections from 0.25 on that answer for no target",
        "false_positives_per_image",
        "not scored",
        ".3f",
        min,
    ),
    Measure(
        "Calibration error, untouched",
        "of detections from 0.25 on: |score - share of right ones|, ten bins",
        "calibration_error",
        "nothing detected",
        ".3f",
        min,
    ),
    *_LATENCY,
)
_READER = (
    Measure("P", "exact matches on the untouched pictures", "p", "no text to read"),
    *_SHARED,
    Measure(
        "Character error rate, untouched",
        "edits / characters",
        "character_error_rate",
        "no text to read",
        ".3f",
        min,
    ),
    Measure(
        "Confidence, untouched", "of what was read, right or wrong", "read_confidence", "no text to read"
    ),
    *_LATENCY,
)


def model_rows(data: RunData) -> list[dict[str, Any]]:
    """A row per measure: its name and meaning, and per model its text, whether it is the best, why it is missing."""
    untouched = {row["model"]: row for row in data.scores if row["clean"]}
    models = [{**untouched.get(row["model"], {}), **row} for row in data.models]
    readers = bool(models) and all(row["kind"] == "reader" for row in models)
    rows = []
    for measure in _READER if readers else _DETECTOR:
        values = [finite(row.get(measure.column)) for row in models]
        known = [value for value in values if value is not None]
        best = measure.better(known) if measure.better and len(set(known)) > 1 else None
        unit = " ms" if measure.column.endswith("_ms") else ""
        cells = [
            {"text": None, "why": measure.missing, "best": False}
            if value is None
            else {"text": _number(value, measure.digits) + unit, "why": "", "best": value == best}
            for value in values
        ]
        rows.append({"name": measure.name, "meaning": measure.meaning, "cells": cells})
    return rows


def model_answers(
    data: RunData, groups: list[str], lights: list[float], velocities: list[tuple[float, float]]
) -> list[dict[str, Any]]:
    """The answer tables, one per model that has answers: its name, in how many an exposure works, its groups."""
    tables = []
    for model in model_names(data):
        own = [answer for answer in data.answers if answer["model"] == model]
        parts = [
            _group_answers([answer for answer in own if answer["group"] == group], lights, velocities)
            | {"clean": clean_confidence(data, model, group), "group": group}
            for group in groups
            if any(answer["group"] == group for answer in own)
        ]
        if own:
            tables.append(
                {"model": model, "working": findings.count_working(own), "of": len(own), "parts": parts}
            )
    return tables


def failures(data: RunData, groups: list[str], lights: list[float]) -> list[dict[str, Any]]:
    """Failure points over blur: per model and group a table of lights (rows) and exposures (columns)."""
    curves = [curve for curve in data.endurances if curve["axis"] == "blur_px"]
    exposures = sorted({curve["exposure_s"] for curve in curves})
    tables = []
    for model in model_names(data):
        for group in groups:
            own = {
                (curve["illuminance_lux"], curve["exposure_s"]): _failure_cell(curve)
                for curve in curves
                if (curve["model"], curve["group"]) == (model, group)
            }
            if own:
                rows = [(lux, [own.get((lux, exposure)) for exposure in exposures]) for lux in lights]
                tables.append(
                    {
                        "model": model,
                        "group": group,
                        "rows": rows,
                        "exposures": list(map(exposure_text, exposures)),
                    }
                )
    return tables


def _failure_cell(curve: dict[str, Any]) -> dict[str, Any]:
    auc = finite(curve["auc"])
    notes = (
        findings.interval_text(curve),
        None if auc is None else f"AUC {auc:.2f}",
        "non-monotonic" if curve["non_monotonic"] else None,
    )
    return {"text": findings.failure_text(curve), "notes": [note for note in notes if note]}


def _group_answers(
    answers: list[dict[str, Any]], lights: list[float], velocities: list[tuple[float, float]]
) -> dict[str, Any]:
    """One model's answers for one target group: a row per light, a cell per velocity."""
    cells = {(answer["illuminance_lux"], velocity_of(answer)): _answer_cell(answer) for answer in answers}
    return {
        "n_targets": max(answer["n_targets"] for answer in answers),
        "rows": [(lux, [cells.get((lux, velocity)) for velocity in velocities]) for lux in lights],
    }


def _answer_cell(answer: dict[str, Any]) -> dict[str, Any]:
    exposures = answer["exposures_s"]
    low, high = math.log(min(exposures)), math.log(max(exposures))

    def percent(exposure_s: float) -> float:
        return 100 * (math.log(exposure_s) - low) / (high - low)

    def bar(a: float, b: float) -> tuple[float, float]:
        return min(percent(a), 100 - MIN_BAR_PERCENT), max(MIN_BAR_PERCENT, percent(b) - percent(a))

    measured = [pair for pair in zip(answer["confidence"], exposures, strict=True) if pair[0] is not None]
    best = max(measured, key=lambda pair: pair[0]) if measured else None
    recommended = answer["recommended_s"]
    return {
        "works": bool(answer["windows_s"]),
        "window": findings.window_text(answer),
        "recommended": None if recommended is None else exposure_text(recommended),
        "confidence": answer["confidence_at_recommended"],
        "best": None if best is None else f"best {best[0]:.2f} at {exposure_text(best[1])}",
        "bars": [bar(a, b) for a, b in answer["windows_s"]] if low < high else None,
        "tick": percent(recommended) if recommended is not None and low < high else None,
    }


def _number(value: float, digits: str) -> str:
    return format(int(value) if digits == "d" else value, digits)
