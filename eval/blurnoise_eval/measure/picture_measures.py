"""Measures of processed pictures that a captured and a simulated one are compared by.

Domain: (H, W, 3) RGB of 8 bits. Grey is the luma of the coded values, 0 to 255.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.measure.pictures import squares

Bytes = NDArray[np.uint8]
CLIPPED_DN = 245
"""Value of the brightest colour from which on a pixel counts as clipped; JPEG spreads clipped areas down to it."""
_FINE_PX = 2.0  # sigma of the Gaussian blur that fine contrast is the difference to
_DARK_DN, _BRIGHT_DN = 8.0, 235.0  # between them flat areas show noise


@dataclass(frozen=True)
class PictureMeasure:
    """A measure of a picture: name in files, title, unit, and its value for a captured and a simulated one."""

    name: str
    title: str
    unit: str
    of: Callable[[Bytes, Bytes], tuple[float, float]]


def grey(picture: Bytes) -> NDArray[np.float32]:
    """Luma (H, W), float."""
    return np.asarray(cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_RGB2GRAY))


def _each(measure: Callable[[Bytes], float]) -> Callable[[Bytes, Bytes], tuple[float, float]]:
    return lambda captured, simulated: (measure(captured), measure(simulated))


def fine_contrast(picture: Bytes) -> float:
    """RMS of grey less its Gaussian blur of 2 px."""
    values = grey(picture)
    return float((values - cv2.GaussianBlur(values, (0, 0), _FINE_PX)).std())


def chroma(picture: Bytes) -> float:
    """Mean chroma C*ab (CIE 1976, D65)."""
    lab = cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    return float(np.hypot(lab[..., 1], lab[..., 2]).mean())


def clipped(picture: Bytes) -> float:
    """Share of clipped pixels, %."""
    return float(100 * (picture.max(-1) >= CLIPPED_DN).mean())


def flat_noise(captured: Bytes, simulated: Bytes) -> tuple[float, float]:
    """RMS deviation of grey in squares of 16 px that are uniform in both pictures; NaN where there are none."""
    pair = [squares(grey(picture).astype(np.float64)) for picture in (captured, simulated)]
    used = pair[0].uniform & pair[1].uniform
    for each in pair:
        used &= (each.level > _DARK_DN) & (each.level < _BRIGHT_DN)
    if not used.any():
        return float("nan"), float("nan")
    # the quieter half: the other one has texture
    quiet = used & (pair[0].variance <= np.median(pair[0].variance[used]))
    real, model = (float(np.sqrt(each.variance[quiet].mean())) for each in pair)
    return real, model


MEASURES = (
    PictureMeasure("mean_grey", "mean grey", "of 255", _each(lambda picture: float(grey(picture).mean()))),
    PictureMeasure("clipped", "clipped share", "%", _each(clipped)),
    PictureMeasure("fine_contrast", "fine contrast", "of 255", _each(fine_contrast)),
    PictureMeasure("chroma", "chroma C*ab", "", _each(chroma)),
    PictureMeasure("flat_noise", "noise of flat areas", "of 255", flat_noise),
)
"""In the order of tables."""
