"""The exposure window in which a detector fulfils a criterion, and an exposure inside it.

Domain: exposures in s, logarithmic; confidences in the criterion's unit: its score, or the share of it that is kept
(above 1 where a condition does better than the untouched pictures). An end of the tested range is unknown, never an
edge: a window reaches at least that far.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.crossings import Bounds, Crossed, Curve, Stretch
from blurnoise_eval.answers.limits import DARK, Limit, Limits, Line, of_best, of_window
from blurnoise_eval.answers.monotone import is_uniform, nested, pooled
from blurnoise_eval.answers.recommendation import best_exposure, without_saturated
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.grid.axes import SETTING

_MOST_PICTURES = 9999  # that are asked for
Verdict = Literal["works", "no exposure works", "cannot tell"]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Answer:
    """What to do for one model and kind of target in one setting and at one velocity.

    criterion: what is enough, in words. at: values of all axes but the exposure. exposures_s: tested, increasing;
    confidence: of the ``n_targets`` targets (times repeats) at each, in the criterion's unit; low, high: its 95 %
    interval over ``n_pictures`` clusters, which count as ``effective_pictures``, see
    :func:`~blurnoise_eval.answers.uncertainty.effective`: None below 8 such; few_pictures: fewer than 20. saturated:
    mean share of the pictures' values at a limit of the sensor, None where it is not known.

    verdict: "works": at some tested exposure ``low`` is at or above its level; "no exposure works": ``high`` is
    at none in the range; else "cannot tell", as always below 8 pictures, and ``pictures_to_tell`` says how
    many should be enough in half of such cases, ``pictures_to_tell_mostly`` in nine of ten (None: more than
    9999). windows_s: stretches of exposure in which
    the mean stays at or above it; windows_low_s, windows_high_s: the 95 % intervals of their first and
    last exposures, None at an end that lies outside the tested range or is not known. sure_windows_s: where it is
    surely so. open_low, open_high: a window reaches the shortest or longest exposure tested.

    recommended_s: a tested exposure, None when the mean reaches the level nowhere; unless the verdict is
    "works" it is only the best guess. recommended_low, recommended_high: the interval of its confidence.
    regret_95: what it loses at most, at 95 %, against the best of the tested exposures.

    best_s: the tested exposure with the highest confidence (of equals the shortest), best_value, with its interval
    best_low, best_high. limited_low, limited_high: what ends the window that holds the recommended exposure, or else
    the first; limited_by: where there is no window, what holds ``best_s`` back: as :mod:`.limits` has them;
    limits_untold: why one of these is None, though there is such an end. clean_value: mean score in the untouched
    pictures, None where it is not known.
    """

    model: str
    group: str
    at: Mapping[str, float]
    n_targets: int
    exposures_s: tuple[float, ...]
    confidence: tuple[float, ...]
    low: tuple[float, ...] | None
    high: tuple[float, ...] | None
    windows_s: tuple[Stretch, ...]
    open_low: bool
    open_high: bool
    recommended_s: float | None
    confidence_at_recommended: float | None
    n_pictures: int
    effective_pictures: float
    few_pictures: bool
    verdict: Verdict
    pictures_to_tell: int | None
    pictures_to_tell_mostly: int | None
    windows_low_s: tuple[Bounds, ...]
    windows_high_s: tuple[Bounds, ...]
    sure_windows_s: tuple[Stretch, ...]
    recommended_low: float | None
    recommended_high: float | None
    regret_95: float | None
    saturated: tuple[float, ...] | None
    saturated_at_recommended: float | None
    criterion: str
    best_s: float
    best_value: float
    best_low: float | None
    best_high: float | None
    limited_low: Limit | None
    limited_high: Limit | None
    limited_by: str | None
    limits_untold: str | None
    clean_value: float | None

    def row(self) -> dict[str, Any]:
        """As a table's row: the axes are columns."""
        rest = {name: value for name, value in vars(self).items() if name not in ("model", "group", "at")}
        for name in ("windows_s", "windows_low_s", "windows_high_s", "sure_windows_s"):
            rest[name] = [list(pair) for pair in rest[name]]
        return {"model": self.model, "group": self.group, **self.at, **rest}


def recommend(
    exposures_s: Sequence[float],
    confidence: Sequence[float],
    threshold: float,
    *,
    saturated: Sequence[float] | None = None,
) -> tuple[float, float] | None:
    """A tested exposure and its confidence, by the rule of :mod:`.recommendation`; None when none reaches the
    threshold."""
    counted = np.asarray(confidence, float)
    if not (counted >= threshold).any():
        return None
    if saturated is not None:
        counted = without_saturated(counted, saturated, threshold)
    chosen = best_exposure(exposures_s, np.where(counted >= threshold, counted, -1.0))  # no dip of a plateau
    return None if chosen is None else (exposures_s[chosen], confidence[chosen])


def answers(
    table: ScoreTable, criterion: Criterion, dark_below: float = DARK, *, monotone: bool = True
) -> list[Answer]:
    """One :class:`Answer` for every setting and velocity of the table; dark_below: as :class:`~.limits.Line` has it.
    monotone: whether no answer may be better at a higher speed, where pictures move as a whole; see
    :mod:`.monotone`."""
    settings = table.take(table.measured).split(SETTING)
    return [each for setting in settings for each in _of_setting(setting, criterion, dark_below, monotone)]


def _of_setting(
    setting: ScoreTable, criterion: Criterion, dark_below: float, monotone: bool
) -> Iterator[Answer]:
    monotone = monotone and is_uniform(setting)
    setting = pooled(setting) if monotone else setting
    lines = list(setting.along("exposure_s"))
    speeds = [float(line.speeds_px_s[0]) for line in lines]
    slowest = lines[int(np.argmin(speeds))]
    at_slowest = dict(zip(slowest.conditions["exposure_s"].tolist(), slowest.mean.tolist(), strict=True))
    curves = [Curve.of(line, "exposure_s") for line in lines]
    if monotone:
        curves = nested(curves, [line.velocities_px_s[0] for line in lines])
    for table, speed, curve in zip(lines, speeds, curves, strict=True):
        line = Line(
            curve.x,
            curve.mean,
            np.array([at_slowest.get(x, np.nan) for x in curve.x]) if speed > min(speeds) else None,
            speed > 0,
            table.saturated,
            table.brightness,
            dark_below,
        )
        at = {name: value for name, value in table.at(0).items() if name != "exposure_s"}
        yield answer((table.model, table.group, at), table.n_targets, curve, line, criterion, table.clean)


def flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """An answer's row in plain cells: of its windows the one with the recommended exposure, or the first."""
    lists = ("exposures_s", "confidence", "low", "high", "saturated")
    kept = {name: value for name, value in row.items() if name not in lists and "windows" not in name}
    spans = list(zip(row["windows_s"], row["windows_low_s"], row["windows_high_s"], strict=True))
    names = [f"window_{end}{bound}_s" for end in ("from", "to") for bound in ("", "_low", "_high")]
    ends: list[float | None] = [None] * len(names)
    if spans:
        place = chosen_window(row["windows_s"], row["recommended_s"])
        (low, high), low_bounds, high_bounds = spans[place]
        ends = [low, *low_bounds, high, *high_bounds]
    return {**kept, "n_windows": len(spans), **dict(zip(names, ends, strict=True))}


def natural(text: str) -> list[tuple[int, float, str]]:
    """A sort key that puts 32 px before 100 px."""
    parts = re.split(r"(\d+)", text)
    return [(1, float(part), "") if part.isdigit() else (0, 0.0, part) for part in parts]


def answer(
    shared: tuple[str, str, Mapping[str, float]],
    n_targets: int,
    curve: Curve,
    line: Line,
    criterion: Criterion,
    clean_value: float | None,
) -> Answer:
    """The answer of one line of exposures. shared: model, group, values of all axes but the exposure."""
    mean, crossed = curve.mean.tolist(), curve.crossed(criterion.level)
    sure = [any(low <= x <= high for low, high in crossed.sure) for x in curve.x]
    verdict = _verdict(crossed, sure)
    saturated = tuple(line.saturated.tolist()) if np.isfinite(line.saturated).all() else None
    choice = recommend(curve.x, mean, criterion.level, saturated=saturated)
    chosen = None if choice is None else curve.x.index(choice[0])
    best = int(np.argmax(mean))
    ends = curve.interval()
    low, high = (None, None) if ends is None else (tuple(end.tolist()) for end in ends)
    limits = _limits(
        line, crossed.windows, None if choice is None else choice[0], best, criterion, clean_value
    )
    needed = _pictures_to_tell(curve, criterion.level) if verdict == "cannot tell" else (None, None)
    return Answer(
        *shared,
        n_targets=n_targets,
        exposures_s=curve.x,
        confidence=tuple(mean),
        low=low,
        high=high,
        windows_s=crossed.windows,
        open_low=mean[0] >= criterion.level,
        open_high=mean[-1] >= criterion.level,
        recommended_s=None if choice is None else choice[0],
        confidence_at_recommended=None if choice is None else choice[1],
        n_pictures=curve.n_clusters,
        effective_pictures=curve.n_effective,
        few_pictures=curve.n_effective < uncertainty.FEW,
        verdict=verdict,
        pictures_to_tell=needed[0],
        pictures_to_tell_mostly=needed[1],
        windows_low_s=tuple(crossed.around(window[0]) for window in crossed.windows),
        windows_high_s=tuple(crossed.around(window[1]) for window in crossed.windows),
        sure_windows_s=crossed.sure,
        recommended_low=None if chosen is None or low is None else low[chosen],
        recommended_high=None if chosen is None or high is None else high[chosen],
        regret_95=None if chosen is None else _regret(curve, chosen),
        saturated=saturated,
        saturated_at_recommended=None if chosen is None or saturated is None else saturated[chosen],
        criterion=criterion.text,
        best_s=curve.x[best],
        best_value=mean[best],
        best_low=None if low is None else low[best],
        best_high=None if high is None else high[best],
        limited_low=limits.low,
        limited_high=limits.high,
        limited_by=limits.by,
        limits_untold=limits.untold,
        clean_value=clean_value,
    )


def chosen_window(windows_s: Sequence[Stretch], recommended_s: float | None) -> int:
    """The place of the window that holds the recommended exposure, or else of the first."""
    held = [recommended_s is not None and low <= recommended_s <= high for low, high in windows_s]
    return held.index(True) if any(held) else 0


def _limits(
    line: Line,
    found: Sequence[Stretch],
    recommended_s: float | None,
    best: int,
    criterion: Criterion,
    clean_value: float | None,
) -> Limits:
    if found:
        return of_window(line, found[chosen_window(found, recommended_s)], criterion.level)
    if not criterion.kept and clean_value is not None and clean_value < criterion.level:
        return Limits(by="the model, as the untouched pictures show")
    return of_best(line, best)


def _verdict(crossed: Crossed, sure: Sequence[bool]) -> Verdict:
    if any(sure):
        return "works"
    return "cannot tell" if crossed.possible else "no exposure works"


def _pictures_to_tell(curve: Curve, threshold: float) -> tuple[int | None, int | None]:
    """How many pictures like these would tell, in half of the cases and in most: enough for the exposure that is most
    clearly above the threshold, or else for all to be clearly below. Exposures at which fewer than two clusters were
    measured say nothing of it."""
    n = np.isfinite(curve.influence).sum(axis=0)
    known = n > 1
    if not known.any():
        return None, None
    n, mean, away = n[known], curve.mean[known], curve.influence[:, known]
    margin, spread, above = mean - threshold, np.nanstd(away, axis=0), mean > threshold
    pulls = np.where(above, mean, curve.most - mean)  # the bound beyond the threshold
    asked = zip(np.abs(margin).tolist(), spread.tolist(), pulls.tolist(), strict=True)
    needed = np.array([uncertainty.pictures_needed(*each, _MOST_PICTURES) for each in asked])
    hardest = int(np.where(above, needed, _MOST_PICTURES + 2).argmin() if above.any() else needed.argmax())
    count = int(needed[hardest])
    if count > _MOST_PICTURES:
        return None, None
    fewest = max(math.ceil(uncertainty.FEWEST * curve.n_clusters / curve.n_effective), int(n.max()) + 1)
    seen = abs(float(margin[hardest])), float(spread[hardest]), float(n[hardest])
    mostly = uncertainty.pictures_needed_mostly(*seen, count, _MOST_PICTURES)
    return max(fewest, count), None if mostly > _MOST_PICTURES else max(fewest, mostly)


def _regret(curve: Curve, chosen: int) -> float | None:
    others = np.arange(len(curve.x)) != chosen
    if not others.any():
        return 0.0 if curve.told.all() else None
    gain = (curve.mean - curve.mean[chosen])[others]
    told = curve.told & curve.told[chosen]
    paired = np.where(told, curve.influence - curve.influence[:, [chosen]], np.nan)[:, others]
    unknown = np.zeros((len(others),) * 2) if curve.open is None else curve.open
    apart = uncertainty.sigma_of_differences(unknown, chosen)
    bound = float(uncertainty.regret_bound(paired, gain, sigma=apart[others]))
    return None if math.isnan(bound) else bound
