"""Surfaces of a run: what its store holds, in the unit of a criterion.

Domain: criteria as in :mod:`blurnoise_eval.scoring.criterion`; names of pictures as the store has them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.picture.develop import tones_8bit
from blurnoise_eval.grid.axes import setting_of, velocity_of
from blurnoise_eval.scoring import criterion as criteria
from blurnoise_eval.scoring.alarm_rate import confidence_at
from blurnoise_eval.scoring.clusters import cluster_of
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.judged import Judged
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.monotone import is_uniform, pooled
from blurnoise_eval.scoring.recommendation import Averages, averages
from blurnoise_eval.scoring.surfaces import Measured, Surface, surface_of
from blurnoise_eval.store import queries
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.store.target_columns import TargetColumns, target_columns
from blurnoise_eval.sweep.coco_export import truths

ENOUGH = "enough"
"""Under which a run's store keeps what was asked to be enough last."""
LEAST_AP50 = 0.05
"""Of the labelled original pictures: below, a detector has no answers."""

LEAST_KNOWN = 0.05
"""Mean score of a group's targets in the original pictures from which on its kept share means something: below it
one target in twenty is found at most, or none with any confidence."""
_DARK = 0.09  # of full scale: half of what auto-exposure aims at


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


def asked_enough(store: Store) -> dict[str, Any]:
    """What was asked to be enough when the run was computed: threshold, keep and score; none of an old run."""
    held: dict[str, Any] = store.about(ENOUGH) or {}
    return held


def grouped_surfaces(store: Store, criterion: Criterion, cluster: str | None) -> Iterator[list[Surface]]:
    """The surfaces of a run, those of one model and group together. cluster: a pattern on pictures' names.

    Of a score of targets; those of AP are :func:`~.scoring.score_surfaces.score_surfaces`.
    """
    for model in queries.models_seen(store):
        yield from _of_model(store, model, criterion, cluster)


def _of_model(store: Store, model: str, criterion: Criterion, cluster: str | None) -> Iterator[list[Surface]]:
    """One model's, group after group."""
    columns = target_columns(store, model)
    values = _values(store, model, columns, criterion)
    rows = [dict(zip(CONDITIONS, each, strict=True)) for each in columns.conditions]
    is_clean = np.array([bool(row["clean"]) for row in rows], bool)
    untouched = is_clean[columns.condition] if len(rows) else np.zeros(0, bool)
    clean = _clean_values(columns, values, untouched)
    exposed = [row for row in rows if not row["clean"]]
    as_set = iter(queries.as_set(store, exposed))
    taken = [row if row["clean"] else next(as_set) for row in rows]
    settings = [None if row["clean"] else setting_of(row) for row in rows]
    unlike = sorted({setting for setting in settings if setting is not None})
    exposure_s = np.array([np.nan if row["clean"] else row["exposure_s"] for row in taken], float)
    velocity = np.array([(np.nan, np.nan) if row["clean"] else velocity_of(row) for row in rows], float)
    of_setting = np.array([-1 if each is None else unlike.index(each) for each in settings], np.int64)
    alike = columns.group.astype(np.int64) * max(len(unlike), 1) + of_setting[columns.condition]
    order = np.lexsort((columns.target_id, columns.repeat, columns.picture, np.where(untouched, -1, alike)))
    order = order[np.count_nonzero(untouched) :]
    ends = np.append(np.flatnonzero(np.diff(alike[order], prepend=-1)), len(order))
    found: dict[str, list[Surface]] = {}
    for start, stop in pairwise(ends.tolist()):
        here = order[start:stop]
        group, setting = divmod(int(alike[here[0]]), len(unlike))
        some, at = columns.rows(here), columns.condition[here]
        measured = Measured(
            columns.pictures,
            some.picture,
            some.repeat,
            some.target_id,
            exposure_s[at],
            velocity[at].reshape(-1, 2),
            values[here],
            clean[here],
            some.saturated,
            some.brightness,
        )
        name = columns.groups[group]
        own = surface_of(
            model, name, unlike[setting], measured, partial(cluster_of, pattern=cluster), kept=criterion.kept
        )
        if own is not None:
            found.setdefault(name, []).append(own)
    yield from found.values()


def _clean_values(
    columns: TargetColumns, values: NDArray[np.float64], untouched: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """What the target of each row has in the untouched picture, NaN where that is not known."""
    most = 1 + int(columns.target_id.max(initial=0))
    key = columns.picture.astype(np.int64) * most + columns.target_id
    of_clean = key[untouched]
    order = np.argsort(of_clean, kind="stable")
    if not len(order):
        return np.full(len(key), np.nan)
    place = np.minimum(np.searchsorted(of_clean[order], key), len(order) - 1)
    found = of_clean[order][place] == key
    return np.where(found, values[untouched][order][place], np.nan)


def too_little(surface: Surface) -> bool:
    """Whether a group's targets score too little in the original pictures to say what a model keeps of it.

    That is less than ``LEAST_KNOWN`` on average, however many they are, and where they make less than 1 in sum, less
    than what counts as found.
    """
    least = FOUND_SCORE if surface.reference < 1 else LEAST_KNOWN
    return surface.kept and (surface.clean or 0.0) < least


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


def run_averages(store: Store, surfaces: Iterable[Surface], level: float) -> list[Averages]:
    """Of each model what its recommendations are made of: pooled over speeds where motion can only hurt, with the
    shares of saturated values as means over pictures."""
    monotone = store.about("manifest").get("trajectory") is None
    shares = queries.saturated_shares(store)
    of_model: dict[str, list[Surface]] = {}
    for surface in surfaces:
        of_model.setdefault(surface.model, []).append(surface)
    return [
        averages(
            [pooled(each) if monotone and is_uniform(each) else each for each in own],
            level,
            monotone=monotone and all(map(is_uniform, own)),
        ).with_saturated(lambda setting, velocity, exposure_s: shares.get((*setting, *velocity, exposure_s)))
        for own in of_model.values()
    ]


def dark_below(camera: Camera) -> float:
    """Mean brightness of a picture, 0-1, that is half of what auto-exposure aims at."""
    black = camera.black_level_dn
    place = round(black + _DARK * (camera.full_scale_dn - black))
    return int(tones_8bit(camera)[place]) / 255


def _values(store: Store, model: str, columns: TargetColumns, criterion: Criterion) -> NDArray[np.float64]:
    """Each row's score, NaN where it has none."""
    if criterion.score == criteria.MATCHES:
        return columns.exact
    if criterion.score == criteria.RATE:
        return (columns.confidence >= FOUND_SCORE).astype(float)
    rate = criterion.alarms_per_picture
    if rate is None:
        return columns.confidence
    return (columns.confidence > alarm_confidences(store, rate)[model]).astype(float)


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
