"""Blur on pictures: identity, flux, centroid, symmetry, borders, closed forms, two routes to one answer."""

from __future__ import annotations

import math
import random

import cv2
import numpy as np
import pytest
import torch
from blurs import optical_blur
from hypothesis import example, given, settings
from hypothesis import strategies as st

from blurnoise import Camera, defocus, motion_blur, simulate
from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise.blur.convolution import NEGLIGIBLE, Method, disc, exposure_blur
from blurnoise.optics.transfer import Optics, motion_error

MOTIONS = st.tuples(st.floats(-30, 30), st.floats(-30, 30))
OURS: tuple[Method, ...] = ("transfer", "tiles")
EDGES = (0.0, 1e-6, 0.3, 0.999, 1.0, 1.001, 2.0, 700.0)
TAIL = 1e-3  # of white, at most; 1e-4 RMS: what a margin of 8 px leaves of the tails in white noise


def noise(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(1), dtype=dtype)


def polar(length: float, angle_deg: float) -> tuple[float, float]:
    return length * math.cos(math.radians(angle_deg)), length * math.sin(math.radians(angle_deg))


def blob(height: int = 101, width: int = 115, sigma: float = 2.0) -> tuple[torch.Tensor, ...]:
    """A Gaussian spot, which pixels hold without aliasing, and its coordinates from the centre."""
    y = torch.arange(height, dtype=torch.float64)[:, None] - height // 2
    x = torch.arange(width, dtype=torch.float64) - width // 2
    spot = torch.exp(-(x * x + y * y) / (2 * sigma**2)) / (2 * math.pi * sigma**2)
    return spot[None, None], y, x


def test_no_motion_is_the_picture_itself() -> None:
    image = noise(2, 3, 5, 7)
    assert motion_blur(image, (0.0, 0.0)) is image
    assert motion_blur(image, (1e-6, 0.0)) is image
    assert motion_blur(image, (9.0, 4.0), method="none") is image
    assert optical_blur(image, Optics()) is image
    assert defocus(image, 0.0) is image
    assert defocus(image, 0.5) is image


@settings(max_examples=40, deadline=None)
@given(MOTIONS, st.sampled_from(OURS))
@example((0.0, 0.3), "transfer")
@example((-30.0, 0.0009), "transfer")
@example((21.213203, 21.213204), "tiles")
def test_flux_centroid_and_spread_of_a_spot(motion: tuple[float, float], method: Method) -> None:
    """A spot is stretched along the line itself: sum and centroid kept, covariance + d d^T / 12, every sign."""
    spot, y, x = blob()
    blurred = motion_blur(spot, motion, method=method)[0, 0]
    assert float(blurred.sum()) == pytest.approx(1, abs=1e-6)
    assert float((blurred * x).sum()) == pytest.approx(0, abs=1e-5)
    assert float((blurred * y).sum()) == pytest.approx(0, abs=1e-5)
    assert float((blurred * x * x).sum()) == pytest.approx(4 + motion[0] ** 2 / 12, abs=5e-4)
    assert float((blurred * y * y).sum()) == pytest.approx(4 + motion[1] ** 2 / 12, abs=5e-4)
    assert float((blurred * x * y).sum()) == pytest.approx(motion[0] * motion[1] / 12, abs=5e-4)


@pytest.mark.parametrize("angle_deg", [0, 17, 45, 73, 90, 163])
@pytest.mark.parametrize("length", [1.5, 3.0, 6.0, 10.4, 25.0, 60.0])
def test_gratings_are_attenuated_by_the_sinc(length: float, angle_deg: float) -> None:
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


@pytest.mark.parametrize("angle_deg", range(0, 360, 45))
def test_nothing_jumps_at_multiples_of_45_degrees(angle_deg: int) -> None:
    image = noise(1, 1, 40, 52)
    at, beside = (motion_blur(image, polar(11.3, angle_deg + by)) for by in (0.0, 1e-6))
    torch.testing.assert_close(at, beside, atol=TAIL, rtol=0)


@settings(max_examples=25, deadline=None)
@given(MOTIONS, st.sampled_from(["reflect", "replicate", "circular"]), st.sampled_from([*OURS, "kornia"]))
def test_constant_pictures_stay_constant(motion: tuple[float, float], border: Border, method: Method) -> None:
    image = torch.full((1, 2, 9, 13), 0.37, dtype=torch.float64)
    blurred = motion_blur(image, motion, border=border, method=method)
    torch.testing.assert_close(blurred, image, atol=1e-6 if method == "kornia" else 1e-12, rtol=0)
    torch.testing.assert_close(defocus(image, 3.3, border=border), image, atol=1e-12, rtol=0)
    lens = optical_blur(image, Optics(2.0, 0.5, 0.4), border=border)
    torch.testing.assert_close(lens, image, atol=1e-12, rtol=0)


def test_black_border_darkens_the_edge() -> None:
    image = torch.ones(1, 1, 9, 21)
    blurred = motion_blur(image, (8.0, 0.0), border="constant")
    assert float(blurred[0, 0, 4, 0]) == pytest.approx(0.5, abs=0.07)
    assert float(blurred[0, 0, 4, 10]) == pytest.approx(1, abs=0.01)


@settings(max_examples=20, deadline=None)
@given(MOTIONS, st.sampled_from(["transfer", "tiles"]))
def test_quarter_turns_commute_and_motion_has_no_sense(motion: tuple[float, float], method: Method) -> None:
    """Turning picture and motion turns the result; to and fro are the same blur."""
    image = noise(1, 1, 24, 31)
    x, y = motion

    def blurred(image: torch.Tensor, motion: tuple[float, float], border: Border) -> torch.Tensor:
        return motion_blur(image, motion, method=method, border=border)

    for border, tolerance in (("circular", 1e-10), ("reflect", TAIL)):
        first = blurred(torch.rot90(image, 1, (2, 3)), (y, -x), border)
        last = torch.rot90(blurred(image, (x, y), border), 1, (2, 3))
        torch.testing.assert_close(first, last, atol=tolerance, rtol=0)
    fro, to = blurred(image, (-x, -y), "reflect"), blurred(image, (x, y), "reflect")
    torch.testing.assert_close(fro, to, atol=1e-12, rtol=0)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("motion", [(7.3, 0.0), (0.0, 7.3), (11.0, -6.4), (66.0, 40.0), (0.5, 0.2)])
def test_routes_agree(motion: tuple[float, float], border: Border) -> None:
    """One transform and tiles are two routes to one answer."""
    rough = noise(1, 2, 200, 160)
    whole = motion_blur(rough, motion, method="transfer", border=border)
    tolerance = 3 * TAIL if border != "constant" else 0.01  # the step to black has tails of its own
    tiled = motion_blur(rough, motion, method="tiles", border=border)
    torch.testing.assert_close(tiled, whole, atol=tolerance, rtol=0)


def test_tiles_of_a_large_picture_have_no_seams() -> None:
    image = noise(1, 1, 900, 1100)
    tiled = motion_blur(image, (9.0, 5.0), method="tiles")
    whole = motion_blur(image, (9.0, 5.0), method="transfer")
    assert not torch.equal(tiled, whole)
    torch.testing.assert_close(tiled, whole, atol=TAIL, rtol=0)


@pytest.mark.parametrize("motion", [(12.0, 5.0), (9.0, 0.0), (0.0, -9.0)])
@pytest.mark.parametrize("shape", [(1, 3, 400, 300), (5, 1, 260, 300)])
def test_bits_do_not_depend_on_threads(shape: tuple[int, ...], motion: tuple[float, float]) -> None:
    image = noise(*shape, dtype=torch.float32)
    threads = torch.get_num_threads()
    try:
        results = []
        for count in (1, 2, 5):
            torch.set_num_threads(count)
            results.append(motion_blur(image, motion))
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(results[0], results[1])
    assert torch.equal(results[0], results[2])


@pytest.mark.parametrize("optics", [Optics(), Optics(1.5, 0.4)], ids=["sharp", "lens"])
@pytest.mark.parametrize("motion", [(12.0, 5.0), (9.0, 0.0), (0.0, -9.0), (90.0, 31.0)])
def test_the_fast_route_equals_the_differentiable_one(motion: tuple[float, float], optics: Optics) -> None:
    """OpenCV's packed transform and torch's, NumPy's response and torch's, tiles or not."""
    image = noise(1, 2, 150, 170)
    for method in ("transfer", "tiles"):
        fast = exposure_blur(image, motion, optics, method=method)
        slow = exposure_blur(image.clone().requires_grad_(), motion, optics, method=method).detach()
        torch.testing.assert_close(fast, slow, atol=1e-12, rtol=0)


@pytest.mark.parametrize("count", [1, 33])
def test_items_do_not_depend_on_their_batch(count: int) -> None:
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
    st.sampled_from(EDGES),
    st.floats(-180, 180),
    st.sampled_from([(1, 1), (1, 9), (9, 1), (3, 4), (16, 33)]),
    st.sampled_from(BORDERS),
    st.sampled_from(["auto", *OURS]),
)
def test_every_length_size_and_border(
    length: float, angle_deg: float, size: tuple[int, int], border: Border, method: Method
) -> None:
    """Finite, of the picture's shape, and within the ringing that a transfer function may cause."""
    image = noise(1, 1, *size)
    blurred = motion_blur(image, polar(length, angle_deg), border=border, method=method)
    assert blurred.shape == image.shape
    assert torch.isfinite(blurred).all()
    assert float(blurred.min()) > -0.25
    assert float(blurred.max()) < 1.25


@pytest.mark.parametrize("border", ["reflect", "replicate"])
@pytest.mark.parametrize("motion", [(400.0, 0.0), (35.0, 260.0)])
def test_longer_than_the_picture(motion: tuple[float, float], border: Border) -> None:
    """The short way, by the period of a reflected picture, equals the long way, by continuing it."""
    image = noise(1, 1, 24, 31)
    long_way = motion_blur(extended(image, (230, 230), (484, 491), border), motion, border="constant")
    short_way = motion_blur(image, motion, border=border)
    torch.testing.assert_close(short_way, long_way[..., 230:254, 230:261], atol=3e-3, rtol=0)
    mean = motion_blur(image[..., :1, :], (31 * 60.0, 0.0), border="circular")
    torch.testing.assert_close(mean, image[..., :1, :].mean().expand_as(mean), atol=1e-6, rtol=0)


@pytest.mark.parametrize("angle_deg", [0, 17, 45, 73])
@pytest.mark.parametrize("length", [0.3, 1.5, 6.0, 25.0])
def test_ringing_is_bounded_and_never_reaches_the_counts(length: float, angle_deg: float) -> None:
    """A step between two pixels rings by less than a tenth; in the dark the camera sees no light below 0."""
    image = torch.zeros(1, 1, 64, 64)
    image[..., 20:44, 20:44] = 1.0
    blurred = motion_blur(image, polar(length, angle_deg), method="transfer")
    assert float(blurred.min()) > -0.1
    assert float(blurred.max()) < 1.1
    camera = Camera.preset("imx250")
    velocity = polar(length / 0.01, angle_deg)
    frame = simulate(
        image, camera, exposure_s=0.01, illuminance_lux=50.0, velocity_px_s=velocity, generator=[3]
    )
    assert torch.isfinite(frame).all()
    assert float(frame.min()) >= 0


@pytest.mark.slow
def test_gradients_reach_picture_and_motion() -> None:
    image = noise(1, 1, 9, 11).requires_grad_()
    motion = torch.tensor([2.3, -1.1], dtype=torch.float64, requires_grad=True)
    for method in ("auto", "tiles"):
        assert torch.autograd.gradcheck(
            lambda i, m, method=method: motion_blur(i, m, method=method), (image, motion), atol=1e-5
        )
    several = torch.tensor([[2.3, 0.0], [0.0, 0.4]], dtype=torch.float64, requires_grad=True)
    pair = noise(2, 1, 6, 8).requires_grad_()
    assert torch.autograd.gradcheck(motion_blur, (pair, several), atol=1e-5)


def test_gradient_at_rest_is_zero() -> None:
    """The blur is even in the motion, so at rest its first derivative vanishes; beside it, it does not."""
    image = noise(1, 1, 9, 11)
    still = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    motion_blur(image, still).square().sum().backward()
    torch.testing.assert_close(still.grad, torch.zeros(2, dtype=torch.float64), atol=1e-12, rtol=0)
    moving = torch.tensor([0.01, 0.0], dtype=torch.float64, requires_grad=True)
    motion_blur(image, moving).square().sum().backward()
    assert moving.grad is not None
    assert float(moving.grad[0]) < -1e-3


def test_memory_layout_and_precision_do_not_matter() -> None:
    image = noise(2, 3, 18, 22)
    expected = motion_blur(image, (4.5, 2.0))
    assert torch.equal(motion_blur(image.to(memory_format=torch.channels_last), (4.5, 2.0)), expected)
    view = image.transpose(2, 3).contiguous().transpose(2, 3)
    assert torch.equal(motion_blur(view, (4.5, 0.0)), motion_blur(image, (4.5, 0.0)))
    single = motion_blur(image.float(), (4.5, 2.0))
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), expected, atol=1e-6, rtol=0)


def test_input_and_global_state_stay_as_they_were() -> None:
    image = noise(2, 1, 40, 50, dtype=torch.float32)
    before = image.clone()

    def state() -> tuple[object, ...]:
        threads = (torch.get_num_threads(), cv2.getNumThreads())
        modes = (torch.get_default_dtype(), torch.is_grad_enabled())
        draws = (torch.get_rng_state().sum(), random.getstate()[1][:3])
        return *threads, *modes, *draws

    was = state()
    for method in ("auto", "tiles", "kornia"):
        motion_blur(image, (6.0, 5.0), method=method)
    assert state() == was
    assert torch.equal(image, before)


def test_lens_and_motion_in_one_pass_equal_one_after_the_other() -> None:
    image = noise(2, 2, 48, 61)
    optics = Optics(defocus_radius_px=1.7, gaussian_sigma_px=0.6, diffraction_lambda_n_px=0.5)
    at_once = exposure_blur(image, (9.0, 4.0), optics, border="circular")
    in_turn = motion_blur(optical_blur(image, optics, border="circular"), (9.0, 4.0), border="circular")
    torch.testing.assert_close(at_once, in_turn, atol=2e-3, rtol=0)  # differ within 0.05 of half a cycle only
    assert float((at_once - motion_blur(image, (9.0, 4.0), border="circular")).abs().max()) > 0.02


def test_auto_leaves_out_what_is_not_seen() -> None:
    motions = torch.tensor([[0.005, 0.0], [14.0, 3.0]], dtype=torch.float64)
    assert motion_error(0.005, 0.0) <= NEGLIGIBLE
    image = noise(2, 1, 48, 64)
    assert torch.equal(motion_blur(image, motions)[0], image[0])
    assert torch.equal(motion_blur(image, motions)[1:], motion_blur(image[1:], motions[1], method="tiles"))
    assert not torch.equal(motion_blur(image, (0.0, 0.05)), image)  # 2.6e-4 of white


@settings(max_examples=30, deadline=None)
@given(st.floats(0.001, 0.3), st.floats(0, 180))
def test_predicted_error_of_leaving_out_bounds_the_worst_picture(length: float, angle_deg: float) -> None:
    picture = (noise(1, 1, 64, 64) > 0.5).double()
    motion = polar(length, angle_deg)
    blurred = motion_blur(picture, motion, border="circular", method="transfer")
    changed = float((blurred - picture).square().mean().sqrt())
    assert changed <= 1.1 * motion_error(*motion)


@pytest.mark.parametrize(
    ("image", "motion", "error", "words"),
    [
        (torch.zeros(3, 4, 4), (1.0, 0.0), ValueError, "image"),
        (torch.zeros(1, 3, 4, 4, dtype=torch.uint8), (1.0, 0.0), TypeError, "image"),
        (torch.zeros(1, 3, 4, 4, dtype=torch.float16), (1.0, 0.0), TypeError, "half precision"),
        (torch.full((1, 1, 2, 2), math.nan), (1.0, 0.0), ValueError, "NaN"),
        (torch.zeros(1, 1, 4, 4), (math.inf, 0.0), ValueError, "displacement_px"),
        (torch.zeros(1, 1, 4, 4), (1.0, 2.0, 3.0), ValueError, "displacement_px"),
        (torch.zeros(2, 1, 4, 4), torch.zeros(3, 2), ValueError, "displacement_px"),
        ("picture", (1.0, 0.0), TypeError, "image"),
    ],
)
def test_bad_input_is_named(image: object, motion: object, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        motion_blur(image, motion)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(1, 40), (40, 1)])
def test_a_lens_blurs_pictures_of_one_row(size: tuple[int, int]) -> None:
    """As it does a picture whose rows are all alike."""
    image = noise(1, 1, *size)
    wide = image.expand(1, 1, *(40 if side == 1 else side for side in size)).contiguous()
    seen = exposure_blur(image, (3.0, 2.0), Optics(2.0))
    expected = exposure_blur(wide, (3.0, 2.0), Optics(2.0))[..., : size[0], : size[1]]
    torch.testing.assert_close(seen, expected, atol=TAIL, rtol=0)
    assert float((seen - image).abs().max()) > 0.1


def test_bad_border_and_radius() -> None:
    with pytest.raises(ValueError, match="border"):
        motion_blur(torch.zeros(1, 1, 4, 4), (1.0, 0.0), border="mirror")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="radius_px"):
        defocus(torch.zeros(1, 1, 4, 4), -1.0)
    with pytest.raises(ValueError, match="method"):
        motion_blur(torch.zeros(1, 1, 4, 4), (1.0, 0.0), method="fft")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="knows motion only"):
        exposure_blur(torch.zeros(1, 1, 4, 4), (1.0, 0.0), Optics(1.0), method="kornia")
    with pytest.raises(ValueError, match=r"displacement_px.*plane of"):
        motion_blur(torch.zeros(1, 1, 4, 4), (1e5, 1e5), border="replicate")
    with pytest.raises(ValueError, match=r"displacement_px.*<= 100000"):
        motion_blur(torch.zeros(1, 1, 4, 4), (1e17, 0.0))
    with pytest.raises(ValueError, match=r"displacement_px.*at most 2000 px"):
        motion_blur(torch.zeros(1, 1, 4, 4), (1e4, 0.0), method="kornia")


def test_disc_equals_matlabs_fspecial() -> None:
    """fspecial('disk', 1): centre 1/pi, side (sqrt(3)/4 + pi/6 - 1/2)/pi, corner 0.0250785810238330."""
    kernel = disc(1.0)
    side = (math.sqrt(3) / 4 + math.pi / 6 - 0.5) / math.pi
    expected = [[0.0250785810238330, side, 0.0250785810238330], [side, 1 / math.pi, side]]
    np.testing.assert_allclose(kernel[:2], expected, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 12.0))
def test_disc_is_a_disc(radius: float) -> None:
    """Unit sum, symmetric, and the pixel areas match a fine grid of points to the grid's own error."""
    kernel = disc(radius)
    assert kernel.shape[0] == kernel.shape[1]
    assert kernel.shape[0] % 2 == 1
    assert kernel.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(kernel, kernel.T, atol=1e-13)
    np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-13)
    assert kernel.min() > -1e-13
    if radius > 0.5:
        fine = (np.arange(kernel.shape[0] * 64) + 0.5) / 64 - kernel.shape[0] / 2
        inside = (fine[:, None] ** 2 + fine**2 <= radius**2).astype(float)
        areas = inside.reshape(kernel.shape[0], 64, -1, 64).mean(axis=(1, 3)) / (math.pi * radius**2)
        np.testing.assert_allclose(kernel, areas, atol=0.02 / (math.pi * radius**2))
