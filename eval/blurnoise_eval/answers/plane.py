"""The plane of exposures: light on the scene and motion during the exposure, both in stops.

A place is (u, w): log2 of H (lux times seconds) and log2 of L (length of the motion during the exposure, px).
Conditions at one place are one experiment, as far as dark current and a rolling shutter do not tell them apart. So a
grid of exposures, lights and speeds covers a piece of the plane, some of it many times over. Motion below
``STILL_PX`` is none and lies there, as do pictures at rest. Motion in opposite directions shares a plane.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
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


def coordinate(x: ArrayLike, logarithmic: bool) -> tuple[Array, bool]:
    """Where the values x are on their axis, and whether these are logarithms: lines are straight there."""
    values = np.asarray(x, float)
    is_log = logarithmic and bool((values > 0).all())
    return np.log(values) if is_log else values, is_log


def trapezoid_weights(x: Array) -> Array:
    """Weights (N,) of values at increasing x in their mean over the range, straight between them."""
    if len(x) < 2 or not np.isfinite(x).all():  # a value that the camera sets has no place on its axis
        return np.full(len(x), 1 / max(len(x), 1))
    weights = np.zeros(len(x))
    steps = np.diff(x)
    weights[:-1] += steps / 2
    weights[1:] += steps / 2
    return np.asarray(weights / steps.sum())


def plane_weights(rows: Sequence[Mapping[str, Any]]) -> Array | None:
    """Weights (N,) of the rows' values in their mean over the piece of the plane that they cover; None without any.

    The distribution is uniform over that piece, straight between conditions: light, exposure and speed log-uniform
    over what was tested, each experiment counted once, directions of one speed alike. Along every further axis that
    varies (temperature, f-number ...) it is the mean over its range, uniform in the axis's coordinate, or over its
    choices. rows: of exposed pictures, one per condition; those without light have no logarithm and no weight.
    """
    planes: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for number, row in enumerate(rows):
        if row["exposure_s"] * row[LIGHT.name] > 0:
            planes[tuple(row[axis.name] for axis in _FURTHER)].append(number)
    weights = {}
    for setting, numbers in planes.items():
        some = [rows[number] for number in numbers]
        exposures, light = (np.array([row[name] for row in some]) for name in ("exposure_s", LIGHT.name))
        speeds = np.array([blur_px(row) for row in some]) / exposures
        weights[setting] = np.zeros(len(rows))
        weights[setting][numbers] = _over_hull(places_of(exposures, light, speeds))
    for axis in _FURTHER:  # each is averaged out in turn
        lines: dict[tuple[float, ...], list[tuple[float, ...]]] = defaultdict(list)
        for setting in sorted(weights):
            lines[setting[1:]].append(setting)
        for rest, line in lines.items():
            x = coordinate([setting[0] for setting in line], axis.logarithmic)[0]
            shares = np.full(len(x), 1 / len(x)) if axis.choices else trapezoid_weights(x)
            weights[rest] = shares @ np.array([weights.pop(setting) for setting in line])
    return weights.get(())


def _over_hull(places: Array) -> Array:
    """Weights (N,) of values at places (N, 2) in their mean over the hull, straight over Delaunay's triangles."""
    different, which = same_places(places)
    away = different - different.mean(axis=0)
    if np.linalg.matrix_rank(away, tol=1e-6 * len(away)) < 2:  # a point, or points on one line
        along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
        order = np.argsort(along)
        weights = np.empty(len(different))
        weights[order] = trapezoid_weights(along[order])
    else:
        from scipy.spatial import Delaunay  # takes 0.2 s

        corners = Delaunay(different).simplices
        sides = different[corners[:, 1:]] - different[corners[:, :1]]
        areas = np.abs(np.linalg.det(sides)) / 2
        weights = np.bincount(corners.ravel(), np.repeat(areas / 3, 3), len(different)) / areas.sum()
    return np.asarray((weights / np.bincount(which))[which])
