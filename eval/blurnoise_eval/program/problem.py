"""The problem of an exposure program: a model's score at any light and exposure of a scenario, within limits.

Domain: lux, s, dB; values in the criterion's unit. Where light times exposure and motion in px decide what a picture
looks like (:mod:`blurnoise_eval.answers.plane`), scores are read off a surface over these two, one for each kind of
target. Elsewhere, as with a rolling shutter, each tested speed has a surface over light and exposure
(:mod:`blurnoise_eval.program.by_speed`). Scores are missing wherever the run has not tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise.light.lights import Light
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import LEAST_KNOWN, ScoreTable
from blurnoise_eval.plan.axes import EGO, FURTHER, HEADLAMP, LIGHT, LIT, SPECTRUM, axis, milliseconds
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.program.by_speed import BySpeed, OnPlane
from blurnoise_eval.program.grounds import OneAxis, unmeasured
from blurnoise_eval.program.metering_by_light import MeteringByLight
from blurnoise_eval.program.scenario import ExposureLimits, Metering, Scenario, half_stops, mean_light
from blurnoise_eval.program.words import lux_text
from blurnoise_eval.report.findings import unfinished
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import SearchSpace, what_breaks
from blurnoise_eval.run.surface import Predicted, Trend
from blurnoise_eval.scoring.uncertainty import effective, influence, ratio_of_sums
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import StoreError
from blurnoise_eval.system.tables import finite

GREY = 0.18
"""The mean light of pictures, a share of white, where all gains of the run are at a limit and do not show it."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inputs:
    """What a run knows of a model.

    planes: its score by kind of target, on the plane or by speed. scenario: the lights, speeds and targets of the
    run, with equal shares. exposures_s: the shortest and the longest of the run. recommended_s: the exposure that the
    run's report recommends for all conditions. notes: what was left out or assumed. lights: the run's named ones.
    one_axis: of a run on the plane. search: the folder of a run that has a part of its grid; "" where it is whole.
    """

    model: str
    criterion: Criterion
    planes: Mapping[str, Predicted | BySpeed]
    metering: Metering
    scenario: Scenario
    exposures_s: tuple[float, float]
    recommended_s: float | None = None
    notes: tuple[str, ...] = ()
    lights: tuple[Light, ...] = ()
    one_axis: OneAxis | None = None
    search: str = ""

    @cached_property
    def known(self) -> dict[str, OnPlane | BySpeed]:
        """What is known of each kind of target."""
        return {of: each if isinstance(each, BySpeed) else OnPlane(each) for of, each in self.planes.items()}


def inputs_of(run: Run, model: str | None = None) -> Inputs:
    """The inputs of one model; the run's only one unless named.

    Raises ``ValueError`` for a run that has no program: a fixed gain, one exposure, or several values of what a
    camera has one of, such as its f-number.
    """
    where, name = f"run = {str(run.folder)!r}", _name_of(run, model)
    of_model = [table for table in run.score_tables() if table.model == name]
    tables = [table for table in of_model if not table.reference_too_low]
    notes = [
        f"{table.group}: left out, because the model finds too few of them in the original pictures"
        for table in of_model
        if table.reference_too_low
    ]
    tables = [table for table in tables if (table.measured & (table.conditions[LIGHT.name] > 0)).any()]
    if not tables:
        raise StoreError(f"{where}: has no targets under any light")
    asked = run.setup.search_space if run.setup.predicted else None
    grid = (asked or SearchSpace(run.plan.spanned)).grid
    # in the dark every exposure gives the same picture, and the logarithm of the light has no end
    space = SearchSpace({**grid, LIGHT.name: [lux for lux in grid[LIGHT.name] if lux]})
    _check(run, space)
    _check_kept(run, tables)
    with run.store as store:
        if missing := run.setup.missing_cells(store):
            notes.insert(0, unfinished(missing))
    setting = {name: float(tables[0].conditions[name][0]) for name in FURTHER}
    if setting["gain_db"] != AUTOMATIC:
        gain = axis("gain_db").text(setting["gain_db"])
        raise ValueError(f"{where}: {gain}; a program needs a run with --gain auto")
    if run.plan.infrared:
        raise ValueError(
            f"{where}: has a lamp in near infrared; a program needs light that is proportional to lux"
        )
    conditions = Conditions(exposure_s=0.01, illuminance_lux=1.0, **{**setting, HEADLAMP.name: 0.0})
    exposure = conditions.exposure(run.camera, spectrum=run.plan.own_spectrum)
    camera, lit_by = exposure.camera, exposure.illuminant
    because = what_breaks(camera, space, run.plan.trajectory, pulsed=run.plan.pulsed)
    trend = Trend.of(camera, lit_by)
    planes: dict[str, Predicted | BySpeed]
    one_axis = None
    if because:
        by_speed = {table.group: BySpeed.of(table, trend) for table in tables}
        planes = {**by_speed}
        notes.append(
            "scores are those of each tested speed, interpolated over exposure and light, because "
            f"lux x seconds alone does not tell them: {'; '.join(because)}"
        )
        notes += unmeasured([*by_speed.values()], run.plan.light)
    else:
        one_axis = OneAxis.of(tables)
        notes.append(one_axis.text)
        planes = {plane.group: Predicted(plane, trend) for table in tables for plane in table.on_plane()}
    metering, unsure = _metering(run, name, Metering(camera, GREY, setting["temperature_c"], lit_by))
    notes += unsure
    lights = half_stops(min(space.grid[LIGHT.name]), max(space.grid[LIGHT.name]))
    speeds = sorted({line.speed_px_s for line in space.lines})
    if driving := [EGO.shown(each) for each in space.grid.get(EGO.name, ()) if any(space.grid[EGO.name])]:
        speeds = [round(speed, 9) for speed in driving]
    choice = run.averages(tables)[0].choose()
    left_out = run.setup.searched and not (run.setup.predicted or run.setup.has_whole_grid)
    return Inputs(
        model=name,
        criterion=run.criterion,
        planes=planes,
        metering=metering,
        scenario=Scenario(
            lights,
            dict.fromkeys(speeds, 1.0),
            dict.fromkeys(planes, 1.0),
            speed_unit=EGO.unit if driving else "px/s",
        ),
        exposures_s=space.exposures_s,
        recommended_s=None if choice is None else choice.exposure_s,
        notes=tuple(notes),
        lights=run.plan.light,
        one_axis=one_axis,
        search=str(run.folder) if left_out else "",
    )


def _check(run: Run, space: SearchSpace) -> None:
    """Raise ``ValueError`` for a run that cannot give a program."""
    low, high = space.exposures_s
    several = [axis(name) for name in FURTHER if len(space.grid.get(name, ())) > 1]
    # Speeds of a vehicle are speeds, and named lights have one spectrum and beam each.
    of_light = [name for name in LIT if run.plan.light and name not in run.plan.grid]
    reasons = [
        f"{each.title.lower()} has several values"
        for each in several
        if each.name not in (EGO.name, *of_light)
    ]
    if high == AUTOMATIC:
        reasons.append("the camera sets the exposure itself")
    elif low == high:
        reasons.append("there is one exposure")
    if reasons:
        raise ValueError(f"run = {str(run.folder)!r}: cannot give a program: {'; '.join(reasons)}")


def _check_kept(run: Run, tables: Sequence[ScoreTable]) -> None:
    """Raise ``ValueError`` where no exposure is better than another, because none keeps enough to compare."""
    most = max(float(np.nanmax(table.mean, initial=0.0)) for table in tables)
    if most < LEAST_KNOWN:
        kept, noun = "kept" if run.criterion.kept else "found", run.criterion.noun
        raise ValueError(
            f"run = {str(run.folder)!r}: next to nothing was {kept} at any exposure ({noun} at most {most:.3f}), "
            "so that none can be recommended"
        )


def _metering(run: Run, model: str, base: Metering) -> tuple[Metering, list[str]]:
    """The metering of the run's pictures, and what is assumed of it."""
    with run.store as store:
        gains = [*queries.gains_set(store, model)]
    lit = run.plan.spanned
    metered: Metering | None
    if len(lit.get(SPECTRUM.name, ())) > 1 or any(lit.get(HEADLAMP.name, ())):
        metered = MeteringByLight.of(gains, base)
    else:
        light = mean_light(gains, base.camera, base.illuminant)
        metered = None if light is None else replace(base, mean_light=light)
    if metered is not None:
        return metered, []
    return base, [
        f"the gains of the run do not show how bright its pictures are; {GREY:g} of white is assumed"
    ]


def _name_of(run: Run, model: str | None) -> str:
    """The name of the model, which may be left out where the run has only one. Raises ``ValueError``."""
    names = [name for name in run.setup.models if name not in run.withheld]
    if model is None and len(names) == 1:
        return names[0]
    if model is None or model not in names:
        reasons = "".join(f"; {name}: {reason}" for name, reason in run.withheld.items())
        given = "model: missing" if model is None else f"model = {model!r}"
        must = f"must be one of {', '.join(names)}{reasons}"
        raise ValueError(f"run = {str(run.folder)!r}: {given}: {must}")
    return model


class Schedule(NamedTuple):
    """Exposures and gains over the scenario's lights, (L,) each.

    lacks_gain: whether the camera's gain is at its limit. values: of the objective, None where it was not tested;
    value: their mean. worst_speed: the mean over lights and targets at the speed at which it is lowest.
    """

    exposures_s: tuple[float, ...]
    gains_db: tuple[float, ...]
    lacks_gain: tuple[bool, ...]
    values: tuple[float | None, ...]
    value: float | None
    worst_speed: float | None


@dataclass(frozen=True, eq=False)
class Problem:
    """A run's planes and metering, the scenario of a program, and its limits.

    Methods that take lights and exposures take M of each, in pairs. Shapes: K cases of the scenario, L lights, S
    exposures, C clusters of pictures.
    """

    inputs: Inputs
    scenario: Scenario
    limits: ExposureLimits

    @property
    def _surfaces(self) -> list[Predicted]:
        known = [self.inputs.known[target] for target in self.scenario.targets]
        return [surface for each in known for surface, _ in each.parts(self.scenario.speeds_px_s)]

    @cached_property
    def clusters(self) -> tuple[str, ...]:
        """Clusters of pictures with any of the targets, (C,)."""
        return tuple(dict.fromkeys(cluster for plane in self._surfaces for cluster in plane.clusters))

    @property
    def most(self) -> float:
        """The greatest value of the objective."""
        return sum(share * self.inputs.planes[target].most for target, share in self.scenario.targets.items())

    @cached_property
    def most_gain(self) -> float:
        """The most gain that the limits allow and the camera has, a factor."""
        camera_db = self.inputs.metering.camera.sensor.gain_max_db
        return float(10 ** (min(self.limits.gain_max_db, camera_db) / 20))

    @property
    def _range(self) -> tuple[Array, Array]:
        """The least and the greatest light times exposure, lux s, and motion, px, that all surfaces cover."""
        # All kinds of targets must be known there, so the narrowest range counts.
        low = np.max([plane.places.min(axis=0) for plane in self._surfaces], axis=0)
        high = np.min([plane.places.max(axis=0) for plane in self._surfaces], axis=0)
        return np.exp2(low), np.exp2(high)

    @cached_property
    def times_s(self) -> tuple[float, ...]:
        """The allowed exposures of the run that it covers at one light at least, rising, (S,)."""
        (low, _), (high, _) = self._range
        asked_s = self.inputs.exposures_s
        shortest_s = max(float(low / self.scenario.lights_lux[-1]), asked_s[0])
        return self.limits.candidates(shortest_s, min(float(high / self.scenario.lights_lux[0]), asked_s[1]))

    @cached_property
    def totals_s(self) -> tuple[float, ...]:
        """The exposure times gain that the camera's meter asks for, (L,)."""
        return tuple(map(self.inputs.metering.total_s, self.scenario.lights_lux))

    def nothing_left(self, lights_lux: Sequence[float]) -> ValueError:
        """The error where no exposure is left at these lights."""
        if folder := self.inputs.search:
            least, most = lux_text(min(lights_lux)), lux_text(max(lights_lux))
            at = f"{least} lux" if least == most else f"{least} to {most} lux"
            return ValueError(
                f"run = {folder!r}: has too few conditions of its grid for a program at {at}; 'blurnoise sweep' with "
                f"the same options and -o {folder} computes the rest"
            )
        if beyond := self._beyond_tested(lights_lux):
            return ValueError(beyond)
        (light_low, motion_low), (light_high, motion_high) = self._range
        lights = ":".join(dict.fromkeys(f"{light:g}" for light in lights_lux))
        unit, speeds = self.scenario.speed_unit, ", ".join(f"{each:g}" for each in self.scenario.speeds_px_s)
        covered = f"motion {motion_low:.3g} to {motion_high:.3g} px"
        if any(isinstance(each, BySpeed) for each in self.inputs.known.values()):
            covered = "exposures {} to {} ms".format(*map(milliseconds, self.inputs.exposures_s))
        return ValueError(
            f"lux, speeds: at {lights} lux, no exposure meets all of: tested at {speeds} {unit}; not longer in more "
            f"light; {', '.join(self.limits.words)}; the run covers light x exposure {lux_text(light_low, 3)} to "
            f"{lux_text(light_high, 3)} lux s, {covered}"
        )

    def _beyond_tested(self, lights_lux: Sequence[float]) -> str:
        """What the brightest and the darkest of these lights ask for, if they were tested, but not such exposures."""
        shortest_s, longest_s = self.inputs.exposures_s
        tested, limits = self.inputs.scenario.lights_lux, self.limits
        for lux in sorted({min(lights_lux), max(lights_lux)}, reverse=True):
            total_s = self.inputs.metering.total_s(lux)
            most_s, lamps_s = limits.settled(total_s), limits.shortest_s
            least_s = max(total_s / 10 ** (limits.gain_max_db / 20), lamps_s if total_s >= lamps_s else 0.0)
            at = f"at {lux_text(lux)} lux the metering"
            if total_s > limits.limit_s or least_s > longest_s:
                at += f", with {', '.join(limits.words)},"
            if tested[0] <= lux <= tested[-1] and most_s < shortest_s:
                wants = f"{at} wants {milliseconds(most_s)} ms, the shortest tested is {milliseconds(shortest_s)} ms"
                return f"lux: test shorter exposures: {wants}"
            if tested[0] <= lux <= tested[-1] and least_s > longest_s:
                wants = f"{at} wants {milliseconds(least_s)} ms, the longest tested is {milliseconds(longest_s)} ms"
                return f"lux: test longer exposures: {wants}"
        return ""

    def predicted(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> list[tuple[Array, Array]]:
        """For each case the sums of scores and the counts of targets by cluster, (C, M) each; NaN where the run has
        not tested."""
        predicted = []
        for speed, target in self.scenario.cases:
            known = self.inputs.known[target]
            plane, places = known.surface(speed), known.places(exposures_s, lights_lux, speed)
            tested = np.where(plane.inside(places), 1.0, np.nan)
            sums, counts = plane.on(places)
            predicted.append((sums * tested, counts * tested))
        return predicted

    def at(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> tuple[Array, Array]:
        """Mean scores (K, M) of the cases, and of the objective (M,); NaN where the run has not tested."""
        cases = np.array(
            [ratio_of_sums(sums, counts) for sums, counts in self.predicted(lights_lux, exposures_s)]
        )
        return cases, np.asarray((self.scenario.weights(cases) * cases).sum(axis=0))

    def objective(self, times_s: Sequence[float]) -> Array:
        """Objective (L, S) at these exposures; NaN where the run has not tested, where the gain is above the limit,
        and where lamps flicker that would not at a longer exposure."""
        lights = np.repeat(self.scenario.lights_lux, len(times_s))
        _, values = self.at(lights, np.tile(times_s, len(self.scenario.lights_lux)))
        gains_db = self.gains_db(times_s)
        # A gain of the limit itself is allowed, whatever its last digit.
        allowed = gains_db <= self.limits.gain_max_db + 1e-9
        if self.limits.mains_hz or self.limits.led:
            flicker = [[self.limits.avoidable(time, total) for time in times_s] for total in self.totals_s]
            allowed &= ~np.array(flicker)
        return np.where(allowed, values.reshape(gains_db.shape), np.nan)

    def gains_db(self, times_s: Sequence[float]) -> Array:
        """The gains (L, S) that the camera's meter sets at these exposures."""
        gain_db = self.inputs.metering.gain_db
        return np.array([[gain_db(lux, time) for time in times_s] for lux in self.scenario.lights_lux])

    def schedule(self, exposures_s: Sequence[float]) -> Schedule:
        """The schedule of these exposures, one for each light."""
        cases, values = self.at(self.scenario.lights_lux, exposures_s)
        by_speed = cases.mean(axis=1).reshape(len(self.scenario.speeds_px_s), -1)
        of_speeds = by_speed @ list(self.scenario.targets.values())
        metering = self.inputs.metering
        gains_db = tuple(map(metering.gain_db, self.scenario.lights_lux, exposures_s))
        return Schedule(
            exposures_s=tuple(map(float, exposures_s)),
            gains_db=gains_db,
            lacks_gain=tuple(gain_db >= metering.camera.sensor.gain_max_db for gain_db in gains_db),
            values=tuple(map(finite, values)),
            value=finite(values.mean()),
            worst_speed=finite(of_speeds.min()),
        )

    def effective(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> float:
        """How many clusters of one size there are at each light and speed, at least, as the run's report counts them
        (:func:`~blurnoise_eval.scoring.uncertainty.effective`)."""
        sizes: dict[float, Array] = {}
        for (speed, target), (_, counts) in zip(
            self.scenario.cases, self.predicted(lights_lux, exposures_s), strict=True
        ):
            rows = [self.clusters.index(cluster) for cluster in self.inputs.planes[target].clusters]
            of_speed = sizes.setdefault(speed, np.zeros((len(self.clusters), counts.shape[1])))
            of_speed[rows] += counts / counts.sum(axis=0)
        return min(float(effective(each).min()) for each in sizes.values())

    def uncertain(self, lights_lux: ArrayLike, exposures_s: ArrayLike) -> tuple[Array, Array, Array]:
        """The objective (M,), the influence of each cluster on it (C, M), and the covariance (M, M) of the surfaces'
        predictions."""
        predicted = self.predicted(lights_lux, exposures_s)
        cases = np.array([ratio_of_sums(sums, counts) for sums, counts in predicted])
        weights = self.scenario.weights(cases)
        objective, weights = (weights * cases).sum(axis=0), np.nan_to_num(weights)
        total = np.zeros((len(self.clusters), len(objective)))
        for weight, (_, target), (sums, counts) in zip(weights, self.scenario.cases, predicted, strict=True):
            of_case = influence(sums, counts)
            # A cluster without this kind of target has no influence on its mean; the mean of all influences, over
            # more clusters, would be too small by that share.
            measured = np.maximum(np.isfinite(of_case).sum(axis=0), 1)
            rows = [self.clusters.index(cluster) for cluster in self.inputs.planes[target].clusters]
            total[rows] += weight * np.nan_to_num(of_case) * len(total) / measured
        # A surface's errors at the speeds that it predicts are correlated; those of different surfaces are not.
        speeds, targets = self.scenario.speeds_px_s, self.scenario.targets
        covariance = np.zeros((len(objective),) * 2)
        of_targets = np.moveaxis(weights.reshape(len(speeds), len(targets), -1), 1, 0)
        for target, of_target in zip(targets, of_targets, strict=True):
            known = self.inputs.known[target]
            for _, those in known.parts(speeds):
                own, weight = [[*speeds][each] for each in those], of_target[those]
                places = np.concatenate([known.places(exposures_s, lights_lux, speed) for speed in own])
                of_plane = known.covariance(own[0], places).reshape(*weight.shape, *weight.shape)
                covariance += np.einsum("vm,vmwn,wn->mn", weight, of_plane, weight)
        return objective, total, covariance
