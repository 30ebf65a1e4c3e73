"""A run's maps: the quality of charts at its nodes beside its detectors' scores there, and what ranks what.

Domain: charts are exposed by the run's camera under the run's conditions, their gain what the camera set for the
pictures, so nothing is measured that the run has not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.grid.axes import MOVES, VELOCITY
from blurnoise_eval.maps.nodes import Array, Plane, plane_of
from blurnoise_eval.maps.predictor import Predictor, predictor_of
from blurnoise_eval.maps.ranking import Ranked, ranked
from blurnoise_eval.maps.scored import NodeScores, scores_of
from blurnoise_eval.quality.measure import METRICS, measure
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Maps:
    """What there is to tell of a run.

    metrics: by name, (N,) values at the plane's nodes, NaN where withheld. scores: of each model, group and score
    that is told; withheld: the others, in words. rows: those of maps.csv, metric by metric for each of the scores.
    predictors: of those scores that have one.
    """

    camera: Camera
    criterion: Criterion
    plane: Plane
    metrics: Mapping[str, Array]
    scores: tuple[NodeScores, ...]
    withheld: tuple[str, ...]
    rows: tuple[Ranked, ...]
    predictors: tuple[Predictor, ...]

    def of(self, scores: NodeScores) -> list[Ranked]:
        """The rows of these scores."""
        own = scores.model, scores.group, scores.score
        return [row for row in self.rows if (row.model, row.group, row.score) == own]

    def predictor(self, scores: NodeScores) -> Predictor | None:
        """The predictor of these scores."""
        return next((each for each in self.predictors if each.scores is scores), None)


@dataclass(frozen=True)
class RunNodes:
    """A run's camera and nodes."""

    camera: Camera
    plane: Plane


def nodes_of(store: Store) -> RunNodes:
    """The nodes of a run. Raises :class:`StoreError` for one that never began or has no exposed picture."""
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"run = {str(store.folder)!r}: no sweep has begun here")
    camera = Camera.from_dict(manifest["camera"])
    plan = store.about("identity")["plan"]  # of a grid, or of the nodes that a search asked for
    stated = plan["grid"] if "grid" in plan else plan["further"]
    if any(
        map(MOVES.place_of, stated.get(MOVES.name, ()) if "grid" in plan else [stated.get(MOVES.name, 0.0)])
    ):
        raise StoreError(
            f"run = {str(store.folder)!r}: its targets or their background move alone, which a chart cannot; maps "
            "are of runs in which all moves"
        )
    if plan.get("ego") is not None:
        raise StoreError(
            f"run = {str(store.folder)!r}: its camera drives, so that each place moves in its own way; maps are of "
            f"runs over {' and '.join(VELOCITY)}"
        )
    plane = plane_of(queries.exposed_conditions(store), camera, list(stated))
    if not plane.nodes:
        raise StoreError(f"run = {str(store.folder)!r}: has no picture that was exposed to light")
    return RunNodes(camera, plane)


def maps_of(
    store: Store,
    run: RunNodes,
    criterion: Criterion,
    *,
    cluster: str | None = None,
    repeats: int = 1,
    seed: int = 0,
    threads: int = 1,
    progress: Progress = lambda done: None,
) -> Maps:
    """The maps of a run, its nodes as :func:`nodes_of` gives them.

    cluster: a pattern on pictures' names, as :func:`~blurnoise_eval.answers.clusters.cluster_of` takes it. repeats:
    noise fields of each chart. progress: told 1 for every node, and for every condition of a model whose AP is new.
    """
    scores, withheld = scores_of(store, run.plane, criterion, cluster, progress)  # first: it may be refused
    metrics = _metrics(run, repeats, seed, threads, progress)
    predictors = [predictor_of(run.plane, each) for each in scores]
    return Maps(
        run.camera,
        criterion,
        run.plane,
        metrics,
        tuple(scores),
        tuple(withheld),
        tuple(row for each in scores for row in ranked(run.plane, metrics, each)),
        tuple(each for each in predictors if each is not None),
    )


def _metrics(run: RunNodes, repeats: int, seed: int, threads: int, progress: Progress) -> dict[str, Array]:
    conditions = [node.conditions for node in run.plane.nodes]
    rows = measure(run.camera, conditions, repeats=repeats, seed=seed, threads=threads, progress=progress)
    values = np.array([row.estimate.value for row in rows], float).reshape(len(conditions), len(METRICS))
    return {metric.name: values[:, place] for place, metric in enumerate(METRICS)}


def by_model(scores: tuple[NodeScores, ...], score: str) -> list[tuple[str, list[NodeScores]]]:
    """Each model with its groups of one score."""
    own = [each for each in scores if each.score == score]
    return [(model, list(each)) for model, each in groupby(own, key=lambda each: each.model)]
