"""Ranking: how well a metric of pictures orders a detector's score over the nodes of a run.

Domain: N nodes, each with a metric's value m and a score y, NaN where unknown. Rank correlations are Spearman's over
all nodes at which both are known. Below ``FEWEST_NODES`` of these nothing is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.uncertainty import interval_of
from blurnoise_eval.maps.nodes import Array, Nodes, NodeScores
from blurnoise_eval.scoring.estimates import left_out

FEWEST_NODES = 20
"""Nodes below which a metric has no rank: by chance alone the correlation has a deviation of 1/sqrt(19)."""
FEWEST_ON_LINE = 5
"""Nodes of equal light, or of equal blur, from which on they count as a line."""
MOST_BLOCKS = 5
"""Of light, or of blur, that are held out in turn."""
RIGHT, FLATTERED = 0.8, 0.2
"""Rank correlation from which a metric seems to rank right along one axis, and the loss over both that misleads."""
_DIGITS = 6  # of log2 H and log2 L by which nodes lie on one line
Mask = NDArray[np.bool_]


class Ranked(NamedTuple):
    """A metric beside a score, a row of maps.csv; None: cannot be computed.

    spearman, low, high: rank correlation over all known nodes and its 95 % interval over clusters of pictures.
    share_told: share of the ``n_nodes`` with a score at which the metric is known. r2_h, r2_l: share of the score's
    variance that an increasing curve of the metric explains in blocks of light, or of blur, that it was not fitted
    to. auc: of telling nodes that keep the level from the others. along_light, along_blur: median rank correlation
    over lines on which the other is constant.
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
    r2_h: float | None = None
    r2_l: float | None = None
    auc: float | None = None
    along_light: float | None = None
    along_blur: float | None = None

    @property
    def lower(self) -> float:
        """The low end of the rank correlation's interval, without one the correlation itself; else -1."""
        known = self.spearman if self.low is None else self.low
        return -1.0 if known is None else known

    @property
    def flattery(self) -> float:
        """How much better the metric ranks along an axis on which it ranks right than over both; else 0."""
        along = max((each for each in (self.along_light, self.along_blur) if each is not None), default=0.0)
        return along - self.spearman if self.spearman is not None and along >= RIGHT else 0.0


def ranked(nodes: Nodes, metrics: Mapping[str, Array], scores: NodeScores) -> Iterator[Ranked]:
    """A row for each metric, (N,) values at the nodes."""
    n_nodes = int(scores.known.sum())
    for name, values in metrics.items():
        known = scores.known & np.isfinite(values)
        row = Ranked(
            scores.table.model,
            name,
            scores.enough.score,
            scores.table.group,
            n_nodes,
            share_told=float(known.sum() / n_nodes) if n_nodes else 0.0,
        )
        if known.sum() < FEWEST_NODES:
            yield row
            continue
        m, y, (u, w) = values[known], scores.values[known], nodes.places[known].T
        estimate = left_out(spearman(m, np.concatenate([y[None], scores.without[:, known]])))
        low, high = interval_of(estimate, None)
        yield row._replace(
            spearman=estimate.value,
            low=None if low is None else max(low, -1.0),
            high=None if high is None else min(high, 1.0),
            r2_h=explained(y, increasing_held_out(m, y, blocks(u))),
            r2_l=explained(y, increasing_held_out(m, y, blocks(w))),
            auc=auc(m, y >= scores.enough.level),
            along_light=along_lines(m, y, w),
            along_blur=along_lines(m, y, u),
        )


def spearman(m: Array, y: Array) -> Array:
    """Rank correlation of m (N,) with each row of y (..., N), (...); NaN where either is constant or unknown."""
    from scipy.stats import rankdata  # takes 0.3 s

    a, b = (rankdata(each, axis=-1) - (len(m) + 1) / 2 for each in (m, y))
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (a * b).sum(axis=-1) / np.sqrt((a**2).sum() * (b**2).sum(axis=-1))
    return np.asarray(np.where(np.isfinite(y).all(axis=-1), found, np.nan))


def increasing(m: Array, y: Array) -> tuple[Array, Array]:
    """The non-decreasing curve with the least squares from points (m, y): its corners, m increasing."""
    from scipy.optimize import isotonic_regression  # takes 0.3 s

    places, which = np.unique(m, return_inverse=True)
    weights = np.bincount(which)
    fitted = isotonic_regression(np.bincount(which, y) / weights, weights=weights).x
    return places, np.asarray(fitted)


def blocks(along: Array) -> list[Mask]:
    """Up to ``MOST_BLOCKS`` stretches of a coordinate (N,), of about as many nodes each; equal values together."""
    values, which = np.unique(along.round(_DIGITS), return_inverse=True)
    counts = np.bincount(which)
    middle = (np.cumsum(counts) - counts / 2) / len(along)
    block = np.minimum((middle * min(MOST_BLOCKS, len(values))).astype(int), MOST_BLOCKS - 1)[which]
    return [block == each for each in np.unique(block)]


def held_out(y: Array, held: Sequence[Mask], predict: Callable[[Mask, Mask], Array]) -> Array | None:
    """(N,) what ``predict`` says of each block, fitted to the other nodes; None for fewer than two blocks.

    predict: from the nodes to fit to and the nodes to predict, flags (N,), to values of the latter.
    """
    if len(held) < 2:
        return None
    found = np.empty_like(y)
    for block in held:
        found[block] = predict(~block, block)
    return found


def increasing_held_out(m: Array, y: Array, held: Sequence[Mask]) -> Array | None:
    """:func:`held_out` of :func:`increasing`, straight between corners and level beyond."""
    return held_out(y, held, lambda fit, at: np.interp(m[at], *increasing(m[fit], y[fit])))


def explained(y: Array, predicted: Array | None) -> float | None:
    """Share of the variance of y (N,) that is explained; below 0 where worse than the mean. None without either."""
    spread = float(((y - y.mean()) ** 2).sum())
    if predicted is None or spread == 0:
        return None
    return 1 - float(((y - predicted) ** 2).sum()) / spread


def auc(m: Array, kept: Mask) -> float | None:
    """The chance that m is higher at a node that keeps the level than at one that does not; ties count half."""
    from scipy.stats import rankdata

    n = int(kept.sum())
    if n in (0, len(m)):
        return None
    return float((rankdata(m)[kept].sum() - n * (n + 1) / 2) / (n * (len(m) - n)))


def along_lines(m: Array, y: Array, fixed: Array) -> float | None:
    """Median rank correlation over the lines on which ``fixed`` is constant; None without any."""
    places = fixed.round(_DIGITS)
    lines = [places == value for value in np.unique(places)]
    found = [float(spearman(m[line], y[line])) for line in lines if line.sum() >= FEWEST_ON_LINE]
    known = [each for each in found if np.isfinite(each)]
    return float(np.median(known)) if known else None


def best(rows: Sequence[Ranked]) -> Ranked | None:
    """Of the metrics known at half of the nodes or more the one that ranks best, by the low end of its interval."""
    known = [row for row in rows if row.spearman is not None and row.share_told >= 0.5]
    return max(known, key=lambda row: row.lower, default=None)


def most_flattered(rows: Sequence[Ranked]) -> Ranked | None:
    """The metric that misleads most, by ``FLATTERED`` or more."""
    misleading = (row for row in rows if row.flattery >= FLATTERED)
    return max(misleading, key=lambda row: row.flattery, default=None)
