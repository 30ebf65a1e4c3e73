"""Rows of a run's answers: exposure windows, curves, recommendations and models.

Domain: exposures in s; scores in the criterion's unit, see :mod:`.criterion`; intervals at 95 % over clusters of
pictures. None: unknown, or from too few pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from blurnoise_eval.plan.axes import NAMES, SETTING
from blurnoise_eval.store.columns import AxisValues, Row, WithInterval

_OF_LINES = ("exposures_s", "confidence", "low", "high", "saturated_share")
_WINDOWS = ("windows_s", "windows_low_s", "windows_high_s", "sure_windows_s")
_ENDS = tuple(f"window_{end}{bound}_s" for end in ("from", "to") for bound in ("", "_low", "_high"))
Window = Sequence[float]
"""First and last exposure of a window."""
Bounds = Sequence[float | None]
"""An interval of an end; None where it lies outside the tested range, or is not known."""


@dataclass(frozen=True, slots=True)
class AnswerRow(Row):
    """The exposures at which a model reaches the criterion: for a group of targets, a setting and a velocity."""

    axes: ClassVar = tuple(name for name in NAMES if name != "exposure_s")

    model: Annotated[str, "the model"]
    group: Annotated[str, "kind of target"]
    conditions: AxisValues
    n_targets: Annotated[int, "targets, times noise fields"]
    exposures_s: Annotated[tuple[float, ...], "tested exposures, rising"]
    confidence: Annotated[tuple[float, ...], "score at each tested exposure"]
    low: Annotated[tuple[float, ...] | None, "low ends of the intervals of these"]
    high: Annotated[tuple[float, ...] | None, "high ends of these"]
    windows_s: Annotated[list[Window], "stretches of exposure in which the mean reaches the criterion"]
    windows_low_s: Annotated[list[Bounds], "intervals of where these begin"]
    windows_high_s: Annotated[list[Bounds], "intervals of where these end"]
    sure_windows_s: Annotated[
        list[Window], "stretches in which the whole interval is at or above the criterion"
    ]
    window_from_open: Annotated[bool, "whether a window reaches the shortest tested exposure"]
    window_to_open: Annotated[bool, "whether a window reaches the longest tested exposure"]
    n_pictures: Annotated[int, "clusters of pictures"]
    effective_pictures: Annotated[float, "how many of equal size they count as"]
    few_pictures: Annotated[bool, "whether these are fewer than 20"]
    verdict: Annotated[str, "works, no exposure works, or cannot tell"]
    pictures_needed: Annotated[
        int | None, "pictures that settle half of such cases, of a verdict cannot tell"
    ]
    recommended_s: Annotated[
        float | None, "the exposure to use; None where the mean reaches the criterion nowhere"
    ]
    score_at_recommended: Annotated[WithInterval, "its score, corrected for having been chosen"]
    saturated_share_at_recommended: Annotated[float | None, "its share of values at a limit of the sensor"]
    regret_95: Annotated[float | None, "what it loses at most against the best tested exposure, at 95 %"]
    saturated_share: Annotated[tuple[float, ...] | None, "share of saturated values at each tested exposure"]
    criterion: Annotated[str, "what is enough"]
    best_s: Annotated[float, "the tested exposure with the highest score"]
    best_score: Annotated[WithInterval, "its score, corrected for having been chosen"]
    window_from_limited_by: Annotated[str | None, "what ends the window at its short end"]
    window_to_limited_by: Annotated[str | None, "what ends it at its long end"]
    best_limited_by: Annotated[str | None, "what holds the best exposure back where no exposure works"]
    clean_score: Annotated[float | None, "score on the original pictures"]

    @property
    def chosen_window(self) -> int:
        """The index of the window with the recommended exposure, or else of the first."""
        return chosen_window(self.windows_s, self.recommended_s)

    def flat(self) -> dict[str, Any]:
        """The columns of answers.csv: of the windows the one with the recommended exposure, or the first."""
        kept = {name: value for name, value in self.columns().items() if name not in (*_OF_LINES, *_WINDOWS)}
        ends: list[float | None] = [None] * len(_ENDS)
        if self.windows_s:
            index = self.chosen_window
            low, high = self.windows_s[index]
            ends = [low, *self.windows_low_s[index], high, *self.windows_high_s[index]]
        return {**kept, "n_windows": len(self.windows_s), **dict(zip(_ENDS, ends, strict=True))}


def chosen_window(windows_s: Sequence[Window], recommended_s: float | None) -> int:
    """The index of the window that holds the recommended exposure, or else of the first.

    >>> chosen_window([(0.001, 0.002), (0.004, 0.016)], 0.008)
    1
    """
    holds = [recommended_s is not None and low <= recommended_s <= high for low, high in windows_s]
    return holds.index(True) if any(holds) else 0


@dataclass(frozen=True, slots=True)
class CurveRow(Row):
    """A score along one axis, or along the blur, everything else constant."""

    axes: ClassVar = tuple(name for name in NAMES if name != "illuminance_lux")

    model: Annotated[str, "the model"]
    group: Annotated[str, "kind of target"]
    illuminance_lux: Annotated[float | None, "light on the scene"]
    axis: Annotated[str, "the axis that varies, or blur_px"]
    conditions: AxisValues
    x: Annotated[tuple[float, ...], "tested values"]
    confidence: Annotated[tuple[float, ...], "score at each of them"]
    auc: Annotated[float, "area under the curve, divided by the range of x"]
    fails_at: Annotated[float | None, "where the curve falls below the criterion for good, if it does"]
    fails_low: Annotated[float | None, "low end of the interval of that"]
    fails_high: Annotated[float | None, "high end of it"]
    non_monotonic: Annotated[bool, "whether it was below the criterion before, and came back"]
    auc_low: Annotated[float | None, "low end of the interval of auc"]
    auc_high: Annotated[float | None, "high end of it"]
    n_pictures: Annotated[int, "clusters of pictures"]
    few_pictures: Annotated[bool, "whether these count as fewer than 20"]
    criterion: Annotated[str, "what is enough"]

    def flat(self) -> dict[str, Any]:
        """The columns of curves.csv: without the curve itself."""
        return {name: value for name, value in self.columns().items() if name not in ("x", "confidence")}


@dataclass(frozen=True, slots=True)
class RecommendationRow(Row):
    """The exposure to use: for all conditions, for one light, or for one light and speed."""

    axes: ClassVar = SETTING

    model: Annotated[str, "the model"]
    scope: Annotated[str, "all conditions, one light over all speeds, or one condition: a light and a speed"]
    conditions: AxisValues
    speed: Annotated[float | None, "px/s, or km/h of a vehicle"]
    exposure_s: Annotated[float, "the exposure to use there"]
    score: Annotated[WithInterval, "its mean score, corrected for having been chosen"]
    verdict: Annotated[str, "works, fails, or cannot tell"]
    n_pictures: Annotated[int, "clusters of pictures"]
    settled: Annotated[
        bool | None,
        "whether every other exposure surely loses, or gains at most 0.03; unknown from fewer than 8 pictures",
    ]
    rival_s: Annotated[float | None, "the other tested exposure that may gain most"]
    rival_gain_95: Annotated[float | None, "what that gains at most, at 95 %"]
    pictures_to_settle: Annotated[
        int | None, "where it is not settled, pictures that settle half of such cases"
    ]
    untested_gain: Annotated[
        float | None, "after decide, what an exposure may gain that was not tested; none where all were"
    ]
    alike_from_s: Annotated[float, "the shortest of the tested exposures that score at most 0.03 less"]
    alike_to_s: Annotated[float, "the longest of these"]
    alike_from_open: Annotated[
        bool, "whether the next shorter one of the grid was not tested, or there is none"
    ]
    alike_to_open: Annotated[bool, "the same of the next longer one"]
    regret: Annotated[float, "how much more the best exposure of each condition would score on average"]
    saturated_share: Annotated[float | None, "the largest saturated share among the conditions"]
    n_works: Annotated[int, "conditions in which the exposure surely works"]
    n_fails: Annotated[int, "conditions in which it surely fails"]
    n_conditions: Annotated[int, "conditions"]
    score_at_overall_exposure: Annotated[float | None, "score of the exposure for all conditions"]


@dataclass(frozen=True, slots=True)
class ModelRow(Row):
    """A model's scores on the original pictures, and how much of these it keeps."""

    model: Annotated[str, "the model"]
    kind: Annotated[str, "detector or reader"]
    measure: Annotated[str, "what P and mPC are means of"]
    p: Annotated[WithInterval, "on the original pictures; None of a detector without labels: it is 1"]
    mpc: Annotated[WithInterval, "mean over all conditions but the original pictures, all weighted alike"]
    rpc: Annotated[WithInterval, "mPC / P"]
    auc_exposure: Annotated[float | None, "mean area under the curves over exposure"]
    auc_blur: Annotated[float | None, "mean area under the curves over blur"]
    scores: Mapping[str, WithInterval]
    latency_ms: Annotated[float | None, "median time of one picture on one thread"]
    latency_p95_ms: Annotated[float | None, "95th percentile of that"]
    latency_threads: Annotated[int | None, "threads of the measurement"]
    mpc_deficit: Annotated[WithInterval, "what it lacks in mPC compared with the best model"]


@dataclass(frozen=True, slots=True)
class AverageCurve:
    """A model's mean score over all conditions, at the exposures that were tested in all."""

    model: str
    exposures_s: tuple[float, ...]
    values: tuple[float, ...]
