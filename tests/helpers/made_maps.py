"""Planes and scores of maps made by hand: a grid of lights, exposures and speeds, and what a made detector keeps."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.maps.nodes import Nodes, nodes_at
from made_tables import table
from numpy.typing import NDArray
from plans import IMX250, OWN

KEEP = Criterion(0.9, True)


def row(exposure_s: float, lux: float, dx: float = 0.0, dy: float = 0.0, **others: float) -> dict[str, Any]:
    """A condition as the store has it, its gain 0 dB unless stated."""
    at = {"exposure_s": exposure_s, "illuminance_lux": lux, "velocity_x_px_s": dx, "velocity_y_px_s": dy}
    return {"clean": 0, **at, **OWN, "applied_gain_db": 0.0, **others}


def plane(
    exposures_s: Iterable[float] = (0.001, 0.003, 0.01, 0.03, 0.09),
    lights_lux: Iterable[float] = (1.0, 7.0, 50.0, 360.0),
    speeds: Iterable[float] = (0.0, 170.0, 600.0),
) -> Nodes:
    """A grid, no two conditions of which are one experiment."""
    return nodes_at([row(*at) for at in product(exposures_s, lights_lux, speeds)], IMX250, ())


def exact(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of which sums over a few clusters are exact: of 24 binary places."""
    return np.asarray(np.round(values * 2**24) / 2**24)


def scores_at(nodes: Nodes, values: NDArray[np.float64], clusters: int = 12) -> ScoreTable:
    """A table at the nodes with mean :func:`exact` ``values`` (N,), from which clusters depart, each in its way."""
    own = exact(0.1 * np.random.default_rng(0).normal(size=(clusters, len(values))))
    own[-1] = -own[:-1].sum(axis=0)
    sums = np.nan_to_num(exact(values) + own)
    counts = np.broadcast_to(np.isfinite(values).astype(float), sums.shape)
    return table(sums[..., None], np.arange(len(nodes)), counts=counts[..., None], group="signs")
