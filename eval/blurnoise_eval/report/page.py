"""The page of a run: one HTML file that works offline and asks the network for nothing.

Domain: confidences in [0, 1], exposures in s (shown in ms), speeds in px/s. Names of models,
classes, files and targets are untrusted: the template escapes all of them, and the script never receives one.
"""

from __future__ import annotations

import base64
import gzip
import io
import math
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs

from blurnoise_eval.grid.axes import BLUR, EXPOSURE, MOVES, SPEED, velocity_text
from blurnoise_eval.plots import annotate as pictures
from blurnoise_eval.report import figures, findings, interactive, tables, words
from blurnoise_eval.report.opening import opening
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import word
from blurnoise_eval.system.files import path_within, write_whole

MAX_GROUPS = 12  # target groups on the page
MAX_SIDE_BY_SIDE = 4  # models
MAX_PICTURES = 60
PICTURE_PX = 400  # longest side of a picture on the page
PICTURE_BYTES = 30_000  # of one picture as JPEG, at most
PICTURES_BYTES = 600_000  # of all: with plotly, packed, the page stays below 3 MB

Figures = dict[str, Callable[[RunData], Figure]]  # by file name
FIGURES: Figures = {
    "confidence_exposure.png": figures.confidence_exposure,
    "confidence_blur.png": partial(figures.confidence_over, x=BLUR),
    "confidence_speed.png": partial(figures.confidence_over, x=SPEED),
    "gain_snr_brightness.png": figures.gain_snr_brightness,
    "examples.png": figures.contact_sheet,
}
TABLES = (
    "recommendations.csv", "answers.csv", "models.csv", "scores.csv", "curves.csv", "results.csv", "targets.csv",
)  # fmt: skip


def figures_of(data: RunData) -> Figures:
    """The figures of this run by file name: one more for each axis that varies besides the usual."""
    found = dict(FIGURES)
    for axis in data.settings.further if data.answers else ():
        if not axis.choices and all(map(math.isfinite, data.settings.values(axis))):
            found[f"confidence_{axis.name}.png"] = partial(figures.confidence_over, x=axis)
    if data.answers and MOVES in data.settings.axes:
        found["score_moves.png"] = figures.score_moves
    if len(data.manifest["models"]) > 1:
        found["latency_robustness.png"] = figures.latency_robustness
    return found


def write_report(data: RunData, folder: Path, progress: Callable[[int], None] = lambda figures: None) -> Path:
    """Write ``folder``/report.html and ``folder``/figures/*.png; return the page's path.

    progress: called for each figure. Raises ``OSError`` where the folder cannot be written.
    """
    path_within(folder, "figures").mkdir(parents=True, exist_ok=True)
    drawn = figures_of(data)
    for name, draw in drawn.items():
        write_whole(folder / "figures" / name, _png(draw(data), 150))
        progress(1)
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = folder / "report.html"
    text = environment.get_template("report.html.j2").render(_page(data, folder), figures=list(drawn))
    write_whole(page, text.encode("utf-8", errors="replace"))
    return page


def _page(data: RunData, folder: Path) -> dict[str, Any]:
    """What the template shows: the run, what is computed of it here, and the modules that it asks for the rest."""
    groups, first = data.largest_groups(MAX_GROUPS), opening(data)
    varied = [axis for axis in data.settings.axes if len(data.settings.values(axis)) > 1]
    return {
        "data": data,
        "findings": findings,
        "tables": tables,
        "words": words,
        "asked": data.criterion,
        "models": data.model_names,
        "side_by_side": 1 < len(data.model_names) <= MAX_SIDE_BY_SIDE,
        "groups": groups,
        "views": [word(EXPOSURE), word(BLUR), word(SPEED), *map(word, varied)],
        "setting_head": "Setting" if data.settings.further else "Light",
        "velocities": [velocity_text(velocity) for velocity in data.velocities_px_s],
        "exposure_text": EXPOSURE.text,
        "opening": first,
        "numbers": interactive.numbers(data, groups),
        "kept_curve": None if first.model is None else interactive.kept_curve(data, first.model),
        "examples": _examples(data, folder),
        "trades": [
            (title, _base64(_png(figures.latency_robustness(data, [name]), 120)))
            for name, title in figures.comparable(data).items()
        ],
        "files": TABLES,
        "other_score": pictures.OTHER_SCORE,
        "plotly_packed": _plotly(),
    }


@cache
def _plotly() -> str:
    return _base64(gzip.compress(get_plotlyjs().encode(), 9, mtime=0))


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _png(figure: Figure, dpi: int) -> bytes:
    drawing = io.BytesIO()
    with warnings.catch_warnings():  # a text in a script that the font lacks is drawn as boxes
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(drawing, format="png", dpi=dpi, pil_kwargs={"compress_level": 1})
    return drawing.getvalue()


def _examples(data: RunData, folder: Path) -> list[dict[str, Any]]:
    """The example pictures as JPEG data, evenly chosen, each with its caption and file."""
    threshold, home = data.found_from, folder.absolute()
    found = []
    chosen = data.spread_examples(MAX_PICTURES)
    most = min(PICTURE_BYTES, PICTURES_BYTES // max(len(chosen), 1))
    for example in chosen:
        picture = pictures.drawn_example(example, PICTURE_PX, threshold)
        path = Path(example["path"]).absolute()
        file = None
        if path.is_relative_to(home):
            file = quote(path.relative_to(home).as_posix(), errors="surrogateescape")
        found.append(
            {
                "image": example["image"],
                "model": data.model_names.index(example["model"]),
                "jpeg": None if picture is None else _jpeg(picture, most),
                "condition": data.settings.condition_text(example),
                "outcome": words.outcome_text(example, threshold),
                "found": "missed" if words.missed(example, threshold) else "found",
                "file": file,
            }
        )
    return found


def _jpeg(rgb: Any, most: int) -> str:
    """The picture as JPEG in base64, at the best of a few qualities, and then sizes, with at most so many bytes."""
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    for scale, quality in ((1.0, 88), (1.0, 75), (1.0, 60), (1.0, 40), (0.7, 40), (0.5, 30)):
        small = cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else bgr
        encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(encoded) <= most:
            break
    return _base64(encoded)
