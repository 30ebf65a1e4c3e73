"""Scores of a run at its nodes, with each cluster of pictures left out, and the quality of charts there.

Domain: values in the criterion's unit; a kept share may pass 1. NaN: not measured. AP belongs to all targets of a
size together, other scores to each group.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers import criterion as criteria
from blurnoise_eval.answers.criterion import PRECISIONS, Criterion
from blurnoise_eval.answers.table import ORDER, ScoreTable
from blurnoise_eval.maps.nodes import Array, Nodes
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
    """A score at N nodes: a table of one condition per node, without the values of the axes; the criterion with this
    score; and the mean side of the targets, px, NaN where unknown."""

    table: ScoreTable
    enough: Criterion
    size_px: float

    @property
    def values(self) -> Array:
        """(N,)."""
        return self.table.mean

    @property
    def known(self) -> NDArray[np.bool_]:
        """The nodes at which there is a value, (N,)."""
        return np.isfinite(self.values)

    @property
    def without(self) -> Array:
        """(C, N): the values with each of C clusters left out; NaN for clusters that count nowhere."""
        sums, counts = self.table.sums, self.table.counts
        left = counts.sum(axis=0) - counts
        with np.errstate(invalid="ignore", divide="ignore"):
            found = np.where(left > 0, (sums.sum(axis=0) - sums) / left, np.nan)
        found[~(np.abs(sums) + counts).any(axis=1)] = np.nan
        return np.asarray(found)


def scores_of(
    store: Store, nodes: Nodes, criterion: Criterion, cluster: str | None, progress: Progress
) -> tuple[list[NodeScores], list[str]]:
    """The usual scores of the run's models and the criterion's at the nodes; and what is withheld, in words.

    cluster: a pattern on pictures' names. progress: called with 1 for each condition of a model whose AP is new.
    """
    models = store.about("manifest")["models"]
    names = [model["name"] for model in models]
    sizes_px = _sizes_px(store)
    found: list[NodeScores] = []
    withheld: list[str] = []
    for score in dict.fromkeys([criterion.score, *USUAL[models[0]["kind"]]]):
        enough = replace(criterion, score=score)
        precisions = (
            run_scores(store, names, cluster, progress, by_size=score) if score in PRECISIONS else None
        )
        for table in score_tables(store, enough, cluster, precisions):
            if table.knows_too_little:
                withheld.append(
                    f"{table.model}, {table.group}, {score}: its targets score {table.clean or 0.0:.2g} on "
                    "average in the original pictures, too little to say what is kept of it"
                )
            else:
                size_px = sizes_px.get((table.model, table.group), np.nan)
                found.append(at_nodes(table, nodes, enough, size_px))
    return sorted(found, key=lambda each: names.index(each.table.model)), withheld


def at_nodes(table: ScoreTable, nodes: Nodes, enough: Criterion, size_px: float) -> NodeScores:
    """A table at the nodes; conditions of one node together."""
    node_at = {
        tuple(row[name] for name in ORDER): node
        for row, node in zip(nodes.rows, nodes.node_of.tolist(), strict=True)
    }
    columns = zip(*(table.conditions[name].tolist() for name in ORDER), strict=True)
    node = np.array([node_at.get(at, -1) for at in columns], np.int64)
    own = (node[:, None] == np.arange(len(nodes))).astype(float)
    unknown = np.full(len(nodes), np.nan)
    merged = {"conditions": {}, "sums": table.sums @ own, "counts": table.counts @ own}
    return NodeScores(replace(table, **merged, saturated=unknown, brightness=unknown), enough, size_px)


def _sizes_px(store: Store) -> dict[tuple[str, str], float]:
    """Mean of width and height of each model's targets by group, and by the sizes of COCO."""
    sides: dict[tuple[str, str], list[float]] = defaultdict(list)
    for row in queries.target_boxes(store):
        width, height = row["width_px"], row["height_px"]
        area = width * height
        sizes = [size for size, (low, high) in zip(SIZES, AREAS_PX2, strict=True) if low <= area <= high]
        for group in (row["group"], *sizes):
            sides[row["model"], group].append((width + height) / 2)
    return {key: float(np.mean(each)) for key, each in sides.items()}
