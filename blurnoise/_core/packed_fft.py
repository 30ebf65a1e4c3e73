"""Planes times real, even transfer functions by OpenCV's packed real Fourier transform: one core, no gradients.

Convention: numpy planes (h, w), float32 or float64. A packed spectrum is a real plane of the same size: in each
row the real and imaginary parts of neighbouring columns, (Re 0, Re 1, Im 1, Re 2, ...); its first column, and
for even w its last, are packed likewise downwards. Twice as fast as a general transform, without threads of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[Any]


def pack(response: Plane, out: Plane) -> None:
    """Lay out a transfer function as the factors of a packed spectrum, divided by ``out``'s size for the way back.

    response: (h, w / 2 + 1), at the frequencies of ``rfft2`` and even in both axes together, or for transforms
    of rows alone (1, w / 2 + 1). out: (h, w) or (1, w), w even.
    """
    out[:, 1:-1:2] = out[:, 2:-1:2] = response[:, 1:-1]
    down = (np.arange(len(response)) + 1) // 2
    out[:, 0], out[:, -1] = response[down, 0], response[down, -1]
    out /= out.size


def multiply(plane: Plane, factors: Plane, scratch: Sequence[Plane], *, rows_alone: bool = False) -> Plane:
    """The plane times the packed ``factors``, in the second of two ``scratch`` planes of the plane's size.

    rows_alone: only rows are transformed, which is faster; ``factors`` are one row, or as many as the plane has.
    """
    rows = cv2.DFT_ROWS if rows_alone else 0
    cv2.dft(plane, scratch[0], rows)
    return back(scratch[0], factors, scratch, rows)


def multiply_complex(plane: Plane, spectrum: Plane, scratch: Sequence[Plane]) -> Plane:
    """The plane times a packed ``spectrum``, as :func:`multiply` otherwise."""
    own, blurred = scratch
    cv2.dft(plane, own)
    cv2.mulSpectrums(own, spectrum, 0, own)
    cv2.dft(own, blurred, cv2.DFT_INVERSE)
    return blurred


def forward(plane: Plane, spectrum: Plane) -> None:
    """The packed spectrum of a plane, into ``spectrum``, for :func:`back` with several factors."""
    cv2.dft(plane, spectrum)


def back(spectrum: Plane, factors: Plane, scratch: Sequence[Plane], rows: int = 0) -> Plane:
    """The plane of ``spectrum`` times the packed ``factors``, in the second of two ``scratch`` planes.

    rows: ``cv2.DFT_ROWS`` where only rows are transformed.
    """
    weighted, blurred = scratch
    np.multiply(spectrum, factors, out=weighted)
    cv2.dft(weighted, blurred, rows | cv2.DFT_INVERSE)
    return blurred
