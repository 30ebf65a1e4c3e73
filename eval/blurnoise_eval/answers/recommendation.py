"""The recommended exposure: one rule for a condition, for a light, and for all tested conditions.

It has the highest score on average over the conditions (lights, speeds, target groups), all weighted alike. An
exposure that saturates more than a tenth of the picture on average is not recommended while another one works or,
where none does, scores alike. Of exposures whose scores differ by less than ``NEAR`` the middle one is taken (in log
exposure), so that a finer grid does not move the answer along a plateau. Exposures between those of the grid are used
where they score more than ``FINER`` above these: else what a refinement or a search happens to test would move the
answer.

Which exposure to use and how good the model is with it are two verdicts: an exposure may be *settled*
(:class:`~.settling.Settled`) by few pictures, long before these tell whether it works.

Domain: exposures in s; values in the criterion's unit: a score, or the share of it that is kept. N conditions, each
a setting and a velocity; E exposures, increasing; C clusters of pictures. NaN: not tested.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.choosing import NEAR, recommended, without_saturated
from blurnoise_eval.answers.rows import AverageCurve, RecommendationRow
from blurnoise_eval.answers.settling import AsGood, Rivals, Settled, alike, settled
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import EGO, EGO_SPEED, GAIN, SETTING
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.uncertainty import ratio_of_sums
from blurnoise_eval.store.columns import AxisValues, WithInterval
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]
Places = NDArray[np.int64]
Setting = tuple[float, ...]
Velocity = tuple[float, float]
CLOSE = 0.2
"""Stops from a tested exposure, closer than which no further one is tested."""
WIDE, THIRD = 0.5, 1 / 3
"""Stops from the best tested exposure to its neighbours, or to one that saturates, within which it is known."""
MOST_COMMON = 4
"""Exposures that are added for each model under all conditions, at most."""
SURE, FAILS, CANNOT_TELL = "works", "fails", "cannot tell"
_ROUNDED = 0.02  # stops: exposures are rounded to three digits
_GAIN, _EGO = SETTING.index(GAIN.name), SETTING.index(EGO.name)


def corrected(score: WithInterval, bias: float) -> WithInterval:
    """The score of an exposure that was chosen for it, less the bias of that; the high end of the interval stays.

    >>> corrected(WithInterval(0.75, 0.5, 0.875), 0.125)
    WithInterval(value=0.625, low=0.375, high=0.875)
    """
    value, low = (end if end is None else max(0.0, end - max(bias, 0.0)) for end in score[:2])
    return WithInterval(value, low, score.high)


class Scope(NamedTuple):
    """Conditions, by index, for which one exposure is recommended. light: None for all; speed: None for several."""

    name: str
    light: Setting | None
    speed: float | None
    members: Sequence[int]


@dataclass(frozen=True, eq=False)
class Choice:
    """An exposure for some conditions.

    conditions: their indices, (N,); bias: (N,) by how much its values there are too high, as it was chosen for them.
    gain_db: where it is one for all. score: the mean over them, less the bias. verdict: "works", "fails", "cannot
    tell". n_pictures: clusters. settled: whether the pictures decide for it. alike: what is as good.
    regret: how much more the best exposure of each condition would keep. saturated_share: the largest, None where
    unknown. n_works, n_fails: in how many the level is surely reached, surely missed.
    """

    conditions: Places
    bias: Array
    gain_db: float | None
    exposure_s: float
    score: WithInterval
    verdict: str
    n_pictures: int
    settled: Settled
    alike: AsGood
    regret: float
    saturated_share: float | None
    n_works: int
    n_fails: int


@dataclass(frozen=True, eq=False)
class Averages:
    """What one model reaches, averaged over target groups, by condition and exposure.

    settings: (N) as ``SETTING`` names their values. velocities_px_s: (N) x and y. value, saturated, sigma: (N, E);
    sigma: the standard error of a prediction. influence: (C, N, E) of clusters; effective: (N, E) the number of
    pictures of equal weight. most: (N,) greatest possible values. of_grid: (E,) exposures that are not
    between those of the grid. monotone: whether more speed can only hurt. untested_gain: of a search, from some
    conditions and an exposure to what another may gain at most over it that was not tested there; None where all
    were. bracketed: of a search, with what is known without being measured; exposures for several conditions are
    chosen from it.
    """

    model: str
    level: float
    settings: tuple[Setting, ...]
    velocities_px_s: tuple[Velocity, ...]
    exposures_s: tuple[float, ...]
    value: Array
    influence: Array
    effective: Array
    sigma: Array
    most: Array
    saturated: Array
    of_grid: NDArray[np.bool_]
    monotone: bool = True
    untested_gain: Callable[[Sequence[Setting], Sequence[Velocity], float], float | None] | None = None
    bracketed: Averages | None = None

    @property
    def speeds(self) -> list[float]:
        """Of each condition: px/s, or km/h of a vehicle."""
        both = zip((setting[_EGO] for setting in self.settings), self.velocities_px_s, strict=True)
        return [float(EGO_SPEED.of({EGO.name: ego})) if ego else math.hypot(*v) for ego, v in both]

    def choose(self, conditions: Iterable[int] | None = None) -> Choice | None:
        """The exposure to use under these conditions (all by default); None where no exposure was tested in all.

        Of several gains that were tested at a light, the one that keeps most is used. Score and low end of the
        interval are corrected for having been chosen among exposures, by :func:`~.uncertainty.selection_bias`; the
        high end stays, as the bias is itself uncertain. The interval takes errors of prediction as if they were all
        alike.
        """
        places = list(range(len(self.settings)) if conditions is None else conditions)
        if self.bracketed is not None and len(places) > 1:
            known = replace(self.bracketed, untested_gain=self.untested_gain)
            return known.choose(places)
        every, mean, share = self.line(places)
        tested = np.flatnonzero(np.isfinite(mean))
        if not len(tested):
            return None
        members, exposures = every[:, tested], np.array(self.exposures_s)[tested]

        def best(values: Array) -> Places:
            return recommended(exposures, values, share[tested], self.level, self.of_grid[tested])

        place = int(best(mean[tested]))
        e, chosen = tested[place], members[:, place]
        away = self.influence[:, members, tested]
        bias = uncertainty.selection_bias(mean[tested], away, place, best)
        value, sigma, effective, saturated = (
            each[chosen, e] for each in (self.value, self.sigma, self.effective, self.saturated)
        )
        own, most = away[..., place], self.most[chosen]
        ends = uncertainty.of_level(value, own, most, sigma, effective)
        verdicts = [self._verdict(low, high) for low, high in zip(ends.low - bias, ends.high, strict=True)]
        whole = np.where(np.isfinite(own).any(axis=1), np.nansum(own, axis=1) / len(chosen), np.nan)
        together = uncertainty.of_level(value.mean(), whole, most.mean(), sigma.mean(), effective.min())
        score = corrected(
            WithInterval(float(value.mean()), *map(finite, map(float, together))), float(bias.mean())
        )
        better = without_saturated(self.value[chosen], self.saturated[chosen], self.level)
        gains = {self.settings[index][_GAIN] for index in chosen}
        rivals = self._rivals(every, mean, share, int(e))
        if self.untested_gain is not None:
            at = [self.settings[n] for n in places], [self.velocities_px_s[n] for n in places]
            untested = self.untested_gain(*at, self.exposures_s[e])
            rivals = rivals._replace(untested_gain=untested)
        return Choice(
            conditions=chosen,
            bias=bias,
            gain_db=gains.pop() if len(gains) == 1 else None,
            exposure_s=self.exposures_s[e],
            score=score,
            verdict=self._verdict(score.low, score.high),
            n_pictures=int(np.isfinite(own).any(axis=1).sum()),
            settled=settled(rivals),
            alike=alike(
                np.array(self.exposures_s),
                without_saturated(mean, share, self.level),
                self.of_grid,
                int(e),
            ),
            regret=float(np.maximum(np.nanmax(better, axis=1) - value, 0.0).mean()),
            saturated_share=finite(float(np.fmax.reduce(saturated))),
            n_works=verdicts.count(SURE),
            n_fails=verdicts.count(FAILS),
        )

    def scopes(self) -> list[Scope]:
        """The conditions for which an exposure is recommended: all, each light over all speeds, each speed there."""
        lights, speeds = [_without(setting, _GAIN, _EGO) for setting in self.settings], self.speeds
        every = [Scope("all", None, None, range(len(lights)))]
        for light in sorted(set(lights)):
            here = [index for index, each in enumerate(lights) if each == light]
            every.append(Scope("light", light, None, here))
            for speed in sorted({speeds[index] for index in here}):
                of_speed = [index for index in here if speeds[index] == speed]
                every.append(Scope("condition", light, speed, of_speed))
        return every

    def next_exposure(self) -> float | None:
        """The exposure to test next under all conditions, nearer to the one that keeps most; None where it is near.

        The top of a parabola in log exposure through the best and its neighbours, unless that is ``CLOSE`` to one of
        them; else the middle of the wider gap between the best and a neighbour that keeps less, where that is wider
        than ``WIDE`` or, beside one that saturates, which comes first, than a third of a stop.
        """
        _, mean, share = self.line(range(len(self.settings)))
        counted = without_saturated(mean, share, self.level)
        tested = np.flatnonzero(np.isfinite(counted))
        x, y = np.log2(np.array(self.exposures_s)[tested]), counted[tested]
        if len(x) < 2 or not np.isfinite(x).all():
            return None
        best = int(np.argmax(y))
        beside = [index for index in (best - 1, best + 1) if 0 <= index < len(x)]
        if len(beside) == 2 and y[beside].all():
            # A parabola through three points has its top where its slope, linear in log exposure, is 0.
            bend, slope, _ = np.polyfit(x[best - 1 : best + 2] - x[best], y[best - 1 : best + 2], 2)
            top = x[best] - slope / (2 * bend) if bend < 0 else x[best]
            if np.abs(top - x).min() >= CLOSE:
                return float(f"{2.0**top:.3g}")
        gaps = {index: abs(x[index] - x[best]) for index in beside if y[index] < y[best] - NEAR}
        wide = [index for index, gap in gaps.items() if gap > (WIDE if y[index] else THIRD) + _ROUNDED]
        if not wide:
            return None
        index = max(wide, key=lambda index: (y[index] == 0, gaps[index]))
        return float(f"{2.0 ** ((x[index] + x[best]) / 2):.3g}")

    def unmeasured(self, measured_s: Collection[float]) -> float | None:
        """Of averages that are predicted the exposure to measure next under all conditions: the one to use, unless
        one that was measured is ``CLOSE`` to it."""
        choice = self.choose()
        exposure_s = None if choice is None else choice.exposure_s
        if exposure_s is None or any(abs(math.log2(exposure_s / each)) < CLOSE for each in measured_s):
            return None
        return float(f"{exposure_s:.3g}")

    def line(self, places: Iterable[int]) -> tuple[Places, Array, Array]:
        """For each light and exposure choose the gain with the highest mean (ties: the smallest).

        Return the indices of the conditions, (N, E), and the means over them of value and saturated share, (E,).
        """
        gains: dict[Setting, dict[float, list[int]]] = {}
        for index in places:
            setting = self.settings[index]
            at_light = gains.setdefault(_without(setting, _GAIN), {})
            at_light.setdefault(setting[_GAIN], []).append(index)
        chosen = []
        for at_light in gains.values():
            rising = [at_light[gain] for gain in sorted(at_light)]
            means = np.array([self.value[members].mean(axis=0) for members in rising])
            best = np.where(np.isnan(means), -1.0, means).argmax(axis=0)
            chosen.append(np.array([rising[each] for each in best]).T)
        members = np.concatenate(chosen)
        value, saturated = (
            np.take_along_axis(each, members, axis=0) for each in (self.value, self.saturated)
        )
        share = ratio_of_sums(np.nan_to_num(saturated), np.isfinite(saturated))
        return members, value.mean(axis=0), share

    def _rivals(self, members: Places, mean: Array, share: Array, chosen: int) -> Rivals:
        """The other exposures that may be used under the conditions ``members``, (N, E), and what they gain over the
        chosen one. mean, share: as :meth:`line` has them.

        The differences are paired by cluster: pictures that are hard at one exposure are hard at the others.
        """
        sigma, effective = (
            np.take_along_axis(each, members, axis=0) for each in (self.sigma, self.effective)
        )
        counted = without_saturated(mean, share, self.level)
        usable = np.flatnonzero(counted == mean)  # not NaN, and not left out because it saturates
        usable = usable[usable != chosen]
        away = np.take_along_axis(self.influence, members[None], axis=1)
        away = away[:, :, usable] - away[:, :, [chosen]]
        known = np.isfinite(away).any(axis=1)
        # Errors of prediction are taken for independent, as their covariance between conditions is not kept.
        error = np.hypot(sigma[:, usable].mean(axis=0), sigma[:, chosen].mean())
        return Rivals(
            exposures_s=np.array(self.exposures_s)[usable],
            gain=mean[usable] - mean[chosen],
            influence=np.where(known, np.nansum(away, axis=1) / len(members), np.nan),
            sigma=np.nan_to_num(error),
            effective=float(effective[:, chosen].min()),
        )

    def _verdict(self, low: float | None, high: float | None) -> str:
        if low is None or high is None:
            return CANNOT_TELL
        return SURE if low >= self.level else FAILS if high < self.level else CANNOT_TELL


def averages(
    tables: Sequence[ScoreTable], level: float, *, grid_s: Sequence[float] = (), monotone: bool = False
) -> Averages:
    """The averages of one model's tables, all target groups weighted alike. grid_s: the exposures of the grid, none
    where all count alike. monotone: whether the tables are pooled over speeds (:mod:`.monotone`), so that no verdict
    is better at a higher speed.

    An exposure counts in a condition where every group was measured that is measured there at all.
    """
    at = [list(zip(table.settings, table.velocities_px_s, strict=True)) for table in tables]
    exposures = np.unique(np.concatenate([table.conditions["exposure_s"] for table in tables]))
    groups, conditions, clusters = (
        {each: index for index, each in enumerate(dict.fromkeys(every))}
        for every in ((table.group for table in tables), chain(*at), chain(*(t.clusters for t in tables)))
    )
    shape = len(groups), len(conditions), len(exposures)
    value, sigma, most, share = np.full((4, *shape), np.nan)
    influence, counts = np.full((2, len(clusters), *shape), np.nan)
    for table, keys in zip(tables, at, strict=True):
        g, n = groups[table.group], np.array([conditions[condition] for condition in keys], np.int64)
        e = np.searchsorted(exposures, table.conditions["exposure_s"])
        c = np.array([clusters[name] for name in table.clusters])[:, None]
        value[g, n, e], share[g, n, e], sigma[g, n, e] = table.mean, table.saturated, table.sigma
        most[g, n, e] = table.most
        influence[c, g, n, e], counts[c, g, n, e] = table.influence, table.counts
    measured = np.isfinite(value)
    of_groups = measured.any(axis=2).sum(axis=0)[:, None]  # (N, 1): so many are measured there
    complete = (measured.sum(axis=0) == of_groups) & (of_groups > 0)
    weights = np.where(complete, measured / np.maximum(of_groups, 1), np.nan)
    known = np.isfinite(influence)
    each = np.where(known, influence, 0.0) * known.any(axis=1).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    together = np.where(known.any(axis=1), (each * weights).sum(axis=1), np.nan)
    sizes = np.nan_to_num(counts / np.maximum(np.nansum(counts, axis=0), 1e-300)).sum(axis=1)
    settings, velocities = zip(*conditions, strict=True)
    means = [np.where(complete, (np.nan_to_num(of) * weights).sum(axis=0), np.nan) for of in (value, sigma)]
    greatest = np.nansum(most, axis=(0, 2)) / np.maximum(measured.sum((0, 2)), 1)
    return Averages(
        tables[0].model, level, settings, velocities, tuple(exposures.tolist()),
        means[0], together, uncertainty.effective(sizes), means[1], greatest,
        ratio_of_sums(np.nan_to_num(share), np.isfinite(share)),
        np.isin(exposures, grid_s) if grid_s else np.ones(len(exposures), bool), monotone,
    )  # fmt: skip


def recommendations(of: Averages) -> list[RecommendationRow]:
    """Rows: one for all conditions, one for each light (and what else varies) over all speeds, one for each speed
    there. Axes and speed are None where a row is an average over them; a chosen gain is given. The score at the
    overall exposure is None where that was not tested there."""
    whole = of.choose()
    common = np.full(len(of.settings), np.nan)
    if whole is not None:
        common = (of.bracketed or of).value[:, of.exposures_s.index(whole.exposure_s)].copy()
        common[whole.conditions] -= whole.bias

    def rows(scopes: Iterable[Scope]) -> list[RecommendationRow]:
        chosen = ((scope, of.choose(scope.members)) for scope in scopes)
        return [row(scope, choice) for scope, choice in chosen if choice is not None]

    def row(scope: Scope, choice: Choice) -> RecommendationRow:
        light = scope.light
        at: dict[str, float | None] = {} if light is None else dict(zip(SETTING, light, strict=True))
        at |= {GAIN.name: choice.gain_db, EGO.name: None}
        return RecommendationRow(
            model=of.model,
            scope=scope.name,
            conditions=AxisValues.of(at),
            speed=scope.speed,
            exposure_s=choice.exposure_s,
            score=choice.score,
            verdict=choice.verdict,
            n_pictures=choice.n_pictures,
            settled=choice.settled.sure,
            rival_s=choice.settled.rival_s,
            rival_gain_95=choice.settled.gain_95,
            pictures_to_settle=choice.settled.pictures,
            untested_gain=choice.settled.untested_gain,
            **{f"alike_{name}": value for name, value in choice.alike._asdict().items()},
            regret=choice.regret,
            saturated_share=choice.saturated_share,
            n_works=choice.n_works,
            n_fails=choice.n_fails,
            n_conditions=len(choice.conditions),
            score_at_overall_exposure=finite(float(common[choice.conditions].mean())),
        )

    every = []
    for _, of_light in groupby(of.scopes(), key=lambda scope: scope.light):
        together, *by_speed = of_light
        alone = rows(by_speed)
        every += rows([together]) + (_nested(alone) if of.monotone else alone)
    return every


def _nested(by_speed: Sequence[RecommendationRow]) -> list[RecommendationRow]:
    """Rows by rising speed, where what surely works at one speed does at all slower ones, and what surely fails does
    at all faster ones."""
    rows = list(by_speed)
    for fast in reversed(range(len(rows))):
        for slow in range(fast):
            if rows[fast].verdict == SURE:
                n = rows[slow].n_conditions
                rows[slow] = replace(rows[slow], verdict=SURE, n_works=n, n_fails=0)
            if rows[slow].verdict == FAILS:
                n = rows[fast].n_conditions
                rows[fast] = replace(rows[fast], verdict=FAILS, n_works=0, n_fails=n)
    return rows


def average_curve(of: Averages) -> AverageCurve:
    """The mean over all conditions at the exposures that were tested in all."""
    value = (of.bracketed or of).value.mean(axis=0)
    tested = np.flatnonzero(np.isfinite(value))
    exposures = np.array(of.exposures_s)[tested]
    return AverageCurve(of.model, tuple(exposures.tolist()), tuple(value[tested].tolist()))


def _without(setting: Setting, *axes: int) -> Setting:
    """With 0 on some axes."""
    return tuple(0.0 if axis in axes else value for axis, value in enumerate(setting))
