"""Tests of an edge's shape: each finds what it is there for, under its own name, and nothing in an honest edge."""

from __future__ import annotations

import pytest
import torch
from edge_cases import CASES, Draw, Setting, usual

from blurnoise.metrics import Flag, SlantedEdge, slanted_edge
from blurnoise.metrics.edge.faults import Profile, negative
from blurnoise.metrics.edge.shape import locate, shape_of

MAKES = {case.name: case.make for case in CASES}
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


def measured(name: str, seed: int, **other: object) -> SlantedEdge:
    draw = Draw.of(seed)
    edge = slanted_edge(MAKES[name](usual(draw, **other), draw), full_scale=2.0, bootstrap=0)
    assert isinstance(edge, SlantedEdge)
    return edge


@pytest.mark.parametrize(("name", "flag"), FOUND.items())
def test_each_fault_is_found_by_its_name(name: str, flag: Flag) -> None:
    assert sum(flag in measured(name, seed).flags for seed in range(4)) >= 3


def colours(by_px: float, steps: tuple[float, float, float]) -> SlantedEdge:
    """A blurred edge at a CNR of 20, red and blue moved apart, each colour with a step of its own."""
    draw, at = Draw.of(4), Setting(noise=0.03, sigma_px=1.3, offset_px=(0.3, 0.1))
    x, y = at.offset_px
    image = torch.stack([
        at.noisy(0.2 + step * at.share(at.edge(offset_px=(x + place * by_px, y))), draw)
        for place, step in zip((1, 0, -1), steps, strict=True)
    ])  # fmt: skip
    edge = slanted_edge(image, full_scale=2.0, bootstrap=0)
    assert isinstance(edge, SlantedEdge)
    return edge


def test_colours_apart_are_found_behind_blur_and_noise() -> None:
    assert Flag.NON_LINEAR_SUSPECTED in colours(1.0, (0.6, 0.6, 0.6)).flags


@pytest.mark.parametrize("steps", [(0.6, 0.6, 0.6), (0.6, 0.3, 0.1), (0.6, 0.5, -0.1), (0.6, 0.6, 0.0)])
def test_an_edge_of_colour_is_no_fault(steps: tuple[float, float, float]) -> None:
    assert not colours(0.0, steps).flags


def test_no_blur_asks_for_negative_light() -> None:
    at = Setting(noise=0.001, sigma_px=0.7, offset_px=(0.3, 0.1))
    clipped = at.level(at.share(at.edge()).clamp(0.1, 0.9))
    images = torch.stack([at.noisy(image, Draw.of(5)) for image in (at.edge(), clipped)])
    shape = shape_of(locate(images)[0])
    assert negative(Profile.of(shape.spline, shape.position_px)).tolist() == [False, True]


def test_a_number_with_a_flag_carries_it() -> None:
    estimate = measured("top clipped at 90%", 0).estimate("mtf50")
    assert estimate.told
    assert "non_linear_suspected" in estimate.flags


def test_a_hot_pixel_is_no_fault_and_costs_nothing() -> None:
    at = Setting(offset_px=(0.3, 0.1))
    image = at.noisy(at.edge(), Draw.of(1))
    image[40, 58:60] = 0.95
    image[70, 90] = 0.95
    edge = slanted_edge(image, full_scale=2.0, bootstrap=0)
    assert isinstance(edge, SlantedEdge)
    assert not edge.flags
    assert edge.mtf50 == pytest.approx(at.mtf50, rel=0.02)


def test_light_that_falls_off_along_the_edge_is_no_fault() -> None:
    """10 % from end to end; without levels by row, MTF50 is 1 % low and the rows look displaced."""
    at = Setting(offset_px=(0.3, 0.1))
    shading = 1 + 0.1 * torch.linspace(-0.5, 0.5, at.height_px, dtype=torch.float64)[:, None]
    edge = slanted_edge(at.noisy(at.edge() * shading, Draw.of(2)), full_scale=2.0, bootstrap=0)
    assert isinstance(edge, SlantedEdge)
    assert not edge.flags
    assert edge.mtf50 == pytest.approx(at.mtf50, rel=0.025)


def test_certainty_is_students() -> None:
    """Quantiles of Student's law at 1 - 0.0005 and 1 - 0.000005, from tables: 30 and 100 degrees of freedom."""
    for rows, places, quantile in ((31, 1, 3.646), (101, 1, 3.390), (101, 100, 4.654)):
        profile = Profile(torch.zeros(1, 5), torch.zeros(1, 5, 5), rows, torch.ones(1, 5), torch.zeros(1))
        assert float(profile.certain(places)) == pytest.approx(quantile, rel=0.02)
