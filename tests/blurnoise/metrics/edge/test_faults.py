"""Deceiving edges are withheld or flagged by name, honest ones are left alone; correlated noise; certain peaks."""

import pytest
import torch
from edge_cases import CASES, CAUGHT, SPARED, Draw, Setting, measured, smoothed, told, usual

from blurnoise.metrics import Flag, SlantedEdge, slanted_edge
from blurnoise.metrics.edge.position import correlation_of
from blurnoise.metrics.edge.response import FREQUENCIES, EdgeResponse

WRONG = {case.name: case for case in CASES if case.deceives}
HONEST = {case.name: case for case in CASES if not case.deceives}
HELD_OUT = range(1000, 1100)
"""Seeds that no threshold was chosen by."""
AT = Setting(offset_px=(0.3, 0.1))


FOUND = {
    "top clipped at 95%": Flag.NON_LINEAR_SUSPECTED,
    "black clipped by 5%": Flag.NON_LINEAR_SUSPECTED,
    "highlight roll-off": Flag.NON_LINEAR_SUSPECTED,
    "lateral colour 1 px": Flag.NON_LINEAR_SUSPECTED,
    "both sides clipped by 10%": Flag.TOO_ABRUPT,
    "unsharp mask 1, sigma 1.5 px, halos cut": Flag.TOO_ABRUPT,
    "unsharp mask 0.2": Flag.SHARPENED,
    "half steps 3 px apart": Flag.TWO_HUMPS,
    "half steps 6 px apart": Flag.TWO_EDGES,
    "row jitter 0.5 px": Flag.DISPLACED,
    "non-local means": Flag.SMOOTHED,
}


@pytest.mark.parametrize("name", FOUND)
def test_each_fault_is_found_by_its_name(name):
    edges = [measured(WRONG[name], seed, bootstrap=0) for seed in range(2)]
    assert all(FOUND[name] in edge.flags for edge in edges)


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_no_plain_wrong_number_on_held_out_seeds(name):
    assert told(WRONG[name], HELD_OUT) >= CAUGHT


@pytest.mark.slow
@pytest.mark.parametrize("name", HONEST)
def test_honest_edges_are_left_alone_on_held_out_seeds(name):
    assert told(HONEST[name], HELD_OUT) <= SPARED


@pytest.mark.parametrize("name", HONEST)
def test_honest_edges_are_left_alone_and_their_intervals_hold(name):
    """One of each; its MTF50 within 2.5 interval widths of the truth."""
    edge = measured(HONEST[name], 0, bootstrap=50)
    assert told(HONEST[name], range(1)) == 0
    if edge.intervals:
        low, high = edge.intervals["mtf50"]
        truth = HONEST[name].mtf50(usual(Draw.of(0)))
        assert abs(edge.mtf50 - truth) < 2.5 * (high - low) + 1e-4


@pytest.mark.parametrize("steps", [(0.6, 0.6, 0.6), (0.6, 0.3, 0.1), (0.6, 0.5, -0.1)])
def test_an_edge_of_colour_is_no_fault(steps):
    """A blurred edge at a CNR of 20, each colour with a step of its own; red and blue moved apart is one."""
    draw, at = Draw.of(4), Setting(noise=0.03, sigma_px=1.3, offset_px=(0.3, 0.1))
    for apart_px in (0.0, 1.0):
        image = torch.stack([
            at.noisy(0.2 + step * at.share(at.edge(place * apart_px)), draw)
            for place, step in zip((1, 0, -1), steps, strict=True)
        ])  # fmt: skip
        flags = slanted_edge(image, full_scale=2.0, bootstrap=0).flags
        if apart_px == 0:
            assert not flags
        elif steps[2] == 0.6:
            assert Flag.NON_LINEAR_SUSPECTED in flags


def test_white_noise_is_white():
    """One in 3 000 is not taken for it; of 200 none."""
    fields = Draw.of(1).normal((200, 100, 24))
    left, right = fields[..., :12], fields[..., 12:]
    sides = [(left, torch.ones_like(left)), (right, torch.ones_like(right))]
    power_at_0, block, too_long, _ = correlation_of(sides, torch.ones(len(fields), dtype=torch.bool))
    assert bool((power_at_0 == 1).all())
    assert bool((block == 1).all())
    assert not too_long.any()


def correlated(sigma_px, seed):
    field = smoothed(Draw.of(seed).normal((120, 140)), sigma_px)[10:-10, 10:-10]
    edge = slanted_edge(AT.edge() + 0.01 * field / field.std(), full_scale=9.0, bootstrap=20)
    assert isinstance(edge, SlantedEdge)
    return edge


def test_correlated_noise_is_noticed():
    """The filter's power at 0 is 7.98 times white noise's; one edge knows it to some 20 %."""
    assert correlated(0.8, 1).noise_power_at_0 == pytest.approx(7.98, rel=0.6)


@pytest.mark.slow
@pytest.mark.parametrize("sigma_px", [0.5, 0.8])
def test_intervals_hold_where_noise_is_correlated(sigma_px):
    """Of 300 at 95 % a share of 91.2 to 98.8 is within three standard errors; without widening it is 90 %."""
    draws = [Draw.of(seed) for seed in range(300)]
    noise = torch.stack([smoothed(draw.normal((120, 140)), sigma_px)[10:-10, 10:-10] for draw in draws])
    found = slanted_edge((AT.edge() + 0.03 * noise / noise.std())[:, None], full_scale=9.0)
    assert isinstance(found, list)
    ends = [edge.intervals["mtf50"] for edge in found if edge.intervals]
    inside = sum(low <= AT.mtf50 <= high for low, high in ends) / len(ends)
    assert 0.912 <= inside <= 0.988, inside


PEAK = 63


def response(noise):
    """A power of 1.5 at one frequency over a fall from 1, and its noise, the same everywhere."""
    power = (1 - FREQUENCIES).clone()
    power[PEAK] = 1.5
    return EdgeResponse(FREQUENCIES[1:2], power[None], torch.full_like(power[None], noise), None)


@pytest.mark.parametrize("noise", [0.0, 1e-14, -1e-14])
def test_a_peak_without_noise_is_certain_though_its_power_round_below_0(noise):
    found = response(1e-14)
    found.noise[0, ::7] = noise
    assert found.peak().tolist() == [PEAK]


def test_a_peak_within_the_noise_is_none():
    """Three standard errors of power 1.5 with noise v are 3 sqrt(3 v): more than 0.5 from v = 0.0093 on."""
    assert response(0.0092).peak().tolist() == [PEAK]
    assert response(0.0094).peak().tolist() == [0]
