"""The page of the rerun, one HTML file that works offline, and paper.csv."""

from __future__ import annotations

import base64
import io
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path

import cv2
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure as Drawn

from blurnoise.optics.camera import Camera
from blurnoise.scene.scene import ExposedScene, Exposure
from blurnoise_eval.paper.item import AGREES, COLUMNS, DIFFERS, NOT_JUDGED, NOT_RUN, Figure, Outcome
from blurnoise_eval.paper.measurement import CAMERA, CHAINS, Chain, camera_of, picture
from blurnoise_eval.paper.table import NOT_COMPARED, PAPER
from blurnoise_eval.plots.style import COLOURS, plain_numbers, tidy
from blurnoise_eval.report import findings
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

_SHOWN_MS, _SHOWN_PX, _SHOWN_DX = (1, 5, 20, 45, 90), 50, 200.0
_QUOTED = "#e8b000"


def write(outcomes: Sequence[Outcome], facts: dict[str, str], folder: Path) -> Path:
    """Write paper.csv and paper.html; returns the page's path. Raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    rows, page = rows_of(outcomes), _page(outcomes, facts)
    write_whole(folder / "paper.csv", (line.encode() for line in csv_lines(COLUMNS, rows)))
    write_whole(folder / "paper.html", page.encode())
    return folder / "paper.html"


def rows_of(outcomes: Sequence[Outcome]) -> list[dict[str, str]]:
    """The rows of paper.csv."""
    return [row for outcome in outcomes for row in outcome.rows()]


def summary(outcomes: Sequence[Outcome]) -> str:
    """'30 of 32 statements agree; 1 differs; 1 item was not run.'"""
    count = Counter(row["verdict"] for row in rows_of(outcomes))
    text = f"{count[AGREES]} of {count[AGREES] + count[DIFFERS]} statements of the paper agree"
    if count[DIFFERS]:
        text += f"; {count[DIFFERS]} differ{'' if count[DIFFERS] > 1 else 's'}"
    if count[NOT_RUN]:
        text += f"; {count[NOT_RUN]} item{' was' if count[NOT_RUN] == 1 else 's were'} not run"
    return f"{text}."


def differs(outcomes: Sequence[Outcome]) -> bool:
    """Whether anything that should agree does not."""
    return any(row["verdict"] == DIFFERS for row in rows_of(outcomes))


def _page(outcomes: Sequence[Outcome], facts: dict[str, str]) -> str:
    folders = [str(Path(__file__).parent / "templates"), str(files("blurnoise_eval.report") / "templates")]
    environment = Environment(
        loader=FileSystemLoader(folders), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    texts: dict[str, list[str]] = {DIFFERS: [], NOT_RUN: []}
    for row in rows_of(outcomes):
        beside = f", not {row['expected']}" if row["verdict"] == DIFFERS else ""
        texts.setdefault(row["verdict"], []).append(f"{row['place']}, {row['what']}: {row['found']}{beside}")
    return environment.get_template("paper.html.j2").render(
        paper=PAPER,
        summary=summary(outcomes),
        differing=texts[DIFFERS],
        missing=texts[NOT_RUN],
        items=[
            {
                "item": outcome.item,
                "rows": outcome.rows(),
                "figures": [{"title": each.title, "png": _base64(png(each))} for each in outcome.figures],
            }
            for outcome in outcomes
        ],
        classes={AGREES: "agrees", DIFFERS: "differs", NOT_RUN: "open", NOT_JUDGED: "open"},
        seen=[(chain, list(_seen(chain))) for chain in CHAINS],
        seen_as=f"sign of {_SHOWN_PX} px, 50 lux, {_SHOWN_DX:g} px/s",
        not_compared=NOT_COMPARED,
        facts=facts,
        camera=findings.sourced(Camera.preset(CAMERA).to_dict()),
        findings=findings,
    )


def _seen(chain: Chain) -> Iterator[dict[str, str]]:
    """A sign through a chain, exposure by exposure."""
    camera, scene = camera_of(chain), ExposedScene.of_picture(picture(chain, _SHOWN_PX))
    exposures = [Exposure(camera, 1e-3 * ms, 50.0, (_SHOWN_DX, 0.0)) for ms in _SHOWN_MS]
    for ms, frame in zip(_SHOWN_MS, scene.frames(exposures), strict=True):
        cut = frame.picture[100:220, 100:220, ::-1].copy()
        yield {"ms": f"{ms:g} ms", "png": _base64(cv2.imencode(".png", cut)[1].tobytes())}


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def png(figure: Figure) -> bytes:
    """The figure, 560 x 360 px at twice the density: lines found here, shaded or marked what the paper says."""
    drawn = Drawn(figsize=(5.6, 3.6), layout="constrained")
    axes = drawn.subplots()
    withheld = False
    for place, line in enumerate(figure.lines):
        colour = COLOURS[(place if line.colour is None else line.colour) % len(COLOURS)]
        style = "o" if figure.points else "--" if line.dashed else "o-"
        axes.plot(line.x, line.y, style, color=colour, ms=3.2, lw=1.4, label=line.label, zorder=3)
        lost = [x for x, y in zip(line.x, line.y, strict=True) if math.isnan(y)]
        foot = [0.03 + 0.03 * place] * len(lost)
        axes.plot(lost, foot, "x", color=colour, ms=4.5, mew=1.2, transform=axes.get_xaxis_transform())
        withheld |= bool(lost)
    if figure.logarithmic and not figure.points:
        axes.set_xscale("log")
        plain_numbers(axes.xaxis, digits=(1, 2, 5))
    for row, (low, high, what) in enumerate(figure.quoted):
        if high > low:
            axes.axvspan(low, high, color=_QUOTED, alpha=0.22, lw=0, zorder=0)
        else:
            axes.axvline(low, color=_QUOTED, lw=1.6, zorder=1)
        middle = (low * high) ** 0.5 if axes.get_xscale() == "log" else (low + high) / 2
        axes.annotate(
            what, (middle, 1.0), (0, 3 + 9 * (row % 3)), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=7.5, color="#7a5c00", ha="center",
        )  # fmt: skip
    if figure.level is not None:
        axes.axhline(figure.level, color="0.6", lw=0.9, zorder=1)
        axes.set_ylim(-0.04, 1.04)
    tidy(axes, x=figure.x_label, y=figure.y_label)
    if len(figure.lines) > 1:
        title = "cross at the foot: withheld" if withheld else None
        columns = 2 if len(figure.lines) > 5 else 1
        axes.legend(fontsize=7.5, frameon=False, title=title, title_fontsize=7.5, ncols=columns)
    made = io.BytesIO()
    drawn.savefig(made, format="png", dpi=200)
    return made.getvalue()
