"""The kernel of a defocused lens: tap weights on the pixel grid, unit sum, centroid on the centre pixel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def disc(radius_px: float) -> NDArray[np.float64]:
    """Kernel of defocus with a round aperture: the exact area of the disc in each pixel, over its own area.

    radius_px >= 0; returns (k, k), k odd, [[1]] up to half a pixel. Equals MATLAB's fspecial('disk', r).
    """
    half = max(0, math.ceil(radius_px - 0.5))
    if half == 0:
        return np.ones((1, 1))
    edges = np.arange(-half - 0.5, half + 1)
    corner = _disc_corner_area(radius_px, edges[None, :], edges[:, None])
    area = corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]
    return np.asarray(area / (math.pi * radius_px**2))


def _disc_corner_area(radius: float, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed area of the disc inside the rectangle between the origin and (a, b); odd in a and in b."""
    sign = np.sign(a) * np.sign(b)
    a, b = np.broadcast_arrays(np.minimum(np.abs(a), radius), np.minimum(np.abs(b), radius))
    meets = np.minimum(np.sqrt(np.maximum(radius**2 - b**2, 0.0)), a)  # where the arc crosses height b

    def under_arc(x: NDArray[np.float64]) -> NDArray[np.float64]:
        root = np.sqrt(np.maximum(radius**2 - x**2, 0.0))
        return np.asarray((x * root + radius**2 * np.arcsin(np.minimum(x / radius, 1.0))) / 2)

    return np.asarray(sign * (b * meets + under_arc(a) - under_arc(meets)))
