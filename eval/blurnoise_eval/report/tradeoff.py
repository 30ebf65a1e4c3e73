"""Latency against robustness: which models are beaten by none in both.

Domain: latency in ms per picture, robustness as a fraction (area under a curve over its range, or rPC).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import finite

ROBUSTNESS = {
    "auc_exposure": "AUC over exposure",
    "auc_blur": "AUC over blur",
    "rpc": "rPC",
}


class Trade(NamedTuple):
    """One model's place: median latency, its 95th percentile, a robustness; ``best``: on the Pareto front."""

    model: str
    latency_ms: float
    p95_ms: float | None
    robustness: float
    best: bool


def pareto_front(points: Sequence[tuple[float | None, float | None]]) -> list[bool]:
    """For each (cost, gain), whether no other point costs no more, gains no less and betters it in one of both.

    Equal points stand on the front together. A point that lacks a value, or whose value is not finite, is
    not on it and keeps none off it.
    """
    known = [(finite(cost), finite(gain)) for cost, gain in points]
    whole = [(cost, gain) for cost, gain in known if cost is not None and gain is not None]
    return [
        cost is not None
        and gain is not None
        and not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in whole)
        for cost, gain in known
    ]


def trades(data: RunData, measure: str) -> list[Trade]:
    """Every model with a latency and this robustness (a key of ``ROBUSTNESS``), in the run's order."""
    front = pareto_front([(row["latency_ms"], row[measure]) for row in data.models])
    return [
        Trade(row["model"], latency, finite(row["latency_p95_ms"]), robustness, best)
        for row, best in zip(data.models, front, strict=True)
        if (latency := finite(row["latency_ms"])) is not None
        and (robustness := finite(row[measure])) is not None
    ]


def comparable(data: RunData) -> list[str]:
    """The measures of robustness by which at least two models can be compared."""
    return [measure for measure in ROBUSTNESS if len(trades(data, measure)) > 1]
