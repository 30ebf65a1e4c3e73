"""Choosing an exposure by its values: the highest that does not saturate too much, in the middle of a plateau.

Exposures between those of a grid are tested by a refinement or a search, and which ones depends on much. So they are
chosen only where they score clearly more: a sweep and a search then name the same exposures.

Domain: exposures in s, increasing; values in the criterion's unit, E of them on the last axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.settling import SETTLED

Array = NDArray[np.float64]
Places = NDArray[np.int64]
NEAR = 0.005
"""Exposures whose values differ by less are equally good."""
FINER = 0.01
"""An exposure between those of the grid is used where it scores more than this above them."""
SATURATED = 0.1
"""A share of saturated values above this speaks against an exposure while another one works, or scores alike."""
AS_SATURATED = 0.05
"""Where all that work saturate more, shares this close to the least are equally good."""


def best_exposures(exposures_s: ArrayLike, values: ArrayLike) -> Places:
    """Places (...) of the exposures that keep most; of those within ``NEAR`` of the best, the middle in log exposure.

    Only exposures next to the best one, without a worse one between, count as near. values: (..., E), none NaN.

    >>> best_exposures([0.001, 0.002, 0.004, 0.008], [0.5, 0.9, 0.9, 0.9])  # the middle of the plateau
    array(2)
    """
    value, at = np.asarray(values, float), np.asarray(exposures_s, float)
    best = value.argmax(axis=-1, keepdims=True)
    if not (np.isfinite(at).all() and (at > 0).all()):
        return np.asarray(best[..., 0])
    worse, place = value < value.max(axis=-1, keepdims=True) - NEAR, np.arange(len(at))
    first = np.where(worse & (place < best), place + 1, 0).max(axis=-1, keepdims=True)
    last = np.where(worse & (place > best), place - 1, len(at) - 1).min(axis=-1, keepdims=True)
    # In log exposure, as exposures are tested: the middle is as many stops from either end of the plateau.
    x = np.log(at)
    away = np.abs(x - (x[first] + x[last]) / 2).round(9)
    away = np.where((first <= place) & (place <= last), away, np.inf)
    nearest = away == away.min(axis=-1, keepdims=True)
    return np.asarray(np.where(nearest, value, -np.inf).argmax(axis=-1))


def best_exposure(exposures_s: Sequence[float], values: ArrayLike) -> int | None:
    """The place of :func:`best_exposures` among those that were tested; values: (E,), NaN where not tested.

    None where nothing was tested.

    >>> best_exposure([0.001, 0.002, 0.004], [0.5, np.nan, 0.9])
    2
    """
    value = np.asarray(values, float)
    tested = np.flatnonzero(np.isfinite(value))
    if not len(tested):
        return None
    return int(tested[best_exposures(np.asarray(exposures_s)[tested], value[tested])])


def best_of_grid(exposures_s: Array, values: Array, of_grid: NDArray[np.bool_]) -> Places:
    """As :func:`best_exposures`, of those of the grid, (E,), unless one between them scores more by ``FINER``.

    >>> at, of_grid = np.array([0.001, 0.002, 0.004]), np.array([True, False, True])
    >>> best_of_grid(at, np.array([[0.9, 0.908, 0.8], [0.9, 0.912, 0.8]]), of_grid).tolist()
    [0, 1]
    """
    grid = np.flatnonzero(of_grid)
    best = best_exposures(exposures_s, values)
    if not len(grid):
        return best
    finer = values.max(axis=-1) > values[..., grid].max(axis=-1) + FINER
    return np.where(finer, best, grid[best_exposures(exposures_s[grid], values[..., grid])])


def recommended(
    exposures_s: ArrayLike, values: Array, saturated: ArrayLike, level: float, of_grid: NDArray[np.bool_]
) -> Places:
    """The place (...) of the exposure to use, by its values (..., E): the one rule of tables, page and searches.

    saturated, level: see :func:`without_saturated`. of_grid: (E,), see :func:`best_of_grid`.

    >>> at, every = np.array([0.001, 0.004, 0.016]), np.ones(3, bool)
    >>> recommended(at, np.array([0.5, 0.9, 0.95]), [0.0, 0.01, 0.3], 0.8, every)  # not the third
    array(1)
    """
    return best_of_grid(np.asarray(exposures_s, float), without_saturated(values, saturated, level), of_grid)


def without_saturated(values: ArrayLike, saturated: ArrayLike, level: float) -> Array:
    """Values (..., E) with 0 where more than a tenth of the picture is saturated while another exposure works.

    Where all that work saturate more than a tenth, 0 for those that saturate clearly more than the least of them.
    Where none works, those within ``SETTLED`` of the best count as if they did. saturated: (..., E) share of
    saturated values, NaN where it is not known. level: the value from which an exposure works.

    >>> without_saturated([0.8, 0.9, 0.95], [0.0, 0.05, 0.2], level=0.7).tolist()
    [0.8, 0.9, 0.0]
    >>> without_saturated([0.3, 0.5, 0.52], [0.0, 0.05, 0.3], level=0.7).tolist()  # none works
    [0.3, 0.5, 0.0]
    """
    value, share = np.asarray(values, float), np.nan_to_num(np.asarray(saturated, float))
    best = np.fmax.reduce(value, axis=-1, keepdims=True)
    works = value >= np.where(best >= level, level, best - SETTLED)
    least = np.where(works, share, np.inf).min(axis=-1, keepdims=True)
    # Bright scenes may saturate at every exposure that works: then the least of them is the yardstick.
    limit = np.maximum(SATURATED, least + AS_SATURATED)
    limit = np.where(least <= SATURATED, SATURATED, limit)
    return np.asarray(np.where((share > limit) & np.isfinite(value), 0.0, value))
