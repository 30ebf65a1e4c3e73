"""Surfaces of a score that belongs to no single target, such as AP: a group is all targets of a size.

Domain: as in :mod:`blurnoise_eval.scoring.surfaces`. A cluster of pictures contributes the score's pseudo-value: the
score and the cluster's jackknife departure from it (Tukey), so that means and intervals are those of the score.
Clusters are numbered, at most ``MOST_CLUSTERS`` of :mod:`blurnoise_eval.scoring.estimates`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import setting_of, velocity_of
from blurnoise_eval.scoring.estimates import Estimate, ratio
from blurnoise_eval.scoring.precision import SIZES
from blurnoise_eval.scoring.surfaces import Surface

Array = NDArray[np.float64]


class Sized(NamedTuple):
    """A score by the size of targets under one condition; row: of scores, n_targets: how many there are of each."""

    row: Mapping[str, Any]
    estimates: Mapping[str, Estimate]
    n_targets: Mapping[str, int]


def score_surfaces(scored: Sequence[Sized], kept: bool) -> Iterator[list[Surface]]:
    """The surfaces of each model and size, together. kept: values are shares of that in the untouched pictures.

    scored: every condition of each model, the untouched pictures first.
    """
    for model, of_model in groupby(scored, lambda each: str(each.row["model"])):
        untouched, *exposed = of_model
        for size in SIZES:
            clean, n_targets = untouched.estimates[size], untouched.n_targets[size]
            if clean.value is None or not n_targets:
                continue
            if found := list(_surfaces(model, size, exposed, clean, n_targets, kept)):
                yield found


def _surfaces(
    model: str, size: str, exposed: Sequence[Sized], clean: Estimate, n_targets: int, kept: bool
) -> Iterator[Surface]:
    at_clean = float(clean.value or 0.0)
    for setting, alike in groupby(sorted(exposed, key=_setting), _setting):
        cells = [(each.row, _told(each.estimates[size], clean, kept)) for each in alike]
        cells = [(row, told) for row, told in cells if told.value is not None and told.departures is not None]
        if not cells:
            continue
        exposures = sorted({row["exposure_s"] for row, _ in cells})
        velocities = sorted({velocity_of(row) for row, _ in cells})
        clusters = max(0 if told.departures is None else len(told.departures) for _, told in cells)
        shape = len(exposures), len(velocities)
        sums, counts = np.zeros((clusters, *shape)), np.zeros((clusters, *shape))
        saturated, brightness = np.full(shape, np.nan), np.full(shape, np.nan)
        for row, told in cells:
            at = exposures.index(row["exposure_s"]), velocities.index(velocity_of(row))
            values = _pseudo_values(told)
            counts[:, *at] = np.isfinite(values)
            sums[:, *at] = np.nan_to_num(values)
            saturated[at], brightness[at] = (
                np.nan if row[name] is None else row[name] for name in ("saturated", "brightness")
            )
        names = tuple(map(str, range(clusters)))
        own = model, size, setting, tuple(exposures), tuple(velocities), names
        measured = sums, counts, saturated, n_targets, brightness
        yield Surface(*own, *measured, at_clean, at_clean * n_targets, kept)


def _setting(scored: Sized) -> tuple[float, ...]:
    return setting_of(scored.row)


def _told(estimate: Estimate, clean: Estimate, kept: bool) -> Estimate:
    return ratio(estimate, clean) if kept else estimate


def _pseudo_values(told: Estimate) -> Array:
    """Of each cluster, (n,); their mean is the value."""
    away = np.asarray(told.departures, float)
    return np.asarray((told.value or 0.0) + away - np.nanmean(away))
