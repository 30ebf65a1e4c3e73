"""Surfaces: confidence of a group of targets under every exposure and velocity in one setting, by cluster.

Domain: axes as in :mod:`blurnoise_eval.grid.axes`; a setting is a value on each but exposure and velocity. A cluster
is a picture with all its targets and noise fields, or what else was drawn together (``--cluster``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import setting_of, velocity_of
from blurnoise_eval.scoring import certainty

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Confidence of N targets (times noise fields) in C clusters over E exposures and V velocities.

    setting: values of all other axes, as ``SETTING`` names them. sums, counts: (C, E, V) of what was measured.
    saturated: (E, V) mean share of the pictures' values at a limit of the sensor, NaN where it is not known.
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

    @cached_property
    def mean(self) -> Array:
        """(E, V), NaN where nothing was measured."""
        return certainty.mean_of(self.sums, self.counts)

    def of_clusters(self, clusters: tuple[str, ...]) -> tuple[Array, Array]:
        """Sums and counts (C, E, V) of these clusters, 0 for those that the surface does not have."""
        place = {cluster: index for index, cluster in enumerate(clusters)}
        own = [place[cluster] for cluster in self.clusters]
        shape = (len(clusters), *self.sums.shape[1:])
        sums, counts = np.zeros(shape), np.zeros(shape)
        sums[own], counts[own] = self.sums, self.counts
        return sums, counts


def surfaces(
    target_rows: Iterable[dict[str, Any]],
    column: str = "confidence",
    cluster_of: Callable[[str], str] = lambda picture: picture,
) -> Iterator[Surface]:
    """One surface per model, group and setting; rows of the store's targets, exposed ones, in that order.

    column: what is read of a row; None in it counts for nothing. cluster_of: from a picture's name to its cluster's.
    Holds the numbers of one surface at a time.
    """

    def key(row: dict[str, Any]) -> tuple[str, str, tuple[float, ...]]:
        return row["model"], row["group"], setting_of(row)

    for (model, group, setting), rows in groupby(target_rows, key):
        clusters: dict[str, int] = {}
        places = set()
        entries = []
        for row in rows:
            if row[column] is None:
                continue
            cluster = clusters.setdefault(cluster_of(row["image"]), len(clusters))
            places.add((row["image"], row["repeat"], row["target_id"]))
            at = row["exposure_s"], velocity_of(row)
            entries.append((cluster, *at, row[column], row.get("saturated")))
        if not entries:
            continue
        exposures = sorted({entry[1] for entry in entries})
        velocities = sorted({entry[2] for entry in entries})
        e_of, v_of = ({value: i for i, value in enumerate(values)} for values in (exposures, velocities))
        cells = tuple(np.array([(c, e_of[e], v_of[v]) for c, e, v, *_ in entries]).T)
        shape = len(clusters), len(exposures), len(velocities)
        sums, counts = np.zeros(shape), np.zeros(shape)
        np.add.at(sums, cells, [entry[3] for entry in entries])
        np.add.at(counts, cells, 1)
        shares = np.array([np.nan if entry[4] is None else entry[4] for entry in entries])
        known, at_limit = np.zeros(shape[1:]), np.zeros(shape[1:])
        np.add.at(known, cells[1:], np.isfinite(shares))
        np.add.at(at_limit, cells[1:], np.nan_to_num(shares))
        saturated = certainty.mean_of(at_limit[None], known[None])
        own = model, group, setting, tuple(exposures), tuple(velocities), tuple(clusters)
        yield Surface(*own, sums, counts, saturated, len(places))
