"""The table of a run's models: how well each does in the original pictures, and how much of that it keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from blurnoise_eval.answers.per_condition import Scored
from blurnoise_eval.answers.rows import CurveRow, ModelRow
from blurnoise_eval.scoring.scores import of_models
from blurnoise_eval.scoring.uncertainty import ClusterEstimate, behind_best, mean_of, ratio, with_interval
from blurnoise_eval.store.columns import UNKNOWN, WithInterval
from blurnoise_eval.system.tables import finite


def model_rows(
    models: Sequence[Mapping[str, Any]],
    scored: Sequence[Scored],
    curves: Sequence[CurveRow],
    grid_s: Sequence[float],
    labelled: bool,
) -> list[ModelRow]:
    """The rows of the table of models, by the conditions of the grid where there is one.

    The interval of ``mpc_deficit`` is of the difference paired by picture, and holds at 95 % for all pairs of models
    together.
    """
    known: dict[str, list[Scored]] = {model["name"]: [] for model in models}
    for condition in scored:
        at = condition.row.conditions
        on_grid = not grid_s or at.original or at.exposure_s in grid_s
        if condition.performance.value is not None and on_grid:
            known[condition.row.model].append(condition)
    mpc = {
        name: mean_of([condition.performance for condition in own if not condition.row.conditions.original])
        for name, own in known.items()
    }
    deficits = _deficits(mpc)
    originals = {
        condition.row.model: condition.row for condition in scored if condition.row.conditions.original
    }
    rows = []
    for model in models:
        name = model["name"]
        scores = originals[name].scores if name in originals else {}
        own_curves = [curve for curve in curves if curve.model == name]
        rows.append(_summary(model, scores, known[name], mpc[name], deficits[name], own_curves, labelled))
    return rows


def _deficits(mpc: Mapping[str, ClusterEstimate]) -> dict[str, WithInterval]:
    """By model how much less mPC it has than the best; unknown of the best itself."""
    values = {name: estimate.value for name, estimate in mpc.items() if estimate.value is not None}
    best = max(values, key=lambda name: values[name], default=None)
    influences = {name: away for name in values if (away := mpc[name].influence) is not None}
    ends = dict.fromkeys(mpc, (np.nan, np.nan))
    if best in influences:
        together = behind_best([values[name] for name in influences], np.array(list(influences.values())).T)
        both = np.clip(together, -1.0, 1.0).T.tolist()  # of a difference of shares
        ends |= {name: (low, high) for name, (low, high) in zip(influences, both, strict=True)}
    lacks = {name: values[best] - values[name] for name in values if best is not None and name != best}
    return {
        name: WithInterval(*map(finite, (lacks[name], *ends[name]))) if name in lacks else UNKNOWN
        for name in mpc
    }


def _summary(
    model: Mapping[str, Any],
    original: Mapping[str, WithInterval],
    known: Sequence[Scored],
    mpc: ClusterEstimate,
    deficit: WithInterval,
    curves: Sequence[CurveRow],
    labelled: bool,
) -> ModelRow:
    """One row of the table of models.

    original: scores on the original pictures. mPC: mean over the grid's conditions, all weighted alike. P, mPC and
    rPC have intervals over clusters of pictures, each left out of the whole measure.
    """
    untouched = (condition.performance for condition in known if condition.row.conditions.original)
    p = next(untouched, ClusterEstimate(None))
    against_itself = model["kind"] == "detector" and not labelled
    latency = model.get("latency", {})
    return ModelRow(
        model=model["name"],
        kind=model["kind"],
        measure="AP" if model["kind"] == "detector" else "exact match",
        p=UNKNOWN if against_itself else with_interval(p, 1.0),
        mpc=with_interval(mpc, 1.0),
        rpc=with_interval(ratio(mpc, p), 1 / p.value if p.value else math.inf),
        auc_exposure=_mean_auc(curves, "exposure_s"),
        auc_blur=_mean_auc(curves, "blur_px"),
        scores={
            score.name: original.get(score.name, UNKNOWN)
            for score in of_models("detector")
            if score.of_pictures
        },
        latency_ms=latency.get("median_ms"),
        latency_p95_ms=latency.get("p95_ms"),
        latency_threads=latency.get("threads"),
        mpc_deficit=deficit,
    )


def _mean_auc(curves: Sequence[CurveRow], axis: str) -> float | None:
    """Mean area under the curves of one axis, all groups, settings and curves alike; None without any."""
    areas = [curve.auc for curve in curves if curve.axis == axis]
    return float(np.mean(areas)) if areas else None
