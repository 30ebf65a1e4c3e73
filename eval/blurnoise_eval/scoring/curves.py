"""Confidence of a group of targets under every exposure and velocity in one setting, and how certain its mean is.

Domain: axes as in :mod:`blurnoise_eval.grid.axes`; a setting is a value on each but exposure and velocity. Blur in
px, confidences in [0, 1].
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import NAMES, SETTING, VELOCITY, axis, setting_of, velocity_of
from blurnoise_eval.scoring.matching import failure_point, mean_over

RESAMPLES = 400
_FEWEST = 3  # samples below which no interval is given
Array = NDArray[np.float64]
Place = tuple[str, int, int]


@dataclass(frozen=True, eq=False)
class Surface:
    """Confidence of N targets (times noise fields) over E exposures and V velocities, NaN where not measured.

    setting: values of all other axes, as ``SETTING`` names them. confidence: (N, E, V). places: (N) of (picture,
    repeat, target). sample: (N,) numbers those that were drawn together: targets of one picture, or, below three
    pictures, of one noise field.
    """

    model: str
    group: str
    setting: tuple[float, ...]
    exposures_s: tuple[float, ...]
    velocities_px_s: tuple[tuple[float, float], ...]
    confidence: Array
    places: tuple[Place, ...]
    sample: NDArray[np.int64]

    @property
    def mean(self) -> Array:
        """(E, V), NaN where nothing was measured."""
        return np.asarray(_means(np.ones((1, self.sample.max() + 1)), self)[0])

    def resampled(self, generator: np.random.Generator) -> Array | None:
        """Means of bootstrap draws over samples, (RESAMPLES, E, V); None for fewer than three samples."""
        weights = _weights(int(self.sample.max()) + 1, generator)
        return None if weights is None else _means(weights, self)


@dataclass(frozen=True)
class Endurance:
    """How one curve holds: mean confidence against one axis, or blur, all else staying as it is.

    axis: the name of an axis or "blur_px". at: values of all axes, None on those that vary along the curve.
    x: increasing. auc: area under the curve over the range of x, so the mean confidence over it. fails_at: where
    the curve falls below the threshold for good, None where it does not within the range; fails_low,
    fails_high: its 95 % bootstrap interval, None at an end that is
    not reached within the range, or without an interval. non_monotonic: the curve had been below and come back.
    """

    model: str
    group: str
    axis: str
    at: Mapping[str, float | None]
    x: tuple[float, ...]
    confidence: tuple[float, ...]
    auc: float | None
    fails_at: float | None
    fails_low: float | None
    fails_high: float | None
    non_monotonic: bool

    def row(self) -> dict[str, Any]:
        """As a table's row: the axes are columns, the light before the others."""
        first = {"illuminance_lux": self.at["illuminance_lux"], "axis": self.axis}
        rest = {
            name: value for name, value in vars(self).items() if name not in ("model", "group", "axis", "at")
        }
        return {"model": self.model, "group": self.group, **first, **self.at, **rest}


def surfaces(target_rows: Iterable[dict[str, Any]]) -> Iterator[Surface]:
    """One surface per model, group and setting; rows of the store's targets, exposed ones, in that order.

    Holds the numbers of one surface at a time.
    """

    def key(row: dict[str, Any]) -> tuple[str, str, tuple[float, ...]]:
        return row["model"], row["group"], setting_of(row)

    for (model, group, setting), rows in groupby(target_rows, key):
        places: dict[Place, int] = {}
        entries = []
        for row in rows:
            place = places.setdefault((row["image"], row["repeat"], row["target_id"]), len(places))
            entries.append((place, row["exposure_s"], velocity_of(row), row["confidence"]))
        exposures = sorted({entry[1] for entry in entries})
        velocities = sorted({entry[2] for entry in entries})
        table = np.full((len(places), len(exposures), len(velocities)), np.nan)
        e_of, v_of = ({value: i for i, value in enumerate(values)} for values in (exposures, velocities))
        for place, exposure, velocity, confidence in entries:
            table[place, e_of[exposure], v_of[velocity]] = confidence
        own = model, group, setting, tuple(exposures), tuple(velocities)
        yield Surface(*own, table, tuple(places), _samples(places))


def _samples(places: Iterable[Place]) -> NDArray[np.int64]:
    keys = list(places)
    whole = len({image for image, _, _ in keys}) >= _FEWEST
    numbers: dict[Any, int] = {}
    return np.array(
        [numbers.setdefault(image if whole else (image, repeat), len(numbers)) for image, repeat, _ in keys]
    )


def _weights(count: int, generator: np.random.Generator) -> Array | None:
    """How often each of ``count`` samples counts in bootstrap draws, (RESAMPLES, count); None for too few."""
    if count < _FEWEST:
        return None
    return generator.multinomial(count, np.full(count, 1 / count), RESAMPLES).astype(float)


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
    exposures = np.array(surface.exposures_s)
    for v, velocity in enumerate(surface.velocities_px_s):
        resampled = None if drawn is None else drawn[:, :, v]
        found = _held(exposures, mean[:, v], resampled, threshold)
        if found is not None:
            yield _curve(surface, "exposure_s", (None, *velocity), found)
    speeds, place = np.unique([np.hypot(*v) for v in surface.velocities_px_s], return_inverse=True)
    alike = (np.arange(len(speeds))[:, None] == place).astype(float)
    for e, exposure_s in enumerate(surface.exposures_s):
        resampled = None if drawn is None else _over(alike, drawn[:, e])
        found = _held(speeds * exposure_s, _over(alike, mean[e]), resampled, threshold)
        if found is not None:
            yield _curve(surface, "blur_px", (exposure_s, None, None), found)


def endurances_across(
    found: Sequence[Surface], threshold: float, generator: np.random.Generator
) -> Iterator[Endurance]:
    """Every curve with at least two points over an axis of the setting on which a detector fails, at one exposure
    and velocity.

    found: the surfaces of one model and group. Their draws are paired: a picture counts as often in each.
    """
    places = dict.fromkeys(place for surface in found for place in surface.places)
    sample_of = dict(zip(places, _samples(places).tolist(), strict=True))
    count = max(sample_of.values()) + 1
    joint = [replace(each, sample=np.array([sample_of[place] for place in each.places])) for each in found]
    means = [_means(np.ones((1, count)), each)[0] for each in joint]
    columns = zip(*(surface.setting for surface in found), strict=True)
    varied = [name for name, column in zip(SETTING, columns, strict=True) if len(set(column)) > 1]
    failing = [name for name in varied if axis(name).fails]
    weights = _weights(count, generator) if failing else None
    drawn = None if weights is None else [_means(weights, each) for each in joint]
    for name in failing:
        place = SETTING.index(name)
        lines: dict[tuple[float, ...], list[int]] = {}
        for index, surface in enumerate(found):
            lines.setdefault((*surface.setting[:place], *surface.setting[place + 1 :]), []).append(index)
        for line in lines.values():
            line.sort(key=lambda index: found[index].setting[place])
            x = np.array([found[index].setting[place] for index in line])
            tested = {
                (e, v)
                for index in line
                for e in found[index].exposures_s
                for v in found[index].velocities_px_s
            }
            for exposure_s, velocity in sorted(tested):
                where = [(found[index], exposure_s, velocity) for index in line]
                y = np.array([_cut(means[index], *at) for index, at in zip(line, where, strict=True)])
                resampled = None
                if drawn is not None:
                    cuts = [_cut(drawn[index], *at) for index, at in zip(line, where, strict=True)]
                    resampled = np.stack(cuts, axis=1)
                held = _held(x, y, resampled, threshold)
                if held is not None:
                    yield _curve(found[line[0]], name, (exposure_s, *velocity), held)


def _cut(values: Array, surface: Surface, exposure_s: float, velocity: tuple[float, float]) -> Array:
    """What values (..., E, V) are at one exposure and velocity, NaN where the surface does not reach."""
    if exposure_s not in surface.exposures_s or velocity not in surface.velocities_px_s:
        return np.full(values.shape[:-2], np.nan)
    return values[..., surface.exposures_s.index(exposure_s), surface.velocities_px_s.index(velocity)]


def _curve(
    surface: Surface, over: str, place: tuple[float | None, float | None, float | None], held: tuple[Any, ...]
) -> Endurance:
    """A curve of the surface; ``place``: exposure and velocity, None where it varies."""
    values: dict[str, float | None] = dict(zip(("exposure_s", *VELOCITY), place, strict=True))
    values |= dict(zip(SETTING, surface.setting, strict=True))
    at = {name: None if name == over else values[name] for name in NAMES}
    return Endurance(surface.model, surface.group, over, at, *held)


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
    """Mean area under the curves of one axis, all groups, settings and curves alike; None without any."""
    areas = [each.auc for each in found if each.axis == axis and each.auc is not None]
    return float(np.mean(areas)) if areas else None
