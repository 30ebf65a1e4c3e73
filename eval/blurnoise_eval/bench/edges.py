"""Bench of slanted edges: ways to measure MTF50, time beside error, on edges whose transfer function is known.

Units: errors are shares of the true MTF50, RMS over pictures. CNR: the edge's step over the noise's deviation.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import brentq
from torch import Tensor

from blurnoise.metrics import slanted_edge
from blurnoise_eval.bench.contest import Case, Contender, Contest

BLURS = {"sharp": (0.5, 0.0), "6 px of motion": (0.3, 6.0)}
"""Sigma of a Gaussian, and motion along x, px."""
CNRS = (math.inf, 20.0, 6.0)
SIDE_PX, ANGLE_DEG = 100, 5.0
_DARK, _STEP = 0.1, 0.7
_ENOUGH = 9.0  # a full scale above every pixel, noise included


def edges(*, quick: bool) -> Contest:
    """The exact mode with and without intervals and the standard's steps, without noise and with it."""
    cases = [partial(_case, blur, cnr, 8 if quick else 64) for blur in BLURS for cnr in CNRS]
    return Contest(
        "edges", "MTF50 of slanted edges, 100x100 px", cases[:2] if quick else cases,
        cost_unit="ms per edge", error_unit="relative",
    )  # fmt: skip


def edge(sigma_px: float, motion_px: float, offset_px: tuple[float, float]) -> Tensor:
    """An edge (H, W) through the picture's centre moved by ``offset_px`` (x, y), its bright side on the right.

    A pixel's value is the step convolved with its own two sides, the motion and the Gaussian along the edge's normal:
    of boxes in closed form, a difference of powers; of the Gaussian on a grid of 0.001 px, to 1e-6.
    """
    cos, sin = math.cos(math.radians(ANGLE_DEG)), math.sin(math.radians(ANGLE_DEG))
    along = np.arange(SIDE_PX) + 0.5 - SIDE_PX / 2
    distance = (along - offset_px[0]) * cos - (along - offset_px[1])[:, None] * sin
    boxes, reach = _boxes(motion_px), np.linspace(-20, 20, 40_001)
    spread = np.zeros_like(reach)
    for signs in product((-0.5, 0.5), repeat=len(boxes)):
        above = np.maximum(reach + np.dot(signs, boxes), 0)
        spread += math.prod(2 * sign for sign in signs) * above ** len(boxes)
    spread /= math.factorial(len(boxes)) * math.prod(boxes)
    spread = gaussian_filter1d(spread, 1e3 * sigma_px, truncate=8, mode="nearest")
    return torch.from_numpy(_DARK + _STEP * np.interp(distance, reach, spread))


def mtf50(sigma_px: float, motion_px: float) -> float:
    """The frequency, cycles/px, at which the edge's transfer function first falls to 1/2."""

    def above_half(f: float) -> float:
        boxes = math.prod(np.sinc(width * f) for width in _boxes(motion_px))
        return float(boxes * math.exp(-2 * (math.pi * sigma_px * f) ** 2)) - 0.5

    return float(brentq(above_half, 1e-4, min(1.0, 0.9 / max(motion_px, 1e-9))))


def _boxes(motion_px: float) -> list[float]:
    """Widths along the normal of the pixel's two sides and of motion along x."""
    cos, sin = math.cos(math.radians(ANGLE_DEG)), math.sin(math.radians(ANGLE_DEG))
    return [cos, sin, motion_px * cos] if motion_px else [cos, sin]


def _case(blur: str, cnr: float, count: int) -> Case:
    """Edges at several places of the pixel grid."""
    generator = torch.Generator().manual_seed(1)
    offsets = np.random.default_rng(1).uniform(-0.5, 0.5, (count, 2)).tolist()
    clean = torch.stack([edge(*BLURS[blur], (x, y)) for x, y in offsets])
    noise = torch.randn(clean.shape, generator=generator, dtype=torch.float64) * _STEP / cnr
    regions, truth = (clean + noise)[:, None], mtf50(*BLURS[blur])

    def error(found: list[Any]) -> float:
        off = np.array([each.mtf50 for each in found]) / truth - 1
        return float(np.sqrt(np.nanmean(off**2)))

    modes: dict[str, Any] = {
        "exact": {"bootstrap": 0},
        "exact, with intervals": {"bootstrap": 200},
        "the standard's steps (ISO 12233)": {"mode": "iso", "bootstrap": 0},
    }
    measure = partial(slanted_edge, regions, full_scale=_ENOUGH)
    ways = [Contender(name, partial(measure, **how), True) for name, how in modes.items()]
    return Case(f"{blur}, CNR {cnr:g}", ways, error, units=count)
