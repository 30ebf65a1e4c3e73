"""Scores of a run: computed from its store once, and kept in it until cells are added."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.scoring.estimates import Estimate
from blurnoise_eval.scoring.per_condition import (
    Asked,
    Moves,
    Scored,
    asked,
    numbered,
    performance,
    scored,
)
from blurnoise_eval.scoring.registry import SCORES
from blurnoise_eval.scoring.score_surfaces import Sized
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.coco_export import objects_of, truths, vehicle_of
from blurnoise_eval.sweep.exposing import box_mover, box_sweeper
from blurnoise_eval.sweep.run_surfaces import models_withheld
from blurnoise_eval.system.machine import usable_cores

_VERSION = 4  # of what is kept
_KEPT = {None: ("scores", "scores, ap", "scores, ap50"), "ap": ("scores, ap",), "ap50": ("scores, ap50",)}
"""Where the store keeps the scores, by what is asked for by size; without it any will do."""
_ALONE_UP_TO = 100_000  # rows of cells; another process takes seconds to begin


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
    names = [score.name for score in SCORES]
    made_of = {"of": queries.count_rows(store), "cluster": cluster, "version": _VERSION, "scores": names}
    every = (kept for kept in map(store.about, _KEPT[by_size]) if kept is not None)
    kept = next((kept for kept in every if made_of == {name: kept.get(name) for name in made_of}), None)
    if kept is None:
        found = _found(store, models, cluster, progress, by_size)
        kept = {
            **made_of,
            "rows": [each.row for each in found],
            "performances": [_packed(each.performance) for each in found],
            "sizes": [{size: _packed(own) for size, own in each.sizes.items()} for each in found],
            "n_targets": [dict(each.n_targets) for each in found],
        }
        if not store.read_only:
            store.set_about(_KEPT[by_size][0], kept)
    rows: list[dict[str, Any]] = kept["rows"]
    performances = [
        _unpacked([performance(row), *rest])
        for row, (_, *rest) in zip(rows, kept["performances"], strict=True)
    ]
    sized = [
        Sized(row, {size: _unpacked(each) for size, each in sizes.items()}, n_targets)
        for row, sizes, n_targets in zip(rows, kept["sizes"], kept["n_targets"], strict=True)
    ]
    return RunScores(rows, performances, sized)


def withheld_models(store: Store, cluster: str | None = None) -> dict[str, str]:
    """As :func:`~.run_surfaces.models_withheld`, by what is scored here of the untouched pictures alone."""
    manifest = store.about("manifest")
    clusters = numbered(queries.pictures_seen(store), cluster)
    every = asked(store, [model["name"] for model in manifest["models"]], clusters)
    clean = [each for each in every if each.counted["clean"]]
    found = scored(store, clean, truths(store), _moves(store), clusters)
    return models_withheld(manifest, (each.row for each in found))


def _found(
    store: Store,
    models: Sequence[str],
    cluster: str | None,
    progress: Callable[[int], None],
    by_size: str | None,
) -> list[Scored]:
    """The rows, of many cells by two processes; what the other one does not answer is scored here."""
    clusters = numbered(queries.pictures_seen(store), cluster)
    conditions = list(asked(store, models, clusters))
    ours, theirs = conditions, conditions[:0]
    if queries.count_rows(store) > _ALONE_UP_TO and usable_cores() > 1:
        ours, theirs = conditions[::2], conditions[1::2]

    def here(some: Sequence[Asked]) -> list[Scored]:
        found = []
        for each in scored(store, some, truths(store), _moves(store), clusters, by_size):
            found.append(each)
            progress(1)
        return found

    if not theirs:
        return here(ours)
    question = pickle.dumps((store.folder, theirs, clusters, by_size))
    command = [sys.executable, "-c", f"from {__name__} import answer; answer()"]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **pipes) as other, ThreadPoolExecutor(1) as pool:
        told = pool.submit(other.communicate, question)
        try:
            found = here(ours)
            answered, _ = told.result()
        except BaseException:
            other.kill()
            raise
    if other.returncode == 0:
        others: list[Scored] = pickle.loads(answered)
        progress(len(others))
    else:
        others = here(theirs)
    return [each for pair in zip_longest(found, others) for each in pair if each is not None]


def answer() -> None:
    """In a process of its own: score the conditions on standard input, to standard output."""
    folder, conditions, clusters, by_size = pickle.load(sys.stdin.buffer)
    with Store(folder, shared=True) as store:
        found = list(scored(store, conditions, truths(store), _moves(store), clusters, by_size))
    pickle.dump(found, sys.stdout.buffer)


def _packed(estimate: Estimate) -> list[Any]:
    """As JSON has it."""
    away = estimate.departures
    return [
        estimate.value,
        None if away is None else [None if np.isnan(each) else float(each) for each in away],
        None if estimate.cautious is None else _packed(estimate.cautious),
    ]


def _unpacked(packed: Sequence[Any]) -> Estimate:
    value, away, cautious = packed
    return Estimate(
        value,
        None if away is None else np.array(away, float),
        None if cautious is None else _unpacked(cautious),
    )


def _moves(store: Store) -> Moves:
    """Where a row's conditions take the boxes of the scene, and what these sweep."""
    camera = Camera.from_dict(store.about("manifest")["camera"])
    objects, vehicle = objects_of(store), vehicle_of(store)

    def mover(row: Mapping[str, Any]) -> tuple[Any, Any]:
        exposure = Conditions(**{name: row[name] for name in NAMES}).exposure(camera, vehicle=vehicle)
        return box_mover(exposure, objects), box_sweeper(exposure, objects)

    return mover
