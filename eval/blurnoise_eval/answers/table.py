"""The table of a score: a group of targets before one model, by cluster of pictures, under every condition.

Curves, windows, planes and maps are groupings of it. A cluster is a picture with all its targets and noise fields, or
several pictures with ``--cluster``. A mean is a ratio of sums over clusters. A kept share is the sum of the targets'
scores, divided by the sum of the same targets' scores in the original pictures. So a target with a low score there
has a low weight, and one that is missed there only adds what is found later. For a score that belongs to no single
target, such as AP, a cluster has the score's pseudo-value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers import plane
from blurnoise_eval.answers.per_condition import Scored
from blurnoise_eval.plan.axes import FURTHER, LIGHT, NAMES, SETTING, VELOCITY
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.precision import SIZES
from blurnoise_eval.scoring.uncertainty import FEW, effective, influence, ratio, ratio_of_sums
from blurnoise_eval.store.queries import TargetColumns

LEAST_KNOWN = 0.05
"""Mean score of a group's targets in the original pictures from which on its kept share means something: below it
one target in twenty is found at most, or none with any confidence."""
ORDER = (*SETTING, *VELOCITY, "exposure_s")
"""The axes by which the conditions of a table are sorted."""
_BLOCK = 64  # conditions whose prediction is asked for at a time
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
    (n, n) at n of the conditions, by their places, beside what clusters differ by. missed_pulses: (N,) share of
    pictures that miss the pulsed lamp, None without lamp.
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
    missed_pulses: Array | None = None

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
    def sigma(self) -> Array:
        """(N,) prediction error, in addition to the variation between clusters; 0 where measured."""
        if self.prediction_cov is None:
            return np.zeros(len(self))
        blocks = np.array_split(np.arange(len(self)), -(-len(self) // _BLOCK))
        variances = [np.diag(self.prediction_cov(block)) for block in blocks]
        return np.asarray(np.sqrt(np.concatenate(variances)))

    @property
    def effective(self) -> Array:
        """(N,) how many clusters of one size they are worth, by their sizes."""
        return effective(self.counts)

    @property
    def n_clusters(self) -> int:
        """How many clusters have a value anywhere."""
        return int(((self.counts > 0) | (self.sums > 0)).any(axis=1).sum())

    @property
    def n_effective(self) -> float:
        """How many clusters of one size they are worth over all conditions."""
        return float(effective(self.counts.sum(axis=1)))

    @property
    def sizes(self) -> dict[str, Any]:
        """As tables have them: how many pictures there are, as how many they count, whether these are few."""
        effective = self.n_effective
        return {
            "n_pictures": self.n_clusters,
            "effective_pictures": effective,
            "few_pictures": effective < FEW,
        }

    @property
    def standard_error(self) -> Array:
        """(N,) of the mean over clusters; NaN of fewer than two."""
        if len(self.clusters) < 2:
            return np.full(len(self), np.nan)
        # Leave-one-out influences are scaled so that their spread over the root of n is the error of the mean.
        n = np.isfinite(self.influence).sum(axis=0)
        return np.asarray(np.nanstd(self.influence, axis=0, ddof=1) / np.sqrt(n))

    @property
    def most(self) -> float:
        """The greatest value of the mean: all of the score, by what was kept."""
        # Of a share of the clean score it is more than 1: all of the score where the original pictures have less.
        return 1 / self.clean if self.kept and self.clean else 1.0

    @property
    def measured(self) -> NDArray[np.bool_]:
        """The conditions under which anything counts, (N,)."""
        return np.asarray(self.counts.sum(axis=0) > 0)

    @property
    def reference_too_low(self) -> bool:
        """Whether the score on the original pictures is too low to serve as a reference for a kept share.

        That is a mean below ``LEAST_KNOWN``, however many targets there are; where the scores add up to less than 1,
        a mean below the score from which a target counts as found.
        """
        least = FOUND_SCORE if self.reference < 1 else LEAST_KNOWN
        return self.kept and (self.clean or 0.0) < least

    def at(self, index: int) -> dict[str, float]:
        """The values of one condition, by axis."""
        return {name: float(self.conditions[name][index]) for name in NAMES}

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
            missed_pulses=None if self.missed_pulses is None else self.missed_pulses[places],
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
                yield here.merged(plane.same_places(here.places)[1])

    def merged(self, which: Places) -> ScoreTable:
        """Conditions of one number (N,) as their mean; each stands at the first."""
        order = np.argsort(which, kind="stable")
        starts = np.flatnonzero(np.diff(which[order], prepend=-1))
        number = np.diff(starts, append=len(order))
        means: dict[str, Any] = {
            name: np.add.reduceat(getattr(self, name)[..., order], starts, axis=-1) / number
            for name in ("sums", "counts", "saturated", "brightness", "missed_pulses")
            if getattr(self, name) is not None
        }
        cov = None
        if self.prediction_cov is not None:
            weights = np.zeros((len(order), len(starts)))
            weights[order, np.repeat(np.arange(len(starts)), number)] = self.counts.sum(axis=0)[order]
            # A mean of predictions, weighted as the means above are by what they count: its covariance is W' C W.
            weights /= weights.sum(axis=0)
            every = weights.T @ self.prediction_cov(np.arange(len(order))) @ weights
            cov = lambda places: every[np.ix_(places, places)]  # noqa: E731
        return replace(self.take(order[starts]), **means, prediction_cov=cov)

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
        """(N, 2) on the plane of :mod:`.plane`, rounded as far as places are the same."""
        exposures, lux = self.conditions["exposure_s"], self.conditions[LIGHT.name]
        return np.asarray(plane.places_of(exposures, lux, self.speeds_px_s).round(plane.DIGITS) + 0.0)

    @property
    def direction(self) -> plane.Direction:
        """Of the first condition that moves, as :func:`~.plane.direction_of` has it."""
        directions = (plane.direction_of(velocity) for velocity in self.velocities_px_s)
        return next((each for each in directions if each is not None), plane.AT_REST)


def same_rows(columns: Sequence[Array], count: int) -> Places:
    """The number of each of ``count`` rows among the different ones, in their order, the first column first."""
    which = np.zeros(count, np.int64)
    for column in columns:
        values, place = np.unique(column, return_inverse=True)
        # One number for both columns; numbered anew at once, as the product would overflow with many columns.
        which = np.unique(which * len(values) + place.ravel(), return_inverse=True)[1].ravel()
    return which


def table_of(
    model: str,
    group: str,
    conditions: Mapping[str, Array],
    rows: TargetColumns,
    value: Array,
    clean: Array,
    cluster_of: Callable[[str], str] = lambda picture: picture,
    *,
    kept: bool = False,
) -> ScoreTable | None:
    """The table of M rows of targets, clusters in the order of their pictures; None where nothing counts.

    conditions: (K,) by axis; equal ones are one. value, clean: (M,) scores, here and of the same target in the
    original picture, NaN where unknown. cluster_of: from a picture's name to its cluster's. kept: values are shares
    of the score in the original pictures, and rows without that count for nothing.
    """
    weight = clean if kept else np.ones(len(value))
    counted = ~np.isnan(value) & ~np.isnan(weight)
    if not counted.any():
        return None
    rows, value, weight, clean = rows.rows(counted), value[counted], weight[counted], clean[counted]
    different, picture = np.unique(rows.picture, return_inverse=True)
    names = [cluster_of(rows.pictures[place]) for place in different.tolist()]
    clusters = {name: place for place, name in enumerate(dict.fromkeys(names))}
    used, place = np.unique(rows.condition, return_inverse=True)
    of_used = same_rows([conditions[name][used] for name in ORDER], len(used))
    first, condition = np.unique(of_used, return_index=True)[1], of_used[place]
    shape = len(clusters), len(first)
    # One number for cluster and condition, so that a single bincount sums all of them: runs have millions of rows.
    cell = np.array([clusters[name] for name in names])[picture] * shape[1] + condition

    def total(of: Array) -> Array:
        return np.asarray(np.bincount(cell, of, math.prod(shape)).reshape(shape), float)

    def mean(of: Array) -> Array:
        known = np.bincount(condition, np.isfinite(of), shape[1])
        return ratio_of_sums(np.bincount(condition, np.nan_to_num(of), shape[1])[None], known[None])

    target = picture * (1 + int(rows.target_id.max())) + rows.target_id
    # Each target once, however many conditions it was tested under.
    known = clean[np.unique(target, return_index=True)[1]]
    known = known[~np.isnan(known)]
    return ScoreTable(
        model,
        group,
        tuple(clusters),
        {name: conditions[name][used][first] for name in ORDER},
        total(value),
        total(weight),
        mean(rows.saturated),
        mean(rows.brightness),
        n_targets=len(np.unique(target * (1 + int(rows.repeat.max())) + rows.repeat)),
        clean=float(known.mean()) if len(known) else None,
        reference=float(known.sum()),
        kept=kept,
        missed_pulses=None if np.isnan(rows.missed_pulse).all() else mean(rows.missed_pulse),
    )


def tables_by_size(scored: Sequence[Scored], kept: bool) -> Iterator[ScoreTable]:
    """The tables of each model and size of targets. kept: values are shares of that in the original pictures.

    scored: every condition of each model, the original pictures first. Clusters are numbered.
    """
    for model, size in product(dict.fromkeys(each.row.model for each in scored), SIZES):
        original, *exposed = (each for each in scored if each.row.model == model)
        clean, n_targets = original.sizes[size], original.n_targets[size]
        valued = [
            (each.row, ratio(each.sizes[size], clean) if kept else each.sizes[size]) for each in exposed
        ]
        known = [(row, each) for row, each in valued if each.influence is not None]
        if clean.value is None or not n_targets or not known:
            continue
        columns = {name: np.array([row.conditions[name] for row, _ in known], float) for name in ORDER}
        values = np.array([each.pseudo_values for _, each in known]).T
        table = ScoreTable(
            model,
            size,
            tuple(map(str, range(len(values)))),
            columns,
            np.nan_to_num(values),
            np.isfinite(values).astype(float),
            np.array([row.saturated_share for row, _ in known], float),
            np.array([row.brightness for row, _ in known], float),
            n_targets,
            clean.value,
            clean.value * n_targets,
            kept,
        )
        yield table.take(np.argsort(same_rows(list(columns.values()), len(known)), kind="stable"))
