"""Slanted edges found in a picture: all of them, alone, and nothing else."""

from __future__ import annotations

from functools import cache

import charts_of_squares as chart
import pytest
import torch
from blurnoise_eval.quality.find_edges import UNUSABLE, Found, find_edges
from blurnoise_eval.quality.linear import Linear
from torch import Tensor

from blurnoise import charts
from blurnoise.blur.convolution import motion_blur
from blurnoise.metrics import Flag, SlantedEdge


def found(image: Tensor, full_scale: float = 1.0, black_level: float = 0.0) -> Found:
    return find_edges(Linear(image[0].double(), full_scale, black_level))


def edge_of(image: Tensor, roi: tuple[int, int, int, int]) -> SlantedEdge:
    return Linear(image[0].double(), 1.0).edge(roi)


def noise(image: Tensor, deviation: float) -> Tensor:
    return image + deviation * torch.randn(image.shape, generator=torch.Generator().manual_seed(2))


BLURS = {  # px of motion to the right, noise, and what MTF50 may be off
    "sharp": (0.0, 0.0, 0.004),
    "noisy": (0.0, 0.02, 0.08),
    "moved": (8.0, 0.0, 0.004),
    "moved far, noisy": (20.0, 0.01, 0.04),
}


@cache
def blurred(name: str) -> tuple[Tensor, list[tuple[int, int, int, int]]]:
    """The chart of squares, and its regions."""
    length, deviation, _ = BLURS[name]
    image = noise(motion_blur(chart.squares(), [[length, 0.0]]), deviation)
    return image, found(image).rois


@pytest.mark.slow
@pytest.mark.parametrize("name", BLURS)
def test_every_edge_of_a_chart_is_found_and_gives_the_closed_form(name: str) -> None:
    """Four sides of four squares: their angles to 0.2°, MTF50 to 0.4 %, with noise to four standard errors."""
    length, _, error = BLURS[name]
    image, regions = blurred(name)
    assert len(regions) == 16
    assert [top for _, top, _, _ in regions] == sorted(top for _, top, _, _ in regions)
    angles = []
    for roi in regions:
        edge = edge_of(image, roi)
        assert not edge.flags & UNUSABLE
        turn = (edge.angle_deg - chart.TILT_DEG + 45) % 90 - 45
        assert abs(turn) < 0.2
        angles.append(round((edge.angle_deg - chart.TILT_DEG) / 90) % 4)
        assert edge.mtf50 == pytest.approx(chart.mtf50(edge.angle_deg, length), rel=error)
    assert sorted(angles) == sorted([0, 1, 2, 3] * 4)


@pytest.mark.parametrize("angle_deg", [3.0, 12.0, 26.565, 95.0, 184.0, -80.0])
def test_an_edge_alone_has_the_whole_picture(angle_deg: float) -> None:
    assert found(charts.slanted_edge(160, 180, angle_deg=angle_deg)).rois == [(0, 0, 180, 160)]


def test_wide_blur_under_noise_shows_at_coarser_scales() -> None:
    image = motion_blur(charts.slanted_edge(200, 200, dark=0.3, bright=0.6), [[30.0, 0.0]])
    assert found(noise(image, 0.03)).rois == [(0, 0, 200, 200)]


NOT_FOUND: dict[str, tuple[Tensor, Flag | None]] = {
    "upright": (charts.slanted_edge(120, 160, angle_deg=0.0), Flag.TOO_FEW_PHASES),
    "clipped": ((chart.squares() * 1.4).clamp(max=1), Flag.CLIPPED),
    "steep": (charts.slanted_edge(120, 160, angle_deg=40.0), None),
    "noise": (noise(charts.flat_patch(90, 120), 0.02), None),
    "small": (charts.slanted_edge(20, 20), None),
    "one pixel": (charts.slanted_edge(1, 1), None),
}


@pytest.mark.parametrize(("image", "reason"), NOT_FOUND.values(), ids=NOT_FOUND)
def test_what_cannot_be_measured_is_not_found(image: Tensor, reason: Flag | None) -> None:
    seen = found(image)
    assert seen.rois == []
    assert set(seen.turned_down) == ({reason} if reason else set())
