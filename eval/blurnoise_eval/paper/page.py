"""The page of the rerun, one HTML file that works offline, and paper.csv."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from blurnoise.optics.camera import Camera
from blurnoise.scene.scene import ExposedScene, Exposure
from blurnoise_eval.paper import chains
from blurnoise_eval.paper.drawing import png
from blurnoise_eval.paper.item import AGREES, COLUMNS, DIFFERS, NOT_JUDGED, NOT_RUN, Outcome
from blurnoise_eval.paper.measurement import CAMERA
from blurnoise_eval.paper.table import NOT_COMPARED, PAPER
from blurnoise_eval.report.findings import sourced
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

_SHOWN_MS, _SHOWN_PX, _SHOWN_DX = (1, 5, 20, 45, 90), 50, 200.0


def write(outcomes: Sequence[Outcome], facts: dict[str, str], folder: Path) -> Path:
    """Write paper.csv and paper.html; returns the page's path. Raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = rows_of(outcomes)
    page = _page(outcomes, facts)
    write_whole(folder / "paper.csv", (line.encode() for line in csv_lines(COLUMNS, rows)))
    write_whole(folder / "paper.html", page.encode())
    return folder / "paper.html"


def rows_of(outcomes: Sequence[Outcome]) -> list[dict[str, str]]:
    """The rows of paper.csv."""
    return [row for outcome in outcomes for row in outcome.rows()]


def summary(outcomes: Sequence[Outcome]) -> str:
    """'30 of 32 statements agree; 1 differs; 1 item was not run.'"""
    count = Counter(row["verdict"] for row in rows_of(outcomes))
    judged = count[AGREES] + count[DIFFERS]
    text = f"{count[AGREES]} of {judged} statements of the paper agree"
    if count[DIFFERS]:
        text += f"; {count[DIFFERS]} differ{'' if count[DIFFERS] > 1 else 's'}"
    if count[NOT_RUN]:
        text += f"; {count[NOT_RUN]} item{' was' if count[NOT_RUN] == 1 else 's were'} not run"
    return f"{text}."


def differs(outcomes: Sequence[Outcome]) -> bool:
    """Whether anything that should agree does not."""
    return any(row["verdict"] == DIFFERS for row in rows_of(outcomes))


def _page(outcomes: Sequence[Outcome], facts: dict[str, str]) -> str:
    report = files("blurnoise_eval.report") / "templates"
    environment = Environment(
        loader=FileSystemLoader([str(Path(__file__).parent / "templates"), str(report)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    rows = rows_of(outcomes)
    return environment.get_template("paper.html.j2").render(
        paper=PAPER,
        summary=summary(outcomes),
        differing=[f"{row['place']}, {row['what']}: {row['found']}, not {row['expected']}" for row in rows
                   if row["verdict"] == DIFFERS],
        missing=[f"{row['place']}, {row['what']}: {row['found']}" for row in rows if row["verdict"] == NOT_RUN],
        items=[_shown(outcome) for outcome in outcomes],
        classes={AGREES: "agrees", DIFFERS: "differs", NOT_RUN: "open", NOT_JUDGED: "open"},
        seen=_seen(),
        seen_as=f"sign of {_SHOWN_PX} px, 50 lux, {_SHOWN_DX:g} px/s",
        not_compared=NOT_COMPARED,
        facts=facts,
        camera=sourced(Camera.preset(CAMERA).to_dict()),
    )  # fmt: skip


def _shown(outcome: Outcome) -> dict[str, Any]:
    figures = [{"title": each.title, "png": _base64(png(each))} for each in outcome.found.figures]
    return {"item": outcome.item, "rows": outcome.rows(), "figures": figures}


def _seen() -> list[tuple[chains.Chain, list[dict[str, str]]]]:
    """The same sign through both chains, exposure by exposure."""
    shown = []
    for chain in chains.CHAINS:
        camera, scene = chains.camera_of(chain), ExposedScene.of_picture(chains.picture(chain, _SHOWN_PX))
        exposures = [Exposure(camera, 1e-3 * ms, 50.0, (_SHOWN_DX, 0.0)) for ms in _SHOWN_MS]
        cells = []
        for ms, frame in zip(_SHOWN_MS, scene.frames(exposures), strict=True):
            cut = frame.picture[100:220, 100:220, ::-1].copy()
            cells.append({"ms": f"{ms:g} ms", "png": _base64(cv2.imencode(".png", cut)[1].tobytes())})
        shown.append((chain, cells))
    return shown


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
