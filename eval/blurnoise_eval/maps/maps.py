"""A run's maps: the quality of charts at its nodes beside its detectors' scores there, in words, tables and files.

Charts are exposed by the run's camera under the run's conditions, with the gain that the camera set for the
pictures. Files: maps.csv, a row per model, score, group and metric; predictor.json, six coefficients for each model,
score and group; nodes.csv, the values of both.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.maps.nodes import Array, Nodes, NodeScores, Progress, scores_of
from blurnoise_eval.maps.predictor import FEATURES, predictor_of
from blurnoise_eval.maps.ranking import FEWEST_NODES, Ranked, best, most_flattered, ranked
from blurnoise_eval.quality.measure import METRICS, measure
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines, finite

MOST_GROUPS = 3
"""Of a model that tables and figures show, those with most targets."""
_TITLE_OF = {metric.name: metric.title for metric in METRICS}


@dataclass(frozen=True, eq=False)
class Map:
    """A model's scores of a group at the nodes, the rank of each metric, and the predictor's record if any."""

    scores: NodeScores
    ranks: tuple[Ranked, ...]
    predictor: dict[str, Any] | None

    @classmethod
    def of(cls, nodes: Nodes, metrics: Mapping[str, Array], scores: NodeScores) -> Map:
        """metrics: (N,) by name at the nodes, rising with quality."""
        return cls(scores, tuple(ranked(nodes, metrics, scores)), predictor_of(nodes, scores))

    @property
    def name(self) -> str:
        """'model, group'."""
        return f"{self.scores.table.model}, {self.scores.table.group}"


@dataclass(frozen=True, eq=False)
class Maps:
    """The maps of a run. metrics: (N,) by name, NaN where withheld. withheld: scores that are, in words."""

    criterion: Criterion
    nodes: Nodes
    metrics: Mapping[str, Array]
    every: tuple[Map, ...]
    withheld: tuple[str, ...] = ()

    @property
    def own(self) -> list[Map]:
        """Those of the criterion's score."""
        return [each for each in self.every if each.scores.enough == self.criterion]

    @property
    def largest(self) -> list[tuple[str, list[Map]]]:
        """Of each model, by its name, ``MOST_GROUPS`` of :attr:`own`, those with most targets."""
        found = []
        for model, groups in groupby(self.own, key=lambda each: each.scores.table.model):
            every = list(groups)
            kept = sorted(every, key=lambda each: -each.scores.table.n_targets)[:MOST_GROUPS]
            found.append((model, [each for each in every if each in kept]))
        return found


def maps_of(
    store: Store,
    nodes: Nodes,
    criterion: Criterion,
    *,
    cluster: str | None = None,
    repeats: int = 1,
    threads: int = 1,
    progress: Progress = lambda done: None,
) -> Maps:
    """The maps of a run at its nodes, as :func:`~blurnoise_eval.maps.nodes.nodes_of` gives them.

    cluster: a pattern on pictures' names, as of :func:`~blurnoise_eval.answers.clusters.cluster_of`. repeats: noise
    fields of each chart. progress: called with 1 for every node, and every condition of a model whose AP is new.
    """
    scores, withheld = scores_of(store, nodes, criterion, cluster, progress)  # first: it may be refused
    rows = measure(nodes.camera, nodes.conditions, repeats=repeats, threads=threads, progress=progress)
    values = np.array([row.estimate.value for row in rows], float).reshape(len(nodes), len(METRICS))
    metrics = {metric.name: of for metric, of in zip(METRICS, values.T, strict=True)}
    rising = {metric.name: metric.sign * metrics[metric.name] for metric in METRICS}
    every = tuple(Map.of(nodes, rising, each) for each in scores)
    return Maps(criterion, nodes, metrics, every, tuple(withheld))


def sentences(maps: Maps) -> Iterator[str]:
    """For each model's groups: which metric ranks best, which misleads, the error of the closed form."""
    for each in maps.own:
        yield f"{each.name}: {_best(each.ranks)} {_misleading(each.ranks)} {_closed_form(each.predictor)}"
    yield from (f"withheld: {text}" for text in maps.withheld)


def _best(ranks: tuple[Ranked, ...]) -> str:
    found = best(ranks)
    if found is None:
        return (
            f"cannot tell which metric ranks conditions: none is told at {FEWEST_NODES} nodes with different scores, "
            "and at half of all."
        )
    between = "" if found.low is None else f", {found.low:.2f} to {found.high:.2f}"
    silent = sum(row.spearman is None for row in ranks)
    left = f" {silent} of {len(ranks)} metrics cannot be told." if silent else ""
    rank = f"rank correlation {found.spearman:.2f}{between}; told at {found.share_told:.0%} of {found.n_nodes} nodes"
    title = _TITLE_OF[found.metric]
    if found.lower <= 0:
        return f"no metric surely ranks conditions; the best is {title} ({rank}).{left}"
    return f"{title} ranks conditions best ({rank}).{left}"


def _misleading(ranks: tuple[Ranked, ...]) -> str:
    if all(row.along_light is None and row.along_blur is None for row in ranks):
        return "Cannot tell which misleads: light or blur does not vary enough."
    worst = most_flattered(ranks)
    if worst is None:
        return "None misleads."
    along = {"light": worst.along_light, "blur": worst.along_blur}
    axis, value = max(along.items(), key=lambda each: -2.0 if each[1] is None else each[1])
    return (
        f"{_TITLE_OF[worst.metric]} misleads: {value:.2f} along {axis} alone, {worst.spearman:.2f} over both."
    )


def _closed_form(predictor: dict[str, Any] | None) -> str:
    if predictor is None:
        return "No closed form: too few nodes, or one score at all."
    edges, (light, blur) = (
        predictor["as_a_window"],
        (predictor["held_out"][name] for name in ("r2_h", "r2_l")),
    )
    text = "The closed form's error cannot be told: light or blur does not vary."
    if light is not None and blur is not None:
        text = f"The closed form explains {light:.0%} of the score in light, {blur:.0%} in blur held out"
    if not edges["measured"]:
        return f"{text}; no end of a window to hold it against." if light is not None else text
    off = edges["off_stops"]
    others = "" if off is None else f" and is {off:.2f} stop off at the others"
    missed = f"{edges['missed']} of {edges['measured']} ends of windows"
    return f"{text}; fitted to all, it misses {missed}{others}: measure ends."


def tables(maps: Maps) -> Iterator[Table]:
    """For each model the metrics, the best first: share of nodes at which each is known (those of the first group),
    and rank correlation with its 95 % interval by group."""
    for model, shown in maps.largest:
        title = f"{model}: rank correlation of {maps.criterion.title} with each metric"
        made = Table(title=title, title_justify="left", padding=(0, 1, 0, 0), box=None, header_style="bold")
        made.add_column("metric", no_wrap=True)
        for head in ("told", *(each.scores.table.group for each in shown)):
            made.add_column(head, justify="right")
        rows = zip(*(each.ranks for each in shown), strict=True)
        for row in sorted(rows, key=lambda row: -(row[0].spearman or -2.0)):
            made.add_row(_TITLE_OF[row[0].metric], f"{row[0].share_told:.0%}", *map(_cell, row))
        yield made


def _cell(row: Ranked) -> str:
    """'0.93 (.88 1.00)'."""
    if row.spearman is None:
        return "cannot tell"
    ends = [f"{each:.2f}".replace("0.", ".", 1) for each in (row.low, row.high) if each is not None]
    return f"{row.spearman:.2f}" + (f" ({' '.join(ends)})" if ends else "")


def summary(maps: Maps) -> dict[str, Any]:
    """For programs: per model and group which metric ranks best, which misleads, and the closed form."""
    answers = []
    for each in maps.own:
        table, found, worst = each.scores.table, best(each.ranks), most_flattered(each.ranks)
        answers.append(
            {
                "model": table.model,
                "group": table.group,
                "best": found and found._asdict(),
                "misleads": worst and {**worst._asdict(), "flattery": worst.flattery},
                "closed_form": each.predictor,
            }
        )
    shared = {"criterion": maps.criterion.row(), "nodes": len(maps.nodes)}
    return {**shared, "answers": answers, "withheld": list(maps.withheld)}


def write(maps: Maps, folder: Path) -> list[Path]:
    """Write maps.csv, nodes.csv and predictor.json; raises ``OSError``."""
    ranks = [row._asdict() for each in maps.every for row in each.ranks]
    columns = {**maps.nodes.figures, **maps.metrics}
    for of in (each.scores for each in maps.every):
        columns[f"{of.table.model}: {of.table.group}: {of.enough.score}"] = of.values
    nodes = [dict(zip(columns, map(finite, row), strict=True)) for row in zip(*columns.values(), strict=True)]
    document = {
        "camera": maps.nodes.camera.to_dict(),
        "criterion": maps.criterion.row(),
        "formula": "score = 1 / (1 + exp(-(sum of coefficients by features)))",
        "features": FEATURES,
        "fitted": [each.predictor for each in maps.every if each.predictor is not None],
    }
    finite_only = json.loads(json.dumps(document), parse_constant=lambda not_a_number: None)
    texts = {
        "maps.csv": "".join(csv_lines(Ranked._fields, ranks)),
        "nodes.csv": "".join(csv_lines(list(columns), nodes)),
        "predictor.json": json.dumps(finite_only, indent=1),
    }
    for name, text in texts.items():
        write_whole(folder / name, text.encode())
    return [folder / name for name in texts]
