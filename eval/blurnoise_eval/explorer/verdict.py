"""Verdicts of one picture: how much of its confidence a detector keeps, and at which exposures that is enough.

Domain: confidences 0 to 1, of each target; exposures in ms, as the page shows them. The rules are those of a run's
answers: its criterion, the ends of its windows, and the exposure that it recommends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from blurnoise_eval.answers.choosing import best_exposure, without_saturated
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import ModelOutput


def mean_confidence(output: ModelOutput) -> float:
    """Over the targets; 0 without any."""
    return sum(row.confidence for row in output.targets) / max(1, len(output.targets))


@dataclass(frozen=True)
class Standard:
    """A criterion applied to one picture.

    level: the least confidence that is enough, in units of ``unit``. kept: the level is a share of the mean
    confidence in the original picture, ``unit``; else the unit is 1. counted: ids of the targets that count, which
    are those found in the original picture if ``kept``.
    """

    level: float
    kept: bool
    unit: float
    counted: frozenset[int]

    @classmethod
    def of(cls, criterion: Criterion, clean: ModelOutput) -> Standard:
        """The standard of a picture; ``clean`` is the detector's output for the original."""
        # No exposure can keep what the original does not have: such a target would hide what the camera changes.
        least = FOUND_SCORE if criterion.kept else 0.0
        rows = tuple(row for row in clean.targets if row.confidence >= least)
        unit = mean_confidence(clean._replace(targets=rows)) if criterion.kept else 1.0
        return cls(criterion.level, criterion.kept, unit, frozenset(row.target_id for row in rows))

    @property
    def required(self) -> float:
        """The least mean confidence that is enough."""
        return self.level * self.unit

    def of_counted(self, output: ModelOutput) -> ModelOutput:
        """An output with the targets that count."""
        return output._replace(targets=tuple(row for row in output.targets if row.target_id in self.counted))

    def text(self, mean: float) -> str:
        """A mean confidence in the unit of the criterion.

        >>> Standard(0.9, True, 0.8, frozenset()).text(0.6)
        '75 %'
        """
        return f"{100 * mean / self.unit:.0f} %" if self.kept else f"{mean:.2f}"

    def verdict(self, output: ModelOutput) -> tuple[bool, str]:
        """Whether the detector works on a picture, and a sentence on it."""
        if output.error:
            return False, f"The model failed on this picture: {output.error[:160]}"
        if not output.targets:
            return (
                False,
                "No score, as the model finds nothing in the original picture. Choose another model.",
            )
        mean = mean_confidence(output)
        hits = sum(row.confidence >= FOUND_SCORE for row in output.targets)
        text = f"Mean confidence {mean:.2f}"
        if self.kept:
            text = (
                f"Keeps {self.text(mean)} of its confidence in the original ({mean:.2f} of {self.unit:.2f})"
            )
        good = mean >= self.required
        required = "" if good else f"; required: {self.text(self.required)}"
        return good, f"{text}, {hits} of {len(output.targets)} found{required}."


class Point(NamedTuple):
    """The mean confidence at an exposure, and the share of the picture's pixels that is saturated."""

    exposure_ms: float
    mean: float
    saturated: float = 0.0


def window(curve: Sequence[Point], required: float, at_ms: float) -> tuple[float, float] | None:
    """The exposures at which the mean is enough: the window around ``at_ms``, else the widest; None without any.

    >>> window([Point(1.0, 0.9), Point(4.0, 0.8), Point(16.0, 0.2)], required=0.8, at_ms=4.0)
    (1.0, 4.0)
    """
    every = windows([point.exposure_ms for point in curve], [point.mean for point in curve], required)
    around = [ends for ends in every if ends[0] <= at_ms <= ends[1]]
    return next(iter(around or sorted(every, key=lambda ends: ends[0] - ends[1])), None)


def window_sentence(curve: Sequence[Point], at_ms: float, standard: Standard) -> str:
    """The window, and the exposure that keeps most by the rule that recommends a run's."""
    values = [point.mean / standard.unit for point in curve]
    unsaturated = without_saturated(values, [point.saturated for point in curve], standard.level)
    best = curve[best_exposure([point.exposure_ms for point in curve], unsaturated) or 0]
    most = f"best: {standard.text(best.mean)} at {best.exposure_ms:g} ms"
    ends, level = window(curve, standard.required, at_ms), standard.text(standard.required)
    if ends is None:
        return f"Exposure: none of the {len(curve)} tested values reaches {level}; {most}."
    low, high = (f"{float(f'{end:.2g}'):g}" for end in ends)
    words = [f"from about {low}"] if ends[0] > curve[0].exposure_ms else []
    words += [f"{'to' if words else 'up to about'} {high}"] if ends[1] < curve[-1].exposure_ms else []
    where = f"{' '.join(words)} ms" if words else "at every tested value"
    here = "" if ends[0] <= at_ms <= ends[1] else ", not here"
    return f"Exposure: {level} or more {where}{here}; {most}."
