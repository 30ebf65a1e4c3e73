"""Everything that a report shows, as plain values read from a run's store, and its tables."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from blurnoise.training.table import FILE as CONDITIONS_FILE
from blurnoise_eval.answers.criterion import CONFIDENCE, Criterion
from blurnoise_eval.answers.rows import AnswerRow, AverageCurve, CurveRow, ModelRow, RecommendationRow
from blurnoise_eval.plan.axes import (
    EGO,
    EGO_SPEED,
    EXPOSURE,
    SPEED,
    Axis,
    Coordinate,
    velocity_text,
)
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.lights import lights_of_run
from blurnoise_eval.report.met_conditions import met_conditions
from blurnoise_eval.report.settings import Tested, TestedSettings
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.rows import Example, ScoreRow, SkippedRow
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

TABLES = (
    "recommendations.csv", "answers.csv", "models.csv", "scores.csv", "curves.csv", "results.csv", "targets.csv",
)  # fmt: skip
"""The tables in the folder of the page; the last two are exports of the store."""
Row = dict[str, Any]


@dataclass(frozen=True)
class RunData:
    """Everything a report shows.

    manifest: how the run was made, and its warnings. models: a row per model, scores: per model and condition, the
    original pictures first. skipped: pictures left out, with the reason.
    answers, curves: see :mod:`~blurnoise_eval.answers.rows`. examples: simulated pictures on disk with their
    detections and targets.
    recommendations: the exposure to use per model: for all conditions, each light, each light and speed; averages:
    per model the mean over lights, speeds and targets at every exposure.
    """

    manifest: Row
    models: list[ModelRow]
    scores: list[ScoreRow]
    skipped: list[SkippedRow]
    answers: list[AnswerRow]
    curves: list[CurveRow]
    examples: list[Example]
    recommendations: list[RecommendationRow] = field(default_factory=list)
    averages: list[AverageCurve] = field(default_factory=list)

    @cached_property
    def criterion(self) -> Criterion:
        """What is enough, in the unit of the answers' values."""
        row = self.manifest["criterion"]
        return Criterion(row["level"], row["kept"], row["score"])

    @cached_property
    def exposed_scores(self) -> list[ScoreRow]:
        """The scores of exposed pictures."""
        return [row for row in self.scores if not row.conditions.original]

    @cached_property
    def clean_scores(self) -> dict[str, ScoreRow]:
        """The scores of each model in the original pictures."""
        return {row.model: row for row in self.scores if row.conditions.original}

    @cached_property
    def tested(self) -> list[AxisValues]:
        """The conditions of answers, without exposures, and of the scores of exposed pictures."""
        of_answers = [row.conditions for row in self.answers]
        return of_answers + [row.conditions for row in self.exposed_scores]

    @property
    def found_from(self) -> float:
        """The confidence from which a target in an example counts as found: the criterion's, if it has one."""
        by_level = not self.criterion.kept and self.criterion.score == CONFIDENCE
        return self.criterion.level if by_level else FOUND_SCORE

    @cached_property
    def settings(self) -> TestedSettings:
        """The settings that were tested."""
        return TestedSettings(self.tested, lights_of_run(self.manifest))

    @cached_property
    def speed(self) -> Coordinate:
        """How fast a row's picture moves: in px/s or, where a vehicle carries the camera, that in km/h."""
        return EGO_SPEED if any(at[EGO.name] for at in self.tested) else SPEED

    @cached_property
    def axes(self) -> tuple[Tested, ...]:
        """Exposure, velocity (the slow ones first), light, and what else varies."""
        exposures = {row.conditions.exposure_s for row in self.exposed_scores}
        exposures = exposures.union(*(answer.exposures_s for answer in self.answers))
        planned = exposures.intersection(self.manifest.get("plan", {}).get("grid", {}).get(EXPOSURE.name, ()))
        grid = sorted(planned or exposures)
        velocities = {at.velocity_px_s for at in self.tested}
        motions = sorted(velocities, key=lambda each: (math.hypot(*each), each))
        speeds, texts = tuple(math.hypot(*v) for v in motions), tuple(map(velocity_text, motions))
        return (
            Tested.of(EXPOSURE, [*grid, *sorted(exposures.difference(grid))], len(grid)),
            Tested(SPEED, tuple(motions), speeds, texts, len(motions)),
            *(
                self._tested(axis, sorted({setting[index] for setting in self.settings.every}))
                for index, axis in enumerate(self.settings.axes)
            ),
        )

    def _tested(self, axis: Axis, values: Sequence[float]) -> Tested:
        texts, short = (
            tuple(text(axis, value) for value in values)
            for text in (self.settings.value_text, self.settings.short_text)
        )
        return replace(Tested.of(axis, values), texts=texts, short=short)

    @cached_property
    def _places(self) -> list[dict[Any, int]]:
        return [{value: index for index, value in enumerate(tested.values)} for tested in self.axes]

    def at(
        self, conditions: AxisValues, exposure_s: float | None, velocity: object = None
    ) -> tuple[int | None, ...]:
        """The indices of a setting, and of this exposure and velocity (None: of none), on the run's axes."""
        values = exposure_s, velocity, *self.settings.of(conditions)
        return tuple(places.get(value) for places, value in zip(self._places, values, strict=True))

    @cached_property
    def model_names(self) -> list[str]:
        """The run's models, in its order."""
        return [model["name"] for model in self.manifest["models"]]

    def largest_groups(self, count: int) -> list[str]:
        """At most ``count`` target groups, those with most targets, in the order of the answers."""
        sizes: dict[str, int] = {}
        for answer in self.answers:
            sizes[answer.group] = max(sizes.get(answer.group, 0), answer.n_targets)
        largest = sorted(sizes, key=lambda group: -sizes[group])[:count]
        return [group for group in sizes if group in largest]

    def spread_examples(self, count: int) -> list[Example]:
        """At most about ``count`` examples, of conditions that are evenly spread, each with all models."""
        paths = list(dict.fromkeys(example.path for example in self.examples))
        shown = spread(paths, max(1, count // max(1, len(self.model_names))))
        chosen = (example for example in self.examples if example.path in shown)
        return sorted(
            chosen, key=lambda each: (shown.index(each.path), self.model_names.index(each.cell.model))
        )


def write_tables(data: RunData, folder: Path) -> list[Path]:
    """Write answers.csv, scores.csv (a row per model and condition), curves.csv (a row per curve), models.csv,
    recommendations.csv (the exposure to use: for all conditions, each light, each light and speed), and
    conditions.json, which the training augmentation draws from."""
    rows_of: list[list[dict[str, Any]]] = [
        [row.columns() for row in data.recommendations],
        [row.flat() for row in data.answers],
        [row.columns() for row in data.models],
        [row.columns() for row in data.scores],
        [row.flat() for row in data.curves],
    ]
    written = dict(zip(TABLES, rows_of, strict=False))
    for name, rows in written.items():
        lines = csv_lines(list(rows[0]) if rows else [], rows)
        write_whole(folder / name, (line.encode("utf-8") for line in lines))
    met = json.dumps(met_conditions(data.scores, data.manifest, data.recommendations), allow_nan=False)
    write_whole(folder / CONDITIONS_FILE, met.encode("utf-8"))
    return [folder / name for name in (*written, CONDITIONS_FILE)]
