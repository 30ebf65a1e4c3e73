"""Blur on pictures: flux, centroid, borders, closed forms, two routes to one answer; transfer functions."""

import math
import random

import cv2
import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from blurnoise import motion_blur
from blurnoise._core.borders import BORDERS, extended
from blurnoise.blur.convolution import NEGLIGIBLE, Method, exposure_blur
from blurnoise.camera import transfer
from blurnoise.camera.transfer import Optics, motion_error

MOTIONS = st.tuples(st.floats(-30, 30), st.floats(-30, 30))
OURS: tuple[Method, ...] = ("transfer", "tiles")
TAIL = 1e-3  # of white, at most; 1e-4 RMS: what a margin of 8 px leaves of the tails in white noise


def optical_blur(image, optics, *, border="reflect"):
    """Blur by the lens."""
    return exposure_blur(image, (0.0, 0.0), optics, border=border)


def noise(*shape, dtype=torch.float64):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(1), dtype=dtype)


def polar(length, angle_deg):
    return length * math.cos(math.radians(angle_deg)), length * math.sin(math.radians(angle_deg))


def blob(height=101, width=115, sigma=2.0):
    """A Gaussian spot, which pixels hold without aliasing, and its coordinates from the centre."""
    y = torch.arange(height, dtype=torch.float64)[:, None] - height // 2
    x = torch.arange(width, dtype=torch.float64) - width // 2
    spot = torch.exp(-(x * x + y * y) / (2 * sigma**2)) / (2 * math.pi * sigma**2)
    return spot[None, None], y, x


def test_no_motion_is_the_picture_itself():
    image = noise(2, 3, 5, 7)
    assert motion_blur(image, (0.0, 0.0)) is image
    assert motion_blur(image, (1e-6, 0.0)) is image
    assert motion_blur(image, (9.0, 4.0), method="none") is image
    assert optical_blur(image, Optics()) is image


@settings(max_examples=40, deadline=None)
@given(MOTIONS, st.sampled_from(OURS))
@example((0.0, 0.3), "transfer")
@example((-30.0, 0.0009), "transfer")
@example((21.213203, 21.213204), "tiles")
def test_flux_centroid_and_spread_of_a_spot(motion, method):
    """A spot is stretched along the line itself: sum and centroid kept, covariance + d d^T / 12, every sign."""
    spot, y, x = blob()
    blurred = motion_blur(spot, motion, method=method)[0, 0]
    assert float(blurred.sum()) == pytest.approx(1, abs=1e-6)
    assert float((blurred * x).sum()) == pytest.approx(0, abs=1e-5)
    assert float((blurred * y).sum()) == pytest.approx(0, abs=1e-5)
    assert float((blurred * x * x).sum()) == pytest.approx(4 + motion[0] ** 2 / 12, abs=5e-4)
    assert float((blurred * y * y).sum()) == pytest.approx(4 + motion[1] ** 2 / 12, abs=5e-4)
    assert float((blurred * x * y).sum()) == pytest.approx(motion[0] * motion[1] / 12, abs=5e-4)


@pytest.mark.parametrize("angle_deg", [0, 17, 45, 73, 163])
@pytest.mark.parametrize("length", [1.5, 10.4, 60.0])
def test_gratings_are_attenuated_by_the_sinc(length, angle_deg):
    """Any grating at or near MTF50 keeps sinc(L f cos phi) of its amplitude: MTF50 is exact at any angle."""
    height, width = 240, 300
    motion = polar(length, angle_deg)
    f = 0.603355 / length
    fx, fy = (round(f * c * n) / n for c, n in zip(polar(1.0, angle_deg), (width, height), strict=True))
    y, x = torch.meshgrid(torch.arange(height).double(), torch.arange(width).double(), indexing="ij")
    wave = torch.cos(2 * math.pi * (fx * x + fy * y))[None, None]
    blurred = motion_blur(wave, motion, border="circular", method="transfer")
    expected = np.sinc(fx * motion[0] + fy * motion[1])
    assert expected == pytest.approx(0.5, abs=0.2)
    torch.testing.assert_close(blurred, expected * wave, atol=1e-9, rtol=0)
    near = motion_blur(wave, (motion[0] * 1.005, motion[1] * 1.005), border="circular", method="transfer")
    assert float((near - expected * wave).abs().max()) > 1e-3  # half a per cent of length would be seen


@settings(max_examples=25, deadline=None)
@given(MOTIONS, st.sampled_from(["reflect", "replicate", "circular"]), st.sampled_from([*OURS, "kornia"]))
def test_constant_pictures_stay_constant(motion, border, method):
    image = torch.full((1, 2, 9, 13), 0.37, dtype=torch.float64)
    blurred = motion_blur(image, motion, border=border, method=method)
    torch.testing.assert_close(blurred, image, atol=1e-6 if method == "kornia" else 1e-12, rtol=0)
    lens = optical_blur(image, Optics(2.0, 0.5, 0.4), border=border)
    torch.testing.assert_close(lens, image, atol=1e-12, rtol=0)


@pytest.mark.parametrize("border", ["reflect", "replicate", "constant"])
@pytest.mark.parametrize("motion", [(11.0, -6.4), (66.0, 40.0)])
def test_one_transform_and_tiles_agree(motion, border):
    rough = noise(1, 1, 300, 400)
    whole, tiled = (motion_blur(rough, motion, method=method, border=border) for method in OURS)
    assert not torch.equal(tiled, whole)
    tolerance = 3 * TAIL if border != "constant" else 0.01  # the step to black has tails of its own
    torch.testing.assert_close(tiled, whole, atol=tolerance, rtol=0)


@pytest.mark.parametrize("shape", [(1, 3, 400, 300), (5, 1, 260, 300)])
def test_bits_do_not_depend_on_threads(shape):
    image, threads, results = noise(*shape, dtype=torch.float32), torch.get_num_threads(), []
    try:
        for count in (1, 2, 5):
            torch.set_num_threads(count)
            results.append(torch.cat([motion_blur(image, motion) for motion in ((12.0, 5.0), (0.0, -9.0))]))
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(results[0], results[1])
    assert torch.equal(results[0], results[2])


@pytest.mark.parametrize("optics", [Optics(), Optics(1.5, 0.4)], ids=["sharp", "lens"])
@pytest.mark.parametrize("motion", [(12.0, 5.0), (9.0, 0.0), (0.0, -9.0), (90.0, 31.0)])
def test_the_fast_route_equals_the_differentiable_one(motion, optics):
    """OpenCV's packed transform and torch's, NumPy's response and torch's, tiles or not."""
    image = noise(1, 1, 300, 340)
    for method in ("transfer", "tiles"):
        fast = exposure_blur(image, motion, optics, method=method)
        slow = exposure_blur(image.clone().requires_grad_(), motion, optics, method=method).detach()
        torch.testing.assert_close(fast, slow, atol=1e-12, rtol=0)


@pytest.mark.parametrize("count", [1, 33])
def test_items_do_not_depend_on_their_batch(count):
    images = noise(count, 2, 17, 23, dtype=torch.float32)
    generator = torch.Generator().manual_seed(4)
    motions = 40 * torch.rand(count, 2, generator=generator) - 20
    motions[0] = 0
    together = motion_blur(images, motions)
    for index in range(count):
        alone = motion_blur(images[index : index + 1], motions[index])
        assert torch.equal(together[index : index + 1], alone)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from((0.0, 1e-6, 0.3, 0.999, 1.0, 1.001, 2.0, 700.0)),
    st.floats(-180, 180),
    st.sampled_from([(1, 1), (1, 9), (9, 1), (3, 4), (16, 33)]),
    st.sampled_from(BORDERS),
    st.sampled_from(["auto", *OURS]),
)
def test_every_length_size_and_border(length, angle_deg, size, border, method):
    """Finite, of the picture's shape, and within the ringing that a transfer function may cause."""
    image = noise(1, 1, *size)
    blurred = motion_blur(image, polar(length, angle_deg), border=border, method=method)
    assert blurred.shape == image.shape
    assert -0.25 < float(blurred.min()) <= float(blurred.max()) < 1.25


@pytest.mark.parametrize("border", ["reflect", "replicate"])
@pytest.mark.parametrize("motion", [(400.0, 0.0), (35.0, 260.0)])
def test_longer_than_the_picture(motion, border):
    """The short way, by the period of a reflected picture, equals the long way, by continuing it."""
    image = noise(1, 1, 24, 31)
    long_way = motion_blur(extended(image, (230, 230), (484, 491), border), motion, border="constant")
    short_way = motion_blur(image, motion, border=border)
    torch.testing.assert_close(short_way, long_way[..., 230:254, 230:261], atol=3e-3, rtol=0)
    mean = motion_blur(image[..., :1, :], (31 * 60.0, 0.0), border="circular")
    torch.testing.assert_close(mean, image[..., :1, :].mean().expand_as(mean), atol=1e-6, rtol=0)


def test_gradient_at_rest_is_zero():
    """The blur is even in the motion, so at rest its first derivative vanishes; beside it, it does not."""
    found = []
    for at in (0.0, 0.01):
        motion = torch.tensor([at, 0.0], dtype=torch.float64, requires_grad=True)
        loss = motion_blur(noise(1, 1, 9, 11), motion).square().sum()
        found.append(float(torch.autograd.grad(loss, motion)[0][0]))
    assert found[0] == pytest.approx(0, abs=1e-12)
    assert found[1] < -1e-3


def test_input_and_global_state_stay_as_they_were():
    image = noise(2, 1, 40, 50, dtype=torch.float32)
    before = image.clone()

    def state():
        modes = (
            torch.get_num_threads(),
            cv2.getNumThreads(),
            torch.get_default_dtype(),
            torch.is_grad_enabled(),
        )
        return *modes, torch.get_rng_state().sum(), random.getstate()[1][:3]

    was = state()
    for method in ("auto", "tiles", "kornia"):
        motion_blur(image, (6.0, 5.0), method=method)
    assert state() == was
    assert torch.equal(image, before)


def test_auto_leaves_out_what_is_not_seen():
    motions = torch.tensor([[0.005, 0.0], [14.0, 3.0]], dtype=torch.float64)
    assert motion_error(0.005, 0.0) <= NEGLIGIBLE
    image = noise(2, 1, 48, 64)
    assert torch.equal(motion_blur(image, motions)[0], image[0])
    assert torch.equal(motion_blur(image, motions)[1:], motion_blur(image[1:], motions[1], method="tiles"))
    assert not torch.equal(motion_blur(image, (0.0, 0.05)), image)  # 2.6e-4 of white


@settings(max_examples=20, deadline=None)
@given(*[st.floats(0, 0.05)] * 3, st.floats(0.001, 0.3), st.floats(0, 180))
def test_predicted_errors_of_leaving_out_are_those_of_the_worst_picture(
    radius, sigma, lambda_n, length, angle_deg
):
    """A checkerboard, all of whose contrast is at the corner of the band, where motion joins its alias."""
    board = (torch.arange(64)[:, None].add(torch.arange(64)) % 2).double()[None, None]
    optics, motion = Optics(radius, sigma, lambda_n), polar(length, angle_deg)
    lens, moved = (
        float((blurred - board).square().mean().sqrt())
        for blurred in (
            optical_blur(board, optics, border="circular"),
            motion_blur(board, motion, border="circular", method="transfer"),
        )
    )
    assert lens <= 1.01 * optics.error + 1e-12
    joined = [motion_error(motion[0] + sign * motion[1], 0.0) for sign in (1, -1)]
    assert moved == pytest.approx(sum(joined) / 2, rel=0.05)
    assert moved <= motion_error(*motion)


DARK = torch.zeros(1, 1, 4, 4)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: motion_blur(DARK, (1e5, 1e5), border="replicate"), r"displacement_px.*plane of"),
        (lambda: motion_blur(DARK, (1e17, 0.0)), "displacement_px.*<= 100000"),
        (lambda: motion_blur(DARK, (1e4, 0.0), method="kornia"), "displacement_px.*at most 2000 px"),
        (lambda: exposure_blur(DARK, (1.0, 0.0), Optics(1.0), method="kornia"), "supports only motion"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises((TypeError, ValueError), match=words):
        call()


def crossing(curve, level, high):
    def above(f):
        return float(curve(torch.tensor([[f]], dtype=torch.float64))) - level

    return float(brentq(above, 1e-6, high))


def box(length_px):
    displacement = torch.tensor([length_px, 0.0], dtype=torch.float64)
    return lambda f: transfer.motion(f, torch.zeros_like(f), displacement)


@pytest.mark.parametrize(
    ("curve", "level", "expected"),
    [
        (box(7.0), 0.5, 0.603355 / 7),
        (box(7.0), 0.2, 0.826250 / 7),
        (box(7.0), 0.1, 0.907929 / 7),
        (lambda f: transfer.disc(f, 3.0), 0.5, 0.352542 / 3),
        (lambda f: transfer.disc(f, 3.0), 0.0, 0.609835 / 3),
        (lambda f: transfer.gaussian(f, 1.5), 0.5, 0.187391 / 1.5),
        (lambda f: transfer.diffraction(f, 4.0), 0.5, 0.403973 / 4),
        (lambda f: transfer.pixel(f, torch.zeros_like(f)) * box(1.0)(f), 0.5, 0.44295),
        (lambda f: transfer.pixel(f, torch.zeros_like(f)) * box(3.0)(f), 0.5, 0.19321),
        (lambda f: transfer.pixel(f, torch.zeros_like(f)) * box(30.0)(f), 0.5, 0.02010),
    ],
)
def test_published_crossings(curve, level, expected):
    """The digits of the table in the field's terms: MTF50, MTF20, MTF10, first zero, in cycles/px."""
    high = 1.01 * expected if level == 0 else 1.4 * expected
    assert crossing(curve, level, high) == pytest.approx(expected, rel=2e-4 if expected < 0.5 else 2e-5)


def test_optical_blur_counts_the_pixel_once():
    """R = 1: MTF50 0.3122 cycles/px over pixel and disc, not 0.2682 with the pixel counted twice."""
    width = 512
    x = torch.arange(width, dtype=torch.float64)
    f = round(0.3122 * width) / width
    wave = torch.cos(2 * math.pi * f * x).expand(1, 1, 4, width)
    blurred = optical_blur(wave, Optics(defocus_radius_px=1.0), border="circular")
    amplitude = float((blurred[0, 0, 0] * wave[0, 0, 0]).mean() * 2)
    pixel = math.sin(math.pi * f) / (math.pi * f)
    assert amplitude * pixel == pytest.approx(0.5, abs=0.002)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (5, 7)])
def test_opencv_and_torch_continue_a_picture_alike(border, size):
    image = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(0))
    spans = (size[0] + 43, size[1] + 37)
    fast = extended(image, (20, 11), spans, border)
    slow = extended(image.clone().requires_grad_(), (20, 11), spans, border).detach()
    assert torch.equal(fast, slow)
    assert torch.equal(fast[..., 20 : 20 + size[0], 11 : 11 + size[1]], image)


def test_reflection_leaves_the_outermost_pixel_single():
    row = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    assert extended(row, (0, 3), (1, 9), "reflect").flatten().tolist() == [2, 3, 2, 1, 2, 3, 2, 1, 2]
    assert extended(row, (0, 1), (1, 5), "constant").flatten().tolist() == [0, 1, 2, 3, 0]
    assert extended(row, (0, 4), (1, 8), "circular").flatten().tolist() == [3, 1, 2, 3, 1, 2, 3, 1]
