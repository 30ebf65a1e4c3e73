"""The tables of a run: what its store holds, in the unit of a criterion.

Domain: criteria as in :mod:`blurnoise_eval.answers.criterion`; names of pictures as the store has them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.picture.develop import tones_8bit
from blurnoise_eval.answers import criterion as criteria
from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.monotone import is_uniform, pooled
from blurnoise_eval.answers.recommendation import Averages, averages
from blurnoise_eval.answers.table import ORDER, ScoreTable, table_of, tables_by_size
from blurnoise_eval.grid.axes import NAMES, SETTING
from blurnoise_eval.scoring.evaluated import NO_TRUTH, Evaluated
from blurnoise_eval.store import queries
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.store.target_columns import TargetColumns, target_columns
from blurnoise_eval.sweep.coco_export import truths
from blurnoise_eval.sweep.run_scores import RunScores, run_scores

ENOUGH = "enough"
"""Under which a run's store keeps what its sweep was asked last: threshold, keep, score and cluster."""
_DARK = 0.09  # of full scale: half of what auto-exposure aims at


def question_of(
    store: Store,
    threshold: float | None = None,
    keep: float | None = None,
    score: str | None = None,
    cluster: str | None = None,
) -> tuple[Criterion, str | None]:
    """The criterion of a run, see :func:`.criterion_for`, and the pattern of its clusters: as given here, and for the
    rest as its sweep was asked. A threshold replaces a share to keep, and the other way round.

    Raises ``StoreError`` for a run that never began.
    """
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"run = {str(store.folder)!r}: no sweep has begun here")
    reads = any(model["kind"] == "reader" for model in manifest["models"])
    rendered = manifest["images"]["kind"] == "rendered"
    labelled = manifest["images"]["labelled"]
    asked: dict[str, Any] = store.about(ENOUGH) or {}
    if threshold is None and keep is None:
        threshold, keep = asked.get("threshold"), asked.get("keep")
    of = {"rendered": rendered, "reads": reads, "labelled": labelled}
    found = criteria.criterion_for(threshold, keep, score or asked.get("score"), **of)
    return found, cluster or asked.get("cluster")


def score_tables(
    store: Store, criterion: Criterion, cluster: str | None, scored: RunScores | None = None
) -> Iterator[ScoreTable]:
    """The tables of a run, one for each model and group of targets. cluster: a pattern on pictures' names.

    scored: what :func:`~.run_scores.run_scores` gives by size, for a score that belongs to no single target.
    """
    if criterion.of is not None and criterion.of.by_size is not None:
        models = [model["name"] for model in store.about("manifest")["models"]]
        scored = scored or run_scores(store, models, cluster, by_size=criterion.score)
        yield from tables_by_size(scored.found, criterion.kept)
        return
    for model in queries.models_seen(store):
        yield from _of_model(store, model, criterion, cluster)


def _of_model(store: Store, model: str, criterion: Criterion, cluster: str | None) -> Iterator[ScoreTable]:
    """One model's, group after group."""
    columns = target_columns(store, model)
    values = _values(store, model, columns, criterion)
    rows = [dict(zip(CONDITIONS, each, strict=True)) for each in columns.conditions]
    is_clean = np.array([bool(row["clean"]) for row in rows], bool)
    original = is_clean[columns.condition] if len(rows) else np.zeros(0, bool)
    clean = _clean_values(columns, values, original)
    as_set = iter(queries.as_set(store, [row for row in rows if not row["clean"]]))
    taken = [row if row["clean"] else next(as_set) for row in rows]
    conditions = {
        name: np.array([np.nan if row["clean"] else row[name] for row in taken], float) for name in NAMES
    }
    group = np.where(original, -1, columns.group)
    order = np.lexsort((columns.target_id, columns.repeat, columns.picture, group))
    order = order[np.count_nonzero(original) :]
    for here in np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(order) else ():
        some = columns.rows(here)
        of = model, columns.groups[int(some.group[0])], conditions, some, values[here], clean[here]
        table = table_of(*of, partial(cluster_of, pattern=cluster), kept=criterion.kept)
        if table is not None:
            yield table


def _clean_values(
    columns: TargetColumns, values: NDArray[np.float64], original: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """What the target of each row has in the original picture, NaN where that is not known."""
    most = 1 + int(columns.target_id.max(initial=0))
    key = columns.picture.astype(np.int64) * most + columns.target_id
    of_clean = key[original]
    order = np.argsort(of_clean, kind="stable")
    if not len(order):
        return np.full(len(key), np.nan)
    place = np.minimum(np.searchsorted(of_clean[order], key), len(order) - 1)
    found = of_clean[order][place] == key
    return np.where(found, values[original][order][place], np.nan)


def run_averages(store: Store, tables: Iterable[ScoreTable], level: float) -> list[Averages]:
    """Of each model what its recommendations are made of: pooled over speeds where motion can only hurt, with the
    shares of saturated values as means over pictures."""
    monotone = store.about("manifest").get("trajectory") is None
    shares = queries.saturated_shares(store)
    of_model: dict[str, list[ScoreTable]] = {}
    for table in tables:
        keys = zip(*(table.conditions[name].tolist() for name in ORDER), strict=True)
        of_pictures = np.array([shares.get(key) for key in keys], float)
        by_picture = np.where(np.isnan(of_pictures), table.saturated, of_pictures)
        of_model.setdefault(table.model, []).extend(replace(table, saturated=by_picture).split(SETTING))
    return [
        averages(
            [pooled(each) if monotone and is_uniform(each) else each for each in own],
            level,
            monotone=monotone and all(map(is_uniform, own)),
        )
        for own in of_model.values()
    ]


def dark_below(camera: Camera) -> float:
    """Mean brightness of a picture, 0-1, that is half of what auto-exposure aims at."""
    black = camera.black_level_dn
    place = round(black + _DARK * (camera.full_scale_dn - black))
    return int(tones_8bit(camera)[place]) / 255


def _values(store: Store, model: str, columns: TargetColumns, criterion: Criterion) -> NDArray[np.float64]:
    """Each row's score, NaN where it has none."""
    if criterion.of is not None and criterion.of.of_targets is not None:
        return criterion.of.of_targets(columns)
    confidence = alarm_confidences(store, criterion.alarms_per_picture or 0.0)[model]
    return (columns.confidence > confidence).astype(float)


def alarm_confidences(store: Store, rate: float) -> dict[str, float]:
    """By model, the confidence above which the original pictures give at most ``rate`` false alarms each."""
    truth_of = truths(store)
    found = {}
    for model in store.about("manifest")["models"]:
        name = model["name"]
        (clean,) = [row for row in queries.condition_counts(store, name) if row["clean"]]
        answers = queries.answers_at(store, name, clean)
        found[name] = Evaluated({}, truth_of(name) or NO_TRUTH, answers).alarms_from(0.0).confidence_at(rate)
    return found
