"""The problem of an exposure program: a model's score at any light and exposure of a scenario, within limits.

Domain: lux, s, dB; values in the criterion's unit. Values exist only where the run has tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.plane import places_of
from blurnoise_eval.deciding.decision import on_lines, question_of
from blurnoise_eval.plan.axes import AUTOMATIC, FURTHER, LIGHT, axis
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.program.scenario import Limits, Metering, Scenario, half_stops, mean_light
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.score_tables import run_averages, score_tables, withheld_models
from blurnoise_eval.run.search_space import SearchSpace, what_breaks
from blurnoise_eval.run.surface import CAUTION, Predicted, Trend
from blurnoise_eval.scoring.uncertainty import influence, ratio_of_sums
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.tables import finite

GREY = 0.18
"""Mean light that is assumed of pictures all of whose gains are at a limit."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inputs:
    """A model's planes by targets in a run, and what goes with them. scenario: what the run was asked, all alike.
    exposures_s: from the least to the greatest; recommended_s: what the run's report recommends for all conditions.
    notes: what was left out or assumed."""

    model: str
    criterion: Criterion
    planes: Mapping[str, Predicted]
    metering: Metering
    scenario: Scenario
    exposures_s: tuple[float, float]
    recommended_s: float | None = None
    notes: tuple[str, ...] = ()


def inputs_of(store: Store, criterion: Criterion, model: str | None = None) -> Inputs:
    """The inputs of one model; the run's only one unless named.

    Raises ``ValueError`` for a run that has no program: several settings or directions of motion, a fixed gain, a
    camera or a motion for which the plane does not hold.
    """
    run, where = Run(store), f"run = {str(store.folder)!r}"
    without_answers = withheld_models(store, criterion.cluster)
    names = [name for name in run.models if name not in without_answers]
    chosen = names[0] if model is None and len(names) == 1 else model
    if chosen not in names:
        unfit = "".join(f"; {name}: {reason}" for name, reason in without_answers.items())
        given = "model: missing" if model is None else f"model = {chosen!r}"
        raise ValueError(f"{where}: {given}: must be one of {', '.join(names)}{unfit}")
    of_model = [each for each in score_tables(store, criterion) if each.model == chosen]
    tables = [each for each in of_model if not each.knows_too_little]
    little = [each.group for each in of_model if each.knows_too_little]
    notes = [
        f"{group}: left out, because the model finds too few of them in the original pictures"
        for group in little
    ]
    every_plane = [plane for table in tables for plane in table.on_plane()]
    if not every_plane:
        raise StoreError(f"{where}: has no targets under any light")
    asked = question_of(store) or SearchSpace(run.grid)
    question = SearchSpace({**asked.grid, LIGHT.name: [lux for lux in asked.grid[LIGHT.name] if lux]})
    setting = {name: float(every_plane[0].conditions[name][0]) for name in FURTHER}
    if setting["gain_db"] != AUTOMATIC:
        gain = axis("gain_db").text(setting["gain_db"])
        raise ValueError(f"{where}: {gain}; a program needs a run with --gain auto")
    camera = Conditions(exposure_s=0.01, illuminance_lux=1.0, **setting).exposure(run.camera).camera
    if because := what_breaks(camera, question, run.trajectory, pulsed=run.plan.pulsed):
        raise ValueError(f"{where}: cannot give a program: {'; '.join(because)}")
    light = mean_light(queries.gains_set(store, every_plane[0].model), camera)
    if light is None:
        notes.append(
            f"the gains of the run do not show how bright its pictures are; {GREY:g} of white is assumed"
        )
    lights = half_stops(min(question.grid[LIGHT.name]), max(question.grid[LIGHT.name]))
    speeds = dict.fromkeys(sorted({line.speed_px_s for line in question.lines}), 1.0)
    planes = {each.group: Predicted(each, Trend.of(camera)) for each in every_plane}
    choice = run_averages(store, on_lines(store, iter(tables)), criterion.level)[0].choose()
    return Inputs(
        model=every_plane[0].model,
        criterion=criterion,
        planes=planes,
        metering=Metering(camera, GREY if light is None else light, setting["temperature_c"]),
        scenario=Scenario(lights, speeds, dict.fromkeys(planes, 1.0)),
        exposures_s=question.exposures_s,
        recommended_s=None if choice is None else choice["exposure_s"],
        notes=tuple(notes),
    )


class Schedule(NamedTuple):
    """Exposures and gains over the scenario's lights, (L,) each; lacks_gain: whether the gain's limit is reached;
    values: the objective, None where it was not tested. value: their mean; worst_speed: the least mean of a speed
    over the lights."""

    exposures_s: tuple[float, ...]
    gains_db: tuple[float, ...]
    lacks_gain: tuple[bool, ...]
    values: tuple[float | None, ...]
    value: float | None
    worst_speed: float | None


@dataclass(frozen=True, eq=False)
class Problem:
    """A run's planes and metering, the scenario of a program, and its limits. Pairs are of light and exposure, (M,)
    each; K cases, L lights, S exposures."""

    inputs: Inputs
    scenario: Scenario
    limits: Limits

    @property
    def _planes(self) -> list[Predicted]:
        return [self.inputs.planes[target] for target in self.scenario.targets]

    @cached_property
    def clusters(self) -> tuple[str, ...]:
        """Of all targets."""
        return tuple(dict.fromkeys(cluster for plane in self._planes for cluster in plane.clusters))

    @property
    def most(self) -> float:
        """The greatest value of the objective."""
        return sum(share * self.inputs.planes[target].most for target, share in self.scenario.targets.items())

    @property
    def _range(self) -> tuple[Array, Array]:
        """The least and the greatest light times exposure, lux s, and motion, px, of all planes."""
        low = np.max([plane.places.min(axis=0) for plane in self._planes], axis=0)
        high = np.min([plane.places.max(axis=0) for plane in self._planes], axis=0)
        return np.exp2(low), np.exp2(high)

    @cached_property
    def times_s(self) -> tuple[float, ...]:
        """Allowed exposures that were asked for, and tested at some light, rising, (S,)."""
        (low, _), (high, _) = self._range
        asked_s = self.inputs.exposures_s
        shortest_s = max(float(low / self.scenario.lights_lux[-1]), asked_s[0])
        return self.limits.candidates(shortest_s, min(float(high / self.scenario.lights_lux[0]), asked_s[1]))

    def nothing_left(self, lights_lux: Sequence[float]) -> ValueError:
        """The error where no exposure is left at these lights."""
        (light_low, motion_low), (light_high, motion_high) = self._range
        lights = ":".join(dict.fromkeys(f"{light:g}" for light in lights_lux))
        speeds = ", ".join(f"{speed:g}" for speed in self.scenario.speeds_px_s)
        return ValueError(
            f"lux, speeds: at {lights} lux, no exposure meets all of: tested at {speeds} px/s; not longer in more "
            f"light; {', '.join(self.limits.words)}; the run covers light x exposure {light_low:.3g} to "
            f"{light_high:.3g} lux s, motion {motion_low:.3g} to {motion_high:.3g} px"
        )

    def predicted(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> list[tuple[Array, Array]]:
        """Of each case sums and counts (C, M), NaN outside what was tested."""
        found = []
        for speed, target in self.scenario.cases:
            plane, places = self.inputs.planes[target], places_of(exposures_s, lights_lux, speed)
            tested = np.where(plane.inside(places), 1.0, np.nan)
            sums, counts = plane.on(places)
            found.append((sums * tested, counts * tested))
        return found

    def at(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> tuple[Array, Array]:
        """Values at pairs: (K, M) of the cases, NaN outside what was tested; (M,) of the objective."""
        cases = np.array([ratio_of_sums(*each) for each in self.predicted(lights_lux, exposures_s)])
        return cases, np.asarray((self.scenario.weights(cases) * cases).sum(axis=0))

    def objective(self, times_s: Sequence[float]) -> Array:
        """(L, S) of these exposures, NaN where it was not tested or the gain is not allowed."""
        lights = np.repeat(self.scenario.lights_lux, len(times_s))
        _, values = self.at(lights, np.tile(times_s, len(self.scenario.lights_lux)))
        gains_db = self.gains_db(times_s)
        allowed = gains_db <= self.limits.gain_max_db + 1e-9
        return np.where(allowed, values.reshape(gains_db.shape), np.nan)

    def gains_db(self, times_s: Sequence[float]) -> Array:
        """(L, S)."""
        gain_db = self.inputs.metering.gain_db
        return np.array([[gain_db(lux, time) for time in times_s] for lux in self.scenario.lights_lux])

    def schedule(self, exposures_s: Sequence[float]) -> Schedule:
        """The schedule of these exposures, one at each light, with the camera's gain."""
        cases, values = self.at(self.scenario.lights_lux, exposures_s)
        by_speed = cases.mean(axis=1).reshape(len(self.scenario.speeds_px_s), -1)
        of_speeds = by_speed @ list(self.scenario.targets.values())
        metering = self.inputs.metering
        gains_db = tuple(map(metering.gain_db, self.scenario.lights_lux, exposures_s))
        return Schedule(
            exposures_s=tuple(map(float, exposures_s)),
            gains_db=gains_db,
            lacks_gain=tuple(gain_db >= metering.camera.gain_max_db for gain_db in gains_db),
            values=tuple(map(finite, values)),
            value=finite(values.mean()),
            worst_speed=finite(of_speeds.min()),
        )

    def uncertain(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> tuple[Array, Array, Array]:
        """At pairs the objective (M,), the influence of each cluster on it (C, M), and the covariance (M, M) of the
        surfaces' prediction, ``CAUTION`` times as wide as they have it."""
        there = self.predicted(lights_lux, exposures_s)
        cases = np.array([ratio_of_sums(*each) for each in there])
        weights = self.scenario.weights(cases)
        objective, weights = (weights * cases).sum(axis=0), np.nan_to_num(weights)
        total = np.zeros((len(self.clusters), len(objective)))
        for weight, (_, target), of_case in zip(weights, self.scenario.cases, there, strict=True):
            own = influence(*of_case)
            known = np.maximum(np.isfinite(own).sum(axis=0), 1)
            rows = [self.clusters.index(cluster) for cluster in self.inputs.planes[target].clusters]
            total[rows] += weight * np.nan_to_num(own) * len(total) / known
        speeds, targets = self.scenario.speeds_px_s, self.scenario.targets
        at = np.concatenate([places_of(exposures_s, lights_lux, speed) for speed in speeds])
        cov = np.zeros((len(objective),) * 2)
        of_targets = np.moveaxis(weights.reshape(len(speeds), len(targets), -1), 1, 0)
        for plane, weight in zip(self._planes, of_targets, strict=True):
            own = plane.surface.covariance(at).reshape(*weight.shape, *weight.shape)
            cov += np.einsum("vm,vmwn,wn->mn", weight, own, weight)
        return objective, total, CAUTION**2 * cov
