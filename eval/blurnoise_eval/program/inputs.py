"""What a finished run, of a search or of a full grid, has for exposure programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.decision import on_lines, question_of
from blurnoise_eval.deciding.kriging import Trend
from blurnoise_eval.deciding.lines import Line
from blurnoise_eval.deciding.predicted import Predicted
from blurnoise_eval.deciding.question import what_breaks
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, FURTHER, axis
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.program.limits import Metering, mean_light
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.run_scores import withheld_models
from blurnoise_eval.sweep.score_tables import run_averages, score_tables

GREY = 0.18
"""Mean light that is assumed of pictures all of whose gains are at a limit."""


@dataclass(frozen=True)
class Inputs:
    """A model's planes by targets in a run, and what goes with them. lights_lux, exposures_s: from the least to the
    greatest; speeds_px_s: each that was asked for. notes: what was left out or assumed. recommended_s: the exposure
    that the run's report recommends for all of these."""

    model: str
    criterion: Criterion
    planes: Mapping[str, Predicted]
    metering: Metering
    lights_lux: tuple[float, float]
    exposures_s: tuple[float, float]
    speeds_px_s: tuple[float, ...]
    notes: tuple[str, ...]
    recommended_s: float | None = None

    def recommended_for(self, scenario: Scenario) -> float | None:
        """What the report recommends, if the scenario asks what the run was asked, all alike."""
        lights = scenario.lights_lux[0], scenario.lights_lux[-1]
        same = scenario.objective == "expected" and lights == self.lights_lux
        same &= set(scenario.speeds_px_s) == set(self.speeds_px_s)
        same &= set(scenario.targets) == set(self.planes)
        for shares in (scenario.speeds_px_s.values(), scenario.targets.values()):
            same &= math.isclose(min(shares), max(shares))
        return self.recommended_s if same else None


def inputs_of(
    store: Store, criterion: Criterion, cluster: str | None = None, model: str | None = None
) -> Inputs:
    """The inputs of one model; the run's only one unless named.

    Raises ``ValueError`` for a run that has no program: several settings or directions of motion, a fixed gain, a
    camera for which the plane does not hold.
    """
    run = f"run = {str(store.folder)!r}"
    unfit = withheld_models(store, cluster)
    tables = [table for table in score_tables(store, criterion, cluster) if table.model not in unfit]
    if unfit and (model in unfit or not tables):
        reasons = (f"{name}: {reason}" for name, reason in unfit.items() if model in (None, name))
        raise ValueError(f"{run}: {'; '.join(reasons)}")
    every = [plane for table in tables for plane in table.on_plane()]
    names = list(dict.fromkeys(seen.model for seen in every))
    if (model is None and len(names) > 1) or (model is not None and model not in names):
        raise ValueError(f"model = {model!r}: must be one of {', '.join(names)}; state it with --model")
    of_model = [each for each in every if each.model == (model or names[0])] if names else []
    seen = [each for each in of_model if not each.knows_too_little]
    little = (each.group for each in of_model if each.knows_too_little)
    notes = [f"{group}: left out, for the model knows too little of these" for group in little]
    if not seen:
        raise StoreError(f"{run}: tells of no targets under any light")
    settings = [tuple(float(each.conditions[name][0]) for name in FURTHER) for each in seen]
    setting = dict(zip(FURTHER, _alone("setting", settings), strict=True))
    _alone("direction of motion", [each.direction for each in seen])
    if setting["gain_db"] != AUTOMATIC:
        gain = axis("gain_db").text(setting["gain_db"])
        raise ValueError(f"{run}: its gain is {gain}; a program needs a run with --gain auto")
    camera = Camera.from_dict(store.about("manifest")["camera"])
    camera = Conditions(exposure_s=0.01, illuminance_lux=1.0, **setting).exposure(camera).camera
    question = question_of(store)
    lines, exposures_s = _measured(seen) if question is None else (question.lines, question.exposures_s)
    because = [] if question is None else question.because
    drives = setting[EGO.name] > 0
    because = because or what_breaks(camera, exposures_s, lines, setting["temperature_c"], drives=drives)
    if because:
        raise ValueError(
            f"{run}: light x exposure and motion do not say all there, so no program follows: {'; '.join(because)}"
        )
    light = mean_light(queries.gains_set(store, seen[0].model), camera)
    if light is None:
        notes.append(f"no gain of the run tells how bright its pictures are: taken for {GREY:g} of white")
    trend, lights = Trend.of(camera), [line.illuminance_lux for line in lines]
    # for all conditions, by the rule and the tables of the run's report
    own = (table for table in tables if table.model == seen[0].model and not table.knows_too_little)
    choice = run_averages(store, on_lines(store, own), criterion.level)[0].choose()
    return Inputs(
        model=seen[0].model,
        criterion=criterion,
        planes={each.group: Predicted(each, trend) for each in seen},
        metering=Metering(camera, GREY if light is None else light, setting["temperature_c"]),
        lights_lux=(min(lights), max(lights)),
        exposures_s=exposures_s,
        speeds_px_s=tuple(sorted({line.speed_px_s for line in lines})),
        notes=tuple(notes),
        recommended_s=None if choice is None else choice["exposure_s"],
    )


def _alone(what: str, values: Sequence[tuple[float, ...]]) -> tuple[float, ...]:
    if len(set(values)) > 1:
        raise ValueError(
            f"run: has more than one {what}; a program is for one: run 'blurnoise decide' with that alone"
        )
    return values[0]


def _measured(seen: Sequence[ScoreTable]) -> tuple[Sequence[Line], tuple[float, float]]:
    """Lines and exposures of a sweep."""
    rows = [each.at(place) for each in seen for place in range(len(each))]
    exposures_s = [row["exposure_s"] for row in rows]
    lines = [Line(row["illuminance_lux"], (row["velocity_x_px_s"], row["velocity_y_px_s"])) for row in rows]
    return lines, (min(exposures_s), max(exposures_s))
