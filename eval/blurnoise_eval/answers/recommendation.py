"""Which exposure to use: the one rule, for one condition, for one light, and for all that was tested.

The exposure to use keeps most on average over the conditions asked (lights, speeds, target groups), all weighted
alike. One that saturates more than a tenth of the picture, averaged over these conditions, is not used while another
one works. Of exposures that keep as much within ``NEAR`` the middle one is taken (in log exposure), so that a finer
grid does not move the answer along a plateau.

Domain: exposures in s; values in the criterion's unit: a score, or the share of it that is kept. N conditions, each
a setting and a velocity; E exposures, increasing; C clusters of pictures. NaN: not tested.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.grid.axes import EGO, EGO_SPEED, GAIN, SETTING

Array = NDArray[np.float64]
Setting = tuple[float, ...]
Velocity = tuple[float, float]
NEAR = 0.005
"""Exposures whose values differ by less are equally good."""
SATURATED = 0.1
"""A share of saturated values above this speaks against an exposure while another one works."""
AS_SATURATED = 0.05
"""Where all that work saturate more, shares this close to the least are equally good."""
CLOSE = 0.2
"""Stops from a tested exposure, closer than which no further one is asked for."""
WIDE, THIRD = 0.5, 1 / 3
"""Stops from the best tested exposure to its neighbours, or to one that saturates, within which it is known."""
MOST_COMMON = 4
"""Exposures that are added for each model under all conditions, at most."""
SURE, FAILS, CANNOT_TELL = "sure", "no", "cannot tell"
_ROUNDED = 0.02  # stops: exposures are rounded to three digits
_LEAST_EFFECTIVE = 3.0  # pictures of equal weight, below which no interval is given


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
    near = value[tested] >= value[tested[best]] - NEAR
    low = high = best
    while low > 0 and near[low - 1]:
        low -= 1
    while high + 1 < len(tested) and near[high + 1]:
        high += 1
    plateau = tested[low : high + 1]
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


@dataclass(frozen=True)
class Choice:
    """The exposure to use under some conditions, and what it keeps there on average.

    places: the conditions, one gain for each light. low, high: the 95 % interval of ``value``, None from too few
    pictures. verdict: whether the level is reached: "sure", "no", "cannot tell". loss: how much less this is than
    the best exposure of each condition would keep. saturated: the largest share of saturated values among the
    conditions, None where it is not known. sure, fails: in how many conditions the level is surely reached, surely
    missed.
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
    vehicle. value, saturated, sigma: (N, E); sigma: the standard error of what is predicted rather than measured.
    departures: (C, N, E) contributions of clusters; effective: (N, E) the number of pictures of equal weight. most:
    (N,) greatest possible values. monotone: whether more speed can only hurt.
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

    @cached_property
    def _ends(self) -> uncertainty.Ends:
        """95 % intervals (N, E)."""
        return self._interval(self.value, self.departures, self.effective, self.sigma, self.most[:, None])

    def with_saturated(self, share_of: Callable[[Setting, Velocity, float], float | None]) -> Averages:
        """With the mean shares of the pictures in place of those of the targets, where they are known."""
        known = [
            [share_of(setting, velocity, each) for each in self.exposures_s]
            for setting, velocity in zip(self.settings, self.velocities_px_s, strict=True)
        ]
        shares = np.array([[np.nan if each is None else each for each in row] for row in known], float)
        return replace(self, saturated=np.where(np.isfinite(shares), shares, self.saturated))

    def choose(self, places: Iterable[int] | None = None) -> Choice | None:
        """The exposure to use under these conditions (all by default); None where no exposure was tested in all.

        Of several gains that were tested at a light, the one that keeps most is used.
        """
        own, counted = self._line(range(len(self.settings)) if places is None else places)
        e = best_exposure(self.exposures_s, counted)
        return None if e is None else self._choice(own[:, e].tolist(), e)

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
        gaps = {place: abs(x[place] - x[best]) for place in beside}
        less = [place for place in beside if y[place] < y[best] - NEAR]
        wide = [place for place in less if gaps[place] > (WIDE if y[place] else THIRD) + _ROUNDED]
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
            setting, gain = _without_gain(self.settings[place])
            of_light.setdefault(setting, {}).setdefault(gain, []).append(place)
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

    def curve(self, places: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """Mean over conditions at the exposures tested in all of them: exposures, values, and their intervals."""
        own = list(places)
        value = self.value[own].mean(axis=0)
        tested = np.isfinite(value)
        ends = self._mean_interval(own, np.flatnonzero(tested))
        return np.array(self.exposures_s)[tested], value[tested], *ends

    def at(self, place: int, exposure_s: float) -> tuple[float, str] | None:
        """Value and verdict of one condition at an exposure; None where it was not tested."""
        e = self.exposures_s.index(exposure_s)
        value = float(self.value[place, e])
        if not math.isfinite(value):
            return None
        return value, self._verdict(float(self._ends.low[place, e]), float(self._ends.high[place, e]))

    def _choice(self, places: list[int], e: int) -> Choice:
        value = float(self.value[places, e].mean())
        low, high = (float(end[0]) for end in self._mean_interval(places, np.array([e])))
        verdicts = [
            self._verdict(float(self._ends.low[place, e]), float(self._ends.high[place, e]))
            for place in places
        ]
        share = self.saturated[places, e]
        known = math.isfinite(low) and math.isfinite(high)
        counted = without_saturated(self.value[places], self.saturated[places], self.level)
        best = np.nanmax(counted, axis=1)
        return Choice(
            tuple(places),
            self.exposures_s[e],
            value,
            low if known else None,
            high if known else None,
            self._verdict(low, high),
            float(np.maximum(best - self.value[places, e], 0.0).mean()),
            float(np.nanmax(share)) if np.isfinite(share).any() else None,
            verdicts.count(SURE),
            verdicts.count(FAILS),
        )

    def _verdict(self, low: float, high: float) -> str:
        return SURE if low >= self.level else FAILS if high < self.level else CANNOT_TELL

    def _mean_interval(self, places: list[int], e: NDArray[Any]) -> uncertainty.Ends:
        some = np.ix_(np.array(places), e)
        away = self.departures[:, places][:, :, e]
        known = np.isfinite(away).any(axis=1)
        mean = np.where(known, np.nansum(away, axis=1) / len(places), np.nan)
        return self._interval(
            self.value[some].mean(axis=0),
            mean,
            self.effective[some].min(axis=0),
            self.sigma[some].mean(axis=0),  # as if errors of prediction were all alike
            np.array(self.most[places].mean()),
        )

    def _interval(
        self, value: Array, away: Array, effective: Array, sigma: Array, most: Array
    ) -> uncertainty.Ends:
        n = np.isfinite(away).sum(axis=0)
        # where few pictures hold most of the targets, as wide as Student's t of so many
        student_t = uncertainty.student_t
        wider = np.fmax(student_t(np.maximum(effective, _LEAST_EFFECTIVE)) / student_t(n), 1.0)
        low, high = uncertainty.of_level(value, away, most)
        widened = uncertainty.Ends(value - wider * (value - low), value + wider * (high - value))
        ends = uncertainty.with_prediction(widened, value, sigma)
        enough = uncertainty.enough(n) & (effective >= _LEAST_EFFECTIVE)
        return uncertainty.Ends(*(np.where(enough, end.clip(0.0, most), np.nan) for end in ends))


def averages(tables: Sequence[ScoreTable], level: float, *, monotone: bool = False) -> Averages:
    """The averages of one model's tables, all target groups weighted alike. monotone: whether these are pooled
    over speeds (:mod:`.monotone`), so that no verdict is better at a higher speed.

    An exposure counts in a condition where every group was measured that is measured there at all.
    """
    every = [list(zip(table.settings, table.velocities_px_s, strict=True)) for table in tables]
    conditions = dict.fromkeys(condition for own in every for condition in own)
    place_of = {condition: place for place, condition in enumerate(conditions)}
    exposures = np.unique(np.concatenate([table.conditions["exposure_s"] for table in tables]))
    clusters = dict.fromkeys(name for table in tables for name in table.clusters)
    cluster_of = {name: place for place, name in enumerate(clusters)}
    shape = len(conditions), len(exposures)
    value, sigma, saturated, weight = (np.zeros(shape) for _ in range(4))
    most, groups = np.zeros(len(conditions)), np.zeros(len(conditions))
    away, shares = np.zeros((len(clusters), *shape)), np.zeros((len(clusters), *shape))
    measured = np.zeros(shape)
    for table, own_conditions in zip(tables, every, strict=True):
        e = np.searchsorted(exposures, table.conditions["exposure_s"])
        n = np.array([place_of[condition] for condition in own_conditions], np.int64)
        c = np.array([cluster_of[name] for name in table.clusters])[:, None]
        there = n, e
        value[there] += np.nan_to_num(table.mean)
        weight[there] += np.isfinite(table.mean)
        most[np.unique(n)] += table.most
        groups[np.unique(n[np.isfinite(table.mean)])] += 1
        known = np.isfinite(table.influence)
        with np.errstate(invalid="ignore", divide="ignore"):
            own = np.where(known, table.influence / known.sum(axis=0), 0.0)
            share = np.nan_to_num(table.counts / table.counts.sum(axis=0))
        away[c, n, e] += own
        shares[c, n, e] += share
        saturated[there] += np.nan_to_num(table.saturated)
        measured[there] += np.isfinite(table.saturated)
        if table.prediction_cov is not None:
            cov = table.prediction_cov
            for line in (np.flatnonzero(n == place) for place in np.unique(n)):
                sigma[n[line], e[line]] += np.sqrt(np.diag(cov(line)))
    of = groups[:, None]
    complete = (weight == of) & (of > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.where((shares > 0).sum(axis=0) > 0, away / of * (shares > 0).sum(axis=0), np.nan)
        return Averages(
            tables[0].model,
            level,
            tuple(setting for setting, _ in conditions),
            tuple(velocity for _, velocity in conditions),
            tuple(_speed(*condition) for condition in conditions),
            tuple(exposures.tolist()),
            np.where(complete, value / of, np.nan),
            np.where((shares > 0) & complete, spread, np.nan),
            uncertainty.effective(shares),
            np.where(complete, sigma / of, np.nan),
            most / np.maximum(groups, 1),
            np.where(measured > 0, saturated / measured, np.nan),
            monotone,
        )


def recommendations(of: Averages) -> list[dict[str, Any]]:
    """Rows: one for all conditions, one for each light (and what else varies) over all speeds, one for each speed
    there. Axes and speed are None where a row is an average over them; a chosen gain is given."""
    lights: dict[Setting, dict[float, list[int]]] = {}
    for place, (setting, speed) in enumerate(zip(of.settings, of.speeds, strict=True)):
        lights.setdefault(_light(setting), {}).setdefault(speed, []).append(place)
    rows = [_row(of, "all", of.choose(), None, None)]
    whole = rows[0]["exposure_s"] if rows[0] else None
    for light in sorted(lights):
        by_speed = lights[light]
        rows.append(
            _row(of, "light", of.choose([place for own in by_speed.values() for place in own]), light, None)
        )
        found = [
            _row(of, "condition", of.choose(by_speed[speed]), light, speed) for speed in sorted(by_speed)
        ]
        rows += _nested(found) if of.monotone else found
    return [_at_common(of, row, whole) for row in rows if row]


def _nested(by_speed: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What is sure at one speed is at all slower ones, and what surely fails does at all faster ones."""
    known = [row for row in by_speed if row]
    for fast, slow in ((fast, slow) for fast in reversed(known) for slow in known):
        if slow["speed"] < fast["speed"] and fast["verdict"] == SURE:
            slow |= {"verdict": SURE, "sure": slow["conditions"], "fails": 0}
        if slow["speed"] < fast["speed"] and slow["verdict"] == FAILS:
            fast |= {"verdict": FAILS, "sure": 0, "fails": fast["conditions"]}
    return by_speed


def curves(of: Averages) -> list[dict[str, Any]]:
    """A row for all speeds (None) and one for each: means over lights and targets at exposures tested in all."""
    found = []
    for speed in (None, *sorted(set(of.speeds))):
        own = [place for place, each in enumerate(of.speeds) if speed in (None, each)]
        exposures, value, low, high = (each.tolist() for each in of.curve(own))
        found.append(
            {"model": of.model, "speed": speed, "exposures_s": exposures, "values": value}
            | {"low": low, "high": high}
        )
    return found


def _row(
    of: Averages, scope: str, choice: Choice | None, light: Setting | None, speed: float | None
) -> dict[str, Any]:
    if choice is None:
        return {}
    shared: dict[str, float | None]
    shared = dict.fromkeys(SETTING) if light is None else dict(zip(SETTING, light, strict=True))
    gains = {of.settings[place][_GAIN] for place in choice.places}
    own = {name: value for name, value in vars(choice).items() if name != "places"}
    shared[GAIN.name] = gains.pop() if len(gains) == 1 else None
    shared[EGO.name] = None
    return {
        "model": of.model,
        "scope": scope,
        **shared,
        "speed": speed,
        **own,
        "conditions": len(choice.places),
        "places": choice.places,
    }


def _at_common(of: Averages, row: dict[str, Any], exposure_s: float | None) -> dict[str, Any]:
    """With what the exposure for all conditions keeps here, None where it was not tested here."""
    found = [of.at(place, exposure_s) for place in row.pop("places") if exposure_s is not None]
    values = [each[0] for each in found if each is not None]
    return row | {"at_common": float(np.mean(values)) if values and len(values) == len(found) else None}


_GAIN, _EGO = SETTING.index(GAIN.name), SETTING.index(EGO.name)


def _without_gain(setting: Setting) -> tuple[Setting, float]:
    return setting[:_GAIN] + setting[_GAIN + 1 :], setting[_GAIN]


def _light(setting: Setting) -> Setting:
    """A setting without gain and vehicle's speed, in whose places stands 0."""
    return tuple(0.0 if place in (_GAIN, _EGO) else value for place, value in enumerate(setting))


def _speed(setting: Setting, velocity_px_s: tuple[float, float]) -> float:
    ego = setting[_EGO]
    return float(EGO_SPEED.of({EGO.name: ego})) if ego else math.hypot(*velocity_px_s)
