"""Estimates: told or not, and those of an edge's scalars."""

from __future__ import annotations

import math

import torch

from blurnoise.metrics import Flag, SlantedEdge, slanted_edge
from blurnoise.metrics.values import Estimate


def test_what_is_not_finite_is_not_told() -> None:
    assert Estimate(0.0).told
    assert not Estimate(math.nan).told
    assert not Estimate(math.inf, 1.0, math.inf).told


def measured(bootstrap: int) -> SlantedEdge:
    x, y = torch.arange(90), torch.arange(110)[:, None]
    ramp = ((x + y / 11 - 50) / 3).clamp(0, 1)
    noise = torch.randn(ramp.shape, generator=torch.Generator().manual_seed(3))
    found = slanted_edge(0.2 + 0.5 * ramp + 0.05 * noise, full_scale=9.0, bootstrap=bootstrap)
    assert isinstance(found, SlantedEdge)
    return found


def test_an_edge_estimates_its_scalars_with_interval_and_flags() -> None:
    edge = measured(bootstrap=50)
    found = edge.estimate("cnr")
    assert (found.value, (found.low, found.high)) == (edge.cnr, edge.intervals["cnr"])
    assert found.low < found.value < found.high


def test_without_a_bootstrap_there_is_no_interval() -> None:
    found = measured(bootstrap=0).estimate("mtf50")
    assert found.told
    assert math.isnan(found.low)
    assert math.isnan(found.high)


def test_a_withheld_edge_says_why() -> None:
    lost = SlantedEdge("exact", frozenset({Flag.NO_EDGE, Flag.TOO_FEW_PHASES}))
    found = lost.estimate("mtf50")
    assert not found.told
    assert found.flags == {"no_edge", "too_few_phases"}
