"""Blur on pictures: identity, flux, centroid, symmetry, borders, two routes to one answer."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from blurnoise import defocus, motion_blur

MOTIONS = st.tuples(st.floats(-30, 30), st.floats(-30, 30))


def noise(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(1), dtype=dtype)


def point(height: int = 61, width: int = 75) -> torch.Tensor:
    image = torch.zeros(1, 1, height, width, dtype=torch.float64)
    image[..., height // 2, width // 2] = 1
    return image


def test_no_motion_is_the_picture_itself() -> None:
    image = noise(2, 3, 5, 7)
    assert motion_blur(image, (0.0, 0.0)) is image
    assert defocus(image, 0.0) is image
    assert defocus(image, 0.5) is image


@settings(max_examples=40, deadline=None)
@given(MOTIONS)
def test_flux_centroid_and_spread_of_a_point(motion: tuple[float, float]) -> None:
    """A point becomes the line itself: sum 1, centroid kept to 1e-9 px, variance d^2/12 per axis."""
    blurred = motion_blur(point(), motion)[0, 0]
    y = torch.arange(61, dtype=torch.float64) - 30
    x = torch.arange(75, dtype=torch.float64) - 37
    across, down = blurred.sum(0), blurred.sum(1)
    assert float(blurred.sum()) == pytest.approx(1, abs=1e-9)
    assert float(across @ x) == pytest.approx(0, abs=1e-9)
    assert float(down @ y) == pytest.approx(0, abs=1e-9)
    assert float(across @ x**2) == pytest.approx(motion[0] ** 2 / 12, abs=1e-8)
    assert float(down @ y**2) == pytest.approx(motion[1] ** 2 / 12, abs=1e-8)


@pytest.mark.parametrize("angle_deg", [20, 110, 200, 290])
def test_direction_in_every_quadrant(angle_deg: float) -> None:
    """x right, y down: the blurred point is stretched along the displacement, not its mirror image."""
    motion = (20 * math.cos(math.radians(angle_deg)), 20 * math.sin(math.radians(angle_deg)))
    blurred = motion_blur(point(), motion)[0, 0]
    y, x = torch.meshgrid(torch.arange(61.0) - 30, torch.arange(75.0) - 37, indexing="ij")
    covariance = float((blurred * x.double() * y.double()).sum())
    assert covariance == pytest.approx(motion[0] * motion[1] / 12, rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(MOTIONS, st.sampled_from(["reflect", "replicate", "circular"]))
def test_constant_pictures_stay_constant(motion: tuple[float, float], border: str) -> None:
    image = torch.full((1, 2, 9, 13), 0.37, dtype=torch.float64)
    torch.testing.assert_close(motion_blur(image, motion, border=border), image, atol=1e-12, rtol=0)
    torch.testing.assert_close(defocus(image, 3.3, border=border), image, atol=1e-12, rtol=0)


def test_black_border_darkens_the_edge() -> None:
    image = torch.ones(1, 1, 9, 21)
    blurred = motion_blur(image, (8.0, 0.0), border="constant")
    assert float(blurred[0, 0, 4, 0]) == pytest.approx(0.5, abs=0.07)
    assert float(blurred[0, 0, 4, 10]) == pytest.approx(1, abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(MOTIONS)
def test_quarter_turns_commute(motion: tuple[float, float]) -> None:
    image = noise(1, 1, 24, 31)
    x, y = motion
    turned_first = motion_blur(torch.rot90(image, 1, (2, 3)), (y, -x))
    turned_last = torch.rot90(motion_blur(image, (x, y)), 1, (2, 3))
    torch.testing.assert_close(turned_first, turned_last, atol=1e-10, rtol=0)
    torch.testing.assert_close(motion_blur(image, (-x, -y)), motion_blur(image, (x, y)), atol=1e-10, rtol=0)


@pytest.mark.parametrize("motion", [(7.3, 0.0), (0.0, 7.3)])
def test_line_filter_agrees_with_kornia(motion: tuple[float, float]) -> None:
    """The route for one line of taps and the differentiable route through kornia give one answer."""
    image = noise(2, 3, 20, 33)
    fast = motion_blur(image, motion)
    slow = motion_blur(image.clone().requires_grad_(), motion).detach()
    torch.testing.assert_close(fast, slow, atol=1e-12, rtol=0)


def test_items_do_not_depend_on_their_batch() -> None:
    images = noise(4, 2, 17, 23)
    motions = torch.tensor([[5.5, 0.0], [0.0, 0.0], [-3.0, 9.0], [60.0, 2.0]], dtype=torch.float64)
    together = motion_blur(images, motions)
    for index in range(4):
        alone = motion_blur(images[index : index + 1], motions[index])
        assert torch.equal(together[index : index + 1], alone)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (3, 4)])
def test_blur_longer_than_the_picture(size: tuple[int, int]) -> None:
    image = noise(1, 1, *size)
    for border in ("reflect", "replicate", "circular"):
        blurred = motion_blur(image, (50.0, 31.0), border=border)
        assert blurred.shape == image.shape
        assert torch.isfinite(blurred).all()
    # Reflected without end, a line much longer than the picture sees its mean.
    very_long = motion_blur(noise(1, 1, 1, 9), (1600.0, 0.0), border="circular")
    torch.testing.assert_close(very_long, noise(1, 1, 1, 9).mean().expand(1, 1, 1, 9), atol=2e-3, rtol=0)


def test_reflect_equals_torchs_own_padding() -> None:
    image = noise(1, 1, 12, 15)
    padded = torch.nn.functional.pad(image, (8, 8, 8, 8), mode="reflect")
    wide = motion_blur(padded, (6.0, 4.0), border="replicate")[..., 8:-8, 8:-8]
    torch.testing.assert_close(motion_blur(image, (6.0, 4.0)), wide, atol=1e-12, rtol=0)


def test_gradients_reach_picture_and_motion() -> None:
    image = noise(1, 1, 9, 11).requires_grad_()
    motion = torch.tensor([2.3, -1.1], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda i, m: motion_blur(i, m), (image, motion), atol=1e-5)
    still = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    motion_blur(image, still).square().sum().backward()
    assert torch.isfinite(still.grad).all()


def test_non_contiguous_and_channels_last() -> None:
    image = noise(2, 3, 18, 22)
    expected = motion_blur(image, (4.5, 2.0))
    torch.testing.assert_close(motion_blur(image.to(memory_format=torch.channels_last), (4.5, 2.0)), expected)
    view = image.transpose(2, 3).contiguous().transpose(2, 3)
    torch.testing.assert_close(motion_blur(view, (4.5, 0.0)), motion_blur(image, (4.5, 0.0)))


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


def test_bad_border_and_radius() -> None:
    with pytest.raises(ValueError, match="border"):
        motion_blur(torch.zeros(1, 1, 4, 4), (1.0, 0.0), border="mirror")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="radius_px"):
        defocus(torch.zeros(1, 1, 4, 4), -1.0)
