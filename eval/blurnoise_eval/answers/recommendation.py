"""Which exposure to use: the one rule, for one condition, for one light, and for all that was tested.

The exposure to use keeps most on average over the conditions (lights, speeds, target groups), all weighted alike. One
that saturates more than a tenth of the picture, averaged over these conditions, is not used while another one works.
Of exposures that keep as much within ``NEAR`` the middle one is taken (in log exposure), so that a finer grid does
not move the answer along a plateau.

Domain: exposures in s; values in the criterion's unit: a score, or the share of it that is kept. N conditions, each
a setting and a velocity; E exposures, increasing; C clusters of pictures. NaN: not tested.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.grid.axes import EGO, EGO_SPEED, GAIN, SETTING

Array = NDArray[np.float64]
Setting = tuple[float, ...]
Velocity = tuple[float, float]
Row = dict[str, Any]
NEAR = 0.005
"""Exposures whose values differ by less are equally good."""
SATURATED = 0.1
"""A share of saturated values above this speaks against an exposure while another one works."""
AS_SATURATED = 0.05
"""Where all that work saturate more, shares this close to the least are equally good."""
CLOSE = 0.2
"""Stops from a tested exposure, closer than which no further one is tested."""
WIDE, THIRD = 0.5, 1 / 3
"""Stops from the best tested exposure to its neighbours, or to one that saturates, within which it is known."""
MOST_COMMON = 4
"""Exposures that are added for each model under all conditions, at most."""
SURE, FAILS, CANNOT_TELL = "sure", "no", "cannot tell"
_ROUNDED = 0.02  # stops: exposures are rounded to three digits
_GAIN, _EGO = SETTING.index(GAIN.name), SETTING.index(EGO.name)


def best_exposure(exposures_s: Sequence[float], values: ArrayLike) -> int | None:
    """Index of the exposure that keeps most; of those within ``NEAR`` of the best, the middle one in log exposure.

    Only exposures next to the best one, without a worse one between, count as near. values: (E,), NaN where not
    tested. None where nothing was tested.
    """
    value = np.asarray(values, float)
    tested = np.flatnonzero(np.isfinite(value))
    if not len(tested):
        return None
    best = int(np.argmax(value[tested]))
    worse = np.flatnonzero(value[tested] < value[tested[best]] - NEAR)
    plateau = tested[worse[worse < best].max(initial=-1) + 1 : worse[worse > best].min(initial=len(tested))]
    at = np.array([exposures_s[place] for place in plateau])
    if len(plateau) == 1 or not (np.isfinite(at).all() and (at > 0).all()):
        return int(tested[best])
    middle = (math.log(at[0]) + math.log(at[-1])) / 2
    away = np.round(np.abs(np.log(at) - middle), 9)
    return int(min(zip(away, -value[plateau], plateau.tolist(), strict=True))[2])


def without_saturated(values: ArrayLike, saturated: ArrayLike, level: float) -> Array:
    """Values (..., E) with 0 where more than a tenth of the picture is saturated while another exposure works.

    Where all that work saturate more than a tenth, 0 for those that saturate clearly more than the least of them.
    saturated: (..., E) share of saturated values, NaN where it is not known. level: the value from which an exposure
    works.
    """
    value, share = np.asarray(values, float), np.nan_to_num(np.asarray(saturated, float))
    least = np.where(value >= level, share, np.inf).min(axis=-1, keepdims=True)
    limit = np.maximum(SATURATED, least + AS_SATURATED)
    limit = np.where(least <= SATURATED, SATURATED, limit)
    return np.asarray(np.where((share > limit) & np.isfinite(value), 0.0, value))


class Choice(NamedTuple):
    """The exposure to use under some conditions, and what it keeps there on average.

    places: the conditions, one gain for each light. low, high: the 95 % interval of ``value``, None from too few
    pictures. verdict: whether the level is reached: "sure", "no", "cannot tell". loss: how much less this is than
    the best exposure of each condition would keep. saturated: the largest share of saturated values among the
    conditions, None where unknown. sure, fails: in how many conditions the level is surely reached, surely missed.
    """

    places: tuple[int, ...]
    exposure_s: float
    value: float
    low: float | None
    high: float | None
    verdict: str
    loss: float
    saturated: float | None
    sure: int
    fails: int


@dataclass(frozen=True, eq=False)
class Averages:
    """What one model reaches, averaged over target groups, by condition and exposure.

    settings: (N) as ``SETTING`` names their values. velocities_px_s: (N) x and y. speeds: (N) px/s, or km/h of a
    vehicle. value, saturated, sigma: (N, E); sigma: the standard error of a prediction. departures: (C, N, E)
    influence of clusters; effective: (N, E) the number of pictures of equal weight. most: (N,) greatest possible
    values. monotone: whether more speed can only hurt.
    """

    model: str
    level: float
    settings: tuple[Setting, ...]
    velocities_px_s: tuple[Velocity, ...]
    speeds: tuple[float, ...]
    exposures_s: tuple[float, ...]
    value: Array
    departures: Array
    effective: Array
    sigma: Array
    most: Array
    saturated: Array
    monotone: bool = True

    def choose(self, places: Iterable[int] | None = None) -> Choice | None:
        """The exposure to use under these conditions (all by default); None where no exposure was tested in all.

        Of several gains that were tested at a light, the one that keeps most is used.
        """
        every, counted = self._line(range(len(self.settings)) if places is None else places)
        e = best_exposure(self.exposures_s, counted)
        if e is None:
            return None
        own = every[:, e]
        value, share = float(self.value[own, e].mean()), self.saturated[own, e]
        low, high = (float(end[0]) for end in self._mean_interval(own, np.array([e])))
        known = math.isfinite(low) and math.isfinite(high)
        verdicts = [self._verdict(place, e) for place in own]
        best = np.nanmax(without_saturated(self.value[own], self.saturated[own], self.level), axis=1)
        return Choice(
            tuple(own.tolist()),
            self.exposures_s[e],
            value,
            low if known else None,
            high if known else None,
            self._of_ends(low, high),
            float(np.maximum(best - self.value[own, e], 0.0).mean()),
            float(np.nanmax(share)) if np.isfinite(share).any() else None,
            verdicts.count(SURE),
            verdicts.count(FAILS),
        )

    def next_exposure(self) -> float | None:
        """The exposure to test next under all conditions, nearer to the one that keeps most; None where it is near.

        The top of a parabola in log exposure through the best and its neighbours, unless that is ``CLOSE`` to one of
        them; else the middle of the wider gap between the best and a neighbour that keeps less, where that is wider
        than ``WIDE`` or, beside one that saturates, which comes first, than a third of a stop.
        """
        _, counted = self._line(range(len(self.settings)))
        tested = np.flatnonzero(np.isfinite(counted))
        x, y = np.log2(np.array(self.exposures_s)[tested]), counted[tested]
        if len(x) < 2 or not np.isfinite(x).all():
            return None
        best = int(np.argmax(y))
        beside = [place for place in (best - 1, best + 1) if 0 <= place < len(x)]
        if len(beside) == 2 and y[beside].all():
            bend, slope, _ = np.polyfit(x[best - 1 : best + 2] - x[best], y[best - 1 : best + 2], 2)
            top = x[best] - slope / (2 * bend) if bend < 0 else x[best]
            if np.abs(top - x).min() >= CLOSE:
                return float(f"{2.0**top:.3g}")
        gaps = {place: abs(x[place] - x[best]) for place in beside if y[place] < y[best] - NEAR}
        wide = [place for place, gap in gaps.items() if gap > (WIDE if y[place] else THIRD) + _ROUNDED]
        if not wide:
            return None
        place = max(wide, key=lambda place: (y[place] == 0, gaps[place]))
        return float(f"{2.0 ** ((x[place] + x[best]) / 2):.3g}")

    def unmeasured(self, measured_s: Collection[float]) -> float | None:
        """Of averages that are predicted the exposure to measure next under all conditions: the one to use, unless
        one that was measured is ``CLOSE`` to it."""
        choice = self.choose()
        if choice is None or any(abs(math.log2(choice.exposure_s / each)) < CLOSE for each in measured_s):
            return None
        return float(f"{choice.exposure_s:.3g}")

    def _line(self, places: Iterable[int]) -> tuple[NDArray[np.int64], Array]:
        """Places (N, E) of the conditions, at each exposure those of the best gains, and the mean (E,) over them, 0
        where it is not used since it saturates."""
        of_light: dict[Setting, dict[float, list[int]]] = {}
        for place in places:
            setting = self.settings[place]
            light = setting[:_GAIN] + setting[_GAIN + 1 :]
            of_light.setdefault(light, {}).setdefault(setting[_GAIN], []).append(place)
        own = np.concatenate([self._best_gains(by_gain) for by_gain in of_light.values()])
        value, saturated = (np.take_along_axis(each, own, axis=0) for each in (self.value, self.saturated))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # where it is known in no condition
            return own, without_saturated(value.mean(axis=0), np.nanmean(saturated, axis=0), self.level)

    def _best_gains(self, by_gain: Mapping[float, list[int]]) -> NDArray[np.int64]:
        """(N, E) places of one light's conditions at the gain that keeps most on average, of equals the smallest."""
        gains = sorted(by_gain)
        means = np.array([self.value[by_gain[gain]].mean(axis=0) for gain in gains])
        best = np.where(np.isnan(means), -1.0, means).argmax(axis=0)
        return np.array([by_gain[gains[each]] for each in best]).T

    def curve(self, places: Sequence[int]) -> Row:
        """Mean over conditions at the exposures tested in all of them, with its interval."""
        value = self.value[list(places)].mean(axis=0)
        tested = np.flatnonzero(np.isfinite(value))
        low, high = self._mean_interval(list(places), tested)
        columns = np.array(self.exposures_s)[tested], value[tested], low, high
        names = "exposures_s", "values", "low", "high"
        return {name: each.tolist() for name, each in zip(names, columns, strict=True)}

    def values_at(self, places: Sequence[int], exposure_s: float | None) -> list[float]:
        """Values of conditions at an exposure, of those in which it was tested."""
        if exposure_s is None:
            return []
        values = self.value[list(places), self.exposures_s.index(exposure_s)]
        return [float(value) for value in values if math.isfinite(value)]

    @cached_property
    def _ends(self) -> uncertainty.Ends:
        """95 % intervals (N, E)."""
        return self._interval(self.value, self.departures, self.effective, self.sigma, self.most[:, None])

    def _verdict(self, place: int, e: int) -> str:
        return self._of_ends(self._ends.low[place, e], self._ends.high[place, e])

    def _of_ends(self, low: float, high: float) -> str:
        return SURE if low >= self.level else FAILS if high < self.level else CANNOT_TELL

    def _mean_interval(self, places: Sequence[int] | NDArray[np.int64], e: NDArray[Any]) -> uncertainty.Ends:
        """95 % intervals (E,) of means over conditions, errors of prediction as if they were all alike."""
        some = np.ix_(np.array(places), e)
        away = self.departures[:, places][:, :, e]
        mean = np.where(np.isfinite(away).any(axis=1), np.nansum(away, axis=1) / len(places), np.nan)
        value, sigma = self.value[some].mean(axis=0), self.sigma[some].mean(axis=0)
        most = np.array(self.most[places].mean())
        return self._interval(value, mean, self.effective[some].min(axis=0), sigma, most)

    @staticmethod
    def _interval(value: Array, away: Array, effective: Array, sigma: Array, most: Array) -> uncertainty.Ends:
        known = uncertainty.enough(effective)
        ends = uncertainty.of_level(value, away, most, sigma)
        return uncertainty.Ends(*(np.where(known, end, np.nan) for end in ends))


def averages(
    tables: Sequence[ScoreTable],
    level: float,
    *,
    monotone: bool = False,
    saturated: Mapping[tuple[float, ...], float | None] | None = None,
) -> Averages:
    """The averages of one model's tables, all target groups weighted alike. monotone: whether these are pooled
    over speeds (:mod:`.monotone`), so that no verdict is better at a higher speed. saturated: mean shares of pictures
    by setting, velocity and exposure, in place of those of the targets.

    An exposure counts in a condition where every group was measured that is measured there at all.
    """
    every = [list(zip(table.settings, table.velocities_px_s, strict=True)) for table in tables]
    conditions = list(dict.fromkeys(condition for own in every for condition in own))
    place_of = {condition: place for place, condition in enumerate(conditions)}
    exposures = np.unique(np.concatenate([table.conditions["exposure_s"] for table in tables]))
    clusters = dict.fromkeys(name for table in tables for name in table.clusters)
    cluster_of = {name: place for place, name in enumerate(clusters)}
    shape = len(conditions), len(exposures)
    value, sigma, share, measured, weight = np.zeros((5, *shape))
    most, groups = np.zeros((2, len(conditions)))
    away, shares = np.zeros((2, len(clusters), *shape))
    for table, own_conditions in zip(tables, every, strict=True):
        e = np.searchsorted(exposures, table.conditions["exposure_s"])
        n = np.array([place_of[condition] for condition in own_conditions], np.int64)
        c = np.array([cluster_of[name] for name in table.clusters])[:, None]
        value[n, e] += np.nan_to_num(table.mean)
        weight[n, e] += np.isfinite(table.mean)
        most[np.unique(n)] += table.most
        groups[np.unique(n[np.isfinite(table.mean)])] += 1
        known = np.isfinite(table.influence)
        with np.errstate(invalid="ignore", divide="ignore"):
            away[c, n, e] += np.where(known, table.influence / known.sum(axis=0), 0.0)
            shares[c, n, e] += np.nan_to_num(table.counts / table.counts.sum(axis=0))
        share[n, e] += np.nan_to_num(table.saturated)
        measured[n, e] += np.isfinite(table.saturated)
        if table.prediction_cov is not None:
            for line in (np.flatnonzero(n == place) for place in np.unique(n)):
                sigma[n[line], e[line]] += np.sqrt(np.diag(table.prediction_cov(line)))
    of = groups[:, None]
    complete = (weight == of) & (of > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(measured > 0, share / measured, np.nan)
        spread = away / of * (shares > 0).sum(axis=0)
        value, sigma = (np.where(complete, each / of, np.nan) for each in (value, sigma))
    for place, (setting, velocity) in enumerate(conditions if saturated else ()):
        found = [
            (saturated or {}).get((*setting, *velocity, exposure_s)) for exposure_s in exposures.tolist()
        ]
        share[place] = [old if new is None else new for old, new in zip(share[place], found, strict=True)]
    return Averages(
        tables[0].model,
        level,
        tuple(setting for setting, _ in conditions),
        tuple(velocity for _, velocity in conditions),
        tuple(_speed(*condition) for condition in conditions),
        tuple(exposures.tolist()),
        value,
        np.where((shares > 0) & complete, spread, np.nan),
        uncertainty.effective(shares),
        sigma,
        most / np.maximum(groups, 1),
        share,
        monotone,
    )


def recommendations(of: Averages) -> list[Row]:
    """Rows: one for all conditions, one for each light (and what else varies) over all speeds, one for each speed
    there. Axes and speed are None where a row is an average over them; a chosen gain is given. at_common: what the
    exposure for all conditions keeps there, None where it was not tested there."""
    lights: dict[Setting, dict[float, list[int]]] = {}
    for place, (setting, speed) in enumerate(zip(of.settings, of.speeds, strict=True)):
        light = tuple(0.0 if axis in (_GAIN, _EGO) else value for axis, value in enumerate(setting))
        lights.setdefault(light, {}).setdefault(speed, []).append(place)
    whole = of.choose()
    common_s = None if whole is None else whole.exposure_s
    rows = _rows(of, "all", whole, None, None, common_s)
    for light, by_speed in sorted(lights.items(), key=lambda each: each[0]):
        over_speeds = of.choose(place for own in by_speed.values() for place in own)
        rows += _rows(of, "light", over_speeds, light, None, common_s)
        found = [
            row
            for speed in sorted(by_speed)
            for row in _rows(of, "condition", of.choose(by_speed[speed]), light, speed, common_s)
        ]
        if of.monotone:
            _nest(found)
        rows += found
    return rows


def _nest(by_speed: list[Row]) -> None:
    """What is sure at one speed is at all slower ones, and what surely fails does at all faster ones."""
    for fast, slow in ((fast, slow) for fast in reversed(by_speed) for slow in by_speed):
        if slow["speed"] < fast["speed"] and fast["verdict"] == SURE:
            slow |= {"verdict": SURE, "sure": slow["conditions"], "fails": 0}
        if slow["speed"] < fast["speed"] and slow["verdict"] == FAILS:
            fast |= {"verdict": FAILS, "sure": 0, "fails": fast["conditions"]}


def _rows(
    of: Averages,
    scope: str,
    choice: Choice | None,
    light: Setting | None,
    speed: float | None,
    common_s: float | None,
) -> list[Row]:
    """One row, none without a choice."""
    if choice is None:
        return []
    axes = dict(zip(SETTING, light or [None] * len(SETTING), strict=True))
    gains = {of.settings[place][_GAIN] for place in choice.places}
    axes |= {GAIN.name: gains.pop() if len(gains) == 1 else None, EGO.name: None}
    own = {name: value for name, value in choice._asdict().items() if name != "places"}
    values = of.values_at(choice.places, common_s)
    at_common = float(np.mean(values)) if values and len(values) == len(choice.places) else None
    row = {"model": of.model, "scope": scope, **axes, "speed": speed, **own}
    return [row | {"conditions": len(choice.places), "at_common": at_common}]


def curves(of: Averages) -> list[Row]:
    """A row for all speeds (None) and one for each: means over lights and targets at exposures tested in all."""
    places = range(len(of.speeds))
    return [
        {"model": of.model, "speed": speed}
        | of.curve([place for place in places if speed in (None, of.speeds[place])])
        for speed in (None, *sorted(set(of.speeds)))
    ]


def _speed(setting: Setting, velocity_px_s: Velocity) -> float:
    ego = setting[_EGO]
    return float(EGO_SPEED.of({EGO.name: ego})) if ego else math.hypot(*velocity_px_s)
