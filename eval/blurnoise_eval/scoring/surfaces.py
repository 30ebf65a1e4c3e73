"""Surfaces: a score of a group of targets under every exposure and velocity in one setting, by cluster.

Domain: axes as in :mod:`blurnoise_eval.grid.axes`; a setting is a value on each but exposure and velocity. A cluster
is a picture with all its targets and noise fields, or what else was drawn together (``--cluster``). What is kept of a
score is a ratio of sums: the targets' scores by what the same targets have in the untouched pictures. So targets of
which the model knows little count little, and one that is not found there counts for nothing but what is found later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

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

    @property
    def most(self) -> float:
        """The greatest value of the mean: all of the score, by what was kept."""
        return 1 / self.clean if self.kept and self.clean else 1.0

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

    for (model, group, setting), rows in groupby(target_rows, key):
        clusters: dict[str, int] = {}
        places = set()
        references: dict[tuple[str, int], float | None] = {}
        entries = []
        pictures: list[tuple[float | None, float | None]] = []
        for row in rows:
            value, clean = value_of(row), clean_of(row)
            weight = clean if kept else 1.0
            if value is None or weight is None:
                continue
            cluster = clusters.setdefault(cluster_of(row["image"]), len(clusters))
            places.add((row["image"], row["repeat"], row["target_id"]))
            references[row["image"], row["target_id"]] = clean
            at = row["exposure_s"], velocity_of(row)
            pictures.append((row.get("saturated"), row.get("brightness")))
            entries.append((cluster, *at, value, weight))
        if not entries:
            continue
        exposures = sorted({entry[1] for entry in entries})
        velocities = sorted({entry[2] for entry in entries})
        e_of, v_of = ({value: i for i, value in enumerate(values)} for values in (exposures, velocities))
        cells = tuple(np.array([(c, e_of[e], v_of[v]) for c, e, v, *_ in entries]).T)
        shape = len(clusters), len(exposures), len(velocities)
        sums, counts = np.zeros(shape), np.zeros(shape)
        np.add.at(sums, cells, [entry[3] for entry in entries])
        np.add.at(counts, cells, [entry[4] for entry in entries])
        saturated, brightness = (
            _means([picture[column] for picture in pictures], cells[1:], shape[1:]) for column in (0, 1)
        )
        known = [clean for clean in references.values() if clean is not None]
        clean = float(np.mean(known)) if known else None
        own = model, group, setting, tuple(exposures), tuple(velocities), tuple(clusters)
        yield Surface(
            *own, sums, counts, saturated, len(places), brightness, clean, float(np.sum(known)), kept
        )


def _means(values: Sequence[float | None], cells: tuple[Any, ...], shape: tuple[int, ...]) -> Array:
    """Means per cell of those that are known, NaN where none is."""
    shares = np.array([np.nan if value is None else value for value in values], float)
    known, total = np.zeros(shape), np.zeros(shape)
    np.add.at(known, cells, np.isfinite(shares))
    np.add.at(total, cells, np.nan_to_num(shares))
    return certainty.mean_of(total[None], known[None])
