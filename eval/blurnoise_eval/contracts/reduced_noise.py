"""What a contract's resize filter leaves of the noise of pictures that are larger than the network's input.

OpenCV's bilinear filter weighs four pixels for each of the smaller picture, however many there are, and so keeps
noise that filters which average all of them take away. A detector does not show by which its deployment resizes:
pictures without noise look alike behind both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.contracts.variants import Image
from blurnoise_eval.detectors.detector import Detector

_MATTERS_STOPS = 0.5


def resize_doubt(detector: Detector, images: Sequence[Image]) -> str:
    """A sentence where nobody stated the filter and another one would see much further into the dark; or "".

    It is of the largest RGB picture (h, w, 3).
    """
    contract = detector.contract
    source = contract.sources["resize_filter"]
    if contract.resize_filter != "bilinear" or contract.states("resize_filter") or not images:
        return ""
    placement = detector.prepare(max(images, key=np.size))[1]
    width, height = placement.width_px, placement.height_px
    reduced = round(height * placement.scale_y), round(width * placement.scale_x)
    stops = reduced_noise_stops((height, width), reduced)
    if stops < _MATTERS_STOPS:
        return ""
    return (
        f"resize_filter = bilinear ({source}) keeps most of the noise where pictures of {width} x {height} px become "
        f"{reduced[1]} x {reduced[0]} px; where your own code averages pixels (OpenCV's area, PIL), the detector "
        f"sees about {stops:.1f} stops further into the dark: set resize_filter to area or antialiased"
    )


def reduced_noise_stops(size_px: tuple[int, int], reduced_px: tuple[int, int]) -> float:
    """log2 of the white noise (standard deviation) behind OpenCV's bilinear filter over that in means of all pixels.

    size_px, reduced_px: (height, width) before and after. So many stops less light give the same ratio of signal to
    noise where read noise dominates.

    >>> round(reduced_noise_stops((1200, 1200), (400, 400)), 2)  # the middle one of three pixels, or all nine
    1.58
    >>> reduced_noise_stops((1200, 1200), (600, 600))  # the mean of four, both
    0.0
    """
    kept = [
        _weights_squared(old, new).mean() * old / new for old, new in zip(size_px, reduced_px, strict=True)
    ]
    return max(0.0, float(np.log2(kept).sum() / 2))


def _weights_squared(old: int, new: int) -> NDArray[np.float64]:
    """The sum of the squares of both weights of each reduced pixel along an axis."""
    share = ((np.arange(new) + 0.5) * old / new - 0.5) % 1
    return share**2 + (1 - share) ** 2
