"""Objects followed over exposure: their confidences, and the exposure at which these fall to half.

Domain: exposures in EV, rising; boxes (x0, y0, x1, y1) px. An object is a box and a class of a detector.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import isotonic_regression

from blurnoise._core import rng
from blurnoise.metrics.values import Estimate
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import MATCH_IOU, target_confidences

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Side = Literal["dark", "bright"]
SIDES: tuple[Side, ...] = ("dark", "bright")
FOUND, SEEN = 0.3, 2
"""Score that an object must have, and in how many pictures."""
FEW = 5
"""Things, below which an interval says little."""
_RESAMPLES = 2000


class Object(NamedTuple):
    """What a detector found: the class, its number, and the box where it was surest. thing: the number of the place
    in the picture, which objects share that overlap: one thing may be called a chair and a couch."""

    label: str
    class_id: int
    box_xyxy: tuple[float, float, float, float]
    thing: int


class Half(NamedTuple):
    """Where a confidence crosses a level, EV; reached: whether it does within the exposures, else ``stops`` is the
    last of them on that side."""

    stops: float
    reached: bool


def objects(found: Sequence[Detections], classes: Sequence[str]) -> tuple[list[Object], int]:
    """Objects that the detections of several pictures show, surest first; and how many were found only once.

    A detection from ``FOUND`` on is an object unless it overlaps a surer one of its class (IoU >= 0.5).

    >>> box = [[0.0, 0.0, 9.0, 9.0]]
    >>> objects([Detections(box, [0.9], [0]), Detections(box, [0.4], [0])], ["car"])
    ([Object(label='car', class_id=0, box_xyxy=(0.0, 0.0, 9.0, 9.0), thing=0)], 0)
    """
    leading = [detections.leading for detections in found]
    every = sorted(
        (-float(score), place, index)
        for place, detections in enumerate(leading)
        for index, score in enumerate(detections.scores)
        if score >= FOUND
    )
    chosen = list[Object]()
    for _, place, index in every:
        box, class_id = leading[place].boxes_xyxy[index], int(leading[place].class_ids[index])
        near = [one for one in chosen if iou([box], [one.box_xyxy])[0, 0] >= MATCH_IOU]
        if all(one.class_id != class_id for one in near):
            thing = near[0].thing if near else len(chosen)
            corners: Any = tuple(map(float, box))
            chosen.append(Object(classes[class_id], class_id, corners, thing))
    seen = (confidences(found, chosen) >= FOUND).sum(0)
    return [one for one, count in zip(chosen, seen, strict=True) if count >= SEEN], int((seen < SEEN).sum())


def confidences(found: Sequence[Detections], followed: Sequence[Object]) -> Array:
    """Confidence of each object in each picture, (pictures, objects); 0 where it is not found."""
    boxes, ids = [one.box_xyxy for one in followed], [one.class_id for one in followed]
    rows = [target_confidences(detections, boxes, ids) for detections in found]
    return np.asarray(rows, np.float64).reshape(len(found), len(followed))


def half(stops: ArrayLike, values: ArrayLike, level: float, side: Side) -> Half | None:
    """Where confidence falls to ``level`` on a side of its largest value; None where it is below it everywhere.

    Confidence rises to its largest value and falls from there (isotonic regression); it is straight in between.

    >>> half([0, 1, 2, 3], [0.0, 0.2, 0.8, 0.8], 0.5, "dark")
    Half(stops=1.5, reached=True)
    >>> half([0, 1, 2, 3], [0.0, 0.2, 0.8, 0.8], 0.5, "bright")
    Half(stops=3.0, reached=False)
    """
    at, confidence = np.asarray(stops, float), np.asarray(values, float)
    if side == "bright":  # the same from the other end
        mirrored = half(-at[::-1], confidence[::-1], level, "dark")
        return mirrored and Half(-mirrored.stops + 0.0, mirrored.reached)
    # The last of the largest, so that a plateau belongs to both sides.
    peak = len(confidence) - 1 - int(confidence[::-1].argmax())
    if confidence[peak] < level:
        return None
    rising = isotonic_regression(confidence[: peak + 1]).x
    if rising[0] >= level:
        return Half(float(at[0]), False)
    above = int(np.argmax(rising >= level)) if (rising >= level).any() else peak
    share = (level - rising[above - 1]) / max(rising[above] - rising[above - 1], 1e-12)
    return Half(float(at[above - 1] + min(1.0, share) * (at[above] - at[above - 1])), True)


def shifts(stops: ArrayLike, captured: Array, simulated: Array, side: Side) -> tuple[Array, Flags]:
    """Simulated less captured exposure at half of the captured confidence's largest value, EV, for each object.

    captured, simulated: (pictures, objects). NaN for objects that do not fall to half in the captured pictures. One
    that does not in the simulated ones counts with the last exposure, one that they never show with that of the
    other end; the second array says which these are.
    """
    at, count = np.asarray(stops, float), captured.shape[1]
    found, beyond = np.full(count, np.nan), np.zeros(count, bool)
    for place in range(count):
        level = captured[:, place].max() / 2
        real = half(at, captured[:, place], level, side) if level > 0 else None
        if real is not None and real.reached:
            model = half(at, simulated[:, place], level, side)
            model = model or Half(float(at[-1 if side == "dark" else 0]), False)
            found[place], beyond[place] = model.stops - real.stops, not model.reached
    return found, beyond


def median(values: ArrayLike, things: Sequence[object], seed: int = 0) -> Estimate:
    """The median with its 95 % interval, by drawing things again, all values of each (bootstrap).

    NaN is left out. No interval for fewer than three things.

    >>> median([0.1, 0.2, 0.6], things="abc")
    Estimate(value=0.2, low=0.1, high=0.6, flags=frozenset())
    """
    every = np.asarray(values, float)
    order = np.argsort(every)
    order = order[np.isfinite(every[order])]
    if not len(order):
        return Estimate(math.nan)
    each, names = every[order], dict.fromkeys(things[index] for index in order)
    middle = float(np.median(each))
    if len(names) < 3:
        return Estimate(middle)
    of = np.array([list(names).index(things[index]) for index in order])
    random = np.random.default_rng(rng.derived(seed, "objects"))
    drawn = random.multinomial(len(names), np.full(len(names), 1 / len(names)), _RESAMPLES)
    # how often each value is drawn, and the values in the middle of all that are
    reached = drawn[:, of].cumsum(1)
    total = reached[:, -1:]
    low, high = (each[(reached >= place).argmax(1)] for place in ((total + 1) // 2, total // 2 + 1))
    ends = np.quantile((low + high) / 2, (0.025, 0.975))
    return Estimate(middle, float(ends[0]), float(ends[1]))
