"""Probe of what a graph answers, once, for families that no shape tells apart.

The picture is drawn, so that no photograph has to travel with the package. It needs structure: on a flat grey
a detector sees nothing anywhere, and then boxes and objectness say little about what they mean.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

TOLD_APART = {"yolox", "yolov6"}
"""The families that it tells apart."""
RAW_SIZE_LIMIT = 16.0
"""YOLOX's raw sizes are logarithms of strides, rarely above 4; boxes in px reach this in the 99th percentile."""


def picture(side_px: int = 416) -> NDArray[np.uint8]:
    """A stop sign and bars before a gradient, (side, side, 3) RGB, the same for every call."""
    from blurnoise import charts  # torch takes a second to import, and few graphs need this picture
    from blurnoise.optics.colour import srgb_from_linear

    sign = charts.stop_sign(side_px / 3, height_px=side_px, width_px=side_px, background=0.18)
    coded = srgb_from_linear(sign[0]).mul(255).permute(1, 2, 0).numpy()
    y, x = np.mgrid[:side_px, :side_px] / side_px
    scene = 60 + 120 * (1 - y)[..., None] * np.array([0.8, 0.9, 1.0])
    scene[(x >= 0.05) & (x < 0.25) & (y >= 0.55) & (y < 0.95)] = 30
    scene[(x >= 0.72) & (x < 0.96) & (y >= 0.6) & (y < 0.75)] = 220
    third = slice(side_px // 3 - 2, side_px - side_px // 3 + 2)
    scene[third, third] = coded[third, third]
    return np.asarray(scene.round(), np.uint8)


def told_apart(outputs: Sequence[NDArray[np.float32]]) -> tuple[str, str] | None:
    """Which family of ``TOLD_APART`` answered with ``outputs``, and what shows it; None where nothing does."""
    rows = outputs[0][0].astype(np.float32)
    if (rows[:, 4] == 1).all():
        return "yolov6", "on a drawn picture the objectness is 1 everywhere"
    largest = float(np.percentile(rows[:, 2:4], 99))
    if largest < RAW_SIZE_LIMIT:
        return "yolox", f"on a drawn picture 99 % of the sizes are below {largest:.3g}, so these are raw"
    return None
