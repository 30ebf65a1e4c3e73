"""Bench of slanted edges: ways to measure MTF50, time beside error, on edges that are known in closed form.

Units: errors are shares of the true MTF50, RMS over pictures. CNR: the edge's step over the noise's deviation.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from blurnoise.metrics import slanted_edge
from blurnoise_eval.bench.closed_edges import closed_edge, closed_mtf50
from blurnoise_eval.bench.contest import Case, Contender, Contest

BLURS: dict[str, dict[str, Any]] = {
    "sharp": {"sigma_px": 0.5},
    "6 px of motion": {"sigma_px": 0.3, "motion_px": (6.0, 0.0)},
}
CNRS = (math.inf, 20.0, 6.0)
_STEP = 0.7  # of the closed edges
_ENOUGH = 9.0  # a full scale above every pixel, noise included


def edges(*, quick: bool) -> Contest:
    """The exact mode with and without intervals and the standard's steps, without noise and with it."""
    cases = [partial(_case, blur, cnr, 8 if quick else 64) for blur in BLURS for cnr in CNRS]
    return Contest(
        "edges", "MTF50 of slanted edges, 100x100 px", cases[:2] if quick else cases,
        cost_unit="ms per edge", error_unit="relative",
    )  # fmt: skip


def _case(blur: str, cnr: float, count: int) -> Case:
    """Edges at several places of the pixel grid."""
    generator = torch.Generator().manual_seed(1)
    offsets = np.random.default_rng(1).uniform(-0.5, 0.5, (count, 2)).tolist()
    clean = torch.stack([closed_edge(100, 100, offset_px=(x, y), **BLURS[blur]) for x, y in offsets])
    noise = torch.randn(clean.shape, generator=generator, dtype=torch.float64) * _STEP / cnr
    regions, truth = (clean + noise)[:, None], closed_mtf50(**BLURS[blur])

    def error(found: list[Any]) -> float:
        off = np.array([each.mtf50 for each in found]) / truth - 1
        return float(np.sqrt(np.nanmean(off**2)))

    def way(regions: Tensor, **how: Any) -> Any:
        return slanted_edge(regions, full_scale=_ENOUGH, **how)

    ways = [
        Contender("exact", partial(way, regions, mode="exact", bootstrap=0), True),
        Contender("exact, with intervals", partial(way, regions, mode="exact", bootstrap=200), True),
        Contender("the standard's steps (ISO 12233)", partial(way, regions, mode="iso", bootstrap=0), True),
    ]
    return Case(f"{blur}, CNR {cnr:g}", ways, error, units=count)
