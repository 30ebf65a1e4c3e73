"""What an exposure program is made for: how a model does at any light and exposure of a scenario, within limits.

Domain: lux, s, dB; values in the criterion's unit. Nothing is said of places that the run has not tested.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import places_of
from blurnoise_eval.deciding.predicted import CAUTION, At, Predicted
from blurnoise_eval.program.inputs import Inputs
from blurnoise_eval.program.limits import Limits
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.program.stages import Stages
from blurnoise_eval.scoring.estimates import influence, ratio_of_sums
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]


class Schedule(NamedTuple):
    """Exposures and gains over the scenario's lights, (L,) each; lacks_gain: whether the gain's limit is reached;
    values: the objective, None where it was not tested. value: their mean; worst_speed: the least mean of a speed
    over the lights; worst_light: the least of a light."""

    exposures_s: tuple[float, ...]
    gains_db: tuple[float, ...]
    lacks_gain: tuple[bool, ...]
    values: tuple[float | None, ...]
    value: float | None
    worst_speed: float | None
    worst_light: float | None


class Uncertain(NamedTuple):
    """The objective (M,), the influence of each cluster on it (C, M), and the covariance (M, M) of the surfaces'
    prediction, ``CAUTION`` times as wide as they have it."""

    objective: Array
    influence: Array
    prediction_cov: Array


@dataclass(frozen=True, eq=False)
class Problem:
    """A run's planes and metering, the scenario of a program, and its limits. Pairs are of light and exposure, (M,)
    each; K cases, L lights, S exposures."""

    inputs: Inputs
    scenario: Scenario
    limits: Limits

    @property
    def lights_lux(self) -> tuple[float, ...]:
        """The scenario's, (L,)."""
        return self.scenario.lights_lux

    @cached_property
    def clusters(self) -> tuple[str, ...]:
        """Of all targets."""
        return tuple(dict.fromkeys(cluster for plane in self._planes for cluster in plane.clusters))

    @cached_property
    def times_s(self) -> tuple[float, ...]:
        """Allowed exposures that were asked for, and tested at some light, rising, (S,)."""
        (low, _), (high, _) = self._range
        asked_s = self.inputs.exposures_s
        shortest_s = max(float(low / self.lights_lux[-1]), asked_s[0])
        return self.limits.candidates(shortest_s, min(float(high / self.lights_lux[0]), asked_s[1]))

    def at(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> tuple[Array, Array]:
        """Values at pairs: (K, M) of the cases, NaN outside what was tested; (M,) of the objective."""
        cases = np.array([ratio_of_sums(*each) for each in self.predicted(lights_lux, exposures_s)])
        return cases, np.asarray((self.scenario.weights(cases) * cases).sum(axis=0))

    def objective(self, times_s: Sequence[float]) -> Array:
        """(L, S) of these exposures, NaN where it was not tested or the gain is not allowed."""
        shape = len(self.lights_lux), len(times_s)
        _, values = self.at(np.repeat(self.lights_lux, shape[1]), np.tile(times_s, shape[0]))
        allowed = self.gains_db(times_s) <= self.limits.most_gain_db + 1e-9
        return np.where(allowed, values.reshape(shape), np.nan)

    def gains_db(self, times_s: Sequence[float]) -> Array:
        """(L, S)."""
        gain_db = self.inputs.metering.gain_db
        return np.array([[gain_db(lux, time) for time in times_s] for lux in self.lights_lux])

    def taken_s(self, stages: Stages, light_lux: float) -> float:
        """The exposure that stages give at a light, in whole periods and lines if so limited."""
        return self.limits.settled(stages.divided(self.inputs.metering.total_s(light_lux))[0])

    def schedule(self, exposures_s: Sequence[float]) -> Schedule:
        """What these exposures do, one at each light, with the camera's gain."""
        cases, values = self.at(self.lights_lux, exposures_s)
        known = bool(np.isfinite(values).all())
        by_speed = cases.mean(axis=1).reshape(len(self.scenario.speeds_px_s), -1)
        of_speeds = np.average(by_speed, axis=1, weights=list(self.scenario.targets.values()))
        pairs = list(zip(self.lights_lux, exposures_s, strict=True))
        return Schedule(
            exposures_s=tuple(float(exposure) for exposure in exposures_s),
            gains_db=tuple(self.inputs.metering.gain_db(*pair) for pair in pairs),
            lacks_gain=tuple(self.inputs.metering.lacks_gain(*pair) for pair in pairs),
            values=tuple(map(finite, values)),
            value=float(values.mean()) if known else None,
            worst_speed=float(of_speeds.min()) if known else None,
            worst_light=float(values.min()) if known else None,
        )

    def uncertain(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> Uncertain:
        """At pairs; the influence's standard deviation by the root of C is the objective's error."""
        cases, objective = self.at(lights_lux, exposures_s)
        weights = np.nan_to_num(self.scenario.weights(cases))
        place = {cluster: index for index, cluster in enumerate(self.clusters)}
        total = np.zeros((len(place), len(objective)))
        there = self.predicted(lights_lux, exposures_s)
        for weight, (_, target), of_case in zip(weights, self.scenario.cases, there, strict=True):
            own = influence(*of_case)
            known = np.maximum(np.isfinite(own).sum(axis=0), 1)
            rows = [place[cluster] for cluster in self.inputs.planes[target].clusters]
            total[rows] += weight * np.nan_to_num(own) * len(place) / known
        cov = np.zeros((len(objective),) * 2)
        for target, plane in self.inputs.planes.items():  # the cases of one plane together
            of = [k for k, (_, each) in enumerate(self.scenario.cases) if each == target]
            if not of:
                continue
            speeds = [self.scenario.cases[k][0] for k in of]
            at = np.concatenate([places_of(exposures_s, lights_lux, speed) for speed in speeds])
            of_cases = weights[of].ravel()[:, None] * plane.surface.covariance(at) * weights[of].ravel()
            cov += of_cases.reshape(len(of), len(cov), len(of), len(cov)).sum(axis=(0, 2))
        return Uncertain(objective, total, CAUTION**2 * cov)

    @property
    def most(self) -> float:
        """The greatest value of the objective."""
        return sum(share * self.inputs.planes[target].most for target, share in self.scenario.targets.items())

    def tested(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> NDArray[np.bool_]:
        """Whether each case was tested at pairs, (K, M)."""
        places = (
            (target, places_of(exposures_s, lights_lux, speed)) for speed, target in self.scenario.cases
        )
        return np.array([self.inputs.planes[target].inside(at) for target, at in places])

    @property
    def _range(self) -> tuple[Array, Array]:
        """The least and the greatest light times exposure, lux s, and motion, px, of all planes."""
        low = np.max([plane.places.min(axis=0) for plane in self._planes], axis=0)
        high = np.min([plane.places.max(axis=0) for plane in self._planes], axis=0)
        return np.exp2(low), np.exp2(high)

    @property
    def range_text(self) -> str:
        """What was tested: 'the run tells of light x exposure ... lux s, motion ... px'."""
        (light_low, motion_low), (light_high, motion_high) = self._range
        return (
            f"the run tells of light x exposure {light_low:.3g} to {light_high:.3g} lux s, "
            f"motion {motion_low:.3g} to {motion_high:.3g} px"
        )

    @property
    def _planes(self) -> list[Predicted]:
        return [self.inputs.planes[target] for target in self.scenario.targets]

    def predicted(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> list[At]:
        """Of each case the planes' prediction, NaN outside what was tested."""
        found = []
        for speed, target in self.scenario.cases:
            plane, places = self.inputs.planes[target], places_of(exposures_s, lights_lux, speed)
            inside = plane.inside(places)
            whole = np.full((2, len(plane.clusters), len(places)), np.nan)
            whole[..., inside] = plane.on(places[inside])
            found.append(At(*whole))
        return found
