"""The plane of exposures: light on the scene and motion during the exposure, both in stops.

A place is (u, w): log2 of H (lux times seconds) and log2 of L (length of the motion during the exposure, px).
Conditions at one place are one experiment, as far as dark current and a rolling shutter do not tell them apart. So a
grid of exposures, lights and speeds covers a piece of the plane, some of it many times over. Motion below
``STILL_PX`` is none and stands there, as do pictures at rest. Motion in opposite directions shares a plane.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.grid.axes import LIGHT, SETTING_AXES, blur_px

STILL_PX = 0.5
DIGITS = 9
"""Decimals of u and w, and of directions, by which they are the same."""
AT_REST = (1.0, 0.0)
"""The direction of a plane on which nothing moves."""
_FURTHER = tuple(axis for axis in SETTING_AXES if axis is not LIGHT)
Row = Mapping[str, Any]
Array = NDArray[np.float64]
Direction = tuple[float, float]


def places_of(exposures_s: ArrayLike, illuminance_lux: ArrayLike, speeds_px_s: ArrayLike) -> Array:
    """(u, w) of N exposures, s above 0, under light above 0, (N, 2)."""
    exposures = np.asarray(exposures_s, float)
    light = np.log2(exposures) + np.log2(np.asarray(illuminance_lux, float))
    motion = np.log2(np.maximum(exposures * np.asarray(speeds_px_s, float), STILL_PX))
    return np.stack(np.broadcast_arrays(light, motion), axis=-1)


def same_places(places: Array) -> tuple[Array, NDArray[np.int64]]:
    """The places (M, 2) that are different, and which of them each of the N is, (N,)."""
    different, which = np.unique(places.round(DIGITS) + 0.0, axis=0, return_inverse=True)
    return different, which.ravel()


def direction_of(velocity_px_s: tuple[float, float]) -> Direction | None:
    """Unit vector of the motion's axis, x >= 0; None at rest."""
    speed = math.hypot(*velocity_px_s)
    if speed == 0:
        return None
    x, y = (round(each / speed, DIGITS) + 0.0 for each in velocity_px_s)
    return (x, y) if (x, y) > (0.0, 0.0) else (0.0 - x, 0.0 - y)


def coordinate(x: ArrayLike, logarithmic: bool) -> Array:
    """Where the values x stand on their axis: straight lines are drawn there."""
    values = np.asarray(x, float)
    return np.log(values) if logarithmic and (values > 0).all() else values


def mean_over_plane(rows: Iterable[Row], value_of: Callable[[Row], float | None]) -> float | None:
    """Mean of ``value_of`` over the piece of the plane that the rows cover, straight between their conditions.

    The distribution is uniform over that piece: light, exposure and speed log-uniform over what was tested, each
    experiment counted once, directions of one speed alike. Along every further axis that varies (temperature,
    f-number ...) it is the mean over its range, uniform in the axis's coordinate, or over its choices. rows: of
    exposed pictures, one per condition; None of a row leaves it out. None without any.
    """
    planes: dict[tuple[float, ...], list[tuple[float, float, float]]] = defaultdict(list)
    for row in rows:
        value = value_of(row)
        if (
            value is None or not row["exposure_s"] * row[LIGHT.name] > 0
        ):  # without light there is no logarithm
            continue
        place = places_of(row["exposure_s"], row[LIGHT.name], blur_px(row) / row["exposure_s"]).tolist()
        planes[tuple(row[axis.name] for axis in _FURTHER)].append((*place, value))
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
    places, which = same_places(points[:, :2])
    values = np.bincount(which, points[:, 2]) / np.bincount(which)
    away = places - places.mean(axis=0)
    if np.linalg.matrix_rank(away, tol=1e-6 * len(away)) < 2:  # a point, or points on one line
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
