"""Curves of a group of targets over one axis, or blur: how long they hold, and how certain that is.

Domain: axes as in :mod:`blurnoise_eval.grid.axes`; blur in px, confidences in the unit of a criterion: its score,
or the share of it that is kept.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import NAMES, SETTING, VELOCITY, axis
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.crossings import Curve
from blurnoise_eval.scoring.surfaces import Surface

Array = NDArray[np.float64]
BLUR = "blur_px"
Place = tuple[float | None, float | None, float | None]
"""Exposure and velocity, None where they vary along a curve."""


@dataclass(frozen=True)
class Endurance:
    """How one curve holds: mean confidence against one axis, or blur, all else staying as it is.

    axis: the name of an axis or "blur_px". at: values of all axes, None on those that vary along the curve.
    x: increasing. auc: area under the curve over the range of x, so the mean confidence over it. fails_at: where
    the curve falls below the criterion for good (x[0]: it is below throughout), None where it does not within the
    range. Intervals at 95 % over ``n_pictures`` clusters: auc_low, auc_high; fails_low, fails_high, None at an
    end that is not reached within the range. None throughout below 8 pictures; few_pictures: below 20, both as
    :func:`~blurnoise_eval.scoring.certainty.effective`.
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
    surface: Surface, criterion: Criterion, exposures_s: Collection[float] = ()
) -> Iterator[Endurance]:
    """Every curve of the surface with at least two points: over exposure, then over blur, at each exposure or, if
    there are any, those of ``exposures_s`` alone."""
    exposures = np.array(surface.exposures_s)
    for v, velocity in enumerate(surface.velocities_px_s):
        curve = _measured(
            exposures, surface.sums[:, :, v], surface.counts[:, :, v], "exposure_s", surface.most
        )
        if curve is not None:
            yield _endurance(surface, "exposure_s", (None, *velocity), curve, criterion)
    speeds, place = np.unique([np.hypot(*v) for v in surface.velocities_px_s], return_inverse=True)
    alike = (np.arange(len(speeds)) == place[:, None]).astype(float)  # directions of one speed are one point
    for e, exposure_s in enumerate(surface.exposures_s):
        if exposures_s and exposure_s not in exposures_s:
            continue
        of_speeds = surface.sums[:, e] @ alike, surface.counts[:, e] @ alike
        curve = _measured(speeds * exposure_s, *of_speeds, BLUR, surface.most)
        if curve is not None:
            yield _endurance(surface, BLUR, (exposure_s, None, None), curve, criterion)


def endurances_across(found: Sequence[Surface], criterion: Criterion) -> Iterator[Endurance]:
    """Every curve with at least two points over an axis of the setting on which a detector fails, at one exposure
    and velocity.

    found: the surfaces of one model and group, whose clusters of one name are the same.
    """
    columns = zip(*(surface.setting for surface in found), strict=True)
    varied = [name for name, column in zip(SETTING, columns, strict=True) if len(set(column)) > 1]
    failing = [name for name in varied if axis(name).fails]
    if not failing:
        return
    clusters = tuple(dict.fromkeys(cluster for surface in found for cluster in surface.clusters))
    paired = [surface.of_clusters(clusters) for surface in found]
    for name in failing:
        place = SETTING.index(name)
        lines: dict[tuple[float, ...], list[int]] = {}
        for index, surface in enumerate(found):
            lines.setdefault((*surface.setting[:place], *surface.setting[place + 1 :]), []).append(index)
        for line in lines.values():
            line.sort(key=lambda index: found[index].setting[place])
            x = np.array([found[index].setting[place] for index in line])
            tested = {
                (e, v)
                for index in line
                for e in found[index].exposures_s
                for v in found[index].velocities_px_s
            }
            for exposure_s, velocity in sorted(tested):
                cuts = [
                    [_cut(values, found[index], exposure_s, velocity) for values in paired[index]]
                    for index in line
                ]
                sums, counts = (np.stack(part, axis=1) for part in zip(*cuts, strict=True))
                curve = _measured(x, sums, counts, name, max(found[index].most for index in line))
                if curve is not None:
                    yield _endurance(found[line[0]], name, (exposure_s, *velocity), curve, criterion)


def mean_auc(found: Sequence[Endurance], axis: str) -> float | None:
    """Mean area under the curves of one axis, all groups, settings and curves alike; None without any."""
    areas = [each.auc for each in found if each.axis == axis and each.auc is not None]
    return float(np.mean(areas)) if areas else None


def _cut(values: Array, surface: Surface, exposure_s: float, velocity: tuple[float, float]) -> Array:
    """What values (C, E, V) are at one exposure and velocity, 0 where the surface does not reach."""
    if exposure_s not in surface.exposures_s or velocity not in surface.velocities_px_s:
        return np.zeros(len(values))
    e, v = surface.exposures_s.index(exposure_s), surface.velocities_px_s.index(velocity)
    return np.asarray(values[:, e, v])


def _measured(x: Array, sums: Array, counts: Array, over: str, most: float) -> Curve | None:
    """The curve through the points that were measured; None through fewer than two. Over blur it is straight in px,
    since pictures at rest have none."""
    there = counts.sum(axis=0) > 0
    if there.sum() < 2:
        return None
    logarithmic = over != BLUR and axis(over).logarithmic
    return Curve(tuple(x[there].tolist()), sums[:, there], counts[:, there], logarithmic, most)


def _endurance(surface: Surface, over: str, place: Place, curve: Curve, criterion: Criterion) -> Endurance:
    values: dict[str, float | None] = dict(zip(("exposure_s", *VELOCITY), place, strict=True))
    values |= dict(zip(SETTING, surface.setting, strict=True))
    at = {name: None if name == over else values[name] for name in NAMES}
    crossed, n = curve.crossed(criterion.level), curve.n_clusters
    above = curve.mean >= criterion.level
    returned = bool((above[1:] & ~above[:-1]).any())
    ends = [window[1] for window in crossed.windows]
    at_end = ends[-1] if ends else curve.x[0]
    auc, (auc_low, auc_high) = curve.area()
    low, high = crossed.fails_between
    return Endurance(
        surface.model,
        surface.group,
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
        curve.n_effective < certainty.FEW,
        criterion.text,
    )
