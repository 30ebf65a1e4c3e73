"""The page of brackets, with pictures and curves, and the files beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from blurnoise_eval.datasets import write_light
from blurnoise_eval.measure.bracket_tables import (
    HEADS,
    WORDS,
    answers,
    confidence_rows,
    document,
    half_rows,
    picture_table,
    table,
)
from blurnoise_eval.measure.bracket_worth import BRACKET, ROUTES, BracketTrial, Curves
from blurnoise_eval.measure.followed import Array
from blurnoise_eval.measure.page import png
from blurnoise_eval.measure.picture_measures import MEASURES, Bytes
from blurnoise_eval.plots.style import COLOURS, GREY, legend_above, small_multiples, spread, tidy
from blurnoise_eval.report.page import jpeg, write_page
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

TEMPLATE = Path(__file__).parent / "templates" / "bracket.html.j2"
FILES = (
    "validation.html",
    "validation.json",
    "pictures.csv",
    "confidences.csv",
    "halves.csv",
    "scenes/*.tiff",
    "*.yaml",
)
_SHOWN, _SHOWN_PX, _MOST_PANELS = 6, 300, 9


def write(trials: Sequence[BracketTrial], notes: Sequence[str], folder: Path) -> None:
    """Write the page, the tables, each scene as linear light and its camera; raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenes").mkdir(exist_ok=True)
    for trial in trials:
        write_light(folder / "scenes" / f"{trial.name}.tiff", trial.scene.light)
        trial.camera.save(folder / f"{trial.name}.yaml")
    tables: dict[str, list[Any]] = {
        "pictures": [row for trial in trials for row in trial.rows],
        "confidences": [*confidence_rows(trials)],
        "halves": [*half_rows(trials)],
    }
    for name, rows in tables.items():
        columns = [*rows[0]] if rows else ["bracket"]
        lines = csv_lines(columns, ({key: _shown(value) for key, value in row.items()} for row in rows))
        write_whole(folder / f"{name}.csv", (line.encode() for line in lines))
    text = json.dumps(document(trials) | {"notes": [*notes]}, indent=1, allow_nan=False)
    write_whole(folder / "validation.json", text.encode())
    _write_page(trials, notes, folder)


def _shown(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write_page(trials: Sequence[BracketTrial], notes: Sequence[str], folder: Path) -> None:
    write_page(
        folder / "validation.html",
        TEMPLATE,
        answers=answers(trials),
        notes=notes,
        heads=HEADS,
        tables=table(trials),
        brackets=[
            {
                "name": trial.name,
                "camera": trial.camera.name,
                "tone": trial.tone,
                "pictures": [*_pictures(trial)],
                "rows": picture_table(trial),
                "measures": png(draw_measures(trial)),
                "curves": [
                    (curves.model, png(draw_curves(trial, curves)), len(curves.objects))
                    for curves in trial.curves
                ],
            }
            for trial in trials
        ],
        most=_MOST_PANELS,
    )


def _pictures(trial: BracketTrial) -> Iterator[dict[str, Any]]:
    for place in spread(range(len(trial.shots)), _SHOWN):
        some = [trial.captured[place], *(trial.simulated[route][place] for route in ROUTES)]
        shown = (one for curves in trial.curves for one in curves.objects[:_MOST_PANELS])
        boxes = {tuple(map(round, one.box_xyxy)) for one in shown}
        yield {
            "caption": f"{trial.stops[place]:+.1f} EV",
            "name": trial.shots[place].name,
            "jpegs": [jpeg(_small(picture, sorted(boxes))) for picture in some],
        }


def _small(picture: Bytes, boxes: Sequence[tuple[int, ...]]) -> Bytes:
    scale = _SHOWN_PX / max(picture.shape[:2])
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    for box in boxes:
        left, top, right, bottom = (round(scale * side) for side in box)
        cv2.rectangle(small, (left, top), (right, bottom), (0, 114, 178), 1)
    return np.asarray(small, np.uint8)


def draw_measures(trial: BracketTrial) -> Figure:
    """Each measure of pictures over exposure: captured, and both kinds of simulated ones."""
    figure, panels = small_multiples(len(MEASURES), 3, (3.7, 2.5), (0.0, 0.5))
    for axes, measure in zip(panels, MEASURES, strict=True):
        rows = {
            route: [row for row in trial.rows if row["measure"] == measure.name and row["route"] == route]
            for route in ROUTES
        }
        captured = np.array([row["captured"] for row in rows[BRACKET]])
        simulated = {route: np.array([row["simulated"] for row in rows[route]]) for route in ROUTES}
        _draw(axes, trial, captured, simulated)
        tidy(axes, x="Exposure / EV", y=f"{measure.title}{f' / {measure.unit}' if measure.unit else ''}")
    legend_above(figure, panels[0].get_legend_handles_labels()[0], "")
    return figure


def draw_curves(trial: BracketTrial, curves: Curves) -> Figure:
    """Confidence over exposure of the objects that were found surest, at most nine."""
    every = range(min(len(curves.objects), _MOST_PANELS))
    figure, panels = small_multiples(max(1, len(every)), 3, (3.7, 2.3), (0.0, 0.5), sharey=True)
    for axes, number in zip(panels, every, strict=False):
        simulated = {route: curves.simulated[route][:, number] for route in ROUTES}
        _draw(axes, trial, curves.captured[:, number], simulated)
        axes.axhline(curves.captured[:, number].max() / 2, color=GREY, lw=0.8, ls=":")
        axes.set_ylim(-0.03, 1.03)
        tidy(axes, title=f"{curves.objects[number].label} {number}", x="Exposure / EV", y="Confidence")
    legend_above(figure, panels[0].get_legend_handles_labels()[0], "")
    return figure


def _draw(axes: Axes, trial: BracketTrial, captured: Array, simulated: Mapping[str, Array]) -> None:
    """Lines of what is compared, of a scene at rest."""
    still = np.array([not shot.moving for shot in trial.shots])
    axes.plot(trial.stops[still], captured[still], color="0.15", marker="o", ms=4, label="captured")
    for colour, route in zip(COLOURS, ROUTES, strict=False):
        used, label = trial.used(route), f"simulated from {WORDS[route]}"
        style: Any = {"marker": "o", "mfc": "none", "ms": 4, "lw": 1.2}
        axes.plot(trial.stops[used], simulated[route][used], color=colour, label=label, **style)
