"""Maps told: the sentences that answer, a table of 80 columns, and the files.

Files: maps.csv, a row per model, score, group and metric; predictor.json, six coefficients for each model, score and
group; nodes.csv, what both are made of.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from blurnoise_eval.maps.mapping import Maps, by_model
from blurnoise_eval.maps.predictor import NAMES, Predictor
from blurnoise_eval.maps.ranking import FEWEST_NODES, Ranked, flattery, most_flattered, sureness, surest
from blurnoise_eval.maps.scored import NodeScores
from blurnoise_eval.quality.measure import METRICS
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

MOST_GROUPS = 3
"""Of a model that the table has columns for, those with most targets."""
COLUMNS = tuple(Ranked.__dataclass_fields__)
_TITLE_OF = {metric.name: metric.title for metric in METRICS}


def sentences(maps: Maps, score: str) -> Iterator[str]:
    """What answers, for each model's groups: what ranks best, what misleads, what the closed form is worth."""
    for model, groups in by_model(maps.scores, score):
        for scores in groups:
            rows = maps.of(scores)
            yield f"{model}, {scores.group}: {_best(rows)} {_misleading(rows)} {closed_form(maps.predictor(scores))}"
    yield from (f"withheld: {text}" for text in maps.withheld)


def _best(rows: Sequence[Ranked]) -> str:
    best = surest(rows)
    if best is None:
        return (
            f"cannot tell which metric ranks conditions: none is told at {FEWEST_NODES} nodes with different scores, "
            "and at half of all."
        )
    between = "" if best.low is None else f", {best.low:.2f} to {best.high:.2f}"
    silent = sum(row.spearman is None for row in rows)
    left = f" {silent} of {len(rows)} metrics cannot be told." if silent else ""
    rank = f"rank correlation {best.spearman:.2f}{between}; told at {best.share_told:.0%} of {best.n_nodes} nodes"
    if sureness(best) <= 0:
        return f"no metric surely ranks conditions; the best is {_TITLE_OF[best.metric]} ({rank}).{left}"
    return f"{_TITLE_OF[best.metric]} ranks conditions best ({rank}).{left}"


def _misleading(rows: Sequence[Ranked]) -> str:
    if not any(row.along_light is not None or row.along_blur is not None for row in rows):
        return "Cannot tell which misleads: light or blur does not vary enough."
    worst = most_flattered(rows)
    if worst is None:
        return "None misleads."
    along = {"light": worst.along_light, "blur": worst.along_blur}
    axis, value = max(along.items(), key=lambda each: -2.0 if each[1] is None else each[1])
    return (
        f"{_TITLE_OF[worst.metric]} misleads: {value:.2f} along {axis} alone, {worst.spearman:.2f} over both."
    )


def closed_form(found: Predictor | None) -> str:
    """What the closed form predicts, and where it fails."""
    if found is None:
        return "No closed form: too few nodes, or one score at all."
    if found.r2_h is None or found.r2_l is None:
        text = "The closed form's error cannot be told: light or blur does not vary."
    else:
        text = f"The closed form explains {found.r2_h:.0%} of the score in light, {found.r2_l:.0%} in blur held out"
    edges = found.edges
    if not edges.measured:
        return f"{text}; no end of a window to hold it against." if found.r2_h is not None else text
    off = "" if edges.off_stops is None else f" and is {edges.off_stops:.2f} stop off at the others"
    return f"{text}; fitted to all, it misses {edges.missed} of {edges.measured} ends of windows{off}: measure ends."


def table(maps: Maps, score: str) -> Iterator[Table]:
    """For each model the metrics, the best first: share of nodes at which each is told (those of the first
    group), and rank correlation with its 95 % interval by group."""
    for model, groups in by_model(maps.scores, score):
        shown = sorted(groups, key=lambda each: -each.n_targets)[:MOST_GROUPS]
        shown = [each for each in groups if each in shown]
        title = f"{model}: rank correlation of {shown[0].enough.title} with each metric"
        made = Table(title=title, title_justify="left", padding=(0, 1, 0, 0), box=None, header_style="bold")
        made.add_column("metric", no_wrap=True)
        made.add_column("told", justify="right")
        for scores in shown:
            made.add_column(scores.group, justify="right")
        rows = {scores.group: {row.metric: row for row in maps.of(scores)} for scores in shown}
        first = rows[shown[0].group]
        for metric in sorted(_TITLE_OF, key=lambda name: -(first[name].spearman or -2.0)):
            cells = (_cell(rows[scores.group][metric]) for scores in shown)
            made.add_row(_TITLE_OF[metric], f"{first[metric].share_told:.0%}", *cells)
        yield made


def _cell(row: Ranked) -> str:
    if row.spearman is None:
        return "cannot tell"
    ends = () if row.low is None or row.high is None else (row.low, row.high)
    return f"{row.spearman:.2f}" + (f" ({' '.join(map(_short, ends))})" if ends else "")


def _short(value: float) -> str:
    """'.88', '-.44', '1.00'."""
    return f"{value:.2f}".replace("0.", ".", 1)


def summary(maps: Maps, score: str) -> dict[str, Any]:
    """For programs: per model and group what ranks best, what misleads, and the closed form."""
    answers = []
    for _, groups in by_model(maps.scores, score):
        for scores in groups:
            rows = maps.of(scores)
            best, worst, form = surest(rows), most_flattered(rows), maps.predictor(scores)
            answers.append(
                {
                    "model": scores.model,
                    "group": scores.group,
                    "best": None if best is None else best.record(),
                    "misleads": None if worst is None else {**worst.record(), "flattery": flattery(worst)},
                    "closed_form": None if form is None else form.record(),
                }
            )
    return {"criterion": maps.criterion.row(), "nodes": len(maps.plane.nodes), "answers": answers} | {
        "withheld": list(maps.withheld)
    }


def write(maps: Maps, folder: Path) -> list[Path]:
    """Write maps.csv, nodes.csv and predictor.json; raises ``OSError``."""
    rows = [row.record() for row in maps.rows]
    nodes = list(_node_rows(maps))
    for name, columns, table_rows in (
        ("maps.csv", COLUMNS, rows),
        ("nodes.csv", tuple(nodes[0]), nodes),
    ):
        write_whole(folder / name, (line.encode("utf-8") for line in csv_lines(columns, table_rows)))
    write_whole(folder / "predictor.json", json.dumps(_document(maps), indent=1, allow_nan=False).encode())
    return [folder / name for name in ("maps.csv", "nodes.csv", "predictor.json")]


def _node_rows(maps: Maps) -> Iterator[dict[str, Any]]:
    for place, node in enumerate(maps.plane.nodes):
        own = {
            "light_lux_s": node.light_lux_s,
            "blur_px": node.blur_px,
            "gain_db": node.conditions["gain_db"],
        }
        metrics = {name: _known(values[place]) for name, values in maps.metrics.items()}
        scores = {_column(each): _known(each.values[place]) for each in maps.scores}
        yield own | {"snr_log2": node.snr_log2, "white_share": node.white_share} | metrics | scores


def _column(scores: NodeScores) -> str:
    return f"{scores.model}: {scores.group}: {scores.score}"


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _document(maps: Maps) -> dict[str, Any]:
    return {
        "camera": maps.camera.to_dict(),
        "criterion": maps.criterion.row(),
        "formula": "score = 1 / (1 + exp(-(sum of coefficients by features)))",
        "features": {
            **dict.fromkeys(NAMES, ""),
            "1": "1",
            "s": "log2(0.62 E / sqrt(0.3 E + read^2 + dark + 1/(12 K^2))), E electrons of a white pixel",
            "s^2": "its square",
            "L/size": "motion during the exposure by the targets' mean side",
            "(L/size)^2": "its square",
            NAMES[-1]: "E_sat: electrons at which white saturates, at the gain",
        },
        "fitted": [_plain(each.record()) for each in maps.predictors],
    }


def _plain(value: Any) -> Any:
    """As JSON has it: None for what is not a number."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
