"""Scores of a run at its nodes: means over pictures, kept shares of them, and what they are without each cluster.

Domain: shares. A kept share is a ratio of sums, over clusters, of a score by what the same model reaches with the same
targets untouched; it may pass 1. Nodes without any target are NaN.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurnoise_eval.maps.nodes import Array, Plane
from blurnoise_eval.scoring.certainty import mean_of
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.estimates import Estimate
from blurnoise_eval.scoring.per_condition import Scored
from blurnoise_eval.store.schema import CONDITIONS

OF_TARGETS = ("target_confidence", "detection_rate", "exact_match")
"""Scores that every target has, so that each group of them has its own."""
OF_PICTURES = ("ap50",)
"""Scores that only all targets of the pictures have together."""
SCORES = (*OF_TARGETS, *OF_PICTURES)
ALL = "all targets"
_LEAST_REFERENCE = 1.0  # sum of a score over the untouched targets: below it a share of it is one of chance


@dataclass(frozen=True, eq=False)
class NodeScores:
    """A score of a model for a group of targets at N nodes.

    values: (N,). without: (C, N), with each of C clusters left out; NaN for clusters that have no target. level: what
    is enough, in the unit of the values. clean: the score of the untouched pictures, None where they have none.
    size_px: mean side of the targets. counts: (N,) targets, times noise fields.
    """

    model: str
    group: str
    score: str
    values: Array
    without: Array
    counts: Array
    level: float
    clean: float | None
    size_px: float

    @property
    def told(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """The nodes at which there is a value, (N,)."""
        return np.isfinite(self.values)


def of_groups(
    rows: Iterable[Mapping[str, Any]], plane: Plane, cluster_of: Mapping[str, int], criterion: Criterion
) -> tuple[list[NodeScores], list[str]]:
    """Scores of every model and group, from the store's ``queries.group_sums``; and what is withheld, in words.

    cluster_of: the number of each picture's cluster.
    """
    node_at = _node_at(plane)
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        found[row["model"], row["group"]].append(row)
    kept: list[NodeScores] = []
    withheld: list[str] = []
    for (model, group), own in found.items():
        size_px = sum(row["side_px"] for row in own) / sum(row["n"] for row in own)
        for score in OF_TARGETS:
            if any(row[score] is None for row in own):
                continue
            clean = {row["image"]: (row[score], row["n"]) for row in own if row["clean"]}
            reference = sum(value for value, _ in clean.values())
            if criterion.kept and reference < _LEAST_REFERENCE:
                withheld.append(
                    f"{model}, {group}, {score}: a sum of {reference:.2g} over all untouched targets is too little "
                    "to keep a share of"
                )
                continue
            shape = 1 + max(cluster_of.values(), default=0), len(plane.nodes)
            sums, counts, targets = np.zeros(shape), np.zeros(shape), np.zeros(shape[1])
            for row in own:
                node = node_at.get(tuple(row[name] for name in CONDITIONS))
                if node is None or (criterion.kept and row["image"] not in clean):
                    continue
                place = cluster_of[row["image"]], node
                share, of = clean[row["image"]] if criterion.kept else (row["n"], row["n"])
                sums[place] += row[score]
                counts[place] += share * row["n"] / of
                targets[node] += row["n"]
            measured = reference / n_clean if (n_clean := sum(n for _, n in clean.values())) else None
            values, without = mean_of(sums, counts), _without(sums, counts)
            kept.append(
                NodeScores(
                    model, group, score, values, without, targets, criterion.level, measured, size_px
                )
            )
    return kept, withheld


def of_pictures(
    rows: Iterable[Scored], plane: Plane, sizes_px: Mapping[str, float], criterion: Criterion
) -> tuple[list[NodeScores], list[str]]:
    """Scores that all targets have together, from the rows of scores; and what is withheld, in words.

    sizes_px: mean side of each model's targets. Of conditions on one node the mean.
    """
    node_at = _node_at(plane)
    found: dict[str, list[Scored]] = defaultdict(list)
    for each in rows:
        found[each.row["model"]].append(each)
    kept: list[NodeScores] = []
    withheld: list[str] = []
    for model, own in found.items():
        clean = next((each for each in own if each.row["clean"]), None)
        for score in OF_PICTURES:
            if model not in sizes_px or not any(
                each.estimates[score].departures is not None for each in own if not each.row["clean"]
            ):
                continue
            reference = None if clean is None else clean.estimates[score]
            if criterion.kept and (reference is None or not reference.value):
                withheld.append(f"{model}, {ALL}, {score}: nothing is right in the untouched pictures")
                continue
            totals: dict[int, list[Array]] = defaultdict(list)
            counts = np.zeros(len(plane.nodes))
            for each in own:
                node = node_at.get(tuple(each.row[name] for name in CONDITIONS))
                estimate = each.estimates[score]
                if node is not None and estimate.value is not None and estimate.departures is not None:
                    totals[node].append(_all_and_without(estimate))
                    counts[node] += each.row["n_targets"] or 0
            every = np.full((max(len(one[0]) for one in totals.values()), len(plane.nodes)), np.nan)
            for node, several in totals.items():
                every[:, node] = np.mean(several, axis=0)
            if criterion.kept and reference is not None:
                own_clean = _all_and_without(reference)[:, None]
                with np.errstate(invalid="ignore", divide="ignore"):
                    every = np.where(own_clean > 0, every / own_clean, np.nan)
            of_clean = None if reference is None else reference.value
            kept.append(
                NodeScores(
                    model, ALL, score, every[0], every[1:], counts, criterion.level, of_clean, sizes_px[model]
                )
            )
    return kept, withheld


def sizes_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """Mean side of each model's targets, px, from ``queries.group_sums``."""
    sides: dict[str, list[tuple[float, int]]] = defaultdict(list)
    for row in rows:
        sides[row["model"]].append((row["side_px"], row["n"]))
    return {model: sum(s for s, _ in each) / sum(n for _, n in each) for model, each in sides.items()}


def _node_at(plane: Plane) -> dict[tuple[Any, ...], int]:
    """The node of a condition, by its columns."""
    columns = (tuple(row[name] for name in CONDITIONS) for row in plane.rows)
    return dict(zip(columns, plane.node_of.tolist(), strict=True))


def _without(sums: Array, counts: Array) -> Array:
    """(C, N): the ratio of sums without each cluster; NaN for those that count nowhere."""
    left = counts.sum(axis=0) - counts
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(left > 0, (sums.sum(axis=0) - sums) / left, np.nan)
    return np.asarray(np.where((counts > 0).any(axis=1)[:, None], ratio, np.nan))


def _all_and_without(estimate: Estimate) -> Array:
    """(1 + C,): the value, and that without each cluster (:func:`~.certainty.jackknife` turned round)."""
    away = np.asarray(estimate.departures, float)
    n = np.isfinite(away).sum()
    value = float(estimate.value or 0.0)
    return np.concatenate([[value], value - away / max(n - 1, 1)])


def groups_by_size(scores: Sequence[NodeScores]) -> list[str]:
    """The groups, those with most targets first."""
    most = {each.group: float(each.counts.sum()) for each in scores}
    return sorted(most, key=lambda group: -most[group])
