"""The table of a score: a group of targets before one model, by cluster of pictures, under every condition.

Curves, windows, planes and maps are groupings of it. A cluster is a picture with all its targets and noise fields, or
what else was drawn together (``--cluster``). A mean is a ratio of sums over clusters. What is kept of a score is the
targets' scores by what the same targets have in the original pictures: so targets of which the model knows little
count little, and one that is not found there counts for nothing but what is found later. Of a score that belongs to
no single target, such as AP, a cluster has the score's pseudo-value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers import plane
from blurnoise_eval.grid.axes import FURTHER, LIGHT, NAMES, SETTING, VELOCITY
from blurnoise_eval.scoring.estimates import Estimate, influence, ratio, ratio_of_sums
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.precision import SIZES

LEAST_KNOWN = 0.05
"""Mean score of a group's targets in the original pictures from which on its kept share means something: below it
one target in twenty is found at most, or none with any confidence."""
ORDER = (*SETTING, *VELOCITY, "exposure_s")
"""The axes by which the conditions of a table are sorted."""
_OF_PICTURES = ("saturated", "brightness")
Array = NDArray[np.float64]
Places = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ScoreTable:
    """A score of one group of targets before one model under N conditions, in C clusters.

    conditions: (N,) values by axis, sorted by the axes in ``ORDER``. sums, counts: (C, N) of what was measured, by
    number or, where ``kept``, by the score of the same targets in the original pictures. saturated: (N,) mean
    share of the pictures' values at a limit of the sensor, brightness: their mean, NaN where unknown. n_targets: how
    many there are, times noise fields. clean: mean score in the original pictures, None where unknown; reference: its
    sum over the targets, each once. prediction_cov: of a mean that is predicted and was not measured, its covariance
    (n, n) at n of the conditions, by their places, beside what clusters differ by.
    """

    model: str
    group: str
    clusters: tuple[str, ...]
    conditions: Mapping[str, Array]
    sums: Array
    counts: Array
    saturated: Array
    brightness: Array
    n_targets: int
    clean: float | None = None
    reference: float = 0.0
    kept: bool = False
    prediction_cov: Callable[[Places], Array] | None = None

    def __len__(self) -> int:
        return int(self.sums.shape[1])

    @cached_property
    def mean(self) -> Array:
        """(N,), NaN where nothing was measured."""
        return ratio_of_sums(self.sums, self.counts)

    @cached_property
    def influence(self) -> Array:
        """What each cluster contributes to the mean's departure from the truth, (C, N), by leaving it out; NaN for
        clusters that have nothing there."""
        return influence(self.sums, self.counts)

    @property
    def standard_error(self) -> Array:
        """(N,) of the mean over clusters; NaN of fewer than two."""
        if len(self.clusters) < 2:
            return np.full(len(self), np.nan)
        n = np.isfinite(self.influence).sum(axis=0)
        return np.asarray(np.nanstd(self.influence, axis=0, ddof=1) / np.sqrt(n))

    @property
    def most(self) -> float:
        """The greatest value of the mean: all of the score, by what was kept."""
        return 1 / self.clean if self.kept and self.clean else 1.0

    @property
    def measured(self) -> NDArray[np.bool_]:
        """The conditions under which anything counts, (N,)."""
        return np.asarray(self.counts.sum(axis=0) > 0)

    @property
    def knows_too_little(self) -> bool:
        """Whether these targets score too little in the original pictures to say what the model keeps of it.

        That is less than ``LEAST_KNOWN`` on average, however many they are, and where they make less than 1 in sum,
        less than what counts as found.
        """
        least = FOUND_SCORE if self.reference < 1 else LEAST_KNOWN
        return self.kept and (self.clean or 0.0) < least

    def at(self, place: int) -> dict[str, float]:
        """The values of one condition, by axis."""
        return {name: float(self.conditions[name][place]) for name in NAMES}

    def take(self, of: ArrayLike) -> ScoreTable:
        """Some of its conditions, by places or flags (N,)."""
        some = np.asarray(of)
        places = np.flatnonzero(some) if some.dtype == bool else some.astype(np.int64)
        cov = self.prediction_cov
        return replace(
            self,
            conditions={name: values[places] for name, values in self.conditions.items()},
            sums=self.sums[:, places],
            counts=self.counts[:, places],
            saturated=self.saturated[places],
            brightness=self.brightness[places],
            prediction_cov=None if cov is None else lambda those: cov(places[those]),
        )

    def split(self, axes: Sequence[str]) -> Iterator[ScoreTable]:
        """Its parts of equal values on these axes, by increasing values, the first axis first."""
        which = same_rows([self.conditions[name] for name in axes], len(self))
        order = np.argsort(which, kind="stable")
        for places in np.split(order, np.flatnonzero(np.diff(which[order])) + 1) if len(order) else ():
            yield self.take(places)

    def along(self, axis: str) -> Iterator[ScoreTable]:
        """Its lines over one axis, all else staying as it is, each by increasing values of the axis."""
        rest = (*SETTING, "exposure_s", *VELOCITY)
        for line in self.split([name for name in rest if name != axis]):
            yield line.take(np.argsort(line.conditions[axis], kind="stable"))

    def on_plane(self) -> Iterator[ScoreTable]:
        """Its planes, one for each setting of the further axes and direction of motion; conditions at one place,
        which are one experiment, as their mean.

        Each is a table of one condition per place, that of the first there, in the order of :attr:`places`.
        Conditions without light have no place and are left out; those at rest are in every direction's plane.
        """
        for alike in self.take(self.measured & (self.conditions[LIGHT.name] > 0)).split(FURTHER):
            of = [plane.direction_of(velocity) for velocity in alike.velocities_px_s]
            for direction in dict.fromkeys(each for each in of if each is not None) or (None,):
                here = alike.take([place for place, each in enumerate(of) if each in (direction, None)])
                which = plane.same_places(here.places)[1]
                first, number = np.unique(which, return_index=True, return_counts=True)[1:]
                means: dict[str, Any] = {}
                for name in ("sums", "counts", *_OF_PICTURES):
                    values = getattr(here, name)
                    total = np.zeros((*values.shape[:-1], len(number)))
                    np.add.at(total.T, which, values.T)
                    means[name] = total / number
                yield replace(here.take(first), **means)

    @property
    def velocities_px_s(self) -> list[tuple[float, float]]:
        """(x, y) of each condition."""
        x, y = (self.conditions[name].tolist() for name in VELOCITY)
        return list(zip(x, y, strict=True))

    @property
    def speeds_px_s(self) -> Array:
        """(N,)."""
        return np.asarray(np.hypot(*(self.conditions[name] for name in VELOCITY)))

    @property
    def settings(self) -> list[tuple[float, ...]]:
        """Of each condition the values on the axes of ``SETTING``."""
        return list(zip(*(self.conditions[name].tolist() for name in SETTING), strict=True))

    @property
    def places(self) -> Array:
        """(N, 2) on the plane of :mod:`.plane`, rounded as places are told apart."""
        exposures, lux = self.conditions["exposure_s"], self.conditions[LIGHT.name]
        return np.asarray(plane.places_of(exposures, lux, self.speeds_px_s).round(plane.DIGITS) + 0.0)

    @property
    def direction(self) -> plane.Direction:
        """Of the first condition that moves, as :func:`~.plane.direction_of` has it."""
        found = (plane.direction_of(velocity) for velocity in self.velocities_px_s)
        return next((each for each in found if each is not None), plane.AT_REST)


def same_rows(columns: Sequence[Array], count: int) -> Places:
    """The number of each of ``count`` rows among the different ones, in their order, the first column first."""
    which = np.zeros(count, np.int64)
    for column in columns:
        values, place = np.unique(column, return_inverse=True)
        which = np.unique(which * len(values) + place.ravel(), return_inverse=True)[1].ravel()
    return which


class Measured(NamedTuple):
    """M measurements of targets under K conditions.

    names: of pictures, picture: (M,) places in them; condition: (M,) places among the conditions. value, clean:
    scores, here and of the same target in the original picture; saturated, brightness: of the picture. NaN: unknown.
    """

    names: Sequence[str]
    picture: NDArray[Any]
    repeat: NDArray[Any]
    target_id: NDArray[Any]
    condition: NDArray[Any]
    value: Array
    clean: Array
    saturated: Array
    brightness: Array


def table_of(
    model: str,
    group: str,
    conditions: Mapping[str, Array],
    every: Measured,
    cluster_of: Callable[[str], str] = lambda picture: picture,
    *,
    kept: bool = False,
) -> ScoreTable | None:
    """The table of measurements, clusters in the order of their first; None where nothing counts.

    conditions: (K,) by axis; equal ones are one. cluster_of: from a picture's name to its cluster's. kept: values are
    shares of the score in the original pictures, and measurements without that count for nothing.
    """
    weights = every.clean if kept else np.ones(len(every.value))
    counted = ~np.isnan(every.value) & ~np.isnan(weights)
    if not counted.any():
        return None
    own = Measured(every.names, *(column[counted] for column in every[1:]))
    seen, first, picture = np.unique(own.picture, return_index=True, return_inverse=True)
    clusters: dict[str, int] = {}
    of_picture = np.empty(len(seen), np.int64)
    for place in np.argsort(first).tolist():
        of_picture[place] = clusters.setdefault(cluster_of(own.names[int(seen[place])]), len(clusters))
    used = np.unique(own.condition)
    columns = {name: conditions[name][used] for name in ORDER}
    of_used = same_rows(list(columns.values()), len(used))
    one_of_each = np.unique(of_used, return_index=True)[1]
    condition = of_used[np.searchsorted(used, own.condition)]
    shape = len(clusters), len(one_of_each)
    cell = of_picture[picture] * shape[1] + condition

    sums, counts = (
        np.asarray(np.bincount(cell, each, math.prod(shape)).reshape(shape), float)
        for each in (own.value, weights[counted])
    )

    def means(values: Array) -> Array:
        known = np.bincount(condition, np.isfinite(values), shape[1])
        return ratio_of_sums(np.bincount(condition, np.nan_to_num(values), shape[1])[None], known[None])

    target = picture * (1 + int(own.target_id.max())) + own.target_id
    references = own.clean[np.sort(np.unique(target, return_index=True)[1])]
    known = references[~np.isnan(references)]
    return ScoreTable(
        model,
        group,
        tuple(clusters),
        {name: column[one_of_each] for name, column in columns.items()},
        sums,
        counts,
        means(own.saturated),
        means(own.brightness),
        n_targets=len(np.unique(target * (1 + int(own.repeat.max())) + own.repeat)),
        clean=float(np.mean(known)) if len(known) else None,
        reference=float(np.sum(known)),
        kept=kept,
    )


class Sized(NamedTuple):
    """A score by the size of targets under one condition; row: of scores, n_targets: how many there are of each."""

    row: Mapping[str, Any]
    estimates: Mapping[str, Estimate]
    n_targets: Mapping[str, int]


def tables_by_size(scored: Sequence[Sized], kept: bool) -> Iterator[ScoreTable]:
    """The tables of each model and size of targets. kept: values are shares of that in the original pictures.

    scored: every condition of each model, the original pictures first. Clusters are numbered.
    """
    for model, size in product(dict.fromkeys(each.row["model"] for each in scored), SIZES):
        original, *exposed = (each for each in scored if each.row["model"] == model)
        clean, n_targets = original.estimates[size], original.n_targets[size]
        found = [
            (each.row, ratio(each.estimates[size], clean) if kept else each.estimates[size])
            for each in exposed
        ]
        known = [(row, each) for row, each in found if each.influence is not None]
        if clean.value is None or not n_targets or not known:
            continue
        columns = {name: np.array([row[name] for row, _ in known], float) for name in (*ORDER, *_OF_PICTURES)}
        values = np.array([_pseudo_values(each) for _, each in known]).T
        saturated, brightness = (columns.pop(name) for name in _OF_PICTURES)
        sums, counts = np.nan_to_num(values), np.isfinite(values).astype(float)
        clusters = tuple(map(str, range(len(values))))
        of_clean = clean.value, clean.value * n_targets, kept
        of_group = str(model), size, clusters
        of_pictures = saturated, brightness, n_targets
        table = ScoreTable(*of_group, columns, sums, counts, *of_pictures, *of_clean)
        yield table.take(np.argsort(same_rows(list(columns.values()), len(known)), kind="stable"))


def _pseudo_values(estimate: Estimate) -> Array:
    """Of each cluster, (n,); their mean is the value (Tukey)."""
    away = np.asarray(estimate.influence, float)
    return np.asarray((estimate.value or 0.0) + away - np.nanmean(away))
