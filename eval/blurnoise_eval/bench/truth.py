"""Motion blur of a scene before pixels see it: the yardstick of every method that starts from pixels.

Domain: linear light in [0, 1], float64 NumPy planes (H, W). A scene is rendered ``FINE`` times finer than its
pixels, moved there by the exact transfer function of its motion, and only then averaged over each pixel, as
a sensor does. Transforms are periodic: a plane is so much larger than what is measured that no border plays
a part. Nothing here uses the blur of :mod:`blurnoise`, which this judges.

Convention: x right, y down; a motion of length L at angle a is L (cos a, sin a).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise import charts

Plane = NDArray[np.float64]
FINE = 8
"""Samples to a pixel's side."""
MTF50_LENGTH = 0.603354564
"""Motion of length L halves the contrast of MTF50_LENGTH / L cycles/px along it: the solution of sinc(x) = 1/2."""
_FASTEST_SIDE = 24  # planes of a multiple of this many pixels transform fast
_SPARE = 16  # px beyond the blur's own reach


def plane_side(size_px: int, longest_px: float) -> int:
    """Side, px, of a plane around a picture of ``size_px`` for motions up to ``longest_px``."""
    return _FASTEST_SIDE * math.ceil((size_px + 2 * (longest_px / 2 + _SPARE)) / _FASTEST_SIDE)


def pixels(fine: Plane) -> Plane:
    """Mean of each FINE x FINE samples; the sides of ``fine`` are multiples of FINE."""
    height, width = fine.shape
    return np.asarray(fine.reshape(height // FINE, FINE, width // FINE, FINE).mean(axis=(1, 3)))


def moved(plane: Plane, motions: Iterable[tuple[float, float]]) -> Iterator[Plane]:
    """The plane under each uniform motion (length in samples of the plane, angle in degrees), exactly.

    Multiplies its spectrum by sinc(L f . u). On pixels instead of fine samples it is exact for what the pixels
    kept, and its error is the aliasing in them.
    """
    spectrum = np.fft.rfft2(plane)
    fy, fx = np.fft.fftfreq(plane.shape[0])[:, None], np.fft.rfftfreq(plane.shape[1])
    for length, angle_deg in motions:
        angle = math.radians(angle_deg)
        response = np.sinc(length * (fx * math.cos(angle) + fy * math.sin(angle)))
        yield np.fft.irfft2(spectrum * response, plane.shape)


def mtf50(spread: Plane, angle_deg: float) -> float | None:
    """Lowest frequency, cycles/px, at which the response to a point halves along ``angle_deg``.

    spread: picture of a point, wherever it lies. Its Fourier sum is taken at single frequencies, so neither a
    grid nor a fit limits it. None where it does not halve up to the sampling's limit in that direction.
    """
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    y, x = (np.arange(side) for side in spread.shape)

    def response(f: Plane) -> Plane:
        along_x = np.exp(-2j * np.pi * cos * np.outer(f, x))
        along_y = np.exp(-2j * np.pi * sin * np.outer(f, y))
        return np.asarray(np.abs(((along_y @ spread) * along_x).sum(axis=1)) / abs(spread.sum()))

    low, high = 0.0, 0.5 / max(abs(cos), abs(sin))
    for _ in range(4):  # each narrows it two hundredfold
        f = np.linspace(low, high, 201)
        below = np.flatnonzero(response(f) < 0.5)
        if not below.size:
            return None
        low, high = f[below[0] - 1], f[below[0]]
    return float(low + high) / 2


def siemens_star(size_px: int, side_px: int) -> Plane:
    """Black and white star of 36 cycles, as wide as the picture."""
    star = charts.siemens_star(
        size_px * FINE,
        height_px=side_px * FINE,
        width_px=side_px * FINE,
        dark=0.0,
        bright=1.0,
        binary=True,
        supersample=1,
    )
    return star[0, 0].double().numpy()


def slanted_edge(size_px: int, side_px: int) -> Plane:
    """Black on the left, white on the right, 5 degrees from upright."""
    edge = charts.slanted_edge(side_px * FINE, side_px * FINE, dark=0.0, bright=1.0)
    return edge[0, 0].double().numpy()


def zone_plate(size_px: int, side_px: int) -> Plane:
    """Sinusoidal rings that reach half a cycle per pixel at the picture's corners: nothing in it aliases."""
    x = (np.arange(side_px * FINE) + 0.5) / FINE - side_px / 2
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * (x**2 + x[:, None] ** 2) / (math.sqrt(2) * size_px)))


def text(size_px: int, side_px: int) -> Plane:
    """Black lines on white, capitals from 1/40 of the picture's height to 1/10."""
    side = side_px * FINE
    page = np.full((side, side), 255, np.uint8)
    baseline = side / 2 - 0.33 * size_px * FINE
    for share in (40, 28, 20, 14, 10, 20, 28):
        capital = size_px * FINE / share
        baseline += 1.6 * capital
        line = "Speed limit 50 km/h, keep RIGHT & yield. " * 3
        scale, stroke = capital / 21.0, max(1, round(capital / 8))  # Hershey capitals are 21 units high
        width = cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)[0][0]
        corner = (round((side - width) / 2), round(baseline))
        cv2.putText(page, line, corner, cv2.FONT_HERSHEY_SIMPLEX, scale, 0, stroke, cv2.LINE_AA)
    return page / 255.0


SCENES: Mapping[str, Callable[[int, int], Plane]] = {
    "Siemens star": siemens_star,
    "slanted edge": slanted_edge,
    "zone plate": zone_plate,
    "text": text,
}
"""Scenes by name: called with the picture's size and the plane's side, px, they return the fine plane."""
