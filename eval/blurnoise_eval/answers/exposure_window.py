"""The exposure window in which a detector fulfils a criterion, and an exposure inside it.

Domain: exposures in s, logarithmic; confidences in the criterion's unit: its score, or the share of it that is kept
(above 1 where a condition does better than the original pictures). An end of the tested range is unknown, never an
edge: a window reaches at least that far.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import Curve, Row, Stretch
from blurnoise_eval.answers.limits import DARK, Limits, Line, of_best, of_window
from blurnoise_eval.answers.monotone import is_uniform, nested, pooled
from blurnoise_eval.answers.recommendation import best_exposure, without_saturated
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import SETTING
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.system.tables import finite

WORKS, NONE_WORKS, CANNOT_TELL = "works", "no exposure works", "cannot tell"
Array = NDArray[np.float64]
_MOST_PICTURES = 9999  # that are asked for
_OF_LINES = ("exposures_s", "confidence", "low", "high", "saturated_share")
_ENDS = tuple(f"window_{end}{bound}_s" for end in ("from", "to") for bound in ("", "_low", "_high"))


def answers(
    table: ScoreTable, criterion: Criterion, dark_below: float = DARK, *, monotone: bool = True
) -> list[Row]:
    """An :func:`answer` for every setting and velocity of the table; dark_below: as :class:`~.limits.Line` has it.
    monotone: whether no answer may be better at a higher speed, where pictures move as a whole; see
    :mod:`.monotone`."""
    found = []
    for setting in table.take(table.measured).split(SETTING):
        uniform = monotone and is_uniform(setting)
        lines = list((pooled(setting) if uniform else setting).along("exposure_s"))
        curves = [Curve.over("exposure_s", line) for line in lines]
        if uniform:
            curves = nested(curves, [line.velocities_px_s[0] for line in lines])
        speeds = [float(line.speeds_px_s[0]) for line in lines]
        slowest = lines[int(np.argmin(speeds))]
        at_slowest = slowest.conditions["exposure_s"], slowest.mean
        for speed, curve in zip(speeds, curves, strict=True):
            slower = _between(curve.x, *at_slowest) if speed > min(speeds) else None
            found.append(answer(curve, Line(curve.line, slower, dark_below), criterion))
    return found


def _between(exposures_s: Sequence[float], tested_s: Array, mean: Array) -> Array:
    """Means at exposures, between two that were tested as windows have it; NaN beyond them. Where windows were
    refined, few exposures were tested at all speeds."""
    if len(tested_s) == 1:  # which may be the camera's own
        return np.where(np.array(exposures_s) == tested_s, mean, np.nan)
    return np.asarray(np.interp(np.log(exposures_s), np.log(tested_s), mean, left=np.nan, right=np.nan))


def answer(curve: Curve, line: Line, criterion: Criterion) -> Row:
    """The answer for one model and group of targets in one setting and at one velocity.

    A row with the model, the group, the axes but the exposure, and

    exposures_s: tested, increasing; confidence: of the ``n_targets`` targets (times repeats) at each, in the
    criterion's unit; low, high: its 95 % interval over ``n_pictures`` clusters, which count as ``effective_pictures``
    (:func:`~blurnoise_eval.scoring.uncertainty.effective`): None below 8 such; few_pictures: fewer than 20.
    saturated_share: mean share of the pictures' values at a limit of the sensor, None where unknown.

    verdict: "works": at some tested exposure ``low`` is at or above the level; "no exposure works": ``high`` is at
    none in the range; else "cannot tell", as always below 8 pictures. Then ``pictures_needed`` is how many should be
    enough in half of such cases (None: more than 9999).

    windows_s: stretches of exposure in which the mean is at or above the level; windows_low_s, windows_high_s: the
    95 % intervals of their ends, None where these lie outside the tested range or are not known. sure_windows_s:
    where it is surely so. window_from_open, window_to_open: a window reaches the shortest or longest exposure tested.

    recommended_s: a tested exposure, None when the mean reaches the level nowhere; unless the verdict is "works" it
    is only the best guess. regret_95: its greatest regret, at 95 %, against the best tested exposure. best_s: the
    tested exposure with the highest confidence (of equals the shortest). Both with their values and intervals.

    window_from_limited_by, window_to_limited_by: what ends the window of the recommended exposure, or else the first;
    best_limited_by: where there is no window, what holds ``best_s`` back: as :mod:`.limits` has them.
    clean_score: mean score in the original pictures, None where unknown.
    """
    table, level = curve.line, criterion.level
    mean, windows, sure = table.mean.tolist(), curve.windows(level), curve.sure(level)
    saturated = tuple(table.saturated.tolist()) if np.isfinite(table.saturated).all() else None
    chosen, best = recommended(curve.x, mean, level, saturated), int(np.argmax(table.mean.round(12)))
    ends = curve.interval()
    low, high = (None, None) if ends is None else (tuple(end.tolist()) for end in ends)
    works = any(first <= x <= last for first, last in sure for x in curve.x)
    verdict = WORKS if works else CANNOT_TELL if curve.possible(level) else NONE_WORKS

    def at(place: int | None, *names: str) -> Row:
        columns = zip(names, (curve.x, mean, low, high, saturated), strict=False)
        return {name: None if place is None or each is None else each[place] for name, each in columns}

    if windows:
        recommended_s = None if chosen is None else curve.x[chosen]
        limits = of_window(line, windows[chosen_window(windows, recommended_s)], level)
    elif not criterion.kept and table.clean is not None and table.clean < level:
        limits = Limits(by="the model, as the original pictures show")
    else:
        limits = of_best(line, best)
    axes = {name: value for name, value in table.at(0).items() if name != "exposure_s"}
    to_recommended = (
        "recommended_s",
        "score_at_recommended",
        "score_at_recommended_low",
        "score_at_recommended_high",
    )
    return {
        "model": table.model,
        "group": table.group,
        **axes,
        "n_targets": table.n_targets,
        "exposures_s": curve.x,
        "confidence": tuple(mean),
        "low": low,
        "high": high,
        "windows_s": [list(window) for window in windows],
        "windows_low_s": [list(curve.around(end, level)) for end, _ in windows],
        "windows_high_s": [list(curve.around(end, level)) for _, end in windows],
        "sure_windows_s": [list(window) for window in sure],
        "window_from_open": mean[0] >= level,
        "window_to_open": mean[-1] >= level,
        **table.sizes,
        "verdict": verdict,
        "pictures_needed": _pictures_needed(table, level) if verdict == CANNOT_TELL else None,
        **at(chosen, *to_recommended, "saturated_share_at_recommended"),
        "regret_95": None if chosen is None else _regret(curve, chosen),
        "saturated_share": saturated,
        "criterion": criterion.text,
        **at(best, "best_s", "best_score", "best_score_low", "best_score_high"),
        "window_from_limited_by": limits.low,
        "window_to_limited_by": limits.high,
        "best_limited_by": limits.by,
        "clean_score": table.clean,
    }


def recommended(
    exposures_s: Sequence[float], values: Sequence[float], level: float, saturated: Sequence[float] | None
) -> int | None:
    """The place of the exposure to use, by the rule of :mod:`.recommendation`; None where none reaches the level."""
    counted = np.asarray(values, float)
    if not (counted >= level).any():
        return None
    if saturated is not None:
        counted = without_saturated(counted, saturated, level)
    return best_exposure(exposures_s, np.where(counted >= level, counted, -1.0))  # no dip of a plateau


def flat(row: Mapping[str, Any]) -> Row:
    """An answer in plain cells: of its windows the one with the recommended exposure, or the first."""
    kept = {name: value for name, value in row.items() if name not in _OF_LINES and "windows" not in name}
    ends: list[float | None] = [None] * 6
    if row["windows_s"]:
        place = chosen_window(row["windows_s"], row["recommended_s"])
        low, high = row["windows_s"][place]
        ends = [low, *row["windows_low_s"][place], high, *row["windows_high_s"][place]]
    return {**kept, "n_windows": len(row["windows_s"]), **dict(zip(_ENDS, ends, strict=True))}


def natural(text: str) -> list[tuple[int, float, str]]:
    """A sort key that puts 32 px before 100 px."""
    parts = re.split(r"(\d+)", text)
    return [(1, float(part), "") if part.isdigit() else (0, 0.0, part) for part in parts]


def chosen_window(windows_s: Sequence[Stretch], recommended_s: float | None) -> int:
    """The place of the window that holds the recommended exposure, or else of the first."""
    held = [recommended_s is not None and low <= recommended_s <= high for low, high in windows_s]
    return held.index(True) if any(held) else 0


def _pictures_needed(line: ScoreTable, level: float) -> int | None:
    """How many would be enough in half of such cases: for one exposure to be above, or all below."""
    n = np.isfinite(line.influence).sum(axis=0)
    known = n > 1
    if not known.any():
        return None
    mean = line.mean[known]
    above = mean > level
    spread = np.nanstd(line.influence[:, known], axis=0)
    pull = np.where(above, mean, line.most - mean)  # of the bound beyond the level
    asked = zip(np.abs(mean - level).tolist(), spread.tolist(), pull.tolist(), strict=True)
    needed = np.array([uncertainty.pictures_needed(*each, _MOST_PICTURES) for each in asked])
    count = int(needed[above].min() if above.any() else needed.max())
    fewest = max(math.ceil(uncertainty.FEWEST * line.n_clusters / line.n_effective), int(n.max()) + 1)
    return None if count > _MOST_PICTURES else max(fewest, count)


def _regret(curve: Curve, chosen: int) -> float | None:
    others = np.arange(len(curve.x)) != chosen
    if not others.any():
        return 0.0 if curve.known.all() else None
    mean, away, known = curve.line.mean, curve.line.influence, curve.known & curve.known[chosen]
    paired = np.where(known, away - away[:, [chosen]], np.nan)[:, others]
    sigma = uncertainty.sigma_of_differences(curve.cov, chosen)[others]
    return finite(float(uncertainty.regret_bound(paired, (mean - mean[chosen])[others], sigma=sigma)))
