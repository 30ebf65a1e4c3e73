"""What a simulation is worth, by brackets: differences of confidence, and exposures at half confidence.

A route is what the simulated pictures are made of: the bracket itself, or one photograph with the defaults.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurnoise.camera import Camera
from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.bracket import Bytes, Shot
from blurnoise_eval.measure import followed
from blurnoise_eval.measure.bracket_scene import MergedScene
from blurnoise_eval.measure.followed import SIDES, Array, Flags, Object, Side

BRACKET, DEFAULTS = "bracket", "defaults"
"""What the simulated pictures are made of."""
ROUTES = (BRACKET, DEFAULTS)
COUNTED = 0.1
"""Confidence, captured or simulated, from which on an object's picture counts in the mean difference."""


@dataclass(frozen=True)
class Curves:
    """Confidences (pictures, objects) of one model in captured pictures and, by route, in simulated ones."""

    model: str
    objects: Sequence[Object]
    captured: Array
    simulated: Mapping[str, Array]
    found_once: int


@dataclass(frozen=True)
class BracketTrial:
    """One bracket: its shots, captured pictures and, by route, simulated ones, measures and confidences.

    compared: by route, which pictures count (P,). rows: a row for each picture, route and measure. camera: of the
    bracket's route, with the tone of all pictures at rest; tone: how it was measured. scene: merged from them.
    """

    name: str
    shots: Sequence[Shot]
    captured: Sequence[Bytes]
    simulated: Mapping[str, Sequence[Bytes]]
    compared: Mapping[str, Sequence[bool]]
    rows: Sequence[Mapping[str, Any]]
    curves: Sequence[Curves]
    camera: Camera
    tone: str
    scene: MergedScene
    notes: Sequence[str]

    @property
    def stops(self) -> Array:
        """Exposures in EV, 0 at the reference."""
        return np.array([shot.stops - self.scene.reference.stops for shot in self.shots])

    def used(self, route: str, *, moving: bool = False) -> Flags:
        """Which pictures a route is compared by, of a scene at rest or in motion."""
        return np.array(
            [c and shot.moving == moving for c, shot in zip(self.compared[route], self.shots, strict=True)]
        )

    def counted(self, curves: Curves, route: str, *, moving: bool = False) -> Array:
        """Simulated less captured confidences of a route, where either is at least ``COUNTED``."""
        used = self.used(route, moving=moving)
        real, model = curves.captured[used], curves.simulated[route][used]
        return (model - real)[np.maximum(real, model) >= COUNTED]

    def shifts(self, curves: Curves, route: str, side: Side) -> tuple[Array, Flags]:
        """Of objects, at half confidence, EV, NaN for none; and which are beyond the exposures."""
        used = self.used(route)
        return followed.shifts(self.stops[used], curves.captured[used], curves.simulated[route][used], side)

    def largest(self, measure: str, route: str) -> float:
        """Largest difference of a measure over the pictures that count, absolute."""
        rows = [
            row
            for row in self.rows
            if row["measure"] == measure and row["route"] == route and row["compared"]
        ]
        return float(np.nanmax([abs(row["simulated"] - row["captured"]) for row in rows], initial=0.0))


@dataclass(frozen=True)
class Worth:
    """What a route is worth over brackets: mean difference of confidences, absolute and signed, and of pictures in
    motion; by side the median shift, EV, of how many objects and things, and how many objects are beyond the
    exposures. NaN where nothing is known."""

    difference: float
    bias: float
    in_motion: float
    shift: Mapping[Side, Estimate]
    objects: Mapping[Side, int]
    things: Mapping[Side, int]
    beyond: Mapping[Side, int]


def worth(trials: Sequence[BracketTrial], model: str, route: str) -> Worth:
    """Of all brackets together; intervals over the things in them."""
    every = [(trial, curves) for trial in trials for curves in trial.curves if curves.model == model]
    apart, moving = (
        np.concatenate([np.zeros(0), *(trial.counted(curves, route, moving=each) for trial, curves in every)])
        for each in (False, True)
    )
    means: list[float] = [float(x.mean()) if len(x) else math.nan for x in (abs(apart), apart, abs(moving))]
    things = [(place, one.thing) for place, (_, curves) in enumerate(every) for one in curves.objects]
    found: dict[str, Any] = {name: {} for name in ("shift", "objects", "things", "beyond")}
    for side in SIDES:
        shifts = [trial.shifts(curves, route, side) for trial, curves in every]
        values = np.concatenate([np.zeros(0), *(some for some, _ in shifts)])
        found["shift"][side] = followed.median(values, things)
        found["objects"][side] = int(np.isfinite(values).sum())
        known = [thing for thing, value in zip(things, values, strict=True) if np.isfinite(value)]
        found["things"][side] = len({*known})
        found["beyond"][side] = int(sum(beyond.sum() for _, beyond in shifts))
    return Worth(means[0], means[1], means[2], **found)
