"""The plane of exposures: light on the scene and motion during the exposure, both in stops.

A place is (u, w): log2 of H (lux times seconds) and log2 of L (length of the motion during the exposure, px).
Conditions at one place are one experiment, as far as dark current and a rolling shutter do not tell them apart. So a
grid of exposures, lights and speeds covers a piece of the plane, some of it many times over. Motion below
``STILL_PX`` is none and lies there, as do pictures at rest. Motion in opposite directions shares a plane.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

STILL_PX = 0.5
DIGITS = 9
"""Decimals of u and w, and of directions, by which they are the same."""
AT_REST = (1.0, 0.0)
"""The direction of a plane on which nothing moves."""
Array = NDArray[np.float64]
Direction = tuple[float, float]


def places_of(exposures_s: ArrayLike, illuminance_lux: ArrayLike, speeds_px_s: ArrayLike) -> Array:
    """(u, w) of N exposures, s above 0, under light above 0, (N, 2).

    >>> places_of([0.01, 0.01], [100.0, 200.0], [400.0, 0.0]).tolist()  # 1 and 2 lux s; 4 px and none
    [[0.0, 2.0], [1.0, -1.0]]
    """
    exposures = np.asarray(exposures_s, float)
    light = np.log2(exposures) + np.log2(np.asarray(illuminance_lux, float))
    motion = np.log2(np.maximum(exposures * np.asarray(speeds_px_s, float), STILL_PX))
    return np.stack(np.broadcast_arrays(light, motion), axis=-1)


def same_places(places: Array) -> tuple[Array, NDArray[np.int64]]:
    """The places (M, 2) that are different, and which of them each of the N is, (N,).

    >>> places, which = same_places(places_of([0.01, 0.02], [100.0, 50.0], [400.0, 200.0]))
    >>> len(places), which.tolist()  # half the light and speed for twice the time
    (1, [0, 0])
    """
    # + 0.0 makes 0.0 of -0.0, which would be another row.
    different, which = np.unique(places.round(DIGITS) + 0.0, axis=0, return_inverse=True)
    return different, which.ravel()


def direction_of(velocity_px_s: tuple[float, float]) -> Direction | None:
    """Unit vector of the motion's axis, x >= 0; None at rest.

    >>> direction_of((3.0, 4.0)), direction_of((-3.0, -4.0)), direction_of((0.0, 0.0))
    ((0.6, 0.8), (0.6, 0.8), None)
    """
    speed = math.hypot(*velocity_px_s)
    if speed == 0:
        return None
    x, y = (round(each / speed, DIGITS) + 0.0 for each in velocity_px_s)
    # A blur to the left is a blur to the right: of two opposite directions one stands for both.
    return (x, y) if (x, y) > (0.0, 0.0) else (0.0 - x, 0.0 - y)
