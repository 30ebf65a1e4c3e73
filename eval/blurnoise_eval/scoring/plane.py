"""The plane of exposures: what a score is on average over conditions that no grid has chosen.

Conditions with the same light on the scene (H, lux times seconds) and the same motion during the exposure (L, px) are
the same experiment, as far as dark current and a rolling shutter do not tell them apart. So a grid of exposures,
lights and speeds covers a piece of the plane of log2 H and log2 L, some of it many times over. The distribution is
uniform over that piece: light, exposure and speed log-uniform over what was tested, each experiment counted once.
Motion below ``STILL_PX`` is none and stands there, as do pictures at rest; directions of one speed are one
experiment.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import LIGHT, SETTING_AXES, blur_px
from blurnoise_eval.scoring.crossings import coordinate

STILL_PX = 0.5
_DIGITS = 6  # of log2 H and log2 L by which an experiment is the same
_FURTHER = tuple(axis for axis in SETTING_AXES if axis is not LIGHT)
Row = Mapping[str, Any]
Array = NDArray[np.float64]


def mean_over_plane(rows: Iterable[Row], value_of: Callable[[Row], float | None]) -> float | None:
    """Mean of ``value_of`` over the piece of the plane that the rows cover, straight between their conditions.

    Along every further axis that varies (temperature, f-number ...) it is the mean over its range, uniform in the
    axis's coordinate, or over its choices. rows: of exposed pictures, one per condition; None of a row leaves it out.
    None without any.
    """
    planes: dict[tuple[float, ...], list[tuple[float, float, float]]] = defaultdict(list)
    for row in rows:
        value = value_of(row)
        light = row["exposure_s"] * row["illuminance_lux"]
        if value is None or not light > 0:  # without light there is no logarithm
            continue
        at = np.log2(light), np.log2(max(blur_px(row), STILL_PX))
        planes[tuple(row[axis.name] for axis in _FURTHER)].append((*at, value))
    means = {setting: _mean(np.array(points)) for setting, points in planes.items()}
    for axis in _FURTHER:
        lines: dict[tuple[float, ...], list[tuple[float, float]]] = defaultdict(list)
        for setting, mean in sorted(means.items()):
            lines[setting[1:]].append((setting[0], mean))
        means = {
            rest: float(np.mean([mean for _, mean in line]))
            if axis.choices
            else _along(coordinate([x for x, _ in line], axis.logarithmic), [mean for _, mean in line])
            for rest, line in lines.items()
        }
    return means.get(())


def _mean(points: Array) -> float:
    """Mean over the hull of points (N, 3) of u, w and a value, straight over Delaunay's triangles."""
    places, which = np.unique(points[:, :2].round(_DIGITS), axis=0, return_inverse=True)
    counts = np.bincount(which.ravel())
    values = np.bincount(which.ravel(), points[:, 2]) / counts
    away = places - places.mean(axis=0)
    if np.linalg.matrix_rank(away, tol=10.0**-_DIGITS * len(away)) < 2:  # a point, or points on one line
        direction = np.linalg.svd(away, full_matrices=False)[2][0]
        along = away @ direction
        order = np.argsort(along)
        return _along(along[order], values[order].tolist())
    from scipy.spatial import Delaunay  # takes 0.2 s

    corners = Delaunay(places).simplices
    sides = places[corners[:, 1:]] - places[corners[:, :1]]
    areas = np.abs(np.linalg.det(sides)) / 2
    return float((areas * values[corners].mean(axis=1)).sum() / areas.sum())


def _along(x: Array, y: Sequence[float]) -> float:
    if len(x) < 2 or not np.isfinite(x).all():  # what the camera sets itself has no place on its axis
        return float(np.mean(y))
    return float(np.trapezoid(y, x) / (x[-1] - x[0]))
