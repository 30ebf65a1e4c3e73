"""Everything that a report shows, in plain values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RunData:
    """Everything a report shows.

    manifest: title, command, models (name, kind, file, sha256, contract with its sources), camera with its
    sources, seed, versions, hardware, threads, threshold, images, wall_s, warnings, errors, n_cells,
    n_target_rows, simulate_ms.
    models: a row per model: P, mPC, rPC, areas under the curves, latency, and scores when untouched.
    scores: a row per model and condition, the untouched pictures first. groups: a row per model and target
    group. skipped: pictures left out, with the reason.
    answers: one per model x group x light x velocity: mean confidence and its 95 % interval at every
    exposure, the windows in s in which confidence stays at or above the threshold (none: no exposure works),
    whether they reach an end of the tested range, and the recommended exposure.
    endurances: one per curve over exposure or blur: area, failure point, its interval, non-monotonic or not.
    examples: simulated pictures on disk with their detections and targets, one per model.
    """

    manifest: dict[str, Any]
    models: list[dict[str, Any]]
    scores: list[dict[str, Any]]
    groups: list[dict[str, Any]]
    skipped: list[dict[str, Any]]
    answers: list[dict[str, Any]]
    endurances: list[dict[str, Any]]
    examples: list[dict[str, Any]]
