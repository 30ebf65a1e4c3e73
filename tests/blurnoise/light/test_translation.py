"""Translation: whole pixels, waves, borders, directions."""

from __future__ import annotations

import math

import pytest
import torch

from blurnoise.blur.rows import translated

PICTURE = torch.rand(2, 3, 21, 34, generator=torch.Generator().manual_seed(1))


def test_nothing_is_the_picture_itself() -> None:
    assert translated(PICTURE, (0.0, 0.0)) is PICTURE


@pytest.mark.parametrize(("x", "y"), [(3, 0), (-4, 2), (0, -5), (60, 0)])
def test_whole_pixels_are_copied(x: int, y: int) -> None:
    seen = translated(PICTURE, (float(x), float(y)), "circular")
    torch.testing.assert_close(seen, torch.roll(PICTURE, (y, x), (-2, -1)), rtol=0, atol=0)


def test_the_border_goes_on_as_it_says() -> None:
    seen = translated(PICTURE, (2.0, 0.0), "constant")
    assert float(seen[..., :2].abs().max()) == 0.0
    seen = translated(PICTURE, (-2.0, 0.0), "replicate")
    torch.testing.assert_close(seen[..., -3:], PICTURE[..., -1:].expand(-1, -1, -1, 3), rtol=0, atol=0)


@pytest.mark.parametrize(("x", "y"), [(0.3, 0.0), (0.0, -2.7), (-5.31, 1.5)])
def test_waves_are_displaced(x: float, y: float) -> None:
    """In the middle; near the border the wave goes on as its mirror image."""
    down, across = torch.meshgrid(torch.arange(160.0), torch.arange(181.0), indexing="ij")

    def wave(x: float, y: float) -> torch.Tensor:
        phases = 2 * math.pi * (0.21 * (across - x) + 0.13 * (down - y))
        return (0.5 + 0.4 * torch.sin(phases))[None, None]

    seen = translated(wave(0.0, 0.0).double(), (x, y))
    middle = (..., slice(60, 100), slice(70, 110))
    torch.testing.assert_close(seen[middle], wave(x, y).double()[middle], rtol=0, atol=0.005)


def test_each_picture_has_its_own_and_gradients_pass() -> None:
    light = PICTURE.double().requires_grad_()
    seen = translated(light, [[0.5, 0.0], [0.0, 2.25]])
    alone = translated(PICTURE.double()[1:], (0.0, 2.25))
    torch.testing.assert_close(seen[1:].detach(), alone, rtol=0, atol=1e-12)
    seen.sum().backward()
    assert light.grad is not None
    assert bool(torch.isfinite(light.grad).all())


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="displacement_px: shape must be"):
        translated(PICTURE, (1.0, 2.0, 3.0))
