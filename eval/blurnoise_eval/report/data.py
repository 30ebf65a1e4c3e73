"""Everything that a report shows, in plain values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from blurnoise_eval.grid.axes import EGO, EGO_SPEED, EXPOSURE, SPEED, Coordinate, velocity_of
from blurnoise_eval.report.settings import Settings, settings_of
from blurnoise_eval.scoring.criterion import CONFIDENCE, Criterion
from blurnoise_eval.scoring.matching import FOUND_SCORE


@dataclass(frozen=True)
class RunData:
    """Everything a report shows.

    manifest: title, command, models (name, kind, file, sha256, contract with its sources), camera with its
    sources, seed, versions, hardware, threads, threshold, images, wall_s, warnings, errors, n_cells,
    missing_cells (of the plan, those of skipped pictures apart), n_target_rows, simulate_ms; searched:
    in words how, where answers are predicted from the conditions that a search asked for.
    models: a row per model: P, mPC, rPC, areas under the curves, latency, and scores when untouched.
    scores: a row per model and condition, the untouched pictures first. groups: a row per model and target
    group. skipped: pictures left out, with the reason.
    answers: one per model x group x setting x velocity: mean confidence and its 95 % interval at every
    exposure, the windows in s in which confidence stays at or above the threshold (none: no exposure works),
    whether they reach an end of the tested range, and the recommended exposure.
    endurances: one per curve over exposure, blur or another axis: area, failure point, its interval,
    non-monotonic or not; None in the column of the axis that varies.
    examples: simulated pictures on disk with their detections and targets, one per model.
    recommendations: the exposure to use per model: for all conditions, each light, each light and speed, as
    :func:`~blurnoise_eval.scoring.recommendation.recommendations` has them. averages: per model and speed the mean
    over lights and targets at every exposure.
    All rows but those of models and groups carry a column per axis of ``AXES``, None for untouched pictures.
    """

    manifest: dict[str, Any]
    models: list[dict[str, Any]]
    scores: list[dict[str, Any]]
    groups: list[dict[str, Any]]
    skipped: list[dict[str, Any]]
    answers: list[dict[str, Any]]
    endurances: list[dict[str, Any]]
    examples: list[dict[str, Any]]
    recommendations: list[dict[str, Any]] = field(default_factory=list)
    averages: list[dict[str, Any]] = field(default_factory=list)

    @cached_property
    def criterion(self) -> Criterion:
        """What is enough: what the answers' values are held to."""
        row = self.manifest["criterion"]
        return Criterion(row["level"], row["kept"], row["score"])

    @property
    def searched(self) -> Sequence[str]:
        """How a search found the answers, which then are no measurements; none of a grid."""
        words: Sequence[str] = self.manifest.get("searched", ())
        return words

    @property
    def taken(self) -> Sequence[dict[str, Any]]:
        """How pictures were taken: a row per condition, with the gain that was applied. Of a search the conditions
        that it asked for, which are no scores to show."""
        rows: Sequence[dict[str, Any]] = self.manifest.get("taken") or [
            row for row in self.scores if not row["clean"]
        ]
        return rows

    @property
    def found_from(self) -> float:
        """The confidence from which a target in an example counts as found: that asked for, where such a one is."""
        asked = not self.criterion.kept and self.criterion.score == CONFIDENCE
        return self.criterion.level if asked else FOUND_SCORE

    @cached_property
    def highest(self) -> float:
        """The greatest value of all answers, at least 1: what is kept may be more than that."""
        return max([1.0, *(float(answer["best_value"]) for answer in self.answers)])

    @cached_property
    def exposed(self) -> list[dict[str, Any]]:
        """The rows of one setting and velocity each: answers, and scores of exposed pictures."""
        return [*self.answers, *(row for row in self.scores if not row["clean"])]

    @cached_property
    def settings(self) -> Settings:
        """The settings that were tested."""
        return settings_of(self.exposed)

    @cached_property
    def velocities_px_s(self) -> list[tuple[float, float]]:
        """The velocities that were tested, the slow ones first."""
        return sorted({velocity_of(row) for row in self.exposed}, key=by_speed)

    @cached_property
    def speed(self) -> Coordinate:
        """How fast a row's picture moves: in px/s or, where a vehicle carries the camera, that in km/h."""
        return EGO_SPEED if any(row[EGO.name] for row in self.exposed) else SPEED

    @cached_property
    def at_any_speed(self) -> Settings:
        """The settings without a vehicle's speed."""
        return self.settings.without(EGO) if EGO in self.settings.axes else self.settings

    @cached_property
    def exposures_s(self) -> list[float]:
        """The exposures that were tested, of a grid those of the grid: at others only the ends of some windows
        were refined."""
        scored = {row["exposure_s"] for row in self.scores if not row["clean"]}
        every = scored.union(*(answer["exposures_s"] for answer in self.answers))
        grid = self.manifest.get("plan", {}).get("grid", {}).get(EXPOSURE.name, ())
        return sorted(every.intersection(grid) or every)


def by_speed(velocity_px_s: tuple[float, float]) -> tuple[float, tuple[float, float]]:
    """A sort key: slow velocities first, those of one speed in a fixed order."""
    return math.hypot(*velocity_px_s), velocity_px_s
