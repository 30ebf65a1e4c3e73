"""Judging one picture: which targets count, what a model keeps of them, and which exposure keeps most.

Domain: scores per target, 0 to 1: confidences, or exact matches of a text recogniser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.criterion import CONFIDENCE, MATCHES, Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.recommendation import NEAR, best_exposure, without_saturated
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Sight

_FINEST = 2**0.25
"""Ratio of neighbouring exposures below which no more are computed."""
_ROUNDED = 1.01  # ratio: exposures are rounded to three digits


class Point(NamedTuple):
    """A point of a curve: the control's value, in its unit, the score of every target, and the share of the picture's
    pixels that is saturated."""

    value: float
    scores: tuple[float, ...]
    saturated: float = 0.0

    @property
    def mean(self) -> float:
        """Over the targets."""
        return sum(self.scores) / len(self.scores)


@dataclass(frozen=True)
class Standard:
    """What a picture is held to. counted: ids of the targets that count; original: their mean score in the original
    picture. Where a share of that is asked for, targets that the model misses there do not count."""

    criterion: Criterion
    counted: frozenset[int]
    original: float

    @classmethod
    def of(cls, criterion: Criterion, clean: Sight) -> Standard:
        """The standard of a picture, by the model's answer to the original."""
        scored = {row["target_id"]: _score(criterion, row) for row in clean.targets}
        if criterion.kept:
            scored = {name: score for name, score in scored.items() if score >= FOUND_SCORE}
        return cls(criterion, frozenset(scored), sum(scored.values()) / max(1, len(scored)))

    @property
    def enough(self) -> float:
        """The mean score from which the model works."""
        return self.criterion.level * (self.original if self.criterion.kept else 1.0)

    @property
    def title(self) -> str:
        """What a curve shows."""
        return "Mean exact matches" if self.criterion.score == MATCHES else "Mean confidence"

    @property
    def found_from(self) -> float:
        """The confidence from which a target counts as found."""
        absolute = not self.criterion.kept and self.criterion.score == CONFIDENCE
        return self.criterion.level if absolute else FOUND_SCORE

    def sight(self, sight: Sight) -> Sight:
        """With the targets that count alone."""
        return sight._replace(targets=tuple(row for row in sight.targets if row["target_id"] in self.counted))

    def scores(self, sight: Sight) -> tuple[float, ...]:
        """Of the targets that count."""
        return tuple(_score(self.criterion, row) for row in self.sight(sight).targets)

    def value(self, mean: float) -> float:
        """A mean score in the criterion's unit."""
        return mean / self.original if self.criterion.kept else mean

    def text(self, value: float) -> str:
        """A value in the criterion's unit, as people read it."""
        return f"{100 * value:.0f} %" if self.criterion.kept else f"{value:.2f}"


def works(
    curve: Sequence[Point], enough: float, at: float, *, logarithmic: bool = False
) -> tuple[float, float] | None:
    """From where to where along a curve the mean score is enough, around ``at`` or else the widest; None: nowhere.

    As a run's windows end, see :func:`~blurnoise_eval.answers.curves.windows`.
    """
    values, means = [point.value for point in curve], [point.mean for point in curve]
    found = windows(values, means, enough, logarithmic)
    around = [window for window in found if window[0] <= at <= window[1]]
    return next(iter(around or sorted(found, key=lambda window: window[0] - window[1])), None)


def keeps_most(curve: Sequence[Point], standard: Standard) -> Point:
    """Of a curve along the exposure: the one to use, by the rule that answers runs."""
    place = best_exposure([point.value for point in curve], _values(curve, standard))
    return curve[place or 0]


def finer(curve: Sequence[Point], standard: Standard) -> float | None:
    """The exposure to try next: in the middle of the widest gap beside those that keep most, or in which a window
    ends. None: all such gaps are a quarter of a stop or less."""
    values = _values(curve, standard)
    near, good = values >= values.max() - NEAR, values >= standard.criterion.level
    unsure = near[1:] | near[:-1] | (good[1:] != good[:-1])
    gaps = [pair for pair, each in zip(pairwise(point.value for point in curve), unsure, strict=True) if each]
    low_ms, high_ms = max(gaps, key=lambda gap: gap[1] / gap[0], default=(1.0, 1.0))
    return None if high_ms / low_ms <= _FINEST * _ROUNDED else float(f"{math.sqrt(low_ms * high_ms):.3g}")


def _values(curve: Sequence[Point], standard: Standard) -> NDArray[np.float64]:
    """In the criterion's unit, 0 where a saturated picture is passed over."""
    values = [standard.value(point.mean) for point in curve]
    return without_saturated(values, [point.saturated for point in curve], standard.criterion.level)


def _score(criterion: Criterion, row: dict[str, Any]) -> float:
    if criterion.score == MATCHES:
        return float(row["text"] == row["truth"])
    return float(row["confidence"])
