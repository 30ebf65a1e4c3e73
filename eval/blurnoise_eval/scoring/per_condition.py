"""What each model scores under each condition of a run: COCO's averages, false alarms, calibration, reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from blurnoise_eval.scoring.judged import Judged, Truth
from blurnoise_eval.scoring.matching import FOUND_SCORE, MoveBoxes
from blurnoise_eval.scoring.registry import SCORES
from blurnoise_eval.store import queries
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store

COUNTS = ("n_images", "n_targets", "errors")


def score_rows(
    store: Store,
    models: Sequence[str],
    truth_of: Callable[[str], Truth | None],
    progress: Callable[[int], None] = lambda rows: None,
    *,
    moves: Callable[[Mapping[str, Any]], tuple[MoveBoxes | None, MoveBoxes | None]] = lambda row: (
        None,
        None,
    ),
) -> Iterator[dict[str, Any]]:
    """One row per model and condition, the untouched pictures first: a column for each of ``SCORES``.

    truth_of: a model's truth, None for a reader. moves: where the conditions of a row have moved the truth's
    boxes, and what these sweep. Pictures that could not be read do not count; those on which the model failed count
    as answered by nothing.
    """
    for model in models:
        truth = truth_of(model)
        for row in queries.condition_means(store, model, FOUND_SCORE):
            cells = [] if truth is None else list(queries.detections_at(store, model, row))
            judged = Judged(row, truth, cells, *((None, None) if row["clean"] else moves(row)))
            progress(1)
            shared = {name: row[name] for name in ("model", *CONDITIONS, "blur_px", *COUNTS)}
            yield shared | {score.name: score.of(judged) for score in SCORES}


def performance(row: Mapping[str, Any]) -> float | None:
    """The one number of a score row that P, mPC and rPC are made of: AP, or for a reader exact matches."""
    value = row["exact_match"] if row["ap"] is None else row["ap"]
    return None if value is None or math.isnan(value) else float(value)
