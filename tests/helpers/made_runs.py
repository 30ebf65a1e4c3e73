"""Runs of any shape for reports: scores from a formula, answers from the package's own functions; no curves."""

import math
from dataclasses import replace
from itertools import product
from typing import Any

import cv2
import numpy as np
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.recommendation import average_curve, averages, recommendations
from blurnoise_eval.answers.rows import ModelRow
from blurnoise_eval.answers.table import ORDER, ScoreTable
from blurnoise_eval.plan.axes import FURTHER, SETTING
from blurnoise_eval.report.run import RunData
from blurnoise_eval.store.columns import UNKNOWN, AxisValues, WithInterval
from blurnoise_eval.store.rows import Example, LabelledBox, ScoreRow
from numpy.typing import NDArray
from plans import OWN
from stored_rows import answer, cell

EXPOSURES_S = (0.001, 0.004, 0.016, 0.064)
THRESHOLD = 0.6
CRITERION = Criterion(THRESHOLD, kept=False)
GROUPS = {"stop sign 100 px": 0.95, "stop sign 30 px": 0.5}
SCORES = {
    "detector": ("ap", "ap50", "ar100", "false_positives_per_image", "calibration_error", "ap50_swept"),
    "reader": ("read_confidence", "exact_match", "character_error_rate"),
}
Row = dict[str, Any]


def confidence(at, best):
    """A model that needs light (exposure x lux, less of it at f/2.8), dislikes blur (exposure x speed) and heat."""
    gathered = at["exposure_s"] * at["illuminance_lux"] * (1.4 / at["f_number"]) ** 2
    seen_px = 0.0 if at["moves"] == 2 else at["exposure_s"] * at["velocity_x_px_s"]  # of a tracked target
    cool = 1 - (at["temperature_c"] - 25.0) / 300
    return best * cool * (1 - math.exp(-gathered / 0.25)) * math.exp(-((seen_px / 14) ** 2))


def made_run(
    folder,
    groups=None,
    exposures_s=EXPOSURES_S,
    lights_lux=(10.0, 200.0),
    speeds=(0.0, 600.0),
    interval=True,
    n_examples=2,
    models=("yolox-nano",),
    kind="detector",
    f_numbers=(1.4,),
    temperatures_c=(25.0,),
    moves=(0.0,),
):
    """``groups`` gives the best confidence of each target group, which model k reaches to 1 - k/5."""
    varied = {"temperature_c": temperatures_c, "f_number": f_numbers, "moves": moves}
    axes = {"illuminance_lux": lights_lux, **{name: varied.get(name, (OWN[name],)) for name in FURTHER}}
    axes |= {"velocity_x_px_s": speeds, "velocity_y_px_s": (0.0,), "exposure_s": exposures_s}
    conditions = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    exposed = [
        {**at, "clean": False, "blur_px": at["exposure_s"] * abs(at["velocity_x_px_s"])} for at in conditions
    ]
    every = [{**dict.fromkeys(exposed[0]), "clean": True}, *exposed]
    names = ("models", "scores", "answers", "curves", "examples", "recommendations", "averages")
    found: dict[str, list[Any]] = {name: [] for name in names}
    for k, model in enumerate(models):
        best_of = {
            group: best * (1 - k / 5) for group, best in (GROUPS if groups is None else groups).items()
        }
        found["scores"] += [_score(model, kind, at, best_of) for at in every]
        found["models"].append(_summary(model, kind, k, bool(best_of)))
        tables = [
            _table(model, group, best, conditions, 24 if interval else 5) for group, best in best_of.items()
        ]
        for table in tables:
            found["answers"] += [
                replace(row, clean_score=best_of[table.group]) for row in answers(table, CRITERION)
            ]
        if tables:
            of = averages([each for table in tables for each in table.split(SETTING)], THRESHOLD)
            found["recommendations"] += recommendations(of)
            found["averages"].append(average_curve(of))
        for index in range(n_examples):
            found["examples"].append(
                _example(folder, index, model, kind, every[index * 7 % len(every)], best_of)
            )
    return RunData(_manifest(models, kind, len(every)), skipped=[], **found)


def _table(model, group, best, conditions, pictures):
    """Of so many pictures that differ by up to 5 %."""
    rows = sorted(conditions, key=lambda at: [at[name] for name in ORDER])
    each = np.linspace(0.95, 1.05, pictures)[:, None]
    sums = each * np.array([confidence(at, best) for at in rows])
    return ScoreTable(
        model=model,
        group=group,
        clusters=tuple(map(str, range(pictures))),
        conditions={name: np.array([at[name] for at in rows]) for name in ORDER},
        sums=sums,
        counts=np.ones_like(sums),
        saturated=np.full(len(rows), 0.01),
        brightness=np.full(len(rows), 0.4),
        n_targets=12,
    )


def _score(model, kind, at, best_of):
    values = [best if at["clean"] else confidence(at, best) for best in best_of.values()]
    mean = float(np.mean(values)) if values else None
    values: Row = {}
    if mean is not None:
        values |= {name: mean * (1 - place / 20) for place, name in enumerate(SCORES[kind])}
    rate = None if mean is None else float(mean > 0.25)
    values |= {"target_confidence": mean, "detection_rate": rate, "detection_rate_swept": rate}
    scores = {name: WithInterval(value) for name, value in values.items()}
    shown: Row = {"applied_gain_db": 6.0, "snr_db": 25.0, "brightness": 0.4, "saturated_share": 0.01}
    about = {} if at["clean"] else shown
    return ScoreRow(model, AxisValues.of(at), at["blur_px"], 3, 3, 0, **about, scores=scores)


def _summary(model, kind, k, scored):
    names = ("p", "mpc", "rpc", "auc_exposure", "auc_blur", "target_confidence", "ap50", "ar100")
    row: Row = {name: 0.8 - k / 10 - place / 50 if scored else None for place, name in enumerate(names)}
    row |= {"ap50": None, "ar100": None} if kind == "reader" else {}
    row |= {"false_positives_per_image": 0.25, "calibration_error": None}
    p, mpc, rpc = (WithInterval(row.pop(name)) for name in ("p", "mpc", "rpc"))
    areas = row.pop("auc_exposure"), row.pop("auc_blur")
    scores = {name: WithInterval(value) for name, value in row.items()}
    latency = 30.0 - 8 * k, 36.0 - 8 * k, 1
    return ModelRow(model, kind, "AP", p, mpc, rpc, *areas, scores, *latency, mpc_deficit=UNKNOWN)


def _example(folder, index, model, kind, at, best_of):
    text = "STOP" if kind == "reader" else None
    targets = []
    for k, best in enumerate(list(best_of.values())[:3]):
        box = {
            "x0": 40 + 150 * k,
            "y0": 60,
            "x1": 140 + 150 * k,
            "y1": 160,
            "width_px": 100,
            "height_px": 100,
        }
        value = best if at["clean"] else confidence(at, best)
        targets.append(answer(k, **box, confidence=value, text=text))
    detections = [LabelledBox(target.box_xyxy, target.confidence, "stop sign") for target in targets]
    detections.append(LabelledBox((300, 200, 380, 290), 0.41, "kite"))
    path = folder / "examples" / f"example {index}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    image: NDArray[np.uint8] = np.full((320, 480, 3), 90, np.uint8)
    cv2.circle(image, (90, 110), 50, (40, 40, 200), -1)
    cv2.imwrite(str(path), image)
    conditions = AxisValues.of(at)
    of = cell(
        str(index), targets, conditions=conditions, blur_px=at["blur_px"], image="chart.png", model=model
    )
    return Example(of.cell, path, tuple(detections if kind == "detector" else ()), tuple(targets))


def _manifest(models, kind, n_conditions):
    sources = {"family": "output shapes", "colour_order": "assumed (usual for YOLOX)"}
    contract: Row = {
        "family": "yolox",
        "colour_order": "BGR",
        "classes": ["stop sign", "kite"],
        "sources": sources,
    }
    sheet = {"read_noise_e": "https://example.org/sheet.pdf"}
    return {
        "title": "Exposure sweep",
        "command": "blurnoise sweep model.onnx --exposures 1ms 4ms",
        "models": [
            {"name": name, "kind": kind, "file": f"{k}.onnx", "sha256": "695e" * 16, "contract": contract}
            for k, name in enumerate(models)
        ],
        "camera": {"name": "AR0237", "read_noise_e": 2.5, "sources": sheet},
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
