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

from blurnoise_eval.answers.per_condition import Condition, Moves, Scored, conditions_of, numbered, scored
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from blurnoise_eval.scoring.scores import of_conditions
from blurnoise_eval.scoring.uncertainty import Estimate
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.coco_export import truths
from blurnoise_eval.sweep.open import Run
from blurnoise_eval.system.machine import usable_cores

LEAST_AP50 = 0.05
"""Of the labelled original pictures: below, a detector has no answers."""
_VERSION = 6  # of what is kept
_KEPT = "scores"
"""Where the store keeps them; by size: under the score's name, which will do without, too."""
_ALONE_UP_TO = 100_000  # rows of cells; another process takes seconds to begin


class RunScores(NamedTuple):
    """The scores of each model and condition."""

    found: list[Scored]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The table of scores."""
        return [each.row for each in self.found]

    @property
    def performances(self) -> list[Estimate]:
        """What P, mPC and rPC are made of."""
        return [each.performance for each in self.found]


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
    keys = [_KEPT] if by_size is None else []
    keys += [
        f"{_KEPT}, {score.name}"
        for score in of_conditions()
        if score.by_size and by_size in (None, score.name)
    ]
    every = (kept for kept in map(store.about, keys) if kept is not None)
    kept = next((kept for kept in every if made_of == {name: kept.get(name) for name in made_of}), None)
    if kept is None:
        found = _found(store, models, cluster, progress, by_size)
        kept = made_of | {"found": [_packed(each) for each in found]}
        if not store.read_only:
            store.set_about(keys[0], kept)
    return RunScores([_unpacked(each) for each in kept["found"]])


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
    """As :func:`models_withheld`, by what is scored here of the original pictures alone."""
    manifest = store.about("manifest")
    clusters = numbered(queries.pictures_seen(store), cluster)
    models = [model["name"] for model in manifest["models"]]
    every = conditions_of(store, models, clusters, original_only=True)
    found = scored(store, every, truths(store), _moves(store), clusters)
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
    conditions = list(conditions_of(store, models, clusters))
    ours, theirs = conditions, conditions[:0]
    if queries.count_rows(store) > _ALONE_UP_TO and usable_cores() > 1:
        ours, theirs = conditions[::2], conditions[1::2]

    def here(some: Sequence[Condition]) -> list[Scored]:
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


def _packed(value: Any) -> Any:
    """Scores as JSON has them: estimates as lists, without NaN."""
    if isinstance(value, np.ndarray):
        return [None if np.isnan(each) else float(each) for each in value]
    if isinstance(value, tuple):
        return [_packed(each) for each in value]
    return {name: _packed(each) for name, each in value.items()} if isinstance(value, dict) else value


def _unpacked(packed: Sequence[Any]) -> Scored:
    row, performance, sizes, n_targets = packed
    by_size = {size: _estimate(each) for size, each in sizes.items()}
    return Scored(row, _estimate(performance), by_size, n_targets)


def _estimate(packed: Sequence[Any]) -> Estimate:
    value, away, cautious = packed
    influence = None if away is None else np.array(away, float)
    return Estimate(value, influence, None if cautious is None else _estimate(cautious))


def _moves(store: Store) -> Moves:
    """Where a row's conditions take the boxes of the scene, and what these sweep."""
    run = Run(store)

    def mover(row: Mapping[str, Any]) -> tuple[Any, Any]:
        exposure = run.exposure(row)
        return box_mover(exposure, run.objects), box_sweeper(exposure, run.objects)

    return mover
