"""Surfaces of a run: what its store holds, in the unit of a criterion.

Domain: criteria as in :mod:`blurnoise_eval.scoring.criterion`; names of pictures as the store has them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import groupby
from typing import Any

from blurnoise.camera import Camera
from blurnoise.picture.develop import tones_8bit
from blurnoise_eval.scoring import criterion as criteria
from blurnoise_eval.scoring.alarm_rate import confidence_at
from blurnoise_eval.scoring.clusters import cluster_of
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.judged import Judged
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.surfaces import Surface, surfaces
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.coco_export import truths

_DARK = 0.09  # of full scale: half of what auto-exposure aims at
Row = Mapping[str, Any]


def criterion_of(
    store: Store, threshold: float | None = None, keep: float | None = None, score: str | None = None
) -> Criterion:
    """The criterion of a run, see :func:`~.scoring.criterion.stated`. Raises ``StoreError`` for none that began."""
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"run = {str(store.folder)!r}: no sweep has begun here")
    reads = any(model["kind"] == "reader" for model in manifest["models"])
    rendered = manifest["images"]["kind"] == "rendered"
    labelled = manifest["images"]["labelled"]
    return criteria.stated(threshold, keep, score, rendered=rendered, reads=reads, labelled=labelled)


def grouped_surfaces(store: Store, criterion: Criterion, cluster: str | None) -> Iterator[list[Surface]]:
    """The surfaces of a run, those of one model and group together. cluster: a pattern on pictures' names.

    Of a score of targets; those of AP are :func:`~.scoring.score_surfaces.score_surfaces`.
    """
    value_of = _value_of(store, criterion)
    clean = {_target(row): value_of(row) for row in queries.untouched_targets(store)}
    every = surfaces(
        queries.exposed_targets(store),
        value_of,
        partial(cluster_of, pattern=cluster),
        clean_of=lambda row: clean.get(_target(row)),
        kept=criterion.kept,
    )
    for _, of_group in groupby(every, key=lambda each: (each.model, each.group)):
        yield list(of_group)


def too_little(surface: Surface) -> bool:
    """Whether a group's targets have too little in the untouched pictures to say what is kept of it: less than 1 in
    sum, and less on average than what is found has."""
    return surface.kept and surface.reference < 1 and (surface.clean or 0.0) < FOUND_SCORE


def dark_below(camera: Camera) -> float:
    """Mean brightness of a picture, 0-1, that is half of what auto-exposure aims at."""
    black = camera.black_level_dn
    place = round(black + _DARK * (camera.full_scale_dn - black))
    return int(tones_8bit(camera)[place]) / 255


def _target(row: Row) -> tuple[str, str, int]:
    return row["model"], row["image"], row["target_id"]


def _value_of(store: Store, criterion: Criterion) -> Callable[[Row], float | None]:
    """A row's score."""
    if criterion.score == criteria.MATCHES:
        return lambda row: None if row["truth"] is None else float(row["text"] == row["truth"])
    if criterion.score == criteria.RATE:
        return lambda row: float(row["confidence"] >= FOUND_SCORE)
    rate = criterion.alarms_per_picture
    if rate is None:
        return lambda row: float(row["confidence"])
    beyond = alarm_confidences(store, rate)
    return lambda row: float(row["confidence"] > beyond[row["model"]])


def alarm_confidences(store: Store, rate: float) -> dict[str, float]:
    """By model, the confidence above which the untouched pictures give at most ``rate`` false alarms each."""
    truth_of = truths(store)
    found = {}
    for model in store.about("manifest")["models"]:
        name = model["name"]
        clean = [row for row in queries.condition_counts(store, name) if row["clean"]]
        cells = [cell for row in clean for cell in queries.detections_at(store, name, row)]
        found[name] = confidence_at(Judged({}, truth_of(name), cells), rate)
    return found
