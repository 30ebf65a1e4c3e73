"""The numbers that sum up an arm of a comparison, and how sure they and their differences are.

Scores are arrays (designs, arms, conditions): the first design is what was measured, the others leave a picture out
or take one seed alone (:func:`designs`). The first condition is the clean picture. AP50 and confidence lie in [0, 1];
false positives are per picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.scoring.estimates import MOST_CLUSTERS
from blurnoise_eval.scoring.matching import FailurePoint, failure_point, mean_over

Array = NDArray[np.float64]
Scores = Mapping[str, Array]
Seen = Sequence[Conditions | None]
Outcome = Literal["better", "worse", "undecided"]

MOVING = (20e-3, 50.0)
"""Exposure, s, and light, lux, of the curves over blur: along them only the speed changes."""
THRESHOLD = 0.5
"""A detection counts as false, and a curve as failed, from this confidence (or precision) on."""
FAILS = {"ap50": "blur where AP50 fails / px", "confidence": "blur where confidence fails / px"}
"""The names of the measures that are failure points, by score."""
_NOTHING = 12  # decimals beyond which a difference is rounding


class Interval(NamedTuple):
    """An estimate with its 95 % interval; None where there is nothing to estimate it from."""

    value: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Measure:
    """One number that sums up an arm. of: from scores to (designs, arms).

    verdict: its words in the verdict, None where it has no say there.
    """

    name: str
    of: Callable[[Scores], Array]
    verdict: str | None = None
    higher_is_better: bool = True

    def outcome(self, difference: Interval) -> Outcome:
        """What a difference means for the arm from which the other was taken: decided where 0 is left out."""
        _, low, high = difference
        if low is None or high is None or low <= 0 <= high:
            return "undecided"
        return "better" if (low > 0) == self.higher_is_better else "worse"


def measures(conditions: Seen) -> list[Measure]:
    """Everything that is summed up and compared, for these conditions, the clean one first."""
    moving = moving_px(conditions)
    exposure_s, moving_lux = MOVING
    lights = sorted({at.illuminance_lux for at in conditions if at is not None})
    found = [
        Measure("AP50, clean (P)", _clean("ap50"), "clean pictures"),
        Measure("AP50, all conditions (mPC)", _every("ap50"), "all conditions"),
        Measure("rPC = mPC / P", _relative),
        Measure(
            "AP50 over blur",
            _over(moving, "ap50"),
            f"motion at {1e3 * exposure_s:g} ms and {moving_lux:g} lux",
        ),
    ]
    for lux in lights:
        words = f"{lux:g} lux at rest" if lux in (lights[0], lights[-1]) else None
        found.append(
            Measure(f"AP50 at rest, {lux:g} lux", _over(resting_log_s(conditions, lux), "ap50"), words)
        )
    found += [
        Measure("confidence, clean", _clean("confidence")),
        Measure("confidence, all conditions", _every("confidence")),
        Measure("confidence over blur", _over(moving, "confidence")),
    ]
    found += [
        Measure(f"confidence at rest, {lux:g} lux", _over(resting_log_s(conditions, lux), "confidence"))
        for lux in lights
    ]
    found += [Measure(name, _failing(moving, score)) for score, name in FAILS.items()]
    found += [
        Measure("false positives, clean", _clean("false_positives"), None, False),
        Measure("false positives, all conditions", _every("false_positives"), "false positives", False),
    ]
    return found


def moving_px(conditions: Seen) -> dict[int, float]:
    """Blur, px, of the conditions at ``MOVING``, increasing, by their place among all."""
    return _increasing(
        {
            place: at.blur_px
            for place, at in enumerate(conditions)
            if at is not None and (at.exposure_s, at.illuminance_lux) == MOVING
        }
    )


def resting_log_s(conditions: Seen, lux: float) -> dict[int, float]:
    """Decadic logarithm of the exposures in s at rest in this light, increasing, by their place among all."""
    return _increasing(
        {
            place: math.log10(at.exposure_s)
            for place, at in enumerate(conditions)
            if at is not None and at.illuminance_lux == lux and at.blur_px == 0
        }
    )


def failure(curve: Array, moving: Mapping[int, float]) -> FailurePoint:
    """Where scores by condition (conditions,) fail over blur, px."""
    return failure_point(list(moving.values()), curve[list(moving)].tolist(), THRESHOLD)


def designs(pictures: int, arms: int, seeds: int) -> tuple[Array, Array]:
    """Weights of pictures (1 + P + S, P) and of seeds (1 + P + S, arms, S), for S = seeds.

    First all alike; then each picture left out in turn, the same for every network and condition, so that arms
    are compared on the same pictures; then each seed alone. What they say together: :func:`interval`. Above
    ``MOST_CLUSTERS`` pictures as many groups of them are left out.
    """
    groups = min(pictures, MOST_CLUSTERS)
    left = (np.arange(pictures) % groups != np.arange(groups)[:, None]).astype(float)
    of_pictures = np.concatenate([np.ones((1, pictures)), left, np.ones((seeds, pictures))])
    shared = np.full((1 + groups, arms, seeds), 1 / seeds)
    alone = np.repeat(np.eye(seeds)[:, None], arms, axis=1)
    return of_pictures, np.concatenate([shared, alone])


def interval(values: Array, seeds: int, rival: Array | None = None) -> Interval:
    """The first value, or what it is above a rival's, with a 95 % interval over pictures and seeds.

    values: (1 + P + S,) by the designs of :func:`designs`. Variances of the mean over pictures (jackknife) and
    over seeds (of each arm on its own: their trainings are independent) are added; Student's t has the degrees
    of freedom of the sum (Satterthwaite, Biometrics Bull. 2 (1946) 110), since three seeds tell little of their
    spread. With one seed it says nothing about other trainings. None below two pictures with a target.
    """
    from scipy.special import stdtrit  # takes 0.1 s

    both = [values] if rival is None else [values, rival]
    whole = float(np.round(values[0] - (0.0 if rival is None else rival[0]), _NOTHING)) + 0.0  # no -0.0
    left = values - (0.0 if rival is None else rival)
    out = left[1 : len(left) - seeds]
    out = out[np.isfinite(out)]
    n = len(out)
    if not math.isfinite(whole) or n < 2:
        return Interval(None, None, None)
    variances = [(n - 1) / n * float(((out - out.mean()) ** 2).sum())]
    freedoms = [n - 1.0]
    if seeds > 1:
        variances += [float(np.var(arm[-seeds:], ddof=1)) / seeds for arm in both]
        freedoms += [seeds - 1.0] * len(both)
    total = sum(variances)
    if not math.isfinite(total) or math.sqrt(total) < 10.0**-_NOTHING:
        return Interval(whole, whole, whole)
    freedom = total**2 / sum(part**2 / count for part, count in zip(variances, freedoms, strict=True))
    half = float(stdtrit(freedom, 0.975)) * math.sqrt(total)
    return Interval(whole, whole - half, whole + half)


def _clean(score: str) -> Callable[[Scores], Array]:
    return lambda scores: scores[score][..., 0]


def _every(score: str) -> Callable[[Scores], Array]:
    def mean(scores: Scores) -> Array:
        return np.asarray(scores[score][..., 1:].mean(axis=-1))

    return mean


def _relative(scores: Scores) -> Array:
    clean, every = _clean("ap50")(scores), _every("ap50")(scores)
    return np.divide(every, clean, out=np.full_like(every, np.nan), where=clean > 0)


def _over(places: Mapping[int, float], score: str) -> Callable[[Scores], Array]:
    return lambda scores: mean_over(list(places.values()), scores[score][..., list(places)])


def _failing(places: Mapping[int, float], score: str) -> Callable[[Scores], Array]:
    """Failure points; a curve that does not fail counts with the longest blur tested, which understates it."""

    def fails(curve: Array) -> float:
        at = failure(curve, places).at
        return max(places.values()) if at is None else at

    def of(scores: Scores) -> Array:
        return np.asarray(np.apply_along_axis(fails, -1, scores[score]), float)

    return of


def _increasing(places: dict[int, float]) -> dict[int, float]:
    return dict(sorted(places.items(), key=lambda place: place[1]))
