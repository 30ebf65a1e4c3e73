"""Scores of a run at its nodes: means over pictures or kept shares of them, and what they are without each cluster.

Domain: values in the criterion's unit, as a run's surfaces have them; a kept share may pass 1. A node at which
nothing was measured is NaN. Scores of AP belong to all targets of a size together, the others to each group.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers import criterion as criteria
from blurnoise_eval.answers.criterion import PRECISIONS, Criterion
from blurnoise_eval.answers.table import ORDER, ScoreTable
from blurnoise_eval.maps.nodes import Array, Plane
from blurnoise_eval.scoring.estimates import ratio_of_sums
from blurnoise_eval.scoring.precision import AREAS_PX2, SIZES
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.run_scores import run_scores
from blurnoise_eval.sweep.score_tables import score_tables

USUAL = {
    "detector": (criteria.CONFIDENCE, criteria.RATE, "ap50"),
    "reader": (criteria.CONFIDENCE, criteria.MATCHES),
}
"""Scores of either kind of model that are mapped, beside the criterion's own."""
Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class NodeScores:
    """A score of a model for a group of targets at N nodes.

    values: (N,). without: (C, N), with each of C clusters left out; NaN for clusters that count nowhere. enough: the
    criterion with this score, ``enough.level`` in the unit of the values. clean: the score of the untouched pictures.
    size_px: mean side of the targets, NaN where it is not known.
    """

    model: str
    group: str
    enough: Criterion
    values: Array
    without: Array
    n_targets: int
    clean: float | None
    size_px: float

    @property
    def score(self) -> str:
        """The score's name."""
        return self.enough.score

    @property
    def level(self) -> float:
        """What is enough."""
        return self.enough.level

    @property
    def told(self) -> NDArray[np.bool_]:
        """The nodes at which there is a value, (N,)."""
        return np.isfinite(self.values)


class RunScores(NamedTuple):
    """Scores of each model and group, score by score, and what is withheld, in words."""

    every: list[NodeScores]
    withheld: list[str]


def scores_of(
    store: Store,
    plane: Plane,
    criterion: Criterion,
    cluster: str | None = None,
    progress: Progress = lambda done: None,
) -> RunScores:
    """The scores that are usual of the run's models, and the criterion's, at the nodes.

    cluster: a pattern on pictures' names. progress: told 1 for each condition of each model that is scored.
    """
    models = store.about("manifest")["models"]
    names = [model["name"] for model in models]
    sizes_px = _sizes_px(store)
    every: list[NodeScores] = []
    withheld: list[str] = []
    for score in dict.fromkeys([criterion.score, *USUAL[models[0]["kind"]]]):
        enough = replace(criterion, score=score)
        scored = None
        if score in PRECISIONS:
            scored = run_scores(store, names, cluster, progress, by_size=score)
        for table in score_tables(store, enough, cluster, scored):
            if table.knows_too_little:
                withheld.append(
                    f"{table.model}, {table.group}, {score}: its targets score {table.clean or 0.0:.2g} on "
                    "average in the original pictures, too little to say what is kept of it"
                )
                continue
            every.append(at_nodes(table, plane, enough, sizes_px.get((table.model, table.group), np.nan)))
    return RunScores(sorted(every, key=lambda each: names.index(each.model)), withheld)


def at_nodes(table: ScoreTable, plane: Plane, enough: Criterion, size_px: float) -> NodeScores:
    """A table at the nodes; conditions of one node together."""
    conditions = (tuple(row[name] for name in ORDER) for row in plane.rows)
    node_at = dict(zip(conditions, plane.node_of.tolist(), strict=True))
    columns = zip(*(table.conditions[name].tolist() for name in ORDER), strict=True)
    nodes = np.array([node_at.get(at, -1) for at in columns], np.int64)
    sums, counts = np.zeros((2, len(table.clusters), len(plane.nodes)))
    for total, values in ((sums, table.sums), (counts, table.counts)):
        np.add.at(total.T, nodes[nodes >= 0], values.T[nodes >= 0])
    own = ratio_of_sums(sums, counts), _without(sums, counts)
    return NodeScores(table.model, table.group, enough, *own, table.n_targets, table.clean, size_px)


def _without(sums: Array, counts: Array) -> Array:
    """(C, N): the ratio of sums without each cluster."""
    left = counts.sum(axis=0) - counts
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(left > 0, (sums.sum(axis=0) - sums) / left, np.nan)
    silent = ~(np.abs(sums) + counts).any(axis=1)
    ratio[silent] = np.nan
    return np.asarray(ratio)


def _sizes_px(store: Store) -> dict[tuple[str, str], float]:
    """Mean side, half of width and height, of each model's targets by group, and by the sizes of COCO."""
    sides: dict[tuple[str, str], list[float]] = defaultdict(list)
    for row in queries.target_boxes(store):
        width, height = row["width_px"], row["height_px"]
        own = [
            size for size, (low, high) in zip(SIZES, AREAS_PX2, strict=True) if low <= width * height <= high
        ]
        for group in (row["group"], *own):
            sides[row["model"], group].append((width + height) / 2)
    return {key: float(np.mean(each)) for key, each in sides.items()}
