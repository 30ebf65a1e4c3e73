"""The ways to measure a slanted edge that are compared, each from regions to MTF50 and response.

Domain: regions (n, H, W) float64, linear, 0 where there is no light; edges near vertical and bright on the right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.metrics import SlantedEdge, slanted_edge
from blurnoise.metrics.edge.measurement import Mode
from blurnoise_eval.bench import iso_steps

EXACT, ISO, ARRAYS, ROWS = "exact", "iso", "numpy arrays", "numpy rows"
METHODS = {
    EXACT: "slanted_edge, mode exact, a batch: a spline through every pixel at its distance from the edge",
    ISO: "slanted_edge, mode iso, a batch: the standard's steps",
    ARRAYS: "the standard's steps in NumPy, a call per region, by whole arrays",
    ROWS: "the same row by row, as the steps are written; timed only, since the numbers are the same",
}
WITH_INTERVALS = "exact, with intervals"
ENOUGH = 9.0
"""A full scale above every pixel, noise included."""


@dataclass(frozen=True)
class EdgeResponse:
    """Response of the edge in one region, as a method measures it."""

    mtf50: float
    frequencies: NDArray[np.float64]
    response: NDArray[np.float64]
    edge: SlantedEdge | None = None


def measured(method: str, regions: Tensor, bootstrap: int = 0) -> list[EdgeResponse]:
    """What ``EXACT``, ``ISO`` or ``ARRAYS`` says of each of the regions (n, H, W)."""
    if method == ARRAYS:
        curves = [iso_steps.iso_steps(region.numpy()) for region in regions]
        return [EdgeResponse(iso_steps.mtf50(*curve), *curve) for curve in curves]
    mode: Mode = "exact" if method == EXACT else "iso"
    edges = slanted_edge(regions[:, None], mode=mode, full_scale=ENOUGH, bootstrap=bootstrap)
    found = edges if isinstance(edges, list) else [edges]
    return [EdgeResponse(edge.mtf50, edge.frequencies.numpy(), edge.sfr.numpy(), edge) for edge in found]


def timed(regions: Tensor) -> dict[str, Callable[[], object]]:
    """A call per method that measures all the regions (n, H, W)."""

    def numpy(by_rows: bool) -> None:
        for region in regions:
            iso_steps.mtf50(*iso_steps.iso_steps(region.numpy(), by_rows=by_rows))

    return {
        EXACT: partial(measured, EXACT, regions),
        WITH_INTERVALS: partial(measured, EXACT, regions, 200),
        ISO: partial(measured, ISO, regions),
        ARRAYS: partial(numpy, False),
        ROWS: partial(numpy, True),
    }
