"""Scores of a run: computed from its store once, and kept in it until cells are added."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from blurnoise_eval.answers.per_condition import (
    Asked,
    Moves,
    Scored,
    asked,
    numbered,
    performance,
    scored,
)
from blurnoise_eval.answers.table import Sized
from blurnoise_eval.scoring.estimates import Estimate
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from blurnoise_eval.scoring.scores import of_conditions
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.coco_export import truths
from blurnoise_eval.sweep.open import Run
from blurnoise_eval.system.machine import usable_cores

LEAST_AP50 = 0.05
"""Of the labelled original pictures: below, a detector has no answers."""
_VERSION = 5  # of what is kept
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
    names = [score.name for score in of_conditions()]
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


def models_withheld(manifest: Mapping[str, Any], scores: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Why there is no answer, by detector: where its AP50 in the labelled original pictures is below ``LEAST_AP50``.

    What such a one keeps is no measure of an exposure: its contract is wrong, or it knows other classes.
    """
    if not manifest["images"]["labelled"]:
        return {}
    detectors = {model["name"] for model in manifest["models"] if model["kind"] == "detector"}
    clean = {row["model"]: row.get("ap50") for row in scores if row["clean"] and row["model"] in detectors}
    return {
        name: f"no exposure is recommended, because its AP50 in the original pictures is {ap50:.3f}, below "
        f"{LEAST_AP50:g}. Is its contract right (blurnoise inspect --probe), and does it know these classes?"
        for name, ap50 in clean.items()
        if ap50 is not None and ap50 < LEAST_AP50
    }


def withheld_models(store: Store, cluster: str | None = None) -> dict[str, str]:
    """As :func:`models_withheld`, by what is scored here of the untouched pictures alone."""
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
    away = estimate.influence
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
    run = Run(store)

    def mover(row: Mapping[str, Any]) -> tuple[Any, Any]:
        exposure = run.exposure(row)
        return box_mover(exposure, run.objects), box_sweeper(exposure, run.objects)

    return mover
