"""Charts of the explorer as options of Apache ECharts, in colours that are readable on light and dark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Point

_INK, _LINE, _ACCENT, _BAD, _GOOD = "#7c8894", "#8883", "#2584ad", "#d4622a", "#12803f2b"
_COLOURS = ("#e5484d", "#30a46c", "#3b7ee0")
_QUIET: dict[str, Any] = {"animation": False, "textStyle": {"color": _INK}}


def scores(
    curve: Sequence[Point], along: Control, at: float, enough: float, window: tuple[float, float] | None
) -> dict[str, Any]:
    """Scores along a control: of each target, and their mean. at: where the control stands; enough: the level;
    window: where the mean is enough."""
    targets = list(zip(*(point.scores for point in curve), strict=True))
    single = bool(along.choices) or len(targets) < 2
    means = [
        {
            "value": [point.value, point.mean],
            "itemStyle": {
                "color": _ACCENT if point.mean >= enough else "#fff0",
                "borderColor": _colour(point, enough),
            },
        }
        for point in curve
    ]
    lines: list[dict[str, Any]] = [{"yAxis": enough, "lineStyle": {"type": "dashed", "color": _INK}}]
    lines += (
        [{"xAxis": at, "lineStyle": {"type": "solid", "color": _INK, "width": 2}}]
        if math.isfinite(at)
        else []
    )
    mean = {
        "type": "scatter" if along.choices else "line",
        "data": means,
        "symbol": "circle",
        "symbolSize": 7,
        "lineStyle": {"color": _ACCENT},
        "markLine": {"symbol": "none", "label": {"show": False}, "silent": True, "data": lines},
        "markArea": {
            "silent": True,
            "itemStyle": {"color": _GOOD},
            "data": [[{"xAxis": window[0]}, {"xAxis": window[1]}]] if window else [],
        },
    }
    thin = {
        "type": "line",
        "symbol": "none",
        "silent": True,
        "lineStyle": {"color": _ACCENT, "width": 1, "opacity": 0.35},
    }
    values = [point.value for point in curve]
    of_targets = (
        [] if single else [{**thin, "data": list(zip(values, each, strict=True))} for each in targets]
    )
    kind = {"type": "log" if along.logarithmic else "value", "min": along.low, "max": along.high}
    names = {"type": "category", "data": list(along.choices)}
    return {
        **_QUIET,
        "grid": {"left": 34, "right": 16, "top": 8, "bottom": 24},
        "tooltip": {"trigger": "item"},
        "xAxis": {**(names if along.choices else kind), "splitLine": {"show": False}},
        "yAxis": {"min": 0, "max": 1, "interval": 0.5, "splitLine": {"lineStyle": {"color": _LINE}}},
        "series": [mean, *of_targets],
    }


def histogram(shares: NDArray[np.float64]) -> dict[str, Any]:
    """Shares (3, bins) of the values of red, green and blue, as roots."""
    hidden = {"show": False}
    series = [
        {
            "type": "line",
            "step": "middle",
            "symbol": "none",
            "silent": True,
            "data": np.sqrt(row).round(5).tolist(),
            "lineStyle": {"width": 0},
            "areaStyle": {"color": colour, "opacity": 0.55},
        }
        for row, colour in zip(shares, _COLOURS, strict=True)
    ]
    return {
        **_QUIET,
        "grid": {"left": 0, "right": 0, "top": 2, "bottom": 0},
        "xAxis": {"type": "category", "boundaryGap": False, **hidden},
        "yAxis": {"type": "value", **hidden},
        "series": series,
    }


def _colour(point: Point, enough: float) -> str:
    return _ACCENT if point.mean >= enough else _BAD
