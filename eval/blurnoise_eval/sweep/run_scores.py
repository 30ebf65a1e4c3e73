"""Scores of a run: computed from its store once, and kept in it until cells are added."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.scoring.estimates import Estimate
from blurnoise_eval.scoring.matching import MoveBoxes
from blurnoise_eval.scoring.per_condition import performance, score_rows
from blurnoise_eval.scoring.score_surfaces import Sized
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.coco_export import objects_of, truths, vehicle_of
from blurnoise_eval.sweep.exposing import box_mover, box_sweeper

_VERSION = 3  # of what is kept


class RunScores(NamedTuple):
    """A row per model and condition, what P, mPC and rPC are made of in each, and the score by size, if asked for."""

    rows: list[dict[str, Any]]
    performances: list[Estimate]
    sized: list[Sized]


def run_scores(
    store: Store,
    models: Sequence[str],
    cluster: str | None,
    progress: Callable[[int], None] = lambda scores: None,
    *,
    by_size: str | None = None,
) -> RunScores:
    """The scores of the models. by_size: "ap" or "ap50" by the size of targets, too."""
    made_of = {"of": queries.count_rows(store), "cluster": cluster, "version": _VERSION}
    kept = store.about("scores")
    if (
        kept is None
        or made_of != {name: kept.get(name) for name in made_of}
        or by_size not in (None, kept["by_size"])
    ):
        found = list(
            score_rows(
                store, models, truths(store), progress, moves=_moves(store), cluster=cluster, by_size=by_size
            )
        )
        kept = {
            **made_of,
            "by_size": by_size,
            "rows": [each.row for each in found],
            "performances": [_packed(each.performance) for each in found],
            "sizes": [{size: _packed(own) for size, own in each.sizes.items()} for each in found],
            "n_targets": [dict(each.n_targets) for each in found],
        }
        if not store.read_only:
            store.set_about("scores", kept)
    rows: list[dict[str, Any]] = kept["rows"]
    performances = [
        _unpacked([performance(row), away]) for row, (_, away) in zip(rows, kept["performances"], strict=True)
    ]
    sized = [
        Sized(row, {size: _unpacked(each) for size, each in sizes.items()}, n_targets)
        for row, sizes, n_targets in zip(rows, kept["sizes"], kept["n_targets"], strict=True)
    ]
    return RunScores(rows, performances, sized)


def _packed(estimate: Estimate) -> list[Any]:
    """As JSON has it."""
    away = estimate.departures
    return [
        estimate.value,
        None if away is None else [None if np.isnan(each) else float(each) for each in away],
    ]


def _unpacked(packed: Sequence[Any]) -> Estimate:
    value, away = packed
    return Estimate(value, None if away is None else np.array(away, float))


def _moves(store: Store) -> Callable[[Mapping[str, Any]], tuple[MoveBoxes | None, MoveBoxes | None]]:
    """Where a row's conditions take the boxes of the scene, and what these sweep."""
    camera = Camera.from_dict(store.about("manifest")["camera"])
    objects, vehicle = objects_of(store), vehicle_of(store)

    def mover(row: Mapping[str, Any]) -> tuple[MoveBoxes | None, MoveBoxes | None]:
        exposure = Conditions(**{name: row[name] for name in NAMES}).exposure(camera, vehicle=vehicle)
        return box_mover(exposure, objects), box_sweeper(exposure, objects)

    return mover
