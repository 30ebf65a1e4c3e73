"""The scores of a run, and its tables of scores in the unit of a criterion.

Scores are computed once and kept in the store until cells are added. Functions take the open store of a run, its
setup and, where values are judged, the criterion (:mod:`blurnoise_eval.answers.criterion`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise.picture.develop import tones_8bit
from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.monotone import is_uniform, pooled
from blurnoise_eval.answers.per_condition import Scored, conditions_of, numbered, scored
from blurnoise_eval.answers.recommendation import Averages, averages
from blurnoise_eval.answers.table import ORDER, ScoreTable, table_of, tables_by_size
from blurnoise_eval.datasets import DOUBTFUL_LABELS
from blurnoise_eval.plan.axes import NAMES, SETTING
from blurnoise_eval.run.coco_export import truths
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.run.surface import Trend, predicted_table
from blurnoise_eval.scoring.evaluated import NO_TRUTH, Evaluated
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from blurnoise_eval.scoring.scores import of_conditions
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.queries import TargetColumns, target_columns
from blurnoise_eval.store.rows import ScoreRow
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.machine import sources

LEAST_AP50 = 0.05
"""On the labelled original pictures: a detector below this has no answers."""
_SCORES = "scores"  # under which the store keeps the scores
_DARK = 0.09  # of full scale: half of what auto-exposure aims at


def run_scores(
    store: Store,
    setup: Setup,
    criterion: Criterion,
    progress: Callable[[int], None] = lambda scores: None,
) -> list[Scored]:
    """The scores of each model and condition; by the size of targets, too, if the criterion is such a score.

    progress: called for each of them.
    """
    names = [score.name for score in of_conditions()]
    by_size = criterion.score if criterion.of_sizes else None
    made_of: dict[str, Any] = {"of": queries.count_rows(store), "cluster": criterion.cluster}
    made_of |= {"by_size": by_size, "software": sources(), "scores": names}
    kept = store.about(_SCORES, own=True)
    if kept is not None and made_of == {name: kept.get(name) for name in made_of}:
        return [Scored.of_document(document) for document in kept["found"]]
    every = []
    for scored_condition in _scored(store, setup, criterion.cluster, by_size):
        every.append(scored_condition)
        progress(1)
    store.keep(_SCORES, made_of | {"found": [condition.document() for condition in every]})
    return every


def _scored(
    store: Store,
    setup: Setup,
    cluster: str | None,
    by_size: str | None = None,
    *,
    original_only: bool = False,
) -> Iterator[Scored]:
    def moves(at: AxisValues) -> tuple[Any, Any]:
        exposure, objects = setup.exposure(at), setup.plan.objects
        return box_mover(exposure, objects), box_sweeper(exposure, objects)

    clusters = numbered(queries.pictures_seen(store), cluster)
    conditions = conditions_of(store, list(setup.models), clusters, original_only=original_only)
    return scored(store, conditions, truths(store, setup), moves, clusters, by_size)


def models_withheld(manifest: Mapping[str, Any], scores: Iterable[ScoreRow]) -> dict[str, str]:
    """Why detectors have no answer: their AP50 on the labelled original pictures is below ``LEAST_AP50``.

    Such a detector has a wrong contract or knows other classes, so its score says nothing about an exposure.
    """
    if not manifest["images"]["labelled"]:
        return {}
    detectors = {model["name"] for model in manifest["models"] if model["kind"] == "detector"}
    clean = {
        row.model: row.scores["ap50"].value
        for row in scores
        if row.conditions.original and row.model in detectors
    }
    notes = manifest["images"].get("notes", ())
    doubts = [note.removeprefix(DOUBTFUL_LABELS) for note in notes if note.startswith(DOUBTFUL_LABELS)]
    labels = f"Are the labels right? {'; '.join(doubts)}. Else: is" if doubts else "Is"
    return {
        name: f"no exposure is recommended, because the AP50 on the original pictures is {ap50:.3f}, below "
        f"{LEAST_AP50:g}. {labels} the contract right (blurnoise inspect --probe), and does the model know these "
        "classes?"
        for name, ap50 in clean.items()
        if ap50 is not None and ap50 < LEAST_AP50
    }


def withheld_models(store: Store, setup: Setup, criterion: Criterion) -> dict[str, str]:
    """As :func:`models_withheld`, from the scores on the original pictures alone."""
    clean = _scored(store, setup, criterion.cluster, original_only=True)
    return models_withheld(setup.manifest, (scored_condition.row for scored_condition in clean))


def score_tables(
    store: Store, setup: Setup, criterion: Criterion, scores: Sequence[Scored] | None = None
) -> Iterator[ScoreTable]:
    """The tables of what was measured, one for each model and group of targets.

    scores: of :func:`run_scores`, if they are known; they are needed for a score that belongs to no single target.
    """
    if criterion.of_sizes:
        yield from tables_by_size(scores or run_scores(store, setup, criterion), criterion.kept)
        return
    for model in queries.models_seen(store):
        yield from _of_model(store, setup, model, criterion)


def on_lines(setup: Setup, measured: Iterable[ScoreTable]) -> Iterator[ScoreTable]:
    """The tables at the exposures that the run was asked for: predicted between the nodes of a search, and of a grid
    those that were measured."""
    if setup.search_space is None or not setup.predicted:
        yield from measured
        return
    trend = Trend.of(setup.camera)
    for table in measured:
        for plane in table.on_plane():
            yield predicted_table(plane, setup.search_space, trend)


def _of_model(store: Store, setup: Setup, model: str, criterion: Criterion) -> Iterator[ScoreTable]:
    """One model's, group after group."""
    columns = target_columns(store, model)
    if criterion.of is not None and criterion.of.of_targets is not None:
        values = criterion.of.of_targets(columns)  # NaN where a row has none
    elif criterion.alarms_per_picture is not None:
        confidence = _alarm_confidence(store, setup, model, criterion.alarms_per_picture)
        values = (columns.confidence > confidence).astype(float)
    else:
        raise ValueError(f"score = {criterion.score!r}: has no value for each target")
    is_clean = np.array([at.original for at in columns.conditions], bool)
    original = is_clean[columns.condition] if len(is_clean) else np.zeros(0, bool)
    clean = _clean_values(columns, values, original)
    as_set = queries.as_set(store, columns.conditions)
    conditions = {
        name: np.array([at[name] for at in as_set], float) for name in NAMES
    }  # NaN of original pictures
    group = np.where(original, -1, columns.group)
    order = np.lexsort((columns.target_id, columns.repeat, columns.picture, group))
    order = order[np.count_nonzero(original) :]
    for here in np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(order) else ():
        some = columns.rows(here)
        of = model, columns.groups[int(some.group[0])], conditions, some, values[here], clean[here]
        table = table_of(*of, partial(cluster_of, pattern=criterion.cluster), kept=criterion.kept)
        if table is not None:
            yield table


def _clean_values(
    columns: TargetColumns, values: NDArray[np.float64], original: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """The score of each row's target in the original picture, NaN where it is unknown."""
    most = 1 + int(columns.target_id.max(initial=0))
    every = columns.picture.astype(np.int64) * most + columns.target_id
    different, key = np.unique(every, return_inverse=True)
    of_target: NDArray[np.float64] = np.full(len(different), np.nan)
    of_target[key[original]] = values[original]
    return np.asarray(of_target[key])


def run_averages(
    store: Store, setup: Setup, criterion: Criterion, tables: Iterable[ScoreTable]
) -> list[Averages]:
    """The averages from which each model's recommendations are made: pooled over speeds where motion can only hurt,
    with saturated shares as means over pictures."""
    shares = queries.saturated_shares(store)
    of_model: dict[str, list[ScoreTable]] = {}
    for table in tables:
        keys = zip(*(table.conditions[name].tolist() for name in ORDER), strict=True)
        of_pictures = np.array([shares.get(key) for key in keys], float)
        by_picture = np.where(np.isnan(of_pictures), table.saturated, of_pictures)
        of_model.setdefault(table.model, []).extend(replace(table, saturated=by_picture).split(SETTING))
    return [
        averages(
            [pooled(part) if setup.monotone and is_uniform(part) else part for part in parts],
            criterion.level,
            grid_s=setup.grid_exposures_s,
            monotone=setup.monotone and all(map(is_uniform, parts)),
        )
        for parts in of_model.values()
    ]


def dark_below(camera: Camera) -> float:
    """Mean brightness, 0-1, of a picture at half of the level that auto-exposure aims at."""
    black = camera.sensor.black_level_dn
    place = round(black + _DARK * (camera.sensor.full_scale_dn - black))
    return int(tones_8bit(camera)[place]) / 255


def _alarm_confidence(store: Store, setup: Setup, model: str, rate: float) -> float:
    """The confidence above which a model's original pictures give at most ``rate`` false alarms each."""
    (clean,) = [row for row in queries.condition_counts(store, model) if row.conditions.original]
    answers = queries.answers_at(store, model, clean.conditions)
    found = Evaluated({}, truths(store, setup)(model) or NO_TRUTH, answers)
    return found.alarms_from(0.0).confidence_at(rate)
