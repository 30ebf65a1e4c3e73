"""Response: how a model does at any light and exposure, case by case of a scenario, from a run's planes.

Domain: lux, s; values in the criterion's unit. Nothing is said of places that the run has not tested.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.deciding.nodes import Line, places_of
from blurnoise_eval.deciding.predicted import At, Predicted
from blurnoise_eval.deciding.search import CAUTION
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.scoring.estimates import influence, ratio_of_sums

Array = NDArray[np.float64]


class Values(NamedTuple):
    """At M pairs of light and exposure: (K, M) of the cases, NaN outside what was tested; (M,) of the objective."""

    cases: Array
    objective: Array


class Uncertain(NamedTuple):
    """The objective (M,), its departures by cluster (C, M), and the covariance (M, M) of what the surfaces leave
    open, ``CAUTION`` times as wide as they have it."""

    objective: Array
    departures: Array
    open: Array


@dataclass(frozen=True, eq=False)
class Response:
    """Planes of a model by the name of the targets, and a scenario of these.

    asked_s: the exposures between which the planes are known to hold.
    """

    scenario: Scenario
    planes: Mapping[str, Predicted]
    asked_s: tuple[float, float] = (0.0, math.inf)

    @cached_property
    def clusters(self) -> tuple[str, ...]:
        """Of all targets."""
        return tuple(dict.fromkeys(cluster for plane in self._planes for cluster in plane.clusters))

    def at(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> Values:
        """Values at pairs of light and exposure, (M,) each."""
        there = [self._case(case, lights_lux, exposures_s) for case in self.scenario.cases]
        cases = np.array([ratio_of_sums(each.sums, each.counts) for each in there])
        return Values(cases, self._objective(cases))

    def uncertain(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> Uncertain:
        """The objective with its uncertainty at pairs of light and exposure, (M,) each.

        Departures are scaled so that their standard deviation by the root of C is the objective's error.
        """
        cases, objective = self.at(lights_lux, exposures_s)
        weights = np.nan_to_num(self.scenario.weights(cases))
        place = {cluster: index for index, cluster in enumerate(self.clusters)}
        departures = np.zeros((len(place), len(objective)))
        for weight, case in zip(weights, self.scenario.cases, strict=True):
            there = self._case(case, lights_lux, exposures_s)
            left_out = influence(there.sums, there.counts)
            known = np.maximum(np.isfinite(left_out).sum(axis=0), 1)
            rows = [place[cluster] for cluster in self.planes[case[1]].clusters]
            departures[rows] += weight * np.nan_to_num(left_out) * len(place) / known
        return Uncertain(objective, departures, self._open(weights, lights_lux, exposures_s))

    def _open(self, weights: Array, lights_lux: ArrayLike, exposures_s: ArrayLike) -> Array:
        """Covariance (M, M) of the objective, whose cases count ``weights`` (K, M): those of one plane together."""
        found = np.zeros((weights.shape[1],) * 2)
        for target, plane in self.planes.items():
            own = [k for k, (_, each) in enumerate(self.scenario.cases) if each == target]
            if own:
                speeds = [self.scenario.cases[k][0] for k in own]
                places = np.concatenate([_places(speed, lights_lux, exposures_s) for speed in speeds])
                by = weights[own].ravel()
                of_cases = by[:, None] * plane.surface.covariance(places) * by
                found += of_cases.reshape(len(own), len(found), len(own), len(found)).sum(axis=(0, 2))
        return CAUTION**2 * found

    @property
    def most(self) -> float:
        """The greatest value of the objective."""
        return sum(share * self.planes[target].most for target, share in self.scenario.targets.items())

    def tested(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> NDArray[np.bool_]:
        """Whether each case was tested at pairs of light and exposure, (K, M)."""
        return np.array(
            [
                self.planes[target].inside(_places(speed, lights_lux, exposures_s))
                for speed, target in self.scenario.cases
            ]
        )

    @property
    def exposures_s(self) -> tuple[float, float]:
        """From the shortest to the longest that was asked for, and tested at any of the lights."""
        lights = self.scenario.lights_lux
        low, high = self._range
        return max(float(low[0] / lights[-1]), self.asked_s[0]), min(
            float(high[0] / lights[0]), self.asked_s[1]
        )

    @property
    def _range(self) -> tuple[Array, Array]:
        """The least and the greatest light times exposure, lux s, and motion, px, of all planes."""
        low = np.max([plane.places.min(axis=0) for plane in self._planes], axis=0)
        high = np.min([plane.places.max(axis=0) for plane in self._planes], axis=0)
        return np.exp2(low), np.exp2(high)

    @property
    def range_text(self) -> str:
        """What was tested: light times exposure, and motion."""
        (light_low, motion_low), (light_high, motion_high) = self._range
        return (
            f"light x exposure {light_low:.3g} to {light_high:.3g} lux s, "
            f"motion {motion_low:.3g} to {motion_high:.3g} px"
        )

    @property
    def _planes(self) -> list[Predicted]:
        return [self.planes[target] for target in self.scenario.targets]

    def _case(self, case: tuple[float, str], lights_lux: ArrayLike, exposures_s: ArrayLike) -> At:
        """What the planes predict, NaN outside what was tested."""
        speed, target = case
        plane, places = self.planes[target], _places(speed, lights_lux, exposures_s)
        inside = plane.inside(places)
        found = []
        for known in plane.on(places[inside]):
            whole = np.full((*known.shape[:-1], len(places)), np.nan)
            whole[..., inside] = known
            found.append(whole)
        return At(*found)

    def _objective(self, cases: Array) -> Array:
        return np.asarray((self.scenario.weights(cases) * cases).sum(axis=0))


def _places(speed_px_s: float, lights_lux: ArrayLike, exposures_s: ArrayLike) -> Array:
    """(M, 2) of pairs of light and exposure."""
    lights = np.asarray(lights_lux, float)
    places = places_of(exposures_s, Line(1.0, (speed_px_s, 0.0)))
    return np.asarray(places + np.stack([np.log2(lights), np.zeros(len(lights))], axis=1))
