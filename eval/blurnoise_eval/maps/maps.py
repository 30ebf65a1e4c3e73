"""A run's maps: the quality of charts at its nodes beside its detectors' scores there, in words and tables.

Domain: N nodes, each with a metric's value m and a score y, NaN where unknown. Charts are exposed by the run's camera
under the run's conditions, with the gain that the camera set for the pictures. Scores are in the criterion's unit; AP
belongs to all targets of a size together, others to each group. Rank correlations are Spearman's over all nodes at
which both are known. Files: maps.csv, a row per model, score, group and metric; nodes.csv, the values of both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.maps.nodes import Array, Nodes
from blurnoise_eval.measure.charts import METRICS, measure
from blurnoise_eval.run.score_tables import score_tables
from blurnoise_eval.scoring.uncertainty import all_and_without, interval_of, left_out
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines, finite

MOST_GROUPS = 3
"""Of a model that are shown, those with most targets."""
FEWEST_NODES = 20
"""Nodes below which a metric has no rank: by chance alone the correlation has a deviation of 1/sqrt(19)."""
FEWEST_ON_LINE = 5
"""Nodes of equal light, or of equal blur, from which on they count as a line."""
RIGHT, MISLEADS = 0.8, 0.2
"""Rank correlation from which a metric seems to rank right along one axis, and the loss over both that misleads."""
_DIGITS = 6  # of log2 H and log2 L by which nodes lie on one line
_TITLE_OF = {metric.name: metric.title for metric in METRICS}


class Rank(NamedTuple):
    """A metric beside a score, a row of maps.csv; None: cannot be computed.

    spearman, low, high: rank correlation over all known nodes and its 95 % interval over clusters of pictures.
    share_told: share of the ``n_nodes`` with a score at which the metric is known. along_light, along_blur: median
    rank correlation over lines on which the other is constant.
    """

    model: str
    metric: str
    score: str
    group: str
    n_nodes: int
    spearman: float | None = None
    low: float | None = None
    high: float | None = None
    share_told: float = 0.0
    along_light: float | None = None
    along_blur: float | None = None

    @property
    def text(self) -> str:
        """'0.93 (0.88 to 1.00)'."""
        if self.spearman is None:
            return "cannot tell"
        return f"{self.spearman:.2f}" + ("" if self.low is None else f" ({self.low:.2f} to {self.high:.2f})")

    @property
    def lower(self) -> float:
        """The low end of the rank correlation's interval, without one the correlation itself; else -1."""
        known = self.spearman if self.low is None else self.low
        return -1.0 if known is None else known

    @property
    def along(self) -> tuple[float, str]:
        """The greater of its rank correlations along one axis, and that axis."""
        known = {"light": self.along_light, "blur": self.along_blur}
        return max((-1.0 if value is None else value, axis) for axis, value in known.items())


@dataclass(frozen=True, eq=False)
class Map:
    """The score of one model and group at the nodes, in the criterion's unit, and the rank of each metric."""

    table: ScoreTable
    ranks: tuple[Rank, ...]


@dataclass(frozen=True, eq=False)
class Maps:
    """The maps of a run. metrics: (N,) by name, NaN where withheld. too_little: groups that score too little."""

    criterion: Criterion
    nodes: Nodes
    metrics: Mapping[str, Array]
    every: tuple[Map, ...]
    too_little: tuple[str, ...] = ()

    @property
    def shown(self) -> dict[str, list[Map]]:
        """By model the maps of the ``MOST_GROUPS`` groups with most targets."""
        found: dict[str, list[Map]] = {}
        for each in sorted(self.every, key=lambda each: -each.table.n_targets):
            found.setdefault(each.table.model, []).append(each)
        return {model: groups[:MOST_GROUPS] for model, groups in found.items()}


def maps_of(
    store: Store,
    nodes: Nodes,
    criterion: Criterion,
    *,
    threads: int = 1,
    progress: Callable[[float], None] = lambda done: None,
) -> Maps:
    """The maps of a run at its nodes, as :func:`~blurnoise_eval.maps.nodes.nodes_of` gives them.

    progress: called with 1 for every node.
    """
    tables = list(score_tables(store, criterion))  # first: it may be refused
    rows = measure(nodes.camera, nodes.conditions, threads=threads, progress=progress)
    values = np.array([row.estimate.value for row in rows], float).reshape(len(nodes), len(METRICS))
    metrics = {metric.name: of for metric, of in zip(METRICS, values.T, strict=True)}
    known = [nodes.group(table) for table in tables if not table.knows_too_little]
    every = tuple(map_of(nodes, metrics, table, criterion.score) for table in known)
    too_little = [f"{table.model}, {table.group}" for table in tables if table.knows_too_little]
    return Maps(criterion, nodes, metrics, every, tuple(too_little))


def map_of(nodes: Nodes, metrics: Mapping[str, Array], table: ScoreTable, score: str) -> Map:
    """The map of a table at the nodes. metrics: (N,) values by name."""
    ranks = (rank(name, values, table, score, nodes.places) for name, values in metrics.items())
    return Map(table, tuple(ranks))


def rank(metric: str, values: Array, table: ScoreTable, score: str, places: Array) -> Rank:
    """The rank of a metric with values (N,) at the nodes, which lie at places (N, 2) of the plane."""
    scored = np.isfinite(table.mean)
    known = scored & np.isfinite(values)
    n_nodes = int(scored.sum())
    share = float(known.sum() / max(n_nodes, 1))
    row = Rank(table.model, metric, score, table.group, n_nodes, share_told=share)
    if known.sum() < FEWEST_NODES:
        return row
    m, y, (u, w) = values[known], table.mean[known], places[known].T
    estimate = left_out(spearman(m, all_and_each_left_out(table)[:, known]))
    low, high = interval_of(estimate, None)
    return row._replace(
        spearman=estimate.value,
        low=None if low is None else max(low, -1.0),
        high=None if high is None else min(high, 1.0),
        along_light=along_lines(m, y, w),
        along_blur=along_lines(m, y, u),
    )


def all_and_each_left_out(table: ScoreTable) -> Array:
    """(1 + C, N): the table's mean, then that without each of its clusters that count anywhere."""
    counting = (np.abs(table.sums) + table.counts).any(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(all_and_without(table.sums[counting]) / all_and_without(table.counts[counting]))


def spearman(m: Array, y: Array) -> Array:
    """Rank correlation of m (N,) with each row of y (..., N), (...); NaN where either is constant or unknown."""
    from scipy.stats import rankdata  # takes 0.3 s

    a, b = (rankdata(each, axis=-1) - (len(m) + 1) / 2 for each in (m, y))
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (a * b).sum(axis=-1) / np.sqrt((a**2).sum() * (b**2).sum(axis=-1))
    return np.asarray(np.where(np.isfinite(y).all(axis=-1), found, np.nan))


def along_lines(m: Array, y: Array, fixed: Array) -> float | None:
    """Median rank correlation over the lines on which ``fixed`` is constant; None without any."""
    places = fixed.round(_DIGITS)
    lines = [places == value for value in np.unique(places)]
    found = [float(spearman(m[line], y[line])) for line in lines if line.sum() >= FEWEST_ON_LINE]
    known = [each for each in found if np.isfinite(each)]
    return float(np.median(known)) if known else None


def sentences(maps: Maps) -> Iterator[str]:
    """For each model's groups: which metric ranks best, by the low end of its interval, and which misleads most."""
    for model, groups in maps.shown.items():
        for each in groups:
            yield f"{model}, {each.table.group}: {_best(each.ranks)}{_misleading(each.ranks)}"
    for name in maps.too_little:
        yield f"{name}: cannot tell, as the scores in the original pictures are too low."


def _best(ranks: tuple[Rank, ...]) -> str:
    known = [row for row in ranks if row.spearman is not None and row.share_told >= 0.5]
    if not known:
        return f"cannot tell which metric ranks conditions; none is known at {FEWEST_NODES} and half of the nodes."
    best = max(known, key=lambda row: row.lower)
    text = f"rank correlation {best.text}; available at {best.share_told:.0%} of {best.n_nodes} nodes"
    title = _TITLE_OF[best.metric]
    sure = (
        f"{title} ranks conditions best"
        if best.lower > 0
        else f"no metric surely ranks conditions; the best is {title}"
    )
    return f"{sure} ({text})."


def _misleading(ranks: tuple[Rank, ...]) -> str:
    right = [row for row in ranks if row.spearman is not None and row.along[0] >= RIGHT]
    worst = max(right, key=lambda row: row.along[0] - (row.spearman or 0.0), default=None)
    if worst is None or worst.spearman is None or worst.along[0] - worst.spearman < MISLEADS:
        return ""
    value, axis = worst.along
    return f" {_TITLE_OF[worst.metric]} misleads: {value:.2f} along {axis} alone, {worst.spearman:.2f} over both."


def tables(maps: Maps) -> Iterator[Table]:
    """For each model the metrics, the best first: share of nodes at which each is known (those of the first group),
    and rank correlation with its 95 % interval by group."""
    for model, groups in maps.shown.items():
        made = Table(title=f"{model}: rank correlation of {maps.criterion.title} with each metric")
        made.add_column("metric", no_wrap=True)
        for head in ("known", *(each.table.group for each in groups)):
            made.add_column(head, justify="right")
        rows = zip(*(each.ranks for each in groups), strict=True)
        for row in sorted(rows, key=lambda row: -(row[0].spearman or -2.0)):
            cells = [each.text for each in row]
            made.add_row(_TITLE_OF[row[0].metric], f"{row[0].share_told:.0%}", *cells)
        yield made


def write(maps: Maps, folder: Path) -> None:
    """Write maps.csv and nodes.csv; raises ``OSError``."""
    ranks = [row._asdict() for each in maps.every for row in each.ranks]
    columns = {**maps.nodes.figures, **maps.metrics}
    for each in maps.every:
        columns[f"{each.table.model}: {each.table.group}: {maps.criterion.score}"] = each.table.mean
    nodes = [dict(zip(columns, map(finite, row), strict=True)) for row in zip(*columns.values(), strict=True)]
    write_whole(folder / "maps.csv", (line.encode() for line in csv_lines(Rank._fields, ranks)))
    write_whole(folder / "nodes.csv", (line.encode() for line in csv_lines(list(columns), nodes)))
