"""Defocus that changes over the picture, held against the disc of every pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from blurs import optical_blur
from scipy.interpolate import BarycentricInterpolator

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise.blur import convolution, fourier, over_the_field
from blurnoise.blur.over_the_field import TOLERANCE, defocus, discs
from blurnoise.optics import transfer
from blurnoise.optics.transfer import Optics

H, W = 31, 43


def radii(centre: float, corner: float, height: int = H, width: int = W, per_px: int = 16) -> Any:
    y, x = np.mgrid[:height, :width]
    squared = (y - (height - 1) / 2) ** 2 + (x - (width - 1) / 2) ** 2
    return np.round(per_px * np.abs(centre + (corner - centre) * squared / squared.max())) / per_px


def picture(height: int = H, width: int = W) -> torch.Tensor:
    """Black and white without correlation: the worst there is."""
    made = torch.rand(1, 2, height, width, generator=torch.Generator().manual_seed(4))
    return (made > 0.5).double()


def dense(image: torch.Tensor, radius_px: Any, border: Border = "reflect") -> torch.Tensor:
    """Every pixel from the blur of the whole picture, continued so far that its disc's tail is known, by its disc."""
    far = 120
    plane = extended(image, (far, far), (H + 2 * far, W + 2 * far), border)
    out = torch.zeros_like(image)
    for radius in np.unique(radius_px):
        own = torch.from_numpy(radius_px == radius)
        blurred = convolution.exposure_blur(plane, (0.0, 0.0), Optics(float(radius)), method="transfer")
        out[..., own] = blurred[..., far:-far, far:-far][..., own]
    return out


@pytest.mark.slow
@pytest.mark.parametrize(("centre", "corner"), [(0.0, 1.0), (0.3, 3.3), (2.0, 0.0), (1.0, -1.5), (4.0, 6.0)])
def test_every_pixel_has_its_own_disc(centre: float, corner: float) -> None:
    """Within the tolerance of the worst disc in the field, and as much of the tails beyond the margin."""
    image, radius = picture(), radii(centre, corner)
    off = defocus(image, radius) - dense(image, radius)
    assert 1e-7 < float(off.square().mean().sqrt()) < 1.6 * TOLERANCE
    assert float(off.abs().max()) < 10 * TOLERANCE


def test_too_few_discs_are_seen() -> None:
    image, radius = picture(), radii(0.0, 3.0)
    assert len(discs(0.0, 3.0, 100 * TOLERANCE)) < len(discs(0.0, 3.0))
    off = defocus(image, radius, tolerance=100 * TOLERANCE) - dense(image, radius)
    assert 5 * TOLERANCE < float(off.square().mean().sqrt()) < 100 * TOLERANCE


@pytest.mark.parametrize("lasting", [False, True], ids=["packed", "torch"])
def test_tiles_of_a_large_picture_meet(lasting: bool) -> None:
    """A picture cut, and not cut: each within its tolerance of the other."""
    image, radius = picture(480, 640).requires_grad_(lasting), radii(0.2, 4.0, 480, 640)
    nodes = discs(0.2, 4.0)
    blend = over_the_field._Discs(nodes, over_the_field.weights(radius**2, nodes))
    whole = fourier.apply(image, blend, "reflect", tiled=False)
    off = (defocus(image, radius) - whole).detach()
    assert 0 < float(off.square().mean().sqrt()) < 2 * TOLERANCE  # the tail beyond each margin is 1e-4


@pytest.mark.parametrize(("least", "most"), [(0.0, 1.0), (0.0, 3.0), (2.0, 3.0), (5.0, 8.0)])
def test_one_disc_fewer_is_too_few(least: float, most: float) -> None:
    """The number is the smallest within the tolerance: the error of the next smaller, by itself, is above it."""
    found = discs(least, most)
    f = (torch.arange(24, dtype=torch.float64) + 0.5) / 48
    band = torch.hypot(f, f[:, None]).flatten()
    seen = np.linspace(least**2, most**2, 201)
    exact = np.stack([transfer.disc(band, float(radius)).numpy() for radius in np.sqrt(seen)])

    def error(count: int) -> float:
        points = (most**2 + least**2) / 2 + (most**2 - least**2) / 2 * np.polynomial.chebyshev.chebpts1(count)
        known = np.stack([transfer.disc(band, float(radius)).numpy() for radius in np.sqrt(points)])
        blended = BarycentricInterpolator(points, known)(seen)
        return float(np.sqrt(((blended - exact) ** 2).mean(1)).max() / 2)

    assert error(len(found)) < 1.1 * TOLERANCE
    assert error(len(found) - 1) > TOLERANCE


def test_weights_are_a_partition_of_unity() -> None:
    nodes = discs(0.0, 5.0)
    u = np.append(np.linspace(0, 25, 99), np.square(nodes))
    weights = over_the_field.weights(u, nodes)
    np.testing.assert_allclose(weights.sum(0), 1, atol=1e-12)
    np.testing.assert_allclose(weights[:, 99:], np.eye(len(nodes)), atol=1e-12)
    np.testing.assert_allclose(weights.T @ np.square(nodes) ** 2, u**2, rtol=1e-12, atol=1e-9)
    single = over_the_field.weights(u.astype(np.float32), nodes)
    np.testing.assert_allclose(single, weights, atol=1e-5)


@pytest.mark.parametrize("border", BORDERS)
def test_borders(border: Any) -> None:
    image, radius = picture(), radii(0.5, 2.5)
    off = defocus(image, radius, border=border) - dense(image, radius, border)
    assert float(off.square().mean().sqrt()) < 1.6 * TOLERANCE


def test_the_same_disc_everywhere_is_one_blur() -> None:
    image, radius = picture(), np.full((H, W), 1.75)
    assert discs(1.75, 1.75) == (1.75,)
    assert float((defocus(image, radius) - dense(image, radius)).square().mean().sqrt()) < 1.1 * TOLERANCE


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
    with pytest.raises(
        ValueError, match="field_curvature_px: discs from 0 to 300 px in one picture are too many"
    ):
        defocus(picture(9, 9), radii(0.0, 300.0, 9, 9))


def test_spreading_differs_as_the_radius_changes_across_a_disc() -> None:
    """0 to 2 px over 640x480: light spread by the disc of where it comes from, or seen through that of its place."""
    radius, image = radii(0.0, 2.0, 480, 640, 4096), picture(480, 640)[:, :1]
    nodes = discs(0.0, 2.0)
    weights = torch.from_numpy(over_the_field.weights(radius**2, nodes))
    parts = [optical_blur(image * own, Optics(each)) for own, each in zip(weights, nodes, strict=True)]
    off = (torch.stack(parts).sum(0) - defocus(image, radius))[..., 16:-16, 16:-16]
    assert float(off.square().mean().sqrt()) == pytest.approx(8e-4, rel=0.1)
