"""The numbers behind the page's interactive curves, heat maps and chart of latency: indexes, never names.

Domain: confidences in [0, 1], exposures in s and ms, light in lux, speeds in px/s, blur in px, latency in ms.
"""

from __future__ import annotations

import math
from typing import Any

from blurnoise_eval.drawing.annotate import exposure_text, velocity_of, velocity_text
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import (
    clean_confidence,
    finite,
    line_colours,
    model_names,
    one_velocity_per_speed,
    points,
)
from blurnoise_eval.report.tradeoff import ROBUSTNESS, comparable, trades

MEASURES = {  # columns of a score row that can be chosen: name, whether more is better
    "ap": ("AP", True),
    "ap50": ("AP50", True),
    "detection_rate": ("Detection rate", True),
    "false_positives_per_image": ("False positives per picture", False),
    "calibration_error": ("Calibration error", False),
    "read_confidence": ("Confidence, right or wrong", True),
    "exact_match": ("Exact match", True),
    "character_error_rate": ("Character error rate", False),
}


def measures(data: RunData) -> list[str]:
    """The columns of ``MEASURES`` that this run has a value of."""
    readers = all(model["kind"] == "reader" for model in data.manifest["models"])
    found = [name for name in MEASURES if any(finite(row[name]) is not None for row in data.scores)]
    return [name for name in found if not (readers and name == "detection_rate")]  # exact matches, in effect


def numbers(
    data: RunData, groups: list[str], lights: list[float], velocities: list[tuple[float, float]]
) -> dict[str, Any]:
    """All that the page's script draws. Models, groups, lights, velocities, exposures are given by index.

    points: model, group, light, velocity, exposure, mean confidence, low, high, number of targets.
    scores: model, light, velocity, exposure, number of pictures, then a value per measure. clean: per model,
    the same values when untouched. clean_confidence: per model and group. failures, over blur: model, group,
    light, exposure, px (None: never, or throughout), low, high, whether the curve had come back, last px tested.
    """
    models = model_names(data)
    measured = [point for point in points(data) if point.group in groups]
    chosen = measures(data)
    exposures = sorted(
        {point.exposure_s for point in measured}
        | {row["exposure_s"] for row in data.scores if not row["clean"]}
    )
    m_of, g_of, l_of, v_of, e_of = (
        {key: place for place, key in enumerate(keys)}
        for keys in (models, groups, lights, velocities, exposures)
    )
    untouched = {row["model"]: row for row in data.scores if row["clean"]}
    return {
        "threshold": data.manifest["threshold"],
        "lights_lux": lights,
        "velocities": [velocity_text(velocity) for velocity in velocities],
        "speeds_px_s": [math.hypot(*velocity) for velocity in velocities],
        "exposures_ms": [1e3 * exposure_s for exposure_s in exposures],
        "exposures": [exposure_text(exposure_s) for exposure_s in exposures],
        "velocity_colours": line_colours("viridis", len(velocities)),
        "exposure_colours": line_colours("plasma", len(exposures)),
        "joined": one_velocity_per_speed(velocities),
        "measures": [dict(zip(("name", "more"), MEASURES[name], strict=True)) for name in chosen],
        "points": [
            [m_of[p.model], g_of[p.group], l_of[p.illuminance_lux], v_of[p.velocity_px_s], e_of[p.exposure_s]]
            + [_short(value) for value in (p.confidence, p.low, p.high)]
            + [p.n_targets]
            for p in measured
        ],
        "scores": [
            [
                m_of[row["model"]],
                l_of[row["illuminance_lux"]],
                v_of[velocity_of(row)],
                e_of[row["exposure_s"]],
            ]
            + [row["n_images"]]
            + [_short(row[name]) for name in chosen]
            for row in data.scores
            if not row["clean"]
        ],
        "clean": [[_short(untouched.get(model, {}).get(name)) for name in chosen] for model in models],
        "clean_confidence": [
            [_short(clean_confidence(data, model, group)) for group in groups] for model in models
        ],
        "windows": [
            [m_of[a["model"]], g_of[a["group"]], l_of[a["illuminance_lux"]], v_of[velocity_of(a)], low, high]
            for a in data.answers
            if a["group"] in g_of
            for low, high in a["windows_s"]
        ],
        "failures": [
            [
                *(m_of[c["model"]], g_of[c["group"]], l_of[c["illuminance_lux"]], e_of[c["exposure_s"]]),
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


def _short(value: float | None) -> float | None:
    kept = finite(value)
    return None if kept is None else round(kept, 4)
