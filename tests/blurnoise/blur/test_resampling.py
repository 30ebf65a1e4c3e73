"""Resampling and defocus that changes over the picture: positions, waves, borders, every pixel's disc, bits."""

import cmath
import math

import cv2
import numpy as np
import pytest
import torch
from scipy.interpolate import BSpline

from blurnoise._core.borders import BORDERS, extended
from blurnoise.blur import convolution, fourier, over_the_field, resampling
from blurnoise.blur.over_the_field import TOLERANCE, defocus, discs
from blurnoise.blur.resampling import sampled
from blurnoise.blur.rows import translated
from blurnoise.camera.transfer import Optics

H, W = 31, 43


def noise(kind=torch.float64, *shape):
    shape = shape or (1, 2, H, W)
    return torch.rand(*shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64).to(kind)


def places(seed=0, margin=0.0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-margin, W - 1 + margin, (11, 17)), rng.uniform(-margin, H - 1 + margin, (11, 17))


def test_positions_are_exact():
    """A ramp is seen where it is, which OpenCV's cubic misses by 0.048 px."""
    ramp = torch.arange(W, dtype=torch.float64).expand(1, 1, H, W).contiguous()
    x = np.linspace(15, 25, 401)[None].repeat(3, 0)
    y = np.full_like(x, 18.3)
    assert float((sampled(ramp, x, y, "replicate") - torch.from_numpy(x)).abs().max()) < 1e-4
    single = sampled(ramp.float(), x, y, "replicate")
    assert float((single - torch.from_numpy(x)).abs().max()) < 2e-4
    cubic = cv2.remap(ramp[0, 0].float().numpy(), x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC)
    assert np.abs(cubic - x).max() > 0.04


def response(f, shift_px=0.5):
    """What a cardinal spline of the fifth degree keeps of a wave of f cycles/px, by SciPy's; 1 is no loss."""
    spline = BSpline.basis_element(np.arange(-3.0, 4.0), extrapolate=False)
    places = np.arange(-3, 4)
    seen = np.nan_to_num(spline(places - shift_px)) @ np.exp(2j * np.pi * f * (places - shift_px))
    return complex(seen / (np.nan_to_num(spline(places)) @ np.cos(2 * np.pi * f * places)))


@pytest.mark.parametrize("shift", [0.5, 0.3])
def test_response_is_that_of_the_picture(shift):
    """A complex wave of a whole number of periods, seen ``shift`` away: what comes back at its own frequency."""
    n, periods = 40, 14
    f = periods / n
    wave = torch.exp(2j * torch.pi * f * torch.arange(n, dtype=torch.float64))
    both = torch.stack([wave.real, wave.imag])[None, :, None].expand(-1, -1, 6, -1).contiguous()
    x = np.arange(n)[None].repeat(2, 0) + shift
    seen = sampled(both, x, np.full_like(x, 2.0), "circular")[0, :, 0]
    at = sum(
        complex(*each) * cmath.exp(-2j * math.pi * f * (place + shift))
        for place, each in enumerate(seen.T.tolist())
    )
    assert at / n == pytest.approx(response(f, shift), abs=1e-6)


@pytest.mark.parametrize("border", BORDERS)
def test_outside_the_picture_its_border_goes_on(border):
    image, (x, y) = noise(), places(margin=12.0)
    wide = extended(image, (80, 80), (H + 160, W + 160), border)
    expected = sampled(wide, x + 80, y + 80, "replicate")
    tolerance = 0.35 if border == "replicate" else 1e-6  # a spline overshoots where its noise turns constant
    off = (sampled(image, x, y, border) - expected).abs()
    assert float(off.max()) < tolerance
    inside = torch.from_numpy((x > 6) & (x < W - 7) & (y > 6) & (y < H - 7))
    assert float(off[..., inside].max()) < 1e-6


@pytest.mark.parametrize("border", BORDERS)
def test_both_routes_agree(border, monkeypatch):
    image, (x, y) = noise(torch.float32, 2, 3, H, W), places(margin=5.0)
    assert resampling._remaps_exactly()
    quick = sampled(image, x, y, border)
    monkeypatch.setattr(resampling, "_remaps_exactly", lambda: False)
    assert float((sampled(image, x, y, border) - quick).abs().max()) < 3e-4
    assert float((sampled(image.double(), x, y, border) - quick).abs().max()) < 3e-4


def test_bits_depend_on_neither_batch_nor_threads():
    image, radius = torch.rand(3, 2, 300, 400), radii(0.1, 2.0, 300, 400)
    x, y = np.meshgrid(np.linspace(3, 390, 400), np.linspace(2, 290, 300))
    before = torch.get_num_threads()
    for blurred in (lambda light: sampled(light, x, y, "reflect"), lambda light: defocus(light, radius)):
        try:
            torch.set_num_threads(1)
            alone = torch.cat([blurred(each[None]) for each in image])
            torch.set_num_threads(2)
            assert torch.equal(blurred(image), alone)
        finally:
            torch.set_num_threads(before)


def radii(centre, corner, height=H, width=W, per_px=16):
    y, x = np.mgrid[:height, :width]
    squared = (y - (height - 1) / 2) ** 2 + (x - (width - 1) / 2) ** 2
    return np.round(per_px * np.abs(centre + (corner - centre) * squared / squared.max())) / per_px


def picture(height=H, width=W):
    """Black and white without correlation: the worst there is."""
    made = torch.rand(1, 2, height, width, generator=torch.Generator().manual_seed(4))
    return (made > 0.5).double()


def dense(image, radius_px, border="reflect"):
    """Every pixel from the blur of the whole picture, continued so far that its disc's tail is known, by its disc."""
    far = 120
    plane = extended(image, (far, far), (H + 2 * far, W + 2 * far), border)
    out = torch.zeros_like(image)
    for radius in np.unique(radius_px):
        own = torch.from_numpy(radius_px == radius)
        blurred = convolution.exposure_blur(plane, (0.0, 0.0), Optics(float(radius)), method="transfer")
        out[..., own] = blurred[..., far:-far, far:-far][..., own]
    return out


@pytest.mark.parametrize(("centre", "corner"), [(0.3, 3.3), pytest.param(4.0, 6.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("border", ["reflect", "constant"])
def test_every_pixel_has_its_own_disc(centre, corner, border):
    """Within the tolerance of the worst disc in the field, and as much of the tails beyond the margin."""
    image, radius = picture(), radii(centre, corner)
    off = defocus(image, radius, border=border) - dense(image, radius, border)
    assert 1e-7 < float(off.square().mean().sqrt()) < 1.6 * TOLERANCE
    assert float(off.abs().max()) < 10 * TOLERANCE


@pytest.mark.parametrize("lasting", [False, True], ids=["packed", "torch"])
def test_tiles_of_a_large_picture_meet(lasting):
    """A picture cut, and not cut: each within its tolerance of the other."""
    image, radius = picture(480, 640).requires_grad_(lasting), radii(0.2, 4.0, 480, 640)
    nodes = discs(0.2, 4.0)
    blend = over_the_field._Discs(nodes, over_the_field.weights(radius**2, nodes))
    whole = fourier.apply(image, blend, "reflect", tiled=False)
    off = (defocus(image, radius) - whole).detach()
    assert 0 < float(off.square().mean().sqrt()) < 2 * TOLERANCE  # the tail beyond each margin is 1e-4


def test_defocus_by_both_routes_and_precisions_agrees():
    image, radius = picture().expand(2, -1, -1, -1), radii(0.3, 2.0)
    double = defocus(image, radius)
    general = defocus(image.clone().requires_grad_(), radius).detach()
    torch.testing.assert_close(general, double, atol=1e-12, rtol=0)
    torch.testing.assert_close(defocus(image.float(), radius).double(), double, atol=5e-6, rtol=0)


def test_gradients_of_defocus():
    image = torch.rand(1, 1, 5, 7, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda light: defocus(light, radii(0.2, 1.5, 5, 7)), image)


def test_discs_are_as_few_as_serve_and_more_than_can_be_blended_is_named():
    assert [len(discs(0.0, most)) for most in (0.0, 3.0)] == [1, 9]
    with pytest.raises(
        ValueError, match="field_curvature_px: discs from 0 to 300 px in one picture are too many"
    ):
        defocus(picture(9, 9), radii(0.0, 300.0, 9, 9))


@pytest.mark.parametrize(("x", "y"), [(-4, 2), (0, -5), (60, 0)])
def test_translation_copies_whole_pixels(x, y):
    seen = translated(noise(), (float(x), float(y)), "circular")
    torch.testing.assert_close(seen, torch.roll(noise(), (y, x), (-2, -1)), rtol=0, atol=0)


@pytest.mark.parametrize(("x", "y"), [(0.3, 0.0), (-5.31, 1.5)])
def test_waves_are_displaced(x, y):
    """In the middle; near the border the wave goes on as its mirror image."""
    down, across = torch.meshgrid(torch.arange(160.0), torch.arange(181.0), indexing="ij")

    def wave(x, y):
        phases = 2 * math.pi * (0.21 * (across - x) + 0.13 * (down - y))
        return (0.5 + 0.4 * torch.sin(phases))[None, None]

    seen = translated(wave(0.0, 0.0).double(), (x, y))
    middle = (..., slice(60, 100), slice(70, 110))
    torch.testing.assert_close(seen[middle], wave(x, y).double()[middle], rtol=0, atol=0.005)
