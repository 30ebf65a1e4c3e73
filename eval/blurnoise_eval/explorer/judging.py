"""Judging one picture: which targets count, what a model keeps of them, and which exposure keeps most.

Domain: scores per target, 0 to 1: confidences, or exact matches of a text recogniser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.scoring.criterion import CONFIDENCE, MATCHES, Criterion
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Sight
from blurnoise_eval.scoring.recommendation import NEAR, best_exposure, without_saturated

_FINEST = 2**0.25
"""Ratio of neighbouring exposures below which no more are computed."""
_ROUNDED = 1.01  # ratio: exposures are rounded to three digits


class Stop(NamedTuple):
    """A place of a strip: the control's value, in its unit, the score of every target (none where the value does not
    go with the rest), and the share of the picture's values that is saturated."""

    value: float
    scores: tuple[float, ...] = ()
    saturated: float = 0.0

    @property
    def mean(self) -> float | None:
        """Over the targets."""
        return sum(self.scores) / len(self.scores) if self.scores else None


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
        """What a strip shows."""
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
    curve: Sequence[Stop], enough: float, at: float, *, logarithmic: bool = False
) -> tuple[float, float] | None:
    """From where to where along a strip the mean score is enough, around ``at`` or else the widest; None: nowhere.

    As a run's windows end: where the straight line between two places tried, over the logarithm where the strip is
    logarithmic, crosses what is enough.
    """
    kept: list[tuple[float, float]] = []
    for low, high in _windows(curve, enough):
        ends = [_crossing(curve, low, low - 1, enough, logarithmic)]
        ends += [_crossing(curve, high, high + 1, enough, logarithmic)]
        kept.append((ends[0], ends[1]))
    around = [run for run in kept if run[0] <= at <= run[1]]
    return next(iter(around or sorted(kept, key=lambda run: run[0] - run[1])), None)


def _windows(curve: Sequence[Stop], enough: float) -> list[tuple[int, int]]:
    """First and last places of each stretch in which the mean score is enough."""
    good = [stop.mean is not None and stop.mean >= enough for stop in curve]
    firsts = [place for place, each in enumerate(good) if each and not (place and good[place - 1])]
    lasts = [place for place, each in enumerate(good) if each and not any(good[place + 1 : place + 2])]
    return list(zip(firsts, lasts, strict=True))


def _crossing(curve: Sequence[Stop], inside: int, outside: int, enough: float, logarithmic: bool) -> float:
    """Where the score falls below what is enough; the last place that has it at an end of what was tried."""
    last = curve[inside].value
    high, low = curve[inside].mean, curve[outside].mean if 0 <= outside < len(curve) else None
    if high is None or low is None:
        return last
    share, other = (high - enough) / (high - low), curve[outside].value
    return last * (other / last) ** share if logarithmic else last + share * (other - last)


def keeps_most(curve: Sequence[Stop], standard: Standard) -> Stop | None:
    """Of a strip along the exposure: the one to use, by the rule that answers runs. None where nothing was tried."""
    tried, values = _tried(curve, standard)
    place = best_exposure([stop.value for stop in tried], values) if tried else None
    return None if place is None else tried[place]


def finer(curve: Sequence[Stop], standard: Standard) -> float | None:
    """The exposure to try next: where those that keep most may end, in their middle, or where a window ends. None:
    they are known to a quarter of a stop."""
    tried, values = _tried(curve, standard)
    if not tried:
        return None
    best = _finer_best(tried, values)
    return _finer_end(tried, standard.enough) if best is None else best


def _finer_end(tried: Sequence[Stop], enough: float) -> float | None:
    """In the widest gap in which a window ends."""
    ends = [pair for low, high in _windows(tried, enough) for pair in ((low - 1, low), (high, high + 1))]
    gaps = [(tried[a].value, tried[b].value) for a, b in ends if a >= 0 and b < len(tried)]
    low_ms, high_ms = max(gaps, key=lambda gap: gap[1] / gap[0], default=(1.0, 1.0))
    return None if high_ms / low_ms <= _FINEST * _ROUNDED else float(f"{math.sqrt(low_ms * high_ms):.3g}")


def _finer_best(tried: Sequence[Stop], values: NDArray[np.float64]) -> float | None:
    """About those that keep most, or in their middle."""
    low = high = int(values.argmax())
    near = values >= values[low] - NEAR
    while low > 0 and near[low - 1]:
        low -= 1
    while high + 1 < len(tried) and near[high + 1]:
        high += 1
    at = [stop.value for stop in tried]
    ends = [(at[place], at[place + 1]) for place in (low - 1, high) if 0 <= place < len(tried) - 1]
    widest = max(ends, key=lambda end: end[1] / end[0], default=(1.0, 1.0))
    if widest[1] / widest[0] > _FINEST:
        return float(f"{math.sqrt(math.prod(widest)):.3g}")
    middle = math.sqrt(at[low] * at[high])
    known = min(max(value / middle, middle / value) for value in at) <= math.sqrt(_FINEST)
    return None if known else float(f"{middle:.3g}")


def _tried(curve: Sequence[Stop], standard: Standard) -> tuple[list[Stop], NDArray[np.float64]]:
    """What was tried, and its values, 0 where a saturated picture is passed over."""
    tried = [(stop, stop.mean) for stop in curve if stop.mean is not None]
    values = [standard.value(mean) for _, mean in tried]
    saturated = [stop.saturated for stop, _ in tried]
    stops = [stop for stop, _ in tried]
    return stops, without_saturated(values, saturated, standard.criterion.level) if stops else np.empty(0)


def _score(criterion: Criterion, row: dict[str, Any]) -> float:
    if criterion.score == MATCHES:
        return float(row["text"] == row["truth"])
    return float(row["confidence"])
