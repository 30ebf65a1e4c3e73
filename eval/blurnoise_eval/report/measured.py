"""The measured points of a run, and which of its models, targets and settings a report shows.

Domain: confidences in [0, 1], exposures in s, velocities in px/s, blur in px.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import matplotlib
import numpy as np

from blurnoise_eval.detectors.baked import UNSEEN_SCORE
from blurnoise_eval.grid.axes import velocity_of
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.settings import Setting
from blurnoise_eval.scoring.criterion import CONFIDENCE

T = TypeVar("T", bound=Hashable)


class Point(NamedTuple):
    """Mean confidence of one model in one target group and condition, with its 95 % interval if there is one."""

    model: str
    group: str
    setting: Setting
    velocity_px_s: tuple[float, float]
    exposure_s: float
    confidence: float
    low: float | None
    high: float | None
    n_targets: int

    @property
    def speed_px_s(self) -> float:
        """Length of the velocity."""
        return math.hypot(*self.velocity_px_s)

    @property
    def blur_px(self) -> float:
        """Length of the motion during the exposure."""
        return self.speed_px_s * self.exposure_s


def points(data: RunData) -> list[Point]:
    """The measured points of all answers; none where nothing was measured."""
    found = []
    for answer in data.answers:
        unknown = [None] * len(answer["exposures_s"])
        means = answer["exposures_s"], answer["confidence"]
        bounds = answer["low"] or unknown, answer["high"] or unknown
        where = answer["model"], answer["group"], data.settings.of(answer), velocity_of(answer)
        for exposure_s, confidence, low, high in zip(*means, *bounds, strict=True):
            if (mean := finite(confidence)) is not None:
                found.append(Point(*where, exposure_s, mean, finite(low), finite(high), answer["n_targets"]))
    return found


def model_names(data: RunData) -> list[str]:
    """The run's models, in its order."""
    return [model["name"] for model in data.manifest["models"]]


def unseen_below(data: RunData, model: str, group: str) -> float | None:
    """The lowest score that ever leaves a model's graph, where confidence is drawn, as the share of the untouched
    pictures' if that is; None where it hides nothing."""
    about = next(each for each in data.manifest["models"] if each["name"] == model)
    lowest = (about.get("baked") or {}).get("lowest_score")
    if lowest is None or lowest < UNSEEN_SCORE or data.criterion.score != CONFIDENCE:
        return None
    if not data.criterion.kept:
        return float(lowest)
    clean = clean_confidence(data, model, group)
    return float(lowest) / clean if clean else None


def largest_groups(data: RunData, count: int) -> list[str]:
    """At most ``count`` target groups, those with most targets, in the order of the answers."""
    sizes: dict[str, int] = {}
    for answer in data.answers:
        sizes[answer["group"]] = max(sizes.get(answer["group"], 0), answer["n_targets"])
    kept = set(sorted(sizes, key=lambda group: -sizes[group])[:count])
    return [group for group in sizes if group in kept]


def clean_confidence(data: RunData, model: str, group: str) -> float | None:
    """Mean confidence of a model in a group on the untouched pictures, None where they were not run."""
    for row in data.groups:
        if (row["model"], row["group"]) == (model, group):
            return finite(row["clean_confidence"])
    return None


def one_velocity_per_speed(velocities_px_s: Iterable[tuple[float, float]]) -> bool:
    """Whether no two velocities share a speed, so that a line over speed is one line."""
    velocities = set(velocities_px_s)
    return len(velocities) == len({math.hypot(*velocity) for velocity in velocities})


def common_windows(windows_s: Sequence[Sequence[Sequence[float]]]) -> list[tuple[float, float]]:
    """The ranges, in s, that lie inside a window of every list; empty where there is none."""
    if not windows_s:
        return []
    common = [(low, high) for low, high in windows_s[0]]
    for windows in windows_s[1:]:
        overlaps = [(max(a, c), min(b, d)) for a, b in common for c, d in windows]
        common = [(low, high) for low, high in overlaps if low <= high]
    return common


def spread(values: Iterable[T], count: int) -> list[T]:
    """At most ``count`` of the values, evenly spread, the first and the last among them."""
    every = list(values)
    if len(every) <= count:
        return every
    return [every[round(i)] for i in np.linspace(0, len(every) - 1, count)]


def spread_examples(data: RunData, count: int) -> list[dict[str, Any]]:
    """At most ``count`` examples, evenly spread over the conditions; each condition with all models, if it can.

    In the order of pictures and conditions; the models of one condition stand together, in the run's order.
    """
    order = {name: place for place, name in enumerate(model_names(data))}
    per_condition: dict[str, list[dict[str, Any]]] = {}
    for example in sorted(data.examples, key=lambda each: order[each["model"]]):
        per_condition.setdefault(example["path"], []).append(example)
    models = max(map(len, per_condition.values()), default=1)
    paths = dict.fromkeys(example["path"] for example in data.examples)
    kept = spread(paths, max(1, count // models))
    return [example for path in kept for example in per_condition[path]][:count]


def line_colours(name: str, count: int) -> list[str]:
    """``count`` hex colours from dark to bright of a perceptually even map, its brightest sixth left out."""
    even = matplotlib.colormaps[name](np.linspace(0, 0.84, count) if count > 1 else [0.35])
    return [str(matplotlib.colors.to_hex(colour)) for colour in even]


def finite(value: float | None) -> float | None:
    """The value, or None for what is none, infinite or not a number."""
    return float(value) if value is not None and math.isfinite(value) else None
