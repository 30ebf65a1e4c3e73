"""What a finished run has for exposure programs: its planes, its camera's metering, what it tested.

Domain: runs as :mod:`blurnoise_eval.store` keeps them, of a search or of a full grid alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.decision import BECAUSE, QUESTION, on_lines
from blurnoise_eval.deciding.nodes import Line
from blurnoise_eval.deciding.plane_holds import what_breaks
from blurnoise_eval.deciding.predicted import Predicted
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.deciding.trend import Trend
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, FURTHER, axis, speed_px_s, velocity_of
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.program.metering import Metering, mean_light
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.run_scores import withheld_models
from blurnoise_eval.sweep.score_tables import run_averages, score_tables

GREY = 0.18
"""Mean light that is assumed of pictures whose gains do not tell it."""


@dataclass(frozen=True)
class Inputs:
    """A model's planes by targets, and what goes with them. lights_lux, exposures_s: from the least to the greatest;
    speeds_px_s: each that was asked for. recommended_s: the exposure that the run's report recommends for all of
    these. notes: what was left out or assumed."""

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
        same &= set(scenario.speeds_px_s) == set(self.speeds_px_s) and set(scenario.targets) == set(
            self.planes
        )
        for shares in (scenario.speeds_px_s.values(), scenario.targets.values()):
            same &= math.isclose(min(shares), max(shares))
        return self.recommended_s if same else None


def inputs_of(
    store: Store, criterion: Criterion, cluster: str | None = None, model: str | None = None
) -> Inputs:
    """The inputs of one model; the run's only one unless named.

    Raises ``ValueError`` for a run that has no program: several settings or directions of motion, a fixed gain, a
    camera of which light and exposure do not tell.
    """
    unfit = withheld_models(store, cluster)
    found = list(score_tables(store, criterion, cluster))
    measured = [table for table in found if table.model not in unfit]
    if unfit and (model in unfit or not measured):
        raise ValueError(
            f"run = {str(store.folder)!r}: "
            + "; ".join(f"{name}: {reason}" for name, reason in unfit.items() if model in (None, name))
        )
    every = [plane for table in measured for plane in table.on_plane()]
    names = list(dict.fromkeys(seen.model for seen in every))
    if (model is None and len(names) > 1) or (model is not None and model not in names):
        raise ValueError(f"model = {model!r}: must be one of {', '.join(names)}; state it with --model")
    seen = [each for each in every if each.model == (model or names[0])] if names else []
    notes = [
        f"{each.group}: left out, for the model knows too little of these"
        for each in seen
        if each.knows_too_little
    ]
    seen = [each for each in seen if not each.knows_too_little]
    if not seen:
        raise StoreError(f"run = {str(store.folder)!r}: tells of no targets under any light")
    settings = [tuple(float(each.conditions[name][0]) for name in FURTHER) for each in seen]
    setting = dict(zip(FURTHER, _alone("setting", settings), strict=True))
    _alone("direction of motion", [each.direction for each in seen])
    if setting["gain_db"] != AUTOMATIC:
        raise ValueError(
            f"run = {str(store.folder)!r}: its gain is {axis('gain_db').text(setting['gain_db'])}; a program needs "
            "a run with --gain auto"
        )
    conditions = Conditions(exposure_s=0.01, illuminance_lux=1.0, **setting)
    camera = conditions.exposure(Camera.from_dict(store.about("manifest")["camera"])).camera
    lines, exposures = _asked(store, seen)
    drives = setting[EGO.name] > 0
    if because := store.about(BECAUSE) or what_breaks(
        camera, exposures, lines, setting["temperature_c"], drives=drives
    ):
        raise ValueError(
            f"run = {str(store.folder)!r}: light x exposure and motion do not say all there, so no program follows: "
            + "; ".join(because)
        )
    light = mean_light(queries.gains_set(store, seen[0].model), camera)
    if light is None:
        notes.append(f"no gain of the run tells how bright its pictures are: taken for {GREY:g} of white")
    trend = Trend.of(camera)
    return Inputs(
        model=seen[0].model,
        criterion=criterion,
        planes={
            each.group: Predicted(each.places, each.clusters, each.sums, each.counts, trend, each.most)
            for each in seen
        },
        metering=Metering(camera, GREY if light is None else light, setting["temperature_c"]),
        lights_lux=(min(line.illuminance_lux for line in lines), max(line.illuminance_lux for line in lines)),
        exposures_s=exposures,
        speeds_px_s=tuple(sorted({line.speed_px_s for line in lines})),
        notes=tuple(notes),
        recommended_s=_recommended(store, measured, criterion, seen[0].model),
    )


def _recommended(
    store: Store, measured: Sequence[ScoreTable], criterion: Criterion, model: str
) -> float | None:
    """The exposure to use for all conditions, by the rule and the tables of the run's report."""
    own = [table for table in measured if table.model == model and not table.knows_too_little]
    choice = run_averages(store, on_lines(store, iter(own)), criterion.level)[0].choose()
    return None if choice is None else choice.exposure_s


def _alone(what: str, values: Sequence[tuple[float, ...]]) -> tuple[float, ...]:
    if len(set(values)) > 1:
        raise ValueError(
            f"run: has more than one {what}; a program is for one: run 'blurnoise decide' with that alone"
        )
    return values[0]


def _asked(store: Store, seen: Sequence[ScoreTable]) -> tuple[list[Line], tuple[float, float]]:
    """Lines and exposures that the run was asked for."""
    if (asked := store.about(QUESTION)) is not None:
        question = Question.from_dict(asked)
        return list(question.lines), question.exposures_s
    rows = [each.at(place) for each in seen for place in range(len(each))]
    lines = {
        (row["illuminance_lux"], speed_px_s(row)): Line(row["illuminance_lux"], velocity_of(row))
        for row in rows
    }
    exposures = [row["exposure_s"] for row in rows]
    return list(lines.values()), (min(exposures), max(exposures))
