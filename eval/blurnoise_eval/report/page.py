"""The page of a run: one HTML file that works offline and asks the network for nothing.

Names of models, classes, files and targets are untrusted: the template escapes all of them, and the script never
receives one.
"""

from __future__ import annotations

import base64
import gzip
import io
import shlex
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs

from blurnoise_eval.plots.annotate import OTHER_SCORE, drawn_example
from blurnoise_eval.report import charts, figures, findings, first_screen, tables, words
from blurnoise_eval.report.opening import opening
from blurnoise_eval.report.run import TABLES, RunData
from blurnoise_eval.store.rows import Example
from blurnoise_eval.system.files import path_within, write_whole

TEMPLATES = Path(__file__).parent / "templates"
FAILURES = "failures.html"
MAX_GROUPS = 12  # target groups on the page
MAX_PICTURES = 40
PICTURE_PX, PICTURE_BYTES = (
    400,
    16_000,
)  # longest side and JPEG of a picture, so that the page stays below 3 MB


def write_report(
    data: RunData,
    folder: Path,
    progress: Callable[[int], None] = lambda figures: None,
    *,
    run: str | None = None,
) -> Path:
    """Write ``folder``/report.html and ``folder``/figures/*.png; return the page's path.

    progress: called for each figure. run: where the run is, for commands to copy, by default the folder. Raises
    ``OSError`` where the folder cannot be written.
    """
    path_within(folder, "figures").mkdir(parents=True, exist_ok=True)
    drawn: dict[str, bytes] = {}
    groups = data.largest_groups(MAX_GROUPS)
    numbers = charts.numbers(data, groups)
    for name, draw in figures.figures_of(data, groups, numbers).items():
        drawn[name] = _png(draw())
        progress(1)
    for name, png in drawn.items():
        write_whole(folder / "figures" / name, png)
    page, first = folder / "report.html", opening(data, shlex.quote(run or str(folder)))
    write_page(
        page,
        TEMPLATES / "report.html.j2",
        data=data,
        findings=findings,
        tables=tables,
        words=words,
        opening=first,
        main_figure=first_screen.main_figure(data, first.model),
        size=(first_screen.WIDTH, first_screen.HEIGHT),
        pair=[_shown(data, folder, each, short=True) for each in first_screen.pair(data, first.model)],
        groups=groups,
        numbers=numbers,
        examples=list(_examples(data, folder)),
        figures=list(drawn),
        files=TABLES,
        failures=FAILURES if (folder / FAILURES).is_file() else None,
        other_score=OTHER_SCORE,
        plotly_packed=_plotly(),
    )
    return page


def write_page(page: Path, template: Path, **shown: Any) -> None:
    """Write what a template shows, which may include those of reports; raises ``OSError``."""
    environment = Environment(
        loader=FileSystemLoader([template.parent, TEMPLATES]), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    text = environment.get_template(template.name).render(**shown)
    write_whole(page, text.encode("utf-8", errors="replace"))


@cache
def _plotly() -> str:
    return _base64(gzip.compress(get_plotlyjs().encode(), 6, mtime=0))


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _png(figure: Figure) -> bytes:
    drawing = io.BytesIO()
    with warnings.catch_warnings():  # a text in a script that the font lacks is drawn as boxes
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(drawing, format="png", dpi=150, pil_kwargs={"compress_level": 1})
    return drawing.getvalue()


def _examples(data: RunData, folder: Path) -> Iterator[dict[str, Any]]:
    """The example pictures, evenly chosen."""
    for example in data.spread_examples(MAX_PICTURES):
        yield _shown(data, folder, example)


def _shown(data: RunData, folder: Path, example: Example, *, short: bool = False) -> dict[str, Any]:
    """An example picture as JPEG data, with its caption and file."""
    threshold = data.found_from
    picture = drawn_example(example.path, example.detections, example.targets, PICTURE_PX, threshold)
    path, home = example.path.absolute(), folder.absolute()
    near = path.is_relative_to(home)
    return {
        "image": example.cell.image,
        "model": data.model_names.index(example.cell.model),
        "jpeg": None if picture is None else jpeg(picture),
        "condition": data.settings.condition_text(example.cell, short=short),
        "outcome": words.outcome_text(example, threshold),
        "file": quote(path.relative_to(home).as_posix(), errors="surrogateescape") if near else None,
    }


def jpeg(rgb: Any) -> str:
    """The picture as JPEG in base64, at the best of a few qualities with which it is small."""
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    for quality in (80, 60, 40, 20):
        encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(encoded) <= PICTURE_BYTES:
            break
    return _base64(encoded)
