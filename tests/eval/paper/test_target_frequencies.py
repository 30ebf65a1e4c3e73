"""Frequencies of a target: the paper's signs, gratings, symmetries, noise and lines without edges."""

from __future__ import annotations

import math

import pytest
import torch
from blurnoise_eval.paper.target_frequencies import target_frequencies
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from blurnoise import charts


def grating(period_px: float, phase: float = 0.3, width: int = 120) -> Tensor:
    x = torch.arange(width, dtype=torch.float64)
    return (100 + 50 * torch.cos(2 * math.pi * (x / period_px - phase))).expand(9, width)


@pytest.mark.parametrize(("size_px", "low", "high"), [(100, 0.04, 0.1), (50, 0.08, 0.2), (32, 0.125, 0.3)])
def test_signs_hold_the_paper_s_frequencies(size_px: int, low: float, high: float) -> None:
    got = target_frequencies(charts.stop_sign(size_px)[0])
    inside = (got.frequency >= low) & (got.frequency <= high)
    assert float(inside.double().mean()) >= 0.6  # the letters' gaps reach further up
    assert low * 0.9 <= got.low <= low * 1.2
    assert high <= got.high <= 1.3 * high


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.floats(64, 260))
def test_frequencies_go_with_the_inverse_of_the_size(size_px: float) -> None:
    got, twice = (target_frequencies(charts.stop_sign(s, supersample=6)[0]) for s in (size_px, 2 * size_px))
    assert len(got.frequency) == len(twice.frequency) == 12
    distance, half = 1 / got.frequency, 1 / (2 * twice.frequency)
    assert float((distance - half).abs().max()) < 0.5  # px: what a pixel leaves of an edge's place


@settings(max_examples=25, deadline=None)
@given(st.floats(6, 30), st.floats(0, 1))
def test_grating_has_one_frequency(period_px: float, phase: float) -> None:
    got = target_frequencies(grating(period_px, phase))
    assert got.low == pytest.approx(1 / period_px, rel=0.01)
    assert got.high == pytest.approx(1 / period_px, rel=0.01)
    assert not got.too_few_edges


def test_places_of_steps() -> None:
    line = torch.zeros(40)
    line[10:20] = 1
    line[28:] = 1
    got = target_frequencies(line.expand(4, 40))
    assert got.rises_px.tolist() == [9.5, 27.5]
    assert got.falls_px.tolist() == [19.5]
    assert got.frequency.tolist() == [1 / 18]
    assert got.low == got.high == 1 / 18


def test_mirrored_and_inverted_targets_hold_the_same() -> None:
    sign = charts.stop_sign(100)[0]
    got = target_frequencies(sign)
    for other in (sign.flip(-1), 1 - sign, 3 * sign + 7):
        again = target_frequencies(other)
        assert torch.allclose(again.frequency, got.frequency, rtol=1e-4)


def test_column_of_the_turned_picture_is_the_row() -> None:
    sign = charts.stop_sign(80, height_px=101, width_px=160)[0]
    row, column = target_frequencies(sign), target_frequencies(sign.transpose(1, 2), across="y")
    assert torch.equal(row.frequency, column.frequency)
    assert not torch.equal(target_frequencies(sign, across="y").profile, row.profile)
    assert torch.equal(row.profile, sign.double().mean(0)[50])


@pytest.mark.parametrize("phase", [0.25, 0.3])  # edges on a sample, and 0.4 px off it
def test_standard_error_is_the_scatter(phase: float) -> None:
    clean = grating(12.0, phase, width=60)[:1]
    noise = torch.randn(600, 1, 60, generator=torch.Generator().manual_seed(2), dtype=torch.float64) / 2
    got = [target_frequencies(clean + each, noise_std=0.5, threshold=0.5) for each in noise]
    drawn = torch.stack([1 / each.rises_px.diff()[0] for each in got])
    stated = torch.cat([each.standard_error for each in got]).square().mean().sqrt()
    assert float(drawn.std()) == pytest.approx(float(stated), rel=0.12)  # 4 times 1/sqrt(2 n)


def test_noise_makes_no_edges() -> None:
    line = 100 + torch.randn(200, generator=torch.Generator().manual_seed(1))
    assert target_frequencies(line.expand(5, 200), noise_std=1.0).too_few_edges
    assert not target_frequencies(line.expand(5, 200)).too_few_edges


@pytest.mark.parametrize("value", [0.0, 0.1, 255.0])
def test_constant_line_has_none(value: float) -> None:
    got = target_frequencies(torch.full((3, 9, 30), value))
    assert got.too_few_edges
    assert math.isnan(got.low)
    assert math.isnan(got.high)
    assert len(got.frequency) == len(got.standard_error) == 0


def test_single_edge_has_none() -> None:
    got = target_frequencies(charts.slanted_edge(40, 50)[0])
    assert got.too_few_edges
    assert len(got.rises_px) == 1


def test_nan_on_the_line_and_off_it() -> None:
    sign = charts.stop_sign(50)[0]
    sign[0, 3, 3] = math.nan
    assert not target_frequencies(sign).not_finite
    sign[0, 50, 40] = math.nan
    got = target_frequencies(sign)
    assert got.not_finite
    assert got.too_few_edges
    assert math.isnan(got.low)


@pytest.mark.parametrize(("dtype", "top"), [(torch.uint8, 255), (torch.uint16, 60000)])
def test_integer_pictures(dtype: torch.dtype, top: int) -> None:
    sign = charts.stop_sign(100)[0]
    got = target_frequencies((sign * top).round().int().to(dtype))
    assert torch.allclose(got.frequency, target_frequencies(sign).frequency, rtol=0.02)


def test_single_row() -> None:
    assert torch.equal(
        target_frequencies(grating(10.0)[:1]).frequency, target_frequencies(grating(10.0)).frequency
    )


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"image": torch.ones(2, 3, 9, 9)}, ValueError, r"\(H, W\) or \(C, H, W\)"),
        ({"image": torch.ones(9)}, ValueError, "2 or more"),
        ({"image": torch.ones(0, 9)}, ValueError, "none of 0"),
        ({"image": torch.ones(9, 4)}, ValueError, "5 px or more along x"),
        ({"image": torch.ones(9, 9).bool()}, TypeError, "real numbers"),
        ({"across": "z"}, ValueError, "across"),
        ({"threshold": 0.0}, ValueError, "threshold"),
        ({"threshold": 1.1}, ValueError, "threshold"),
        ({"noise_std": -1.0}, ValueError, "noise_std"),
    ],
)
def test_wrong_arguments_are_named(change: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        target_frequencies(**{"image": torch.ones(9, 9), **change})
