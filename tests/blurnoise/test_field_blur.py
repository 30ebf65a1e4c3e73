"""Defocus that changes over the picture, held against the disc of every pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from blurnoise._core.borders import BORDERS
from blurnoise.blur import convolution, over_the_field
from blurnoise.blur.over_the_field import TOLERANCE, Tile, defocus, discs, plan
from blurnoise.optics import transfer
from blurnoise.optics.transfer import Optics

H, W = 31, 43


def radii(centre: float, corner: float, height: int = H, width: int = W) -> Any:
    y, x = np.mgrid[:height, :width]
    squared = (y - (height - 1) / 2) ** 2 + (x - (width - 1) / 2) ** 2
    return np.abs(centre + (corner - centre) * squared / squared.max())


def picture(height: int = H, width: int = W) -> torch.Tensor:
    """Black and white without correlation: the worst there is."""
    made = torch.rand(1, 2, height, width, generator=torch.Generator().manual_seed(4))
    return (made > 0.5).double()


def dense(image: torch.Tensor, radius_px: Any, border: Any = "reflect") -> torch.Tensor:
    """Every pixel from the blur of the whole picture by its own disc, in Fourier transforms of the same length."""
    out = torch.zeros_like(image)
    margin = max(tile.margin for tile in plan(radius_px))
    for radius in np.unique(radius_px):
        own = torch.from_numpy(radius_px == radius)
        one = Tile(slice(0, H), slice(0, W), margin, (float(radius),))
        out[..., own] = defocus(image, radius_px, border=border, tiles=[one])[..., own]
    return out


@pytest.mark.slow
@pytest.mark.parametrize(("centre", "corner"), [(0.0, 1.0), (0.3, 3.3), (2.0, 0.0), (1.0, -1.5), (4.0, 6.0)])
def test_every_pixel_has_its_own_disc(centre: float, corner: float) -> None:
    """Within the tolerance, which is that of the worst disc in the field; known to a tenth from this many pixels."""
    image, radius = picture(), radii(centre, corner)
    off = defocus(image, radius) - dense(image, radius)
    assert 1e-7 < float(off.square().mean().sqrt()) < 1.1 * TOLERANCE
    assert float(off.abs().max()) < 10 * TOLERANCE


@pytest.mark.slow
def test_too_few_discs_are_seen() -> None:
    image, radius = picture(), radii(0.0, 3.0)
    few = plan(radius, 100 * TOLERANCE)
    assert max(len(tile.radii_px) for tile in few) < max(len(tile.radii_px) for tile in plan(radius))
    off = defocus(image, radius, tiles=few) - dense(image, radius)
    assert 5 * TOLERANCE < float(off.square().mean().sqrt()) < 100 * TOLERANCE


def test_tiles_of_a_large_picture_meet() -> None:
    """A picture cut, and not cut: each within its tolerance of the other."""
    assert len(plan(radii(0.0, 5.0, 720, 1280))) > 1
    image, radius = picture(150, 215), radii(0.2, 4.0, 150, 215)
    tiles, whole = (over_the_field._cut(radius, *counts, TOLERANCE) for counts in ((2, 3), (1, 1)))
    off = defocus(image, radius, tiles=tiles) - defocus(image, radius, tiles=whole)
    assert float(off.square().mean().sqrt()) < 3 * TOLERANCE  # the tail beyond each margin is another 1e-4
    seen = {(row, column) for tile in tiles for row in (tile.rows.start,) for column in (tile.columns.start,)}
    assert len(seen) == len(tiles)


@pytest.mark.parametrize(("least", "most"), [(0.0, 1.0), (0.0, 3.0), (2.0, 3.0), (5.0, 8.0)])
def test_one_disc_fewer_is_too_few(least: float, most: float) -> None:
    """The number is the smallest within the tolerance: the error of the next smaller, by itself, is above it."""
    found = discs(least, most)
    f = (torch.arange(24, dtype=torch.float64) + 0.5) / 48
    band = torch.hypot(f, f[:, None]).flatten()
    seen = np.linspace(least**2, most**2, 201)
    exact = np.stack([transfer.disc(band, float(radius)).numpy() for radius in np.sqrt(seen)])

    def error(count: int) -> float:
        nodes = over_the_field._points(least, most, count)
        known = np.stack([transfer.disc(band, radius).numpy() for radius in nodes])
        blended = np.stack(over_the_field._weights(seen, nodes)).T @ known
        return float(np.sqrt(((blended - exact) ** 2).mean(1)).max() / 2)

    assert error(len(found)) < 1.1 * TOLERANCE
    assert error(len(found) - 1) > TOLERANCE


def test_weights_are_a_partition_of_unity() -> None:
    weights = over_the_field._weights(np.linspace(0, 25, 99), discs(0.0, 5.0))
    np.testing.assert_allclose(sum(weights), 1, atol=1e-12)


@pytest.mark.parametrize("border", BORDERS)
def test_borders(border: Any) -> None:
    image, radius = picture(), radii(0.5, 2.5)
    off = defocus(image, radius, border=border) - dense(image, radius, border)
    assert float(off.square().mean().sqrt()) < 1.1 * TOLERANCE


def test_the_same_disc_everywhere_is_one_blur() -> None:
    image, radius = picture(), np.full((H, W), 1.75)
    assert [tile.radii_px for tile in plan(radius)] == [(1.75,)]
    expected = convolution.optical_blur(image, Optics(1.75))
    off = (defocus(image, radius) - expected).square().mean().sqrt()
    assert float(off) < 3 * TOLERANCE  # the tails beyond the margins, in a picture that is all border


@pytest.mark.slow
def test_white_stays_white() -> None:
    seen = defocus(torch.ones(1, 1, H, W, dtype=torch.float64), radii(0.2, 4.0))
    torch.testing.assert_close(seen, torch.ones_like(seen), atol=1e-9, rtol=0)


def test_both_routes_and_both_precisions_agree() -> None:
    image, radius = picture().expand(2, -1, -1, -1), radii(0.3, 2.0)
    double = defocus(image, radius)
    general = defocus(image.clone().requires_grad_(), radius).detach()
    torch.testing.assert_close(general, double, atol=1e-12, rtol=0)
    torch.testing.assert_close(defocus(image.float(), radius).double(), double, atol=5e-6, rtol=0)


def test_gradients() -> None:
    image = torch.rand(1, 1, 5, 7, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda light: defocus(light, radii(0.2, 1.5, 5, 7)), image)


def test_a_picture_of_one_pixel_stays() -> None:
    one = torch.full((1, 3, 1, 1), 0.4, dtype=torch.float64)
    torch.testing.assert_close(defocus(one, np.array([[2.0]])), one)


def test_bits_depend_on_neither_batch_nor_threads() -> None:
    image, radius = torch.rand(3, 2, 300, 400), radii(0.1, 2.0, 300, 400)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        alone = torch.cat([defocus(each[None], radius) for each in image])
        torch.set_num_threads(2)
        assert torch.equal(defocus(image, radius), alone)
    finally:
        torch.set_num_threads(before)


def test_more_than_can_be_blended_is_named() -> None:
    assert discs(0.0, 200.0) == ()
    with pytest.raises(
        ValueError, match="field_curvature_px: discs from 0 to 300 px in one picture are too many"
    ):
        plan(radii(0.0, 300.0, 9, 9))


def test_spreading_differs_as_the_radius_changes_across_a_disc() -> None:
    """0 to 2 px over 640x480: light spread by the disc of where it comes from, or seen through that of its place."""
    radius, image = radii(0.0, 2.0, 480, 640), picture(480, 640)[:, :1]
    nodes = discs(0.0, 2.0)
    weights = (torch.from_numpy(each) for each in over_the_field._weights(radius**2, nodes))
    parts = [
        convolution.optical_blur(image * own, Optics(each)) for own, each in zip(weights, nodes, strict=True)
    ]
    off = (torch.stack(parts).sum(0) - defocus(image, radius))[..., 16:-16, 16:-16]
    assert float(off.square().mean().sqrt()) == pytest.approx(8e-4, rel=0.1)
