"""Ranking: how well a metric of pictures orders a detector's score over conditions.

Domain: N nodes, each with a metric's value m and a score y; NaN is withheld, and what is withheld at a node says
nothing of it. A rank correlation is Spearman's, over all nodes at which both are told, light and blur moving. Below
``FEWEST_NODES`` of these nothing is told.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.uncertainty import interval_of
from blurnoise_eval.maps.nodes import Array, Plane
from blurnoise_eval.maps.scored import NodeScores
from blurnoise_eval.scoring.estimates import left_out

FEWEST_NODES = 20
"""Nodes below which a metric's rank is not told: by chance alone the correlation has a deviation of 1/sqrt(19)."""
FEWEST_ON_LINE = 5
"""Nodes of equal light, or of equal blur, from which on they count as a line."""
MOST_BLOCKS = 5
"""Of light, or of blur, that are held out in turn."""
RIGHT, FLATTERED = 0.8, 0.2
"""Rank correlation from which a metric seems to rank right along one axis, and the loss over both that misleads."""
_DIGITS = 6  # of log2 H and log2 L by which nodes stand on one line
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Ranked:
    """A metric before a score: a row of maps.csv; None is what cannot be told.

    spearman, low, high: rank correlation over all told nodes and its 95 % interval over clusters of pictures.
    share_told: of the ``n_nodes`` that have a score. r2_h, r2_l: share of the score's variance that an increasing
    curve of the metric explains in blocks of light, or of blur, that it was not fitted to; below 0 where it is worse
    than the mean. auc: of telling the nodes that keep the level from the others. along_light, along_blur: median
    rank correlation over lines on which the other stands still.
    """

    model: str
    metric: str
    score: str
    group: str
    n_nodes: int
    spearman: float | None
    low: float | None
    high: float | None
    share_told: float
    r2_h: float | None
    r2_l: float | None
    auc: float | None
    along_light: float | None
    along_blur: float | None

    def record(self) -> dict[str, Any]:
        """As a row of a table."""
        return asdict(self)


def ranked(plane: Plane, metrics: Mapping[str, Array], scores: NodeScores) -> Iterator[Ranked]:
    """A row for each metric, (N,) values at the nodes."""
    scored = scores.told
    for name, values in metrics.items():
        told = scored & np.isfinite(values)
        own = scores.model, name, scores.score, scores.group, int(scored.sum())
        share = float(told.sum() / scored.sum()) if scored.any() else 0.0
        if told.sum() < FEWEST_NODES:
            yield Ranked(*own, None, None, None, share, None, None, None, None, None)
            continue
        m, y, u, w = values[told], scores.values[told], plane.u[told], plane.w[told]
        rank, low, high = _with_interval(m, y, scores.without[:, told])
        r2_h, r2_l = (held_out_r2(y, increasing_held_out(m, y, blocks(along))) for along in (u, w))
        telling = auc(m, y >= scores.level)
        along_light, along_blur = along_lines(m, y, w), along_lines(m, y, u)
        yield Ranked(*own, rank, low, high, share, r2_h, r2_l, telling, along_light, along_blur)


def spearman(m: Array, y: Array) -> Array:
    """Rank correlation of m (N,) with each row of y (..., N), (...); NaN where either is constant or not known."""
    from scipy.stats import rankdata  # takes 0.3 s

    a, b = (rankdata(each, axis=-1) - (len(m) + 1) / 2 for each in (m, y))
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (a * b).sum(axis=-1) / np.sqrt((a**2).sum() * (b**2).sum(axis=-1))
    return np.asarray(np.where(np.isfinite(y).all(axis=-1), found, np.nan))


def _with_interval(m: Array, y: Array, without: Array) -> tuple[float | None, float | None, float | None]:
    every = np.concatenate([y[None], without])
    estimate = left_out(spearman(m, every))
    if estimate.value is None:
        return None, None, None
    low, high = interval_of(estimate, None)
    return estimate.value, None if low is None else max(low, -1.0), None if high is None else min(high, 1.0)


def increasing(m: Array, y: Array) -> tuple[Array, Array]:
    """The non-decreasing curve with the least squares from points (m, y): its corners, m increasing."""
    from scipy.optimize import isotonic_regression  # takes 0.3 s

    places, which = np.unique(m, return_inverse=True)
    weights = np.bincount(which)
    fitted = isotonic_regression(np.bincount(which, y) / weights, weights=weights).x
    return places, np.asarray(fitted)


def blocks(along: Array) -> list[Mask]:
    """Up to ``MOST_BLOCKS`` stretches of a coordinate, of about as many nodes each, (N,); equal ones together."""
    values, which = np.unique(along.round(_DIGITS), return_inverse=True)
    counts = np.bincount(which)
    middle = (np.cumsum(counts) - counts / 2) / len(along)
    block = np.minimum((middle * min(MOST_BLOCKS, len(values))).astype(int), MOST_BLOCKS - 1)[which]
    return [block == each for each in np.unique(block)]


def increasing_held_out(m: Array, y: Array, held: Sequence[Mask]) -> Array | None:
    """What :func:`increasing` of the other blocks says of each block's nodes, straight between corners and level
    beyond; None for fewer than two blocks."""
    if len(held) < 2:
        return None
    told = np.empty_like(y)
    for block in held:
        told[block] = np.interp(m[block], *increasing(m[~block], y[~block]))
    return told


def held_out_r2(y: Array, told: Array | None) -> float | None:
    """1 - the mean square of what is told wrongly by the variance of y; None without either."""
    spread = float(((y - y.mean()) ** 2).sum())
    return None if told is None or spread == 0 else 1 - float(((y - told) ** 2).sum()) / spread


def auc(m: Array, kept: Mask) -> float | None:
    """The chance that m is higher at a node that keeps the level than at one that does not; ties count half."""
    from scipy.stats import rankdata

    n = int(kept.sum())
    if n in (0, len(m)):
        return None
    return float((rankdata(m)[kept].sum() - n * (n + 1) / 2) / (n * (len(m) - n)))


def along_lines(m: Array, y: Array, fixed: Array) -> float | None:
    """Median rank correlation over the lines on which ``fixed`` stands still; None without any."""
    places = fixed.round(_DIGITS)
    lines = [places == value for value in np.unique(places)]
    found = [spearman(m[line], y[line]) for line in lines if line.sum() >= FEWEST_ON_LINE]
    known = [float(each) for each in found if np.isfinite(each)]
    return float(np.median(known)) if known else None


def surest(rows: Sequence[Ranked]) -> Ranked | None:
    """Of the metrics told at half of the nodes or more the one that ranks best, by the low end of its interval."""
    told = [row for row in rows if row.spearman is not None and row.share_told >= 0.5]
    return max(told, key=sureness, default=None)


def sureness(row: Ranked) -> float:
    """The rank correlation that a metric surely has: the low end of its interval, or without one itself."""
    told = row.spearman if row.low is None else row.low
    return -1.0 if told is None else told


def most_flattered(rows: Sequence[Ranked]) -> Ranked | None:
    """The metric that misleads: along one axis it ranks right (``RIGHT``), over both worst in comparison, by
    ``FLATTERED`` or more."""
    return max((row for row in rows if flattery(row) >= FLATTERED), key=flattery, default=None)


def flattery(row: Ranked) -> float:
    """How much better a metric ranks along an axis on which it ranks right than over both; 0 without such an axis."""
    along = max((each for each in (row.along_light, row.along_blur) if each is not None), default=0.0)
    return along - row.spearman if row.spearman is not None and along >= RIGHT else 0.0
