"""Surfaces: a score of a group of targets under every exposure and velocity in one setting, by cluster.

Domain: axes as in :mod:`blurnoise_eval.grid.axes`; a setting is a value on each but exposure and velocity. A cluster
is a picture with all its targets and noise fields, or what else was drawn together (``--cluster``). What is kept of a
score is a ratio of sums: the targets' scores by what the same targets have in the untouched pictures. So targets of
which the model knows little count little, and one that is not found there counts for nothing but what is found later.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import setting_of, velocity_of
from blurnoise_eval.scoring import certainty

Array = NDArray[np.float64]
Row = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Surface:
    """A score of N targets (times noise fields) in C clusters over E exposures and V velocities.

    setting: values of all other axes, as ``SETTING`` names them. sums, counts: (C, E, V) of what was measured, counts
    by number or, where ``kept``, by the score of the same targets in the untouched pictures. saturated: (E, V) mean
    share of the pictures' values at a limit of the sensor, brightness: their mean, NaN where it is not known. clean:
    mean score in the untouched pictures, None where it is not known; reference: its sum over the targets, each once.
    open: (V, E, E) covariance of what is not known of a mean that is predicted and was not measured, beside what
    clusters differ by; None of what was measured.
    """

    model: str
    group: str
    setting: tuple[float, ...]
    exposures_s: tuple[float, ...]
    velocities_px_s: tuple[tuple[float, float], ...]
    clusters: tuple[str, ...]
    sums: Array
    counts: Array
    saturated: Array
    n_targets: int
    brightness: Array
    clean: float | None = None
    reference: float = 0.0
    kept: bool = False
    open: Array | None = None

    @property
    def most(self) -> float:
        """The greatest value of the mean: all of the score, by what was kept."""
        return 1 / self.clean if self.kept and self.clean else 1.0

    @cached_property
    def mean(self) -> Array:
        """(E, V), NaN where nothing was measured."""
        return certainty.mean_of(self.sums, self.counts)

    def at(self, exposures_s: Collection[float]) -> Surface:
        """Of its exposures those that are among these."""
        kept = [place for place, exposure in enumerate(self.exposures_s) if exposure in exposures_s]
        left: dict[str, Any] = {name: getattr(self, name)[kept] for name in ("saturated", "brightness")}
        left |= {"sums": self.sums[:, kept], "counts": self.counts[:, kept]}
        left |= {"exposures_s": tuple(self.exposures_s[place] for place in kept)}
        return replace(self, **left, open=None if self.open is None else self.open[:, kept][:, :, kept])

    def of_clusters(self, clusters: tuple[str, ...]) -> tuple[Array, Array]:
        """Sums and counts (C, E, V) of these clusters, 0 for those that the surface does not have."""
        place = {cluster: index for index, cluster in enumerate(clusters)}
        own = [place[cluster] for cluster in self.clusters]
        shape = (len(clusters), *self.sums.shape[1:])
        sums, counts = np.zeros(shape), np.zeros(shape)
        sums[own], counts[own] = self.sums, self.counts
        return sums, counts


def surfaces(
    target_rows: Iterable[Row],
    value_of: Callable[[Row], float | None] = lambda row: row["confidence"],
    cluster_of: Callable[[str], str] = lambda picture: picture,
    *,
    clean_of: Callable[[Row], float | None] = lambda row: None,
    kept: bool = False,
) -> Iterator[Surface]:
    """One surface per model, group and setting; rows of the store's targets, exposed ones, in that order.

    value_of: the score of a row; None counts for nothing. cluster_of: from a picture's name to its cluster's.
    clean_of: the score of the same target in the untouched picture; kept: values are shares of it, and rows without
    count for nothing. Holds the numbers of one surface at a time.
    """

    def key(row: Row) -> tuple[str, str, tuple[float, ...]]:
        return row["model"], row["group"], setting_of(row)

    for own, rows in groupby(target_rows, key):
        names: dict[str, int] = {}
        entries = [
            (
                names.setdefault(row["image"], len(names)),
                row["repeat"],
                row["target_id"],
                row["exposure_s"],
                *velocity_of(row),
                *(value_of(row), clean_of(row), row.get("saturated"), row.get("brightness")),
            )
            for row in rows
        ]
        columns = [np.array(column, float) for column in zip(*entries, strict=True)]
        places = [column.astype(np.int64) for column in columns[:3]]
        found: list[Any] = [list(names), *places, columns[3], np.stack(columns[4:6], axis=1), *columns[6:]]
        measured = Measured(*found)
        if (surface := surface_of(*own, measured, cluster_of, kept=kept)) is not None:
            yield surface


class Measured(NamedTuple):
    """N measurements of a group of targets in one setting.

    names: of pictures, picture: (N,) places in them; value, clean: scores, here and of the same target in the
    untouched picture; NaN: not known.
    """

    names: Sequence[str]
    picture: NDArray[Any]
    repeat: NDArray[Any]
    target_id: NDArray[Any]
    exposure_s: Array
    velocity_px_s: Array
    value: Array
    clean: Array
    saturated: Array
    brightness: Array


def surface_of(
    model: str,
    group: str,
    setting: tuple[float, ...],
    every: Measured,
    cluster_of: Callable[[str], str] = lambda picture: picture,
    *,
    kept: bool = False,
) -> Surface | None:
    """The surface of measurements, clusters in the order of their first; None where nothing counts."""
    weights = every.clean if kept else np.ones(len(every.value))
    counted = ~np.isnan(every.value) & ~np.isnan(weights)
    if not counted.any():
        return None
    weights = weights[counted]
    some: list[Any] = [column[counted] for column in every[1:]]
    own = Measured(every.names, *some)
    seen, first, picture = np.unique(own.picture, return_index=True, return_inverse=True)
    clusters: dict[str, int] = {}
    of_picture = np.empty(len(seen), np.int64)
    for place in np.argsort(first).tolist():
        of_picture[place] = clusters.setdefault(cluster_of(own.names[int(seen[place])]), len(clusters))
    exposures, e = np.unique(own.exposure_s, return_inverse=True)
    velocities, v = np.unique(own.velocity_px_s, axis=0, return_inverse=True)
    shape = len(clusters), len(exposures), len(velocities)
    cells = of_picture[picture], e.ravel(), v.ravel()
    flat = np.ravel_multi_index(cells, shape)
    sums, counts = (
        np.asarray(np.bincount(flat, each, math.prod(shape)).reshape(shape), float)
        for each in (own.value, weights)
    )
    saturated, brightness = (_means(each, cells[1:], shape[1:]) for each in (own.saturated, own.brightness))
    _, first = np.unique(np.stack([picture.ravel(), own.target_id]), axis=1, return_index=True)
    references = own.clean[np.sort(first)]
    known = references[~np.isnan(references)]
    targets = np.unique(np.stack([picture.ravel(), own.repeat, own.target_id]), axis=1).shape[1]
    where = tuple(exposures.tolist()), tuple((x, y) for x, y in velocities.tolist()), tuple(clusters)
    return Surface(
        model,
        group,
        setting,
        *where,
        sums,
        counts,
        saturated,
        targets,
        brightness,
        float(np.mean(known)) if len(known) else None,
        float(np.sum(known)),
        kept,
    )


def _means(values: Array, cells: tuple[Any, ...], shape: tuple[int, ...]) -> Array:
    """Means per cell of those that are known, NaN where none is."""
    flat = np.ravel_multi_index(cells, shape)
    known, total = (
        np.bincount(flat, each, math.prod(shape)).reshape(shape)
        for each in (np.isfinite(values), np.nan_to_num(values))
    )
    return certainty.mean_of(total[None], known[None])
