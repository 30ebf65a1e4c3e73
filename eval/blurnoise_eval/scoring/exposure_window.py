"""The exposure window in which a detector keeps its confidence, and an exposure inside it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurnoise_eval.grid.axes import NAMES, SETTING, VELOCITY
from blurnoise_eval.scoring.curves import Surface

NEAR_BEST = 0.02
"""Confidences this close to the window's best count as equally good when one exposure is recommended."""


@dataclass(frozen=True)
class Answer:
    """What to do for one model and kind of target in one setting and at one velocity.

    at: values of all axes but the exposure. exposures_s: tested, increasing; confidence: mean over the
    ``n_targets`` samples (targets x repeats) at each; low, high: its 95 % bootstrap interval over pictures, or
    over noise fields below three pictures, None below three of either. windows_s: stretches of exposure in which
    the mean stays at or above the threshold, ends interpolated on a logarithmic scale; open_low, open_high: a
    window reaches the shortest or longest exposure tested. recommended_s: a tested exposure, None when no
    exposure works.
    """

    model: str
    group: str
    at: Mapping[str, float]
    n_targets: int
    exposures_s: tuple[float, ...]
    confidence: tuple[float, ...]
    low: tuple[float, ...] | None
    high: tuple[float, ...] | None
    windows_s: tuple[tuple[float, float], ...]
    open_low: bool
    open_high: bool
    recommended_s: float | None
    confidence_at_recommended: float | None

    def row(self) -> dict[str, Any]:
        """As a table's row: the axes are columns."""
        rest = {name: value for name, value in vars(self).items() if name not in ("model", "group", "at")}
        rest["windows_s"] = [list(window) for window in self.windows_s]
        return {"model": self.model, "group": self.group, **self.at, **rest}


def windows(
    exposures_s: Sequence[float], confidence: Sequence[float], threshold: float
) -> list[tuple[float, float]]:
    """Stretches of exposure with confidence >= threshold, between log-interpolated crossings.

    exposures_s: increasing, > 0. A stretch that holds at an end of the range ends there.
    """
    result: list[tuple[float, float]] = []
    start: float | None = None
    for index, (exposure, value) in enumerate(zip(exposures_s, confidence, strict=True)):
        above = value >= threshold
        if above and start is None:
            start = exposure if index == 0 else _crossing(exposures_s, confidence, index, threshold)
        elif not above and start is not None:
            result.append((start, _crossing(exposures_s, confidence, index, threshold)))
            start = None
    if start is not None:
        result.append((start, exposures_s[-1]))
    return result


def recommend(
    exposures_s: Sequence[float], confidence: Sequence[float], threshold: float
) -> tuple[float, float] | None:
    """A tested exposure and its confidence: of those near the best, the one with most stops to spare.

    The window that holds the best tested confidence counts; None when no exposure reaches the threshold.
    """
    best = max(range(len(exposures_s)), key=lambda index: confidence[index])
    if confidence[best] < threshold:
        return None
    found = windows(exposures_s, confidence, threshold)
    low, high = next(window for window in found if window[0] <= exposures_s[best] <= window[1])
    inside = [
        index
        for index, exposure in enumerate(exposures_s)
        if low <= exposure <= high and confidence[index] >= max(threshold, confidence[best] - NEAR_BEST)
    ]
    chosen = max(inside, key=lambda index: min(exposures_s[index] / low, high / exposures_s[index]))
    return exposures_s[chosen], confidence[chosen]


def answers(surface: Surface, threshold: float, generator: np.random.Generator) -> list[Answer]:
    """One :class:`Answer` for every velocity of the surface."""
    drawn = surface.resampled(generator)
    mean = surface.mean
    found = []
    for v, velocity in enumerate(surface.velocities_px_s):
        measured = np.isfinite(mean[:, v])
        if not measured.any():
            continue
        exposures = tuple(np.array(surface.exposures_s)[measured].tolist())
        means = tuple(mean[measured, v].tolist())
        low = high = None
        if drawn is not None:
            ends = np.nanquantile(drawn[:, measured, v], (0.025, 0.975), axis=0)
            low, high = (tuple(end.tolist()) for end in ends)
        choice = recommend(exposures, means, threshold)
        at = dict(zip((*SETTING, *VELOCITY), (*surface.setting, *velocity), strict=True))
        found.append(
            Answer(
                surface.model,
                surface.group,
                {name: at[name] for name in NAMES if name in at},
                n_targets=len(surface.confidence),
                exposures_s=exposures,
                confidence=means,
                low=low,
                high=high,
                windows_s=tuple(windows(exposures, means, threshold)),
                open_low=means[0] >= threshold,
                open_high=means[-1] >= threshold,
                recommended_s=choice[0] if choice else None,
                confidence_at_recommended=choice[1] if choice else None,
            )
        )
    return found


def natural(text: str) -> list[tuple[int, float, str]]:
    """A sort key that puts 32 px before 100 px."""
    parts = re.split(r"(\d+)", text)
    return [(1, float(part), "") if part.isdigit() else (0, 0.0, part) for part in parts]


def _crossing(
    exposures_s: Sequence[float], confidence: Sequence[float], index: int, threshold: float
) -> float:
    """Exposure at which the line from index - 1 to index meets the threshold, logarithmic in exposure."""
    before, after = confidence[index - 1], confidence[index]
    share = (threshold - before) / (after - before)
    shortest, longest = exposures_s[index - 1], exposures_s[index]
    start, end = math.log(shortest), math.log(longest)
    crossing = math.exp(start + share * (end - start))
    return min(max(crossing, shortest), longest)  # exp(log x) may miss x by a rounding
