"""Runs made by hand, whose parts agree with each other: what a report is tested on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.recommendation import average_curve, averages, recommendations
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.report.run import RunData
from made_tables import table
from numpy.typing import NDArray

EXPOSURES_S = (0.001, 0.004, 0.016, 0.064)
THRESHOLD = 0.6
CRITERION = Criterion(THRESHOLD, kept=False)
F_NUMBERS, TEMPERATURES_C = (1.4,), (25.0,)
GROUPS = {"stop sign 100 px": 0.95, "stop sign 30 px": 0.5}
DETECTOR_SCORES = ("ap", "ap50", "ar100", "false_positives_per_image", "calibration_error", "ap50_swept")
READER_SCORES = ("read_confidence", "exact_match", "character_error_rate")


def confidence(exposure_s: float, setting: dict[str, float], speed: float, best: float) -> float:
    """A model that needs light (exposure x lux, less of it at f/2.8), dislikes blur (exposure x speed) and heat."""
    gathered = exposure_s * setting["illuminance_lux"] * (F_NUMBERS[0] / setting["f_number"]) ** 2
    cool = 1 - (setting["temperature_c"] - TEMPERATURES_C[0]) / 300
    seen_speed = 0.0 if setting["moves"] == 2 else speed  # of a target that is tracked
    return best * cool * (1 - math.exp(-gathered / 0.25)) * math.exp(-((exposure_s * seen_speed / 14) ** 2))


def made_run(
    folder: Path,
    groups: dict[str, float] | None = None,
    exposures_s: tuple[float, ...] = EXPOSURES_S,
    lights_lux: tuple[float, ...] = (10.0, 200.0),
    speeds: tuple[float, ...] = (0.0, 600.0),
    interval: bool = True,
    n_examples: int = 2,
    models: tuple[str, ...] = ("yolox-nano",),
    kind: str = "detector",
    f_numbers: tuple[float, ...] = F_NUMBERS,
    temperatures_c: tuple[float, ...] = TEMPERATURES_C,
    moves: tuple[float, ...] = (0.0,),
) -> RunData:
    """``groups`` gives the best confidence of each target group, which model k reaches to 1 - k/5."""
    groups = GROUPS if groups is None else groups
    settings = _settings(lights_lux, f_numbers, temperatures_c, moves)
    conditions: list[dict[str, Any]] = [_condition(None, None, None)] + [
        _condition(t, setting, v) for setting in settings for v in speeds for t in exposures_s
    ]
    found: dict[str, list[dict[str, Any]]] = {
        name: [] for name in ("models", "scores", "answers", "endurances", "examples")
    }
    found |= {"recommendations": [], "averages": []}
    for k, model in enumerate(models):
        best_of = {group: best * (1 - k / 5) for group, best in groups.items()}
        found["scores"] += [_score(model, kind, at, best_of) for at in conditions]
        found["models"].append(_summary(model, kind, k, bool(groups)))
        for group, best in best_of.items():
            for setting in settings:
                found["answers"] += [
                    {"model": model, "group": group} | _answer(exposures_s, setting, v, best, interval)
                    for v in speeds
                ]
                found["endurances"] += [
                    {"model": model, "group": group} | _over_blur(t, setting, speeds, best, interval)
                    for t in exposures_s
                    if len(speeds) > 1
                ]
            for axis, values in (("f_number", f_numbers), ("temperature_c", temperatures_c)):
                found["endurances"] += [
                    {"model": model, "group": group} | _over_axis(axis, values, t, setting, v, best, interval)
                    for setting, t, v in product(settings, exposures_s, speeds)
                    if len(values) > 1 and setting[axis] == values[0]
                ]
        if best_of:
            of = averages(
                [
                    _surface(model, group, setting, exposures_s, speeds, best, interval)
                    for group, best in best_of.items()
                    for setting in settings
                ],
                THRESHOLD,
            )
            found["recommendations"] += recommendations(of)
            found["averages"].append(average_curve(of))
        for index in range(n_examples):
            at = conditions[(index * 7) % len(conditions)]
            found["examples"].append(_example(folder, index, model, kind, at, best_of))
    return RunData(_manifest(models, kind, len(conditions)), skipped=[], **found)


def _surface(
    model: str,
    group: str,
    setting: dict[str, float],
    exposures_s: tuple[float, ...],
    speeds: tuple[float, ...],
    best: float,
    interval: bool,
) -> ScoreTable:
    """24 pictures that differ by up to 5 %, or 5 of them."""
    mean = np.array([[confidence(t, setting, v, best) for v in speeds] for t in exposures_s])
    each = np.linspace(0.95, 1.05, 24 if interval else 5)[:, None, None]
    velocities = [(v, 0.0) for v in speeds]
    shared: dict[str, Any] = {"model": model, "group": group, "n_targets": 12, "clean": best}
    return table(each * mean, exposures_s, velocities, saturated=0.01, at=setting, **shared)


def _settings(
    lights_lux: tuple[float, ...],
    f_numbers: tuple[float, ...],
    temperatures_c: tuple[float, ...],
    moves: tuple[float, ...] = (0.0,),
) -> list[dict[str, float]]:
    return [
        {"illuminance_lux": lux, "temperature_c": celsius, "f_number": f_number}
        | {"defocus_radius_px": 0.0, "gain_db": 0.0, "moves": move, "ego_speed_m_s": 0.0}
        for lux, celsius, f_number, move in product(lights_lux, temperatures_c, f_numbers, moves)
    ]


def _condition(
    exposure_s: float | None, setting: dict[str, float] | None, speed: float | None
) -> dict[str, Any]:
    clean = exposure_s is None or speed is None
    return {
        "clean": clean,
        "exposure_s": exposure_s,
        "velocity_x_px_s": speed,
        "velocity_y_px_s": None if clean else 0.0,
        **(setting or dict.fromkeys(_settings((0.0,), F_NUMBERS, TEMPERATURES_C)[0])),
        "blur_px": None if exposure_s is None or speed is None else exposure_s * abs(speed),
    }


def _confidence_at(at: dict[str, Any], best: float) -> float:
    if at["clean"]:
        return best
    return confidence(at["exposure_s"], at, at["velocity_x_px_s"], best)


def _score(model: str, kind: str, at: dict[str, Any], best_of: dict[str, float]) -> dict[str, Any]:
    values = [_confidence_at(at, best) for best in best_of.values()]
    mean = float(np.mean(values)) if values else None
    row = dict.fromkeys((*DETECTOR_SCORES, *READER_SCORES))
    if mean is not None:
        own = DETECTOR_SCORES if kind == "detector" else READER_SCORES
        row |= {name: mean * (1 - place / 20) for place, name in enumerate(own)}
    rate = None if mean is None else float(mean > 0.25)
    means = {"target_confidence": mean, "detection_rate": rate, "detection_rate_swept": rate}
    shown = {"applied_gain_db": 6.0, "snr_db": 25.0, "brightness": 0.4, "saturated": 0.01}
    if at.get("clean"):
        shown = dict.fromkeys(shown)
    return {"model": model, "n_images": 3} | shown | means | at | row


def _summary(model: str, kind: str, k: int, scored: bool) -> dict[str, Any]:
    row: dict[str, Any] = {"model": model, "kind": kind, "measure": "AP"}
    names = ("p", "mpc", "rpc", "auc_exposure", "auc_blur", "target_confidence", "ap50", "ar100")
    row |= {name: (0.8 - k / 10 - place / 50 if scored else None) for place, name in enumerate(names)}
    if kind == "reader":
        row |= {"ap50": None, "ar100": None}
    row |= {"false_positives_per_image": 0.25, "calibration_error": None}
    return row | {"latency_ms": 30.0 - 8 * k, "latency_p95_ms": 36.0 - 8 * k, "latency_threads": 1}


def _answer(
    exposures_s: tuple[float, ...], setting: dict[str, float], speed: float, best: float, interval: bool
) -> dict[str, Any]:
    curve = [confidence(t, setting, speed, best) for t in exposures_s]
    windows, top = _windows(exposures_s, curve), int(np.argmax(curve))
    return {
        **setting,
        "velocity_x_px_s": speed,
        "velocity_y_px_s": 0.0,
        "n_targets": 12,
        "exposures_s": list(exposures_s),
        "confidence": curve,
        "low": [_low(c) for c in curve] if interval else None,
        "high": [_high(c) for c in curve] if interval else [None] * len(curve),
        "windows_s": windows,
        "open_low": curve[0] >= THRESHOLD,
        "open_high": curve[-1] >= THRESHOLD,
        "recommended_s": exposures_s[top] if windows else None,
        "confidence_at_recommended": curve[top] if windows else None,
        "n_pictures": 24 if interval else 5,
        "effective_pictures": 24.0 if interval else 5.0,
        "few_pictures": not interval,
        "verdict": ("works" if windows else "no exposure works") if interval else "cannot tell",
        "pictures_to_tell": None if interval else 40,
        "windows_low_s": [_about(low, exposures_s, interval) for low, _ in windows],
        "windows_high_s": [_about(high, exposures_s, interval) for _, high in windows],
        "sure_windows_s": windows if interval else [],
        "recommended_low": _low(curve[top]) if windows and interval else None,
        "recommended_high": _high(curve[top]) if windows and interval else None,
        "regret_95": 0.012 if windows and interval else None,
        "criterion": CRITERION.text,
        "best_s": exposures_s[top],
        "best_value": curve[top],
        "best_low": _low(curve[top]) if interval else None,
        "best_high": _high(curve[top]) if interval else None,
        "limited_low": "noise" if windows and curve[0] < THRESHOLD else None,
        "limited_high": "blur" if windows and curve[-1] < THRESHOLD else None,
        "limited_by": None if windows else "blur and noise" if speed else "noise",
        "clean_value": best,
        "saturated": [0.0] * len(curve),
        "saturated_at_recommended": 0.0 if windows else None,
    }


def _low(value: float) -> float:
    """Of a value's interval, on the threshold's side on which the value is."""
    return max(THRESHOLD, value - 0.06) if value >= THRESHOLD else max(0.0, value - 0.06)


def _high(value: float) -> float:
    return min(1.0, value + 0.04) if value >= THRESHOLD else min(THRESHOLD - 0.01, value + 0.04)


def _about(end: float, exposures_s: tuple[float, ...], interval: bool) -> list[float | None]:
    within = interval and exposures_s[0] < end < exposures_s[-1]
    return [0.9 * end, 1.1 * end] if within else [None, None]


def _windows(exposures_s: tuple[float, ...], curve: list[float]) -> list[list[float]]:
    """Runs of tested exposures at or above the threshold, their ends interpolated in log exposure."""
    log, found, start = np.log(exposures_s), [], None
    for i, value in enumerate(curve):
        if value >= THRESHOLD and start is None:
            start = exposures_s[i]
            if i:
                start = math.exp(np.interp(THRESHOLD, [curve[i - 1], value], log[i - 1 : i + 1]))
        if value < THRESHOLD and start is not None:
            found.append([start, math.exp(np.interp(THRESHOLD, [value, curve[i - 1]], [log[i], log[i - 1]]))])
            start = None
    return [*found, [start, exposures_s[-1]]] if start is not None else found


def _over_blur(
    exposure_s: float, setting: dict[str, float], speeds: tuple[float, ...], best: float, interval: bool
) -> dict[str, Any]:
    lengths = sorted({abs(speed) for speed in speeds})
    at = {**setting, "exposure_s": exposure_s, "velocity_x_px_s": None, "velocity_y_px_s": None}
    y = [confidence(exposure_s, setting, length, best) for length in lengths]
    return at | _endurance("blur_px", [exposure_s * length for length in lengths], y, interval)


def _over_axis(
    axis: str,
    values: tuple[float, ...],
    exposure_s: float,
    setting: dict[str, float],
    speed: float,
    best: float,
    interval: bool,
) -> dict[str, Any]:
    at = {**setting, "exposure_s": exposure_s, "velocity_x_px_s": speed, "velocity_y_px_s": 0.0, axis: None}
    y = [confidence(exposure_s, setting | {axis: value}, speed, best) for value in values]
    return at | _endurance(axis, list(values), y, interval)


def _endurance(axis: str, x: list[float], y: list[float], interval: bool) -> dict[str, Any]:
    at, returned = failure_point(x, y, THRESHOLD)
    bounds = (None, None) if not interval or at is None else (0.9 * at, 1.1 * at)
    return {
        "axis": axis,
        "x": x,
        "confidence": y,
        "auc": float(np.mean(y)),
        "fails_at": at,
        "fails_low": bounds[0],
        "fails_high": bounds[1],
        "non_monotonic": returned,
        "auc_low": max(0.0, float(np.mean(y)) - 0.05) if interval else None,
        "auc_high": min(1.0, float(np.mean(y)) + 0.05) if interval else None,
        "n_pictures": 24 if interval else 5,
        "few_pictures": not interval,
    }


def _example(
    folder: Path, index: int, model: str, kind: str, at: dict[str, Any], best_of: dict[str, float]
) -> dict[str, Any]:
    boxes = {group: [40 + 150 * k, 60, 140 + 150 * k, 160] for k, group in enumerate(list(best_of)[:3])}
    targets = [
        {"box_xyxy": box, "label": "stop sign", "confidence": _confidence_at(at, best_of[group])}
        | {"text": "STOP" if kind == "reader" else None}
        for group, box in boxes.items()
    ]
    detections = [
        {"box_xyxy": t["box_xyxy"], "score": t["confidence"], "label": "stop sign"} for t in targets
    ]
    detections.append({"box_xyxy": [300, 200, 380, 290], "score": 0.41, "label": "kite"})
    path = folder / "examples" / f"example {index}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), _picture(list(boxes.values()), at))
    facts = {"path": str(path), "image": "chart.png", "model": model, "error": None}
    return facts | {"detections": detections if kind == "detector" else [], "targets": targets} | at


def _picture(boxes: list[list[int]], at: dict[str, Any]) -> NDArray[np.uint8]:
    image: NDArray[Any] = np.full((320, 480, 3), 90, np.uint8)
    for x0, y0, x1, y1 in boxes:
        cv2.circle(image, ((x0 + x1) // 2, (y0 + y1) // 2), (x1 - x0) // 2, (40, 40, 200), -1)
    if not at["clean"]:
        image = cv2.blur(image, (max(1, round(at["blur_px"])), 1))
        electrons = at["exposure_s"] * at["illuminance_lux"] * 400
        image = image + np.random.default_rng(0).normal(0, 255 / math.sqrt(electrons + 4), image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def _manifest(models: tuple[str, ...], kind: str, n_conditions: int) -> dict[str, Any]:
    contract: dict[str, Any] = {"family": "yolox", "colour_order": "BGR", "classes": ["stop sign", "kite"]}
    sources = {"family": "output shapes", "colour_order": "assumed (usual for YOLOX)"}
    return {
        "title": "Exposure sweep",
        "command": "blurnoise sweep model.onnx --exposures 1ms 4ms",
        "models": [
            {"name": name, "kind": kind, "file": f"{k}.onnx", "sha256": "695e" * 16}
            | {"contract": contract | {"sources": sources}}
            for k, name in enumerate(models)
        ],
        "camera": {
            "name": "AR0237",
            "read_noise_e": 2.5,
            "sources": {"read_noise_e": "https://example.org/sheet.pdf"},
        },
        "seed": 7,
        "versions": {"blurnoise": "0.1.0", "onnxruntime": "1.31"},
        "hardware": {"cpu": "8 cores"},
        "threads": 2,
        "criterion": CRITERION.row(),
        "threshold": THRESHOLD,
        "withheld": [],
        "images": {"kind": "rendered targets", "count": 1, "labelled": True, "notes": []},
        "wall_s": 12.3,
        "warnings": ["two pictures are smaller than the sensor"],
        "errors": [],
        "n_cells": n_conditions * len(models),
        "missing_cells": 0,
        "n_target_rows": n_conditions * len(models) * 2,
        "simulate_ms": 7.0,
    }


class FailurePoint(NamedTuple):
    """Where a curve falls below a threshold for good, and whether it had been below before and come back."""

    at: float | None
    returned: bool


def failure_point(x: Sequence[float], y: Sequence[float], threshold: float) -> FailurePoint:
    """Where y(x), straight between its points, falls below ``threshold`` and stays there to the end.

    x: increasing. ``at`` is None where y ends at or above the threshold (it never fails), and x[0] where y is
    below it throughout; ``returned`` tells of a curve that was below earlier and rose again, whose one number
    hides something.
    """
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    above = ys >= threshold
    if above[-1]:
        return FailurePoint(None, not above.all())
    if not above.any():
        return FailurePoint(float(xs[0]), False)
    last = int(np.flatnonzero(above)[-1])
    share = (ys[last] - threshold) / (ys[last] - ys[last + 1])
    return FailurePoint(float(xs[last] + share * (xs[last + 1] - xs[last])), not above[:last].all())
