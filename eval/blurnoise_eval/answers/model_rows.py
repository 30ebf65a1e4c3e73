"""The table of a run's models: how well each does in the original pictures, and how much of that it keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from blurnoise_eval.scoring.scores import of_models
from blurnoise_eval.scoring.uncertainty import Estimate, behind_best, columns, mean_of, ratio
from blurnoise_eval.system.tables import finite

_ENDS = "", "_low", "_high"


def model_rows(
    models: Sequence[dict[str, Any]],
    scores: list[dict[str, Any]],
    performances: list[Estimate],
    curves: list[dict[str, Any]],
    grid_s: Sequence[float],
    labelled: bool,
) -> list[dict[str, Any]]:
    """The rows of the table of models, by the conditions of the grid where there is one.

    With what each lacks in mPC compared with the best: ``mpc_deficit``.
    Its interval is of the difference paired by picture, and holds at 95 % for all pairs of models together.
    """
    known: dict[str, list[tuple[dict[str, Any], Estimate]]] = {model["name"]: [] for model in models}
    for row, each in zip(scores, performances, strict=True):
        on_grid = not grid_s or row["clean"] or row["exposure_s"] in grid_s
        if each.value is not None and on_grid:
            known[row["model"]].append((row, each))
    mpc = {name: mean_of([each for row, each in own if not row["clean"]]) for name, own in known.items()}
    behind = _behind(mpc)
    return [
        _summary(model, scores, known[model["name"]], mpc[model["name"]], curves, labelled)
        | {f"mpc_deficit{end}": value for end, value in zip(_ENDS, behind[model["name"]], strict=True)}
        for model in models
    ]


def _behind(mpc: Mapping[str, Estimate]) -> dict[str, tuple[float | None, ...]]:
    """By model how much less it is than the best, and the interval of that; None of the best itself."""
    values = {name: each.value for name, each in mpc.items() if each.value is not None}
    first = max(values, key=lambda name: values[name], default=None)
    away = {name: own for name in values if (own := mpc[name].influence) is not None}
    ends = dict.fromkeys(mpc, (np.nan, np.nan))
    if first in away:
        together = behind_best([values[name] for name in away], np.array(list(away.values())).T)
        both = np.clip(together, -1.0, 1.0).T.tolist()  # of a difference of shares
        ends |= {name: (low, high) for name, (low, high) in zip(away, both, strict=True)}
    lacks = {name: values[first] - values[name] for name in values if first is not None and name != first}
    return {
        name: tuple(map(finite, (lacks[name], *ends[name]))) if name in lacks else (None,) * 3 for name in mpc
    }


def _summary(
    model: dict[str, Any],
    scores: list[dict[str, Any]],
    own_scores: list[tuple[dict[str, Any], Estimate]],
    mpc: Estimate,
    curves: list[dict[str, Any]],
    labelled: bool,
) -> dict[str, Any]:
    """One row of the table of models. mPC: mean over the grid's conditions, all weighted alike.
    Of a detector without labels P is None: it is 1.

    P, mPC and rPC have intervals over clusters of pictures, each left out of the whole measure.
    """
    own = [row for row in scores if row["model"] == model["name"]]
    p = next((each for row, each in own_scores if row["clean"]), Estimate(None))
    against_itself = model["kind"] == "detector" and not labelled
    rpc = ratio(mpc, p)
    held = [each for each in curves if each["model"] == model["name"]]
    clean_row = next((row for row in own if row["clean"]), {})
    latency = model.get("latency", {})
    original = [score.name for score in of_models("detector") if score.of_pictures]
    return {
        "model": model["name"],
        "kind": model["kind"],
        "measure": "AP" if model["kind"] == "detector" else "exact match",
        **columns(Estimate(None) if against_itself else p, "p", 1.0),
        **columns(mpc, "mpc", 1.0),
        **columns(rpc, "rpc", 1 / p.value if p.value else math.inf),
        "auc_exposure": _mean_auc(held, "exposure_s"),
        "auc_blur": _mean_auc(held, "blur_px"),
        **{f"{name}{end}": clean_row.get(f"{name}{end}") for name in original for end in _ENDS},
        "latency_ms": latency.get("median_ms"),
        "latency_p95_ms": latency.get("p95_ms"),
        "latency_threads": latency.get("threads"),
    }


def _mean_auc(curves: Sequence[Mapping[str, Any]], axis: str) -> float | None:
    """Mean area under the curves of one axis, all groups, settings and curves alike; None without any."""
    areas = [each["auc"] for each in curves if each["axis"] == axis and each["auc"] is not None]
    return float(np.mean(areas)) if areas else None
