"""A run drawn and written down: figures for print and one HTML page that answers the exposure question.

Domain: confidences in [0, 1], exposures in s (shown in ms), light in lux, speeds in px/s. The page works
offline and asks the network for nothing. Names of classes, files and targets are untrusted: the template
escapes all of them, and the interactive curves never receive one.
"""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from blurnoise_eval import figures, findings, pictures
from blurnoise_eval.files import write_whole
from blurnoise_eval.pictures import exposure_text, velocity_of, velocity_text

MAX_GROUPS = 12  # target groups on the page
MAX_PICTURES = 16
PICTURE_PX = 480  # longest side of a picture on the page
PICTURE_BYTES = 40_000  # of one picture as JPEG: 16 of them and plotly stay below 6 MB

FIGURES = {
    "confidence_exposure.png": figures.confidence_exposure,
    "confidence_blur.png": figures.confidence_blur,
    "confidence_speed.png": figures.confidence_speed,
    "examples.png": figures.contact_sheet,
}


@dataclass(frozen=True)
class RunData:
    """Everything a report shows.

    manifest: title, command, model (name, file, sha256, contract with its sources, assumptions), camera with
    its sources, seed, versions, hardware, threads, threshold, images, wall_s, warnings.
    cells: one row per picture and condition. targets: one row per cell and target.
    skipped: pictures left out, with the reason.
    answers: one per group x light x velocity: mean confidence and its 95 % interval at every exposure, the
    windows in s in which confidence stays at or above the threshold (none: no exposure works), whether they
    reach an end of the tested range, and the recommended exposure.
    examples: simulated pictures on disk with their detections and targets.
    """

    manifest: dict[str, Any]
    cells: list[dict[str, Any]]
    targets: list[dict[str, Any]]
    skipped: list[dict[str, Any]]
    answers: list[dict[str, Any]]
    examples: list[dict[str, Any]]


def write_report(data: RunData, folder: Path) -> Path:
    """Write ``folder``/report.html and ``folder``/figures/*.png; return the page's path.

    Raises ``OSError`` where the folder cannot be written.
    """
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name, draw in FIGURES.items():
        draw(data).savefig(folder / "figures" / name, dpi=150)
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = folder / "report.html"
    text = environment.get_template("report.html.j2").render(_page(data, folder))
    write_whole(page, text.encode("utf-8", errors="replace"))
    return page


def _page(data: RunData, folder: Path) -> dict[str, Any]:
    manifest, model, camera = data.manifest, data.manifest["model"], data.manifest["camera"]
    contract = model.get("contract", {})
    groups = figures.largest_groups(data, MAX_GROUPS)
    lights = sorted({answer["illuminance_lux"] for answer in data.answers})
    velocities = sorted({velocity_of(answer) for answer in data.answers}, key=lambda v: (math.hypot(*v), v))
    return {
        "title": manifest["title"],
        "threshold": manifest["threshold"],
        "model_name": model["name"],
        "camera_name": camera.get("name", "camera"),
        "groups": groups,
        "lights": lights,
        "velocities": [velocity_text(velocity) for velocity in velocities],
        "answers": [_group_answers(data, group, lights, velocities) for group in groups],
        "summary": findings.summary(data),
        "n_hidden_groups": len({answer["group"] for answer in data.answers}) - len(groups),
        "alarms": findings.alarms(data),
        "warnings": findings.warnings(data),
        "assumptions": findings.assumptions(data),
        "curves": _curves(data, groups, lights, velocities),
        "examples": _examples(data, folder),
        "n_examples": len(data.examples),
        "other_score": pictures.OTHER_SCORE,
        "figures": list(FIGURES),
        "run": findings.run_facts(data),
        "model": {key: findings.shown(model[key]) for key in ("name", "file", "sha256") if key in model},
        "contract": findings.sourced(contract),
        "camera": findings.sourced(camera),
        "versions": {name: findings.shown(value) for name, value in manifest.get("versions", {}).items()},
        "hardware": {name: findings.shown(value) for name, value in manifest.get("hardware", {}).items()},
        "plotly_js": Markup(get_plotlyjs()),  # the library's own text, no user input
    }


def _group_answers(
    data: RunData, group: str, lights: list[float], velocities: list[tuple[float, float]]
) -> dict[str, Any]:
    """One target group's part of the answer table: a row per light, a cell per velocity."""
    answers = {
        (answer["illuminance_lux"], velocity_of(answer)): answer
        for answer in data.answers
        if answer["group"] == group
    }
    cells = {key: _answer_cell(answer) for key, answer in answers.items()}
    return {
        "group": group,
        "n_targets": max(answer["n_targets"] for answer in answers.values()),
        "clean": findings.clean_confidence(data, group),
        "rows": [(lux, [cells.get((lux, velocity)) for velocity in velocities]) for lux in lights],
    }


def _answer_cell(answer: dict[str, Any]) -> dict[str, Any]:
    exposures = answer["exposures_s"]
    low, high = math.log(min(exposures)), math.log(max(exposures))

    def percent(exposure_s: float) -> float:
        return 100 * (math.log(exposure_s) - low) / (high - low)

    measured = [pair for pair in zip(answer["confidence"], exposures, strict=True) if pair[0] is not None]
    best = max(measured, key=lambda pair: pair[0]) if measured else None
    recommended = answer["recommended_s"]
    bars = (
        [(percent(a), max(1.5, percent(b) - percent(a))) for a, b in answer["windows_s"]]
        if low < high
        else None
    )
    return {
        "works": bool(answer["windows_s"]),
        "window": findings.window_text(answer),
        "recommended": None if recommended is None else exposure_text(recommended),
        "confidence": answer["confidence_at_recommended"],
        "best": None if best is None else f"best {best[0]:.2f} at {exposure_text(best[1])}",
        "bars": bars,
        "tick": percent(recommended) if recommended is not None and low < high else None,
    }


def _curves(
    data: RunData, groups: list[str], lights: list[float], velocities: list[tuple[float, float]]
) -> dict[str, Any]:
    """Numbers for the interactive curves; groups, lights, velocities and exposures by index, no names."""
    measured = figures.points(data)
    exposures = sorted({point.exposure_s for point in measured})
    rows = [
        [
            *(groups.index(p.group), lights.index(p.illuminance_lux)),
            *(velocities.index(p.velocity_px_s), exposures.index(p.exposure_s)),
            *(
                None if value is None else round(value, 4)
                for value in (p.blur_px, p.confidence, p.low, p.high)
            ),
            p.n_targets,
        ]
        for p in measured
        if p.group in groups
    ]
    windows = [
        [
            groups.index(a["group"]),
            lights.index(a["illuminance_lux"]),
            velocities.index(velocity_of(a)),
            low,
            high,
        ]
        for a in data.answers
        if a["group"] in groups
        for low, high in a["windows_s"]
    ]
    return {
        "threshold": data.manifest["threshold"],
        "lights_lux": lights,
        "velocities": [velocity_text(velocity) for velocity in velocities],
        "speeds_px_s": [math.hypot(*velocity) for velocity in velocities],
        "exposures_ms": [1e3 * exposure_s for exposure_s in exposures],
        "exposures": [exposure_text(exposure_s) for exposure_s in exposures],
        "velocity_colours": figures.line_colours("viridis", len(velocities)),
        "exposure_colours": figures.line_colours("plasma", len(exposures)),
        "joined": figures.one_velocity_per_speed(measured),
        "points": rows,
        "windows": windows,
    }


def _examples(data: RunData, folder: Path) -> list[dict[str, Any]]:
    """The example pictures as JPEG data, evenly chosen, each with its caption and file."""
    threshold = data.manifest["threshold"]
    shown = []
    for index in figures.spread(range(len(data.examples)), MAX_PICTURES):
        example = data.examples[index]
        picture = pictures.drawn_example(example, PICTURE_PX, threshold)
        path = Path(example["path"]).absolute()
        near = path.is_relative_to(folder.absolute())
        shown.append(
            {
                "image": example["image"],
                "jpeg": None if picture is None else _jpeg_base64(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)),
                "condition": pictures.condition_text(example),
                "outcome": pictures.outcome_text(example, threshold),
                "file": quote(path.relative_to(folder.absolute()).as_posix(), errors="surrogateescape")
                if near
                else None,
            }
        )
    return shown


def _jpeg_base64(bgr: Any) -> str:
    """The picture as JPEG in base64, at the best of a few qualities that keeps it below PICTURE_BYTES."""
    for quality in (88, 75, 60, 40, 20):
        encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(encoded) <= PICTURE_BYTES:
            break
    return base64.b64encode(encoded).decode("ascii")
