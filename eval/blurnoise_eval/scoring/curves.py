"""Confidence of a group of targets under every exposure and velocity at one light, and how certain its mean is.

Domain: exposures s, light lux, velocities px/s, blur px, confidences in [0, 1].
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.scoring.matching import failure_point, mean_over

RESAMPLES = 400
_FEWEST = 3  # samples below which no interval is given
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Confidence of N targets (times noise fields) over E exposures and V velocities, NaN where not measured.

    confidence: (N, E, V). sample: (N,) numbers those that were drawn together: targets of one picture, or,
    below three pictures, of one noise field.
    """

    model: str
    group: str
    illuminance_lux: float
    exposures_s: tuple[float, ...]
    velocities_px_s: tuple[tuple[float, float], ...]
    confidence: Array
    sample: NDArray[np.int64]

    @property
    def mean(self) -> Array:
        """(E, V), NaN where nothing was measured."""
        return np.asarray(_means(np.ones((1, self.sample.max() + 1)), self)[0])

    def resampled(self, generator: np.random.Generator) -> Array | None:
        """Means of bootstrap draws over samples, (RESAMPLES, E, V); None for fewer than three samples."""
        count = int(self.sample.max()) + 1
        if count < _FEWEST:
            return None
        weights = generator.multinomial(count, np.full(count, 1 / count), RESAMPLES)
        return _means(weights.astype(float), self)


@dataclass(frozen=True)
class Endurance:
    """How one curve holds: mean confidence against exposure (at one velocity) or blur (at one exposure).

    axis: "exposure_s" or "blur_px". x: increasing. auc: area under the curve over the range of x, so the mean
    confidence over it. fails_at: where the curve falls below the threshold for good, None where it does not
    within the range; fails_low, fails_high: its 95 % bootstrap interval, None at an end that is not reached
    within the range, or without an interval. non_monotonic: the curve had been below and come back.
    """

    model: str
    group: str
    illuminance_lux: float
    axis: str
    exposure_s: float | None
    velocity_x_px_s: float | None
    velocity_y_px_s: float | None
    x: tuple[float, ...]
    confidence: tuple[float, ...]
    auc: float | None
    fails_at: float | None
    fails_low: float | None
    fails_high: float | None
    non_monotonic: bool


def surfaces(target_rows: Iterable[dict[str, Any]]) -> Iterator[Surface]:
    """One surface per model, group and light; rows of the store's targets, exposed ones, in that order.

    Holds the numbers of one surface at a time.
    """

    def key(row: dict[str, Any]) -> tuple[str, str, float]:
        return row["model"], row["group"], row["illuminance_lux"]

    for (model, group, lux), rows in groupby(target_rows, key):
        places: dict[tuple[str, int, int], int] = {}
        entries = []
        for row in rows:
            place = places.setdefault((row["image"], row["repeat"], row["target_id"]), len(places))
            velocity = row["velocity_x_px_s"], row["velocity_y_px_s"]
            entries.append((place, row["exposure_s"], velocity, row["confidence"]))
        exposures = sorted({entry[1] for entry in entries})
        velocities = sorted({entry[2] for entry in entries})
        table = np.full((len(places), len(exposures), len(velocities)), np.nan)
        e_of, v_of = ({value: i for i, value in enumerate(axis)} for axis in (exposures, velocities))
        for place, exposure, velocity, confidence in entries:
            table[place, e_of[exposure], v_of[velocity]] = confidence
        yield Surface(model, group, lux, tuple(exposures), tuple(velocities), table, _samples(places))


def _samples(places: Iterable[tuple[str, int, int]]) -> NDArray[np.int64]:
    keys = list(places)
    whole = len({image for image, _, _ in keys}) >= _FEWEST
    numbers: dict[Any, int] = {}
    return np.array(
        [numbers.setdefault(image if whole else (image, repeat), len(numbers)) for image, repeat, _ in keys]
    )


def _means(weights: Array, surface: Surface) -> Array:
    """Means with sample c counted ``weights[:, c]`` times, (R, E, V)."""
    measured = np.isfinite(surface.confidence)
    shape = (weights.shape[1], *surface.confidence.shape[1:])
    sums, counts = np.zeros(shape), np.zeros(shape)
    np.add.at(sums, surface.sample, np.where(measured, surface.confidence, 0.0))
    np.add.at(counts, surface.sample, measured)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.tensordot(weights, sums, 1) / np.tensordot(weights, counts, 1))


def endurances(surface: Surface, threshold: float, generator: np.random.Generator) -> Iterator[Endurance]:
    """Every curve of the surface with at least two points: over exposure, then over blur."""
    mean, drawn = surface.mean, surface.resampled(generator)
    where = surface.model, surface.group, surface.illuminance_lux
    exposures = np.array(surface.exposures_s)
    for v, (vx, vy) in enumerate(surface.velocities_px_s):
        resampled = None if drawn is None else drawn[:, :, v]
        found = _held(exposures, mean[:, v], resampled, threshold)
        if found is not None:
            yield Endurance(*where, "exposure_s", None, vx, vy, *found)
    speeds, place = np.unique([np.hypot(*v) for v in surface.velocities_px_s], return_inverse=True)
    alike = (np.arange(len(speeds))[:, None] == place).astype(float)
    for e, exposure_s in enumerate(surface.exposures_s):
        resampled = None if drawn is None else _over(alike, drawn[:, e])
        found = _held(speeds * exposure_s, _over(alike, mean[e]), resampled, threshold)
        if found is not None:
            yield Endurance(*where, "blur_px", exposure_s, None, None, *found)


def _over(alike: Array, values: Array) -> Array:
    """Means (..., S) of those of the values (..., V) that are marked in ``alike`` (S, V) and not NaN."""
    measured = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        return np.asarray((np.where(measured, values, 0.0) @ alike.T) / (measured @ alike.T))


def _held(x: Array, y: Array, drawn: Array | None, threshold: float) -> tuple[Any, ...] | None:
    """The fields of an :class:`Endurance` from ``x`` on; points that were not measured are left out."""
    there = np.isfinite(y)
    x, y = x[there], y[there]
    if len(x) < 2:
        return None
    at, returned = failure_point(x.tolist(), y.tolist(), threshold)
    low = high = None
    if drawn is not None:
        low, high = _interval(_failures(x, drawn[:, there], threshold))
    return tuple(x.tolist()), tuple(y.tolist()), float(mean_over(x, y)), at, low, high, returned


def _failures(x: Array, y: Array, threshold: float) -> Array:
    """:func:`~blurnoise_eval.scoring.matching.failure_point` of each row of y (R, N), infinite if it never fails."""
    above = y >= threshold  # NaN is below: a draw that lacks the point
    last = len(x) - 1 - above[:, ::-1].argmax(axis=1)
    next_one = np.minimum(last + 1, len(x) - 1)
    rows = np.arange(len(y))
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (y[rows, last] - threshold) / (y[rows, last] - y[rows, next_one])
        at = x[last] + share * (x[next_one] - x[last])
    at = np.where(last == len(x) - 1, np.inf, at)
    return np.where(above.any(axis=1), at, x[0])


def _interval(values: Array) -> tuple[float | None, float | None]:
    low, high = np.quantile(values, (0.025, 0.975), method="nearest")
    return (float(low) if np.isfinite(low) else None), (float(high) if np.isfinite(high) else None)


def mean_auc(found: Sequence[Endurance], axis: str) -> float | None:
    """Mean area under the curves of one axis, all groups, lights and curves alike; None without any."""
    areas = [each.auc for each in found if each.axis == axis and each.auc is not None]
    return float(np.mean(areas)) if areas else None
