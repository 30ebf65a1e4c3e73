"""Correlation of an edge's noise against filters of known power, and the blocks that a bootstrap draws."""

from __future__ import annotations

import pytest
import torch
from edge_cases import Draw, Setting, smoothed

from blurnoise.metrics import Flag, SlantedEdge, information, slanted_edge
from blurnoise.metrics.edge.place import correlation_of
from blurnoise.metrics.edge.response import block_weights, widening

AT = Setting(offset_px=(0.3, 0.1))


def test_white_noise_is_white() -> None:
    """One in 3 000 is not taken for it; of 200 none."""
    fields = Draw.of(1).normal((200, 100, 24))
    left, right = fields[..., :12], fields[..., 12:]
    sides = [(left, torch.ones_like(left)), (right, torch.ones_like(right))]
    power_at_0, block, too_long, _ = correlation_of(sides, torch.ones(len(fields), dtype=torch.bool))
    assert bool((power_at_0 == 1).all())
    assert bool((block == 1).all())
    assert not too_long.any()


@pytest.mark.parametrize(("sigma_px", "power"), [(0.5, 2.43), (0.8, 7.98), (1.5, 28.27)])
def test_power_at_0_is_the_filters(sigma_px: float, power: float) -> None:
    """Median of 12 edges, each known to some 20 %; strips 10 px wide lose a little of it."""
    found = [noisy(sigma_px, seed) for seed in range(12)]
    powers = torch.tensor([edge.noise_power_at_0 for edge in found])
    assert float(powers.nanmedian()) == pytest.approx(power, rel=0.25)
    assert all(("noise_not_white" in information.neq_0(edge).flags) for edge in found if edge.intervals)
    if sigma_px == 1.5:
        assert sum(Flag.NOISE_CORRELATED in edge.flags for edge in found) >= 10


def noisy(sigma_px: float, seed: int) -> SlantedEdge:
    draw = Draw.of(seed)
    field = smoothed(draw.normal((120, 140)), sigma_px)[10:-10, 10:-10]
    edge = slanted_edge(AT.edge() + 0.01 * field / field.std(), full_scale=9.0, bootstrap=20)
    assert isinstance(edge, SlantedEdge)
    return edge


def test_columns_of_their_own_are_flagged() -> None:
    flagged = 0
    for seed in range(10):
        draw = Draw.of(seed)
        image = AT.edge() + 0.01 * (draw.normal((100, 120)) + draw.normal((120,)))
        edge = slanted_edge(image, full_scale=9.0, bootstrap=0)
        assert isinstance(edge, SlantedEdge)
        flagged += bool(edge.flags)
    assert flagged >= 8


def test_blocks_are_whole_and_as_many_rows_as_there_are() -> None:
    weights = block_weights(300, 100, 7, seed=1)
    assert bool((weights.sum(1) == 100).all())
    assert float(weights.mean(0).std()) < 0.15  # every row as often: of 300 draws the mean is known to 0.06
    neighbours = torch.corrcoef(torch.stack([weights[:, :-1].flatten(), weights[:, 1:].flatten()]))[0, 1]
    assert float(neighbours) == pytest.approx(6 / 7, abs=0.05)
    assert torch.equal(block_weights(5, 40, 1, seed=3), block_weights(5, 40, 1, seed=3))


def test_few_blocks_widen_intervals_as_student_says() -> None:
    """t at 97.5 % with 9 degrees of freedom, from tables 2.262, over 1.96, times the root of 10/9."""
    assert widening(100, 1) == 1
    assert widening(100, 10) == pytest.approx(2.262 / 1.96 * (10 / 9) ** 0.5, rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("sigma_px", [0.5, 0.8])
def test_intervals_hold_where_noise_is_correlated(sigma_px: float) -> None:
    """Of 300 at 95 % a share of 91.2 to 98.8 is within three standard errors; without widening it is 90 %."""
    draws = [Draw.of(seed) for seed in range(300)]
    noise = torch.stack([smoothed(draw.normal((120, 140)), sigma_px)[10:-10, 10:-10] for draw in draws])
    found = slanted_edge((AT.edge() + 0.03 * noise / noise.std())[:, None], full_scale=9.0)
    assert isinstance(found, list)
    ends = [edge.intervals["mtf50"] for edge in found if edge.intervals]
    inside = sum(low <= AT.mtf50 <= high for low, high in ends) / len(ends)
    assert 0.912 <= inside <= 0.988, inside
