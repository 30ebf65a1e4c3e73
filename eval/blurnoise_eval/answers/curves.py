"""Curves of a group of targets over one axis, or blur: how long they hold, and how certain that is.

Domain: axes as in :mod:`blurnoise_eval.grid.axes`; blur in px, confidences in the unit of a criterion: its score,
or the share of it that is kept.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.crossings import Curve
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.answers.uncertainty import FEW
from blurnoise_eval.grid.axes import NAMES, SETTING, axis

BLUR = "blur_px"


@dataclass(frozen=True)
class Endurance:
    """How one curve holds: mean confidence against one axis, or blur, all else staying as it is.

    axis: the name of an axis or "blur_px". at: values of all axes, None on those that vary along the curve.
    x: increasing. auc: area under the curve over the range of x, so the mean confidence over it. fails_at: where
    the curve falls below the criterion for good (x[0]: it is below throughout), None where it does not within the
    range. Intervals at 95 % over ``n_pictures`` clusters: auc_low, auc_high; fails_low, fails_high, None at an
    end that is not reached within the range. None throughout below 8 pictures; few_pictures: below 20, both as
    :func:`~blurnoise_eval.answers.uncertainty.effective`.
    non_monotonic: the curve had been below and come back. criterion: in words.
    """

    model: str
    group: str
    axis: str
    at: Mapping[str, float | None]
    x: tuple[float, ...]
    confidence: tuple[float, ...]
    auc: float | None
    fails_at: float | None
    fails_low: float | None
    fails_high: float | None
    non_monotonic: bool
    auc_low: float | None
    auc_high: float | None
    n_pictures: int
    few_pictures: bool
    criterion: str

    def row(self) -> dict[str, Any]:
        """As a table's row: the axes are columns, the light before the others."""
        first = {"illuminance_lux": self.at["illuminance_lux"], "axis": self.axis}
        rest = {
            name: value for name, value in vars(self).items() if name not in ("model", "group", "axis", "at")
        }
        return {"model": self.model, "group": self.group, **first, **self.at, **rest}


def endurances(
    table: ScoreTable, criterion: Criterion, exposures_s: Collection[float] = ()
) -> Iterator[Endurance]:
    """Of each setting every curve through at least two points: over exposure, then over blur, at each exposure or, if
    there are any, those of ``exposures_s`` alone."""
    for setting in table.take(table.measured).split(SETTING):
        yield from _along(setting, "exposure_s", criterion)
        for at_once in setting.split(["exposure_s"]):
            exposure_s = float(at_once.conditions["exposure_s"][0])
            speeds, place = np.unique(at_once.speeds_px_s, return_inverse=True)
            if len(speeds) < 2 or (exposures_s and exposure_s not in exposures_s):
                continue
            alike = (np.arange(len(speeds)) == place[:, None]).astype(
                float
            )  # directions of one speed: one point
            x = tuple((speeds * exposure_s).tolist())  # straight in px, since pictures at rest have none
            counts, cov = at_once.counts @ alike, None
            if at_once.prediction_cov is not None:
                shares = alike * at_once.counts.sum(axis=0)[:, None] / counts.sum(axis=0)
                cov = shares.T @ at_once.prediction_cov(np.arange(len(at_once))) @ shares
            curve = Curve(x, at_once.sums @ alike, counts, most=table.most, open=cov)
            yield _endurance(at_once, BLUR, ("exposure_s", *SETTING), curve, criterion)


def endurances_across(table: ScoreTable, criterion: Criterion) -> Iterator[Endurance]:
    """Every curve through at least two points over an axis of the setting on which a detector fails, at one exposure
    and velocity."""
    for name in SETTING:
        if axis(name).fails:
            yield from _along(table.take(table.measured), name, criterion)


def _along(table: ScoreTable, name: str, criterion: Criterion) -> Iterator[Endurance]:
    for line in table.along(name):
        if len(line) > 1:
            fixed = [each for each in NAMES if each != name]
            yield _endurance(line, name, fixed, Curve.of(line, name), criterion)


def mean_auc(found: Sequence[Endurance], axis: str) -> float | None:
    """Mean area under the curves of one axis, all groups, settings and curves alike; None without any."""
    areas = [each.auc for each in found if each.axis == axis and each.auc is not None]
    return float(np.mean(areas)) if areas else None


def _endurance(
    line: ScoreTable, over: str, fixed: Collection[str], curve: Curve, criterion: Criterion
) -> Endurance:
    """fixed: the axes that do not vary along the curve."""
    at = {name: value if name in fixed else None for name, value in line.at(0).items()}
    crossed, n = curve.crossed(criterion.level), curve.n_clusters
    above = curve.mean >= criterion.level
    returned = bool((above[1:] & ~above[:-1]).any())
    ends = [window[1] for window in crossed.windows]
    at_end = ends[-1] if ends else curve.x[0]
    auc, (auc_low, auc_high) = curve.area()
    low, high = crossed.fails_between
    return Endurance(
        line.model,
        line.group,
        over,
        at,
        curve.x,
        tuple(curve.mean.tolist()),
        auc,
        None if curve.mean[-1] >= criterion.level else at_end,
        low,
        high,
        returned,
        auc_low,
        auc_high,
        n,
        curve.n_effective < FEW,
        criterion.text,
    )
