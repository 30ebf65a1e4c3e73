"""The exposure window in which a detector fulfils a criterion, and an exposure inside it.

Domain: exposures in s, logarithmic; confidences in the criterion's unit: its score, or the share of it that is kept
(above 1 where a condition does better than the original pictures). An end of the tested range is unknown, never an
edge: a window reaches at least that far.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.choosing import recommended
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import ScoreCurve
from blurnoise_eval.answers.limits import DARK, TestedLine, WindowLimits, of_best, of_window
from blurnoise_eval.answers.monotone import is_faster, is_uniform, nested, pooled
from blurnoise_eval.answers.recommendation import corrected
from blurnoise_eval.answers.rows import AnswerRow, chosen_window
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import SETTING
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.store.columns import UNKNOWN, AxisValues, WithInterval
from blurnoise_eval.system.tables import finite

WORKS, NONE_WORKS, CANNOT_TELL = "works", "no exposure works", "cannot tell"
Array = NDArray[np.float64]
_MOST_PICTURES = 9999  # that are asked for


def answers(
    table: ScoreTable,
    criterion: Criterion,
    dark_below: float = DARK,
    *,
    monotone: bool = True,
    grid_s: Sequence[float] = (),
) -> list[AnswerRow]:
    """An :func:`answer` for every setting and velocity of the table.

    dark_below: see :class:`~.limits.TestedLine`. monotone: whether no answer may be better at a higher speed, where
    pictures move as a whole, see :mod:`.monotone`. grid_s: the exposures of the grid, none where all count alike.
    """
    rows = []
    for setting in table.take(table.measured).split(SETTING):
        uniform = monotone and is_uniform(setting)
        lines = list((pooled(setting) if uniform else setting).along("exposure_s"))
        curves = [ScoreCurve.over("exposure_s", line) for line in lines]
        choices = [_ChosenOfLine.of(curve.line, criterion.level, grid_s) for curve in curves]
        velocities = [line.velocities_px_s[0] for line in lines]
        if uniform:
            curves = nested(curves, velocities)
        speeds = [float(line.speeds_px_s[0]) for line in lines]
        slowest = lines[int(np.argmin(speeds))]
        at_slowest = slowest.conditions["exposure_s"], slowest.mean
        for curve, choice, speed, velocity in zip(curves, choices, speeds, velocities, strict=True):
            slower = _between(curve.x, *at_slowest) if speed > min(speeds) else None
            of = TestedLine(curve.line, slower, dark_below)
            # What surely works at one speed does at all slower ones, so that the least bias of these counts.
            beside = zip(choices, velocities, strict=True)
            faster = [each for each, other in beside if uniform and is_faster(other, velocity)]
            bias = min(each.bias for each in (choice, *faster))
            rows.append(answer(curve, of, criterion, choice, criterion.level + bias))
    return rows


class _ChosenOfLine(NamedTuple):
    """The exposure that is chosen of a line, by its place, and by how much its score is too high because of that."""

    place: int
    bias: float

    @classmethod
    def of(cls, line: ScoreTable, level: float, grid_s: Sequence[float]) -> _ChosenOfLine:
        """By the rule of :mod:`.recommendation`."""
        exposures = line.conditions["exposure_s"]
        of_grid = np.isin(exposures, grid_s) if grid_s else np.ones(len(exposures), bool)

        def choose(values: Array) -> NDArray[np.int64]:
            return recommended(exposures, values, line.saturated, level, of_grid)

        place = int(choose(line.mean))
        bias = uncertainty.selection_bias(line.mean, line.influence[:, None], place, choose)
        return cls(place, max(0.0, float(bias[0])))


def _between(exposures_s: Sequence[float], tested_s: Array, mean: Array) -> Array:
    """Means at exposures, between two that were tested as windows have it; NaN beyond them. Where windows were
    refined, few exposures were tested at all speeds."""
    if len(tested_s) == 1:  # which may be the camera's own
        return np.where(np.array(exposures_s) == tested_s, mean, np.nan)
    return np.asarray(np.interp(np.log(exposures_s), np.log(tested_s), mean, left=np.nan, right=np.nan))


def answer(
    curve: ScoreCurve, line: TestedLine, criterion: Criterion, choice: _ChosenOfLine, sure_from: float
) -> AnswerRow:
    """The answer for one model and group of targets in one setting and at one velocity.

    sure_from: the level and the bias of the choice. verdict: "works": at some tested exposure the low end of the
    interval is at or above ``sure_from``; "no exposure works": at none in the range is the high end; else "cannot
    tell", as always below 8 pictures. Then ``pictures_needed`` is how many should be enough in half of such cases
    (None: more than 9999).

    recommended_s: None where no mean reaches the level; unless the verdict is "works" it is only the best guess.
    best_s: of equals the shortest. The limits, see :mod:`.limits`, are those of the window with the recommended
    exposure, or else the first; where there is no window, what holds ``best_s`` back.
    """
    table, level = curve.line, criterion.level
    mean, windows, sure = table.mean.tolist(), curve.windows(level), curve.sure(sure_from)
    saturated = tuple(table.saturated.tolist()) if np.isfinite(table.saturated).all() else None
    # Rounded: of values that are equal but for their last digits the shortest exposure is the best.
    best, recommended_s = int(np.argmax(table.mean.round(12))), curve.x[choice.place] if windows else None
    ends = curve.interval()
    low, high = (None, None) if ends is None else (tuple(end.tolist()) for end in ends)
    works = any(first <= x <= last for first, last in sure for x in curve.x)
    verdict = WORKS if works else CANNOT_TELL if curve.possible(level) else NONE_WORKS

    def score_at(index: int) -> WithInterval:
        of = mean[index], None if low is None else low[index], None if high is None else high[index]
        return corrected(WithInterval(*of), choice.bias)

    if windows:
        limits = of_window(line, windows[chosen_window(windows, recommended_s)], level)
    # Where the original pictures fail already, neither light nor motion is to blame.
    elif not criterion.kept and table.clean is not None and table.clean < level:
        limits = WindowLimits(by="the model, as the original pictures show")
    else:
        limits = of_best(line, best, level)
    return AnswerRow(
        model=table.model,
        group=table.group,
        conditions=AxisValues.of(table.at(0)).but(exposure_s=None),
        n_targets=table.n_targets,
        exposures_s=curve.x,
        confidence=tuple(mean),
        low=low,
        high=high,
        windows_s=[list(window) for window in windows],
        windows_low_s=[list(curve.around(end, level)) for end, _ in windows],
        windows_high_s=[list(curve.around(end, level)) for _, end in windows],
        sure_windows_s=[list(window) for window in sure],
        window_from_open=mean[0] >= level,
        window_to_open=mean[-1] >= level,
        **table.sizes,
        verdict=verdict,
        pictures_needed=_pictures_needed(table, level) if verdict == CANNOT_TELL else None,
        recommended_s=recommended_s,
        score_at_recommended=score_at(choice.place) if windows else UNKNOWN,
        saturated_share_at_recommended=saturated[choice.place] if windows and saturated else None,
        regret_95=_regret(curve, choice.place) if windows else None,
        saturated_share=saturated,
        criterion=criterion.text,
        best_s=curve.x[best],
        best_score=score_at(best),
        window_from_limited_by=limits.low,
        window_to_limited_by=limits.high,
        best_limited_by=limits.by,
        clean_score=table.clean,
    )


def natural(text: str) -> list[tuple[int, float, str]]:
    """A sort key that puts 32 px before 100 px.

    >>> sorted(["100 px", "32 px"], key=natural)
    ['32 px', '100 px']
    """
    parts = re.split(r"(\d+)", text)
    return [(1, float(part), "") if part.isdigit() else (0, 0.0, part) for part in parts]


def _pictures_needed(line: ScoreTable, level: float) -> int | None:
    """How many would be enough in half of such cases: for one exposure to be above, or all below."""
    n = np.isfinite(line.influence).sum(axis=0)
    known = n > 1
    if not known.any():
        return None
    mean = line.mean[known]
    above = mean > level
    spread = np.nanstd(line.influence[:, known], axis=0)
    # The unseen cluster of an interval pulls towards the bound that lies beyond the level.
    reach = uncertainty.reach(mean, line.influence[:, known], line.most)
    pull = np.where(above, mean, reach - mean)  # of the bound beyond the level
    asked = zip(np.abs(mean - level).tolist(), spread.tolist(), pull.tolist(), strict=True)
    needed = np.array([uncertainty.pictures_needed(*each, _MOST_PICTURES) for each in asked])
    count = int(needed[above].min() if above.any() else needed.max())
    fewest = max(math.ceil(uncertainty.FEWEST * line.n_clusters / line.n_effective), int(n.max()) + 1)
    return None if count > _MOST_PICTURES else max(fewest, count)


def _regret(curve: ScoreCurve, chosen: int) -> float | None:
    # Paired by cluster: pictures that are hard at one exposure are hard at all of them, which cancels.
    others = np.arange(len(curve.x)) != chosen
    if not others.any():
        return 0.0 if curve.known.all() else None
    mean, away, known = curve.line.mean, curve.line.influence, curve.known & curve.known[chosen]
    paired = np.where(known, away - away[:, [chosen]], np.nan)[:, others]
    sigma = uncertainty.sigma_of_differences(curve.cov, chosen)[others]
    return finite(float(uncertainty.regret_bound(paired, (mean - mean[chosen])[others], sigma=sigma)))
