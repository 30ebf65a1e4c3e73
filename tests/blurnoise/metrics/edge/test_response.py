"""Response of an edge: its certain peak, whatever rounding leaves of no noise."""

from __future__ import annotations

import pytest
import torch

from blurnoise.metrics.edge.response import FREQUENCIES, Response

PEAK = 63


def response(noise: float) -> Response:
    """A power of 1.5 at one frequency over a fall from 1, and its noise, the same everywhere."""
    power = (1 - FREQUENCIES).clone()
    power[PEAK] = 1.5
    return Response(FREQUENCIES[1:2], power[None], torch.full_like(power[None], noise), None)


@pytest.mark.parametrize("noise", [0.0, 1e-14, -1e-14])
def test_a_peak_without_noise_is_certain_though_its_power_round_below_0(noise: float) -> None:
    found = response(1e-14)
    found.noise[0, ::7] = noise
    assert found.peak().tolist() == [PEAK]


def test_a_peak_within_the_noise_is_none() -> None:
    """Three standard errors of power 1.5 with noise v are 3 sqrt(3 v): more than 0.5 from v = 0.0093 on."""
    assert response(0.0092).peak().tolist() == [PEAK]
    assert response(0.0094).peak().tolist() == [0]
