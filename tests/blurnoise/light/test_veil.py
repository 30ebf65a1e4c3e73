"""Veiling glare: halos against a kernel in space, the sum of light, bits, gradients, the plan and every capture."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from exposed_frames import budget, raw_frames
from scipy.signal import fftconvolve

from blurnoise import Camera
from blurnoise.camera.captures import Capture
from blurnoise.light import effects
from blurnoise.light.resolved import Resolved
from blurnoise.light.veil import INNER_PX, OUTER_PX, VEIL, scattered, transfer

CAMERA = Camera.preset("imx250").with_figures(width_px=86, height_px=60)
LIT: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 50.0}


def at(camera):
    return Resolved(camera, *[torch.zeros(1)] * 3, torch.zeros(1, 2))


def picture(size=(61, 87), kind=torch.float64, batch=1):
    return torch.rand(batch, 3, *size, generator=torch.Generator().manual_seed(4), dtype=torch.float64).to(
        kind
    )


def lamp(size, place, kind=torch.float64):
    light = torch.zeros(1, 1, *size, dtype=kind)
    light[..., place[0], place[1]] = 1.0
    return light


def spread(r, inner=INNER_PX, outer=OUTER_PX):
    """K in space: 1/r^2 between two radii, by its closed form."""
    squared = np.maximum(r, 1e-6) ** 2
    shell = np.exp(-squared / outer**2) - np.exp(-squared / inner**2)
    return shell / (2 * np.pi * np.log(outer / inner) * squared)


def by_kernel(light, share, reach, radii=(INNER_PX, OUTER_PX)):
    """The halos of a plane (H, W) by brute force: convolved with K over as many mirror images as it reaches."""
    far = np.arange(-reach, reach + 1)
    kernel = spread(np.hypot(far[:, None], far), *radii)
    wide = np.pad(light, reach, mode="symmetric")
    return (1 - share) * light + share * fftconvolve(wide, kernel, mode="valid")


@pytest.mark.parametrize(
    ("size", "place"),
    [((91, 120), (40, 51)), ((91, 120), (0, 119)), ((37, 53), (5, 50)), ((2, 1), (1, 0))],
)
def test_halos_are_those_of_the_kernel_in_space(size, place):
    """In the middle, in a corner, in pictures that are smaller than the halo: within 0.1 % of the light around."""
    light = lamp(size, place)
    seen = scattered(light, 0.0, 0.1)[0, 0].numpy()
    expected = by_kernel(
        light[0, 0].numpy(), 0.1, reach=900
    )  # beyond, exp(-900^2 / 256^2) = 4e-6 of the share
    around = expected != expected[place]
    np.testing.assert_allclose(seen[around], expected[around], rtol=1e-3)
    assert seen[place] == pytest.approx(expected[place], rel=1e-3)


def test_halos_have_the_same_light_in_every_octave():
    """From 8 to 64 px, off the soft ends; of six octaves each has a sixth."""
    y, x = np.indices((1025, 1025)) - 512
    halo = scattered(lamp((1025, 1025), (512, 512)), 0.0, 0.5)[0, 0].numpy() / 0.5
    r = np.hypot(x, y)
    shares = [halo[(r >= low) & (r < 2 * low)].sum() for low in (8, 16, 32)]
    assert shares == pytest.approx([1 / 6] * 3, rel=0.04)


@pytest.mark.parametrize("period_px", [8, 20, 160])
def test_a_wave_keeps_what_the_transfer_function_says(period_px):
    x = torch.arange(320, dtype=torch.float64) + 0.5
    wave = 0.5 + 0.5 * torch.cos(2 * torch.pi * x / period_px).expand(1, 1, 9, 320)
    seen = scattered(wave, 0.02, 0.1)
    kept = 1 - 0.12 + 0.1 * float(transfer(np.array(1 / period_px)))
    torch.testing.assert_close(seen - 0.5, kept * (wave - 0.5), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 5), (61, 87), (300, 257)])
@pytest.mark.parametrize("shares", [(0.1, 0.0), (0.0, 0.3), (0.05, 0.2)])
def test_all_light_is_kept(size, shares):
    """Of lamps in the corner and in the last row, in single precision; an even picture stays as it is."""
    light = lamp(size, (0, 0), torch.float32) * 1e4 + lamp(size, (-1, size[1] // 2), torch.float32) * 300
    light += 0.05
    total = float(light.sum(dtype=torch.float64))
    assert float(scattered(light, *shares).sum(dtype=torch.float64)) == pytest.approx(total, rel=1e-5)
    even = torch.full((1, 3, *size), 0.3)
    torch.testing.assert_close(scattered(even, *shares), even)


def test_an_even_veil_around_a_lamp():
    """640 x 640 px of 0.05 with one pixel of 1e4: the mean is 0.074414, of which every pixel gets 1 %."""
    light = torch.full((1, 1, 640, 640), 0.05)
    light[..., 200, 411] = 1e4
    seen = scattered(light, 0.01, 0.0)
    around = torch.ones_like(light, dtype=torch.bool)
    around[..., 200, 411] = False
    assert float((seen[around] - 0.050244).abs().max()) < 1e-6
    with_halo = scattered(light, 0.01, 0.02)
    assert float(with_halo.sum(dtype=torch.float64)) == pytest.approx(
        float(light.sum(dtype=torch.float64)), rel=5e-4
    )
    assert float(with_halo.min()) > 0.0485  # a lamp takes no light from what is around it


def test_a_black_patch_reads_the_veil_and_half_of_the_halos():
    """As ISO 9358: from beyond 24 px come (E1(24^2 / b^2) - E1(24^2 / a^2)) / (2 ln(b / a)) = 1/2."""
    y, x = np.indices((201, 201)) - 100
    field = torch.from_numpy((np.hypot(x, y) > 24).astype(float))[None, None]
    veil = 0.01 * float(field.mean())
    read = float(scattered(field, 0.01, 0.2)[..., 100, 100])
    assert read == pytest.approx(
        veil + 0.2 * 0.5, rel=0.03
    )  # the patch has further images in the mirror: 1 % each


@pytest.mark.parametrize(("per_px", "within", "stays"), [(0.25, 2.0, 1 / 6), (1.2, 4.8, 0.0)])
def test_halos_are_in_px_of_the_sensor(per_px, within, stays):
    """In a picture of another size than the sensor's; of six octaves the one within 2 px stays where it is."""
    light = lamp((41, 53), (20, 11))
    seen = scattered(light, 0.0, 0.1, per_px)[0, 0].numpy()
    outer = OUTER_PX * per_px
    expected = by_kernel(
        light[0, 0].numpy(), 0.1 * (1 - stays), reach=round(2.8 * outer), radii=(within, outer)
    )
    np.testing.assert_allclose(seen, expected, rtol=2e-3)


def test_the_sensor_sets_the_scale_in_the_chain():
    camera = CAMERA.with_figures(halo_share=0.1, width_px=174, height_px=122)  # twice the picture
    light = picture()
    assert torch.equal(effects.through(light, at(camera)), scattered(light, 0.0, 0.1, 0.5))


def test_bits_depend_neither_on_the_batch_nor_on_threads():
    light = picture((131, 257), torch.float32, batch=3)
    every = scattered(light, 0.01, 0.05)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(3)
        assert torch.equal(scattered(light.repeat(3, 1, 1, 1), 0.01, 0.05), every.repeat(3, 1, 1, 1))
    finally:
        torch.set_num_threads(before)
    assert torch.equal(scattered(light[1:2], 0.01, 0.05), every[1:2])
    assert torch.equal(scattered(light[:, 2:], 0.01, 0.05), every[:, 2:])


def test_gradients_are_those_of_finite_differences():
    light = picture((5, 7)).requires_grad_()
    assert torch.autograd.gradcheck(lambda seen: scattered(seen, 0.1, 0.3), light)
    assert torch.autograd.gradgradcheck(lambda seen: scattered(seen, 0.1, 0.3).square(), light)


@pytest.mark.parametrize("shares", [(0.04, 0.0), (0.0, 0.04), (0.1, 0.3)])
def test_no_picture_changes_by_more_than_the_bound(shares):
    """Noise, and half of the picture black: the even veil reaches the bound, which the plan has."""
    camera = CAMERA.with_figures(veil_share=shares[0], halo_share=shares[1])
    halves = torch.zeros(1, 3, 60, 86, dtype=torch.float64)
    halves[..., 43:] = 1.0
    found = [float((effects.through(x, at(camera)) - x).square().mean().sqrt()) for x in (picture(), halves)]
    bound = VEIL.bound(replace(Resolved(camera, 0.01, 25.0, 1000.0), size=(60, 86)))
    assert bound == pytest.approx(sum(shares) / 2)
    assert max(found) <= bound * (1 + 1e-9)
    if not shares[1]:
        assert max(found) == pytest.approx(bound)
    told = {each.name: each for each in budget(camera, **LIT).stages}["veiling glare"]
    assert told.kept


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_without_shares_the_light_itself_comes_back(fidelity):
    light = picture()
    assert effects.through(light, at(CAMERA)) is light
    assert VEIL.idle(CAMERA)
    small = CAMERA.with_figures(veil_share=1e-7)
    told = {each.name: each for each in budget(small, **LIT).stages}["veiling glare"]
    assert (told.kept, told.how) == (False, "left out: within the tolerance")


def test_it_follows_the_blurs_in_one_transform():
    """Between defocus and motion it would part them; it commutes with both."""
    names = [effect.name for effect in effects.EFFECTS]
    assert names.index("rolling shutter") + 1 == names.index("veiling glare") == names.index("vignetting") - 1


@pytest.mark.parametrize("rows", [{}, {"shutter": "rolling", "row_time_s": 2e-5}])
def test_what_moves_and_is_out_of_focus_is_scattered_after_it(rows):
    """Also with rows that are exposed in turn: the same as scattering what they have seen."""
    camera = CAMERA.with_figures(defocus_radius_px=1.5, **rows)
    moved = replace(at(camera), exposure_s=torch.tensor([0.01]), displacement_px=torch.tensor([[6.0, -2.0]]))
    scattering = replace(moved, camera=camera.with_figures(veil_share=0.01, halo_share=0.05))
    light = picture((60, 86))
    expected = scattered(effects.through(light, moved), 0.01, 0.05)
    assert torch.equal(effects.through(light, scattering), expected)
    assert not torch.equal(effects.through(light, moved), light)


def test_every_capture_has_it():
    """Of a lamp in the picture, dark pixels get 2 % of the mean light, whatever the capture's time."""
    light = torch.zeros(1, 1, 60, 86, dtype=torch.float64)
    light[..., 10:14, 10:14] = 50.0
    mean = torch.full_like(light, 0.02 * float(light.mean()))
    captures = [Capture(), Capture(exposure_ratio=4.0)]
    given: dict[str, Any] = {"noise": False, "quantised": False, **LIT}
    seen = raw_frames(light, CAMERA.with_figures(veil_share=0.02), captures, **given)
    expected = raw_frames(mean, CAMERA, captures, **given)
    for dn, of_mean in zip(seen, expected, strict=True):
        assert float(dn[..., 40, 60]) == pytest.approx(float(of_mean[..., 40, 60]), rel=1e-6)
        assert float(of_mean.mean()) > CAMERA.sensor.black_level_dn + 0.5


def test_exposures_share_light_only_under_the_same_glare():
    one = Resolved(CAMERA.with_figures(halo_share=0.1), 0.01, 25.0, 1000.0)
    other = replace(one, camera=CAMERA.with_figures(halo_share=0.2))
    assert effects.key(one) == effects.key(replace(one, white_e=5.0))
    assert effects.key(one) != effects.key(other)
