"""Answers that motion cannot improve: a table pooled over speeds, and curves whose intervals follow.

Domain: velocities px/s. On average a detector finds no more in a picture that moves faster in the same direction, so
where a mean rises with speed it is the noise of few pictures. Those speeds are pooled: isotonic regression by pool
adjacent violators, weighted by what was counted, on the tree whose root is rest and whose branches are directions
(Robertson, Wright and Dykstra, Order Restricted Statistical Inference, 1988, section 2.3). Each cluster is pooled
alike, so that intervals are those of the pooled means.

It holds for pictures that move as a whole. Where only targets or only the background move, where the camera drives,
or along a trajectory, a speed may undo another motion, and nothing is pooled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.curves import ScoreCurve
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.scoring.uncertainty import Ends

Array = NDArray[np.float64]
Velocity = tuple[float, float]
_SAME = 1e-6  # of an exposure by which it is the same
_UNIFORM = ("moves", "ego_speed_m_s")  # axes that must be 0 for the picture to move as a whole


def is_uniform(setting: ScoreTable) -> bool:
    """Whether the pictures of one setting move as a whole, at several speeds."""
    moves_apart = any(setting.conditions[name].any() for name in _UNIFORM)
    return len(set(setting.velocities_px_s)) > 1 and not moves_apart


def pooled(setting: ScoreTable) -> ScoreTable:
    """One setting with sums and counts pooled over speeds, so that its mean never rises with speed.

    Directions are not compared with each other; rest belongs to each.
    """
    # By what was counted, as isotonic regression needs: a mean of few pictures yields to one of many.
    weight, velocities = setting.counts.sum(axis=0), setting.velocities_px_s
    sums, counts = setting.sums.copy(), setting.counts.copy()
    exposures = setting.conditions["exposure_s"]
    for exposure_s in np.unique(exposures):
        here = np.flatnonzero((exposures == exposure_s) & setting.measured)
        branches, root = _branches([velocities[index] for index in here])
        for block in _blocks(setting.mean[here], weight[here], branches, root):
            for values in (sums, counts):
                values[:, here[block]] = values[:, here[block]].mean(axis=1, keepdims=True)
    return replace(setting, sums=sums, counts=counts)


def nested(curves: Sequence[ScoreCurve], velocities: Sequence[Velocity]) -> list[ScoreCurve]:
    """The curves of a pooled table, one for each velocity, with intervals that never rise with speed: what surely
    works at one speed does at all slower ones of its direction, and what surely fails does at all faster ones.

    They are compared at the exposures that they share, and between two of these where neither has another.
    """
    nested_curves = []
    for curve, velocity in zip(curves, velocities, strict=True):
        low, high = [curve.ends.low], [curve.ends.high]
        for other, its_velocity in zip(curves, velocities, strict=True):
            if is_faster(its_velocity, velocity):
                low.append(_shared(other, other.ends.low, curve))
            elif is_faster(velocity, its_velocity):
                high.append(_shared(other, other.ends.high, curve))
        # Only where the curve has an interval of its own: others narrow it, and never make one.
        known = np.isfinite(curve.ends.low)
        ends = np.fmax.reduce(low), np.fmin.reduce(high)
        nested_curves.append(replace(curve, given=Ends(*(np.where(known, end, np.nan) for end in ends))))
    return nested_curves


def is_faster(one: Velocity, other: Velocity) -> bool:
    """Whether one velocity is faster than another of its direction, or than rest.

    >>> is_faster((200.0, 0.0), (100.0, 0.0)), is_faster((200.0, 0.0), (0.0, 100.0))
    (True, False)
    """
    faster = math.hypot(*one) > math.hypot(*other)
    return faster and (not any(other) or _direction(one) == _direction(other))


def _shared(other: ScoreCurve, end: Array, curve: ScoreCurve) -> Array:
    """The end of another curve's interval where this one's is known; NaN where the other's is not."""
    if other.x == curve.x:
        return end
    index = np.searchsorted(other.fine, curve.fine * (1 - _SAME)).clip(max=len(other.fine) - 1)
    return np.where(np.abs(other.fine[index] - curve.fine) <= _SAME * curve.fine, end[index], np.nan)


def _direction(velocity: Velocity) -> float:
    return round(math.atan2(velocity[1], velocity[0]), 9)


def _branches(velocities: Sequence[Velocity]) -> tuple[list[list[int]], list[int]]:
    """Places of the velocities of each direction, by increasing speed, and that of rest, if it is there."""
    directions: dict[float, list[int]] = {}
    for v in sorted(range(len(velocities)), key=lambda v: math.hypot(*velocities[v])):
        if any(velocities[v]):
            directions.setdefault(_direction(velocities[v]), []).append(v)
    return list(directions.values()) or [[]], [v for v, each in enumerate(velocities) if not any(each)]


def _blocks(mean: Array, weight: Array, branches: Sequence[list[int]], root: list[int]) -> list[list[int]]:
    """Places to be pooled, each block of two or more."""

    def of(block: list[int]) -> float:
        return float(mean[block] @ weight[block] / weight[block].sum())

    chains: list[list[list[int]]] = []
    for branch in branches:
        chain: list[list[int]] = []
        for v in branch:
            chain.append([v])
            while len(chain) > 1 and of(chain[-1]) > of(chain[-2]):
                last = chain.pop()
                chain[-1] = chain[-1] + last
        chains.append(chain)
    rest = list(root)
    while rest and (left := [chain for chain in chains if chain]):
        best = max(left, key=lambda chain: of(chain[0]))
        if of(best[0]) <= of(rest):
            break
        rest += best.pop(0)
    return [block for block in (rest, *(each for chain in chains for each in chain)) if len(block) > 1]
