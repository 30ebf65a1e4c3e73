"""Items that follow from a formula or one noise-free picture: Table 2, equations 9-13, section 4.2.1.

The paper's light coding does not matter to them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from blurnoise import charts
from blurnoise.motion.ego import blur_pixels
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import photoelectrons
from blurnoise_eval.paper.item import Check, Parts
from blurnoise_eval.paper.measurement import CAMERA, Measurements


class Road(NamedTuple):
    """A row of Table 2: blur as printed, and what it follows from.

    Widths, distances and exposures are reconstructed from the results: only speed times exposure and width over
    distance enter. speed_kmh in rows 7 and 8 is 27.778 m/s; the printed 13.889 is a misprint.
    """

    printed_px: float
    width_m: float
    distance_m: float
    speed_kmh: float
    exposure_ms: float


TABLE_2 = (
    Road(3.938, 0.5, 25, 5, 30),
    Road(1.969, 0.5, 50, 5, 30),
    Road(0.985, 0.5, 100, 5, 30),
    Road(1.969, 0.5, 100, 10, 30),
    Road(3.937, 4.9, 100, 20, 30),
    Road(9.843, 4.9, 100, 50, 30),
    Road(19.675, 4.9, 50, 100, 15),
    Road(39.35, 4.9, 50, 100, 30),
    Road(19.687, 4.9, 100, 100, 30),
)
PRINTED_PX = 0.005
QUANTA = 5774.616
"""Of white at 50 lux and 30 ms in the paper's tool."""
FREQUENCIES = {100: (0.04, 0.1), 50: (0.08, 0.2), 32: (0.125, 0.3)}
"""Cycles/px that a sign of so many px holds, section 4.2.1."""
FREQUENCY_SHARE = 0.25


def table_2(measured: Measurements) -> Parts:
    """Motion blur of road users, row by row."""
    camera = Camera.preset(CAMERA)
    optics: Any = {"width_px": camera.width_px, "hfov_deg": camera.hfov_deg}
    for number, (printed, width, distance, kmh, ms) in enumerate(TABLE_2, 1):
        found = blur_pixels(kmh / 3.6, distance, 1e-3 * ms, target_width_m=width, **optics)
        what = f"row {number}: {width:g} m wide, {distance:g} m away, {kmh:g} km/h, {ms:g} ms"
        agrees, rule = abs(found - printed) <= PRINTED_PX, f"within {PRINTED_PX:g} px"
        yield Check(what, f"{printed:.3f} px", f"{found:.4f} px", rule, agrees)


def quanta(measured: Measurements) -> Parts:
    """Quanta of white light: the camera's electrons times the sensitivity by which the tool multiplies."""
    camera = Camera.preset(CAMERA)
    electrons, gain = photoelectrons(camera, 50.0, 0.030), camera.system_gain_dn_per_e
    text = f"{electrons:.1f} e- x {gain:g} = {electrons * gain:.1f}"
    agrees = abs(electrons * gain / QUANTA - 1) <= 1e-3
    yield Check("quanta of white", f"{QUANTA:.1f} (its tool)", text, "within 0.1 %", agrees)


def frequencies(measured: Measurements) -> Parts:
    """Spatial frequencies of the noise-free sign, from the distances of its edges."""
    for size, (low, high) in FREQUENCIES.items():
        found = edge_frequencies(charts.stop_sign(size)[0])
        least, most = float(found.min()), float(found.max())
        agrees = max(abs(least / low - 1), abs(most / high - 1)) <= FREQUENCY_SHARE
        text, rule = f"{least:.3f}-{most:.3f} cycles/px", f"both ends within {FREQUENCY_SHARE:.0%}"
        yield Check(f"sign of {size} px", f"{low:g}-{high:g} cycles/px", text, rule, agrees)


def edge_frequencies(picture: Tensor) -> Tensor:
    """Inverse distances (K,), cycles/px, of neighbouring edges of one direction along the centre row of (C, H, W).

    The central difference of the row (the mean of two where their number is even) has a peak at every edge; from a
    peak to the next one of its direction lasts a cycle (section 4.2.1). Peaks below a fifth of the largest do not
    count; each is placed by the parabola through three differences, of equal neighbours in their middle.
    """
    rows = picture.double().mean(0)
    profile = rows[(len(rows) - 1) // 2 : len(rows) // 2 + 1].mean(0)
    slope = (profile[2:] - profile[:-2]) / 2
    least = max(0.2 * float(slope.abs().max()), 1e-12 * float(profile.abs().max()))
    found = []
    for direction in (slope, -slope):
        height, length = torch.unique_consecutive(direction, return_counts=True)
        middle = length.cumsum(0) - (length - 1) / 2
        left, top, right = height[:-2], height[1:-1], height[2:]
        places = middle[1:-1] + (right - left) / (2 * (2 * top - left - right))
        found.append(1 / places[(top > left) & (top > right) & (top > least)].diff())
    return torch.cat(found)
