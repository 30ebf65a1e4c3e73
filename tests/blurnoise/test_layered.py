"""Layers: the matte formula where it is exact, else parts of the exposure, against moments and closed forms."""

from __future__ import annotations

import math

import pytest
import sub_exposures
import torch
from layered_scenes import BACKGROUND, MATTE, OBJECT, OTHER, SECOND, STILL, Motion, close, disc, seen, texture
from torch import Tensor

from blurnoise import Layer, expose_layers, motion_blur
from blurnoise.blur import sub_exposures as blur_sub_exposures
from blurnoise.blur.layers import seen_behind


def matte_formula(moved: Motion, background: Motion) -> Tensor:
    a = motion_blur(MATTE[None, None], moved)
    return motion_blur((OBJECT * MATTE)[None], moved) + (1 - a) * motion_blur(BACKGROUND[None], background)


def blurred_matte_over_blurred_picture(moved: Motion) -> Tensor:
    """What must never be done."""
    sharp = OBJECT * MATTE + (1 - MATTE) * BACKGROUND
    a = motion_blur(MATTE[None, None], moved)
    return a * motion_blur(sharp[None], moved) + (1 - a) * sharp


# --- against moments --------------------------------------------------------


@pytest.mark.parametrize(
    ("moved", "background"),
    [
        ((24.0, 5.0), STILL),
        (STILL, (20.0, -8.0)),
        ((24.0, 0.0), (-12.0, 0.0)),
        ((14.0, 10.0), (-12.0, 6.0)),
        ((10.0, 4.0), (10.0, 4.0)),
        ((3.0, 0.0), (-2.0, 1.0)),
    ],
)
def test_exposures_are_the_mean_of_moments(moved: Motion, background: Motion) -> None:
    """1.5 DN is allowed; the tests of what is simpler below tell what is wrong where it fails."""
    truth = sub_exposures.exposure(BACKGROUND, [(OBJECT, MATTE, moved)], background)
    middle = (..., slice(20, 70), slice(20, 100))
    assert sub_exposures.rms_dn(seen(moved, background)[0][middle], truth[middle]) < 0.6
    if STILL not in (moved, background) and math.hypot(*moved) > 5:
        assert sub_exposures.rms_dn(matte_formula(moved, background)[0][middle], truth[middle]) > 0.8
    if background == STILL:
        wrong = blurred_matte_over_blurred_picture(moved)[0]
        assert sub_exposures.rms_dn(wrong[middle], truth[middle]) > 5


@pytest.mark.slow
@pytest.mark.parametrize("background", [STILL, (8.0, 3.0)])
def test_objects_that_overlap_cover_each_other_as_they_pass(background: Motion) -> None:
    layers = [Layer(OBJECT, MATTE, (24.0, 0.0)), Layer(OTHER, SECOND, (-10.0, 6.0))]
    found = expose_layers(BACKGROUND[None], layers, exposure_s=1.0, velocity_px_s=background)
    objects = [(OBJECT, MATTE, (24.0, 0.0)), (OTHER, SECOND, (-10.0, 6.0))]
    truth = sub_exposures.exposure(BACKGROUND, objects, background)
    middle = (..., slice(20, 70), slice(20, 100))
    assert sub_exposures.rms_dn(found[0][middle], truth[middle]) < 0.6
    turned = expose_layers(BACKGROUND[None], layers[::-1], exposure_s=1.0, velocity_px_s=background)
    assert sub_exposures.rms_dn(turned[0][middle], truth[middle]) > 5


def test_a_scene_rendered_finer_with_what_is_hidden() -> None:
    """Eight times finer, whole fine pixels a moment, each camera pixel the mean of 64: no interpolation anywhere."""
    finer, parts, size = 8, 48, (40, 56)
    fine = (size[0] * finer, size[1] * finer)
    scene, light = texture(*fine, 5), texture(*fine, 6)
    scene, light = (
        motion_blur(motion_blur(each[None], (14.0, 0.0)), (0.0, 14.0))[0] for each in (scene, light)
    )
    matte = (disc(*fine, 224.0, 160.0, 64.0) > 0.5).double()

    def pixels(plane: Tensor) -> Tensor:
        return torch.nn.functional.avg_pool2d(plane[None], finer)[0]

    truth = torch.zeros(3, *size, dtype=torch.float64)
    for part in range(
        parts
    ):  # moved by 2 (object) and -1 (background) fine pixels a part: 12 and -6 px in all
        steps = part - (parts - 1) / 2
        object_px, scene_px = round(2 * steps), math.floor(-steps)
        cover = torch.roll(matte, object_px, -1)
        truth += pixels(
            torch.roll(light, object_px, -1) * cover + (1 - cover) * torch.roll(scene, scene_px, -1)
        )
    alpha = pixels(matte[None])[0]
    colour = pixels(light * matte) / alpha.clamp_min(1e-9)
    layer = Layer(colour, alpha, (12.0, 0.0))
    # whole fine pixels lie half of one to the left of the middle: a sixteenth of a pixel
    found = expose_layers(pixels(scene)[None], [layer], exposure_s=1.0, velocity_px_s=(-6.0, 0.0))[0]
    middle = (..., slice(8, 32), slice(12, 44))
    assert sub_exposures.rms_dn(found[middle], truth[middle] / parts) < 1.5
    a = motion_blur(alpha[None, None], (12.0, 0.0))
    naive = a * motion_blur((colour * alpha + (1 - alpha) * pixels(scene))[None], (12.0, 0.0))
    naive = (naive + (1 - a) * (colour * alpha + (1 - alpha) * pixels(scene)))[0]
    assert sub_exposures.rms_dn(naive[middle], truth[middle] / parts) > 5


# --- closed forms -----------------------------------------------------------


@pytest.mark.parametrize(
    ("white", "background_px", "largest"),
    [(0.0, -10.0, 0.2488), (0.0, 10.0, 0.2500), (1.0, 5.0, 0.164), (1.0, -10.0, 0.074), (1.0, 0.0, 0.0)],
)
def test_where_both_move_the_matte_formula_is_wrong_by_what_is_known(
    monkeypatch: pytest.MonkeyPatch, white: float, background_px: float, largest: float
) -> None:
    """An object 20 px wide that moves 10 px: a black one, the background a step at its edge, and a white one
    before (1 + cos(2 pi x / 7)) / 2. Sixteen samples a pixel; sub-exposures a twentieth of
    one apart: the mean of K hard edges is a staircase that errs by up to 1 / 2K, 0.0025 of K = 201."""
    finer, width = 16, 100
    x = (torch.arange(width * finer, dtype=torch.float64) + 0.5) / finer - width / 2  # 0: the object's middle
    alpha = (x.abs() < 10).double()[None]
    behind = (1 + torch.cos(2 * math.pi * x / 7)) / 2 if white else (x < -10).double()
    light = torch.full((1, *alpha.shape), white, dtype=torch.float64)
    monkeypatch.setattr(blur_sub_exposures, "SPACING_PX", 0.05 * finer)
    fine = {"exposure_s": 1.0, "velocity_px_s": (background_px * finer, 0.0)}
    background = behind[None, None, None]
    found = expose_layers(background, [Layer(light, alpha, (10.0 * finer, 0.0))], **fine)
    a = motion_blur(alpha[None, None], (10.0 * finer, 0.0))
    formula = motion_blur(light[None] * alpha, (10.0 * finer, 0.0))
    formula = formula + (1 - a) * motion_blur(background, (background_px * finer, 0.0))
    error = (found - formula)[..., 20 * finer : -20 * finer].abs().amax()
    assert float(error) == pytest.approx(largest, abs=0.004)


@pytest.mark.parametrize(("length", "share"), [(10, 0.05), (30, 0.15), (75, 0.375), (200, 0.75)])
def test_the_share_that_is_seen_of_what_is_behind(length: float, share: float) -> None:
    layer = Layer(torch.ones(1, 50, 50), torch.ones(50, 50), place_px=(300, 300))
    for moved in ((length, 0.0), (0.0, -length)):
        assert seen_behind(layer, [(layer, moved)], (650, 650)) == pytest.approx(share, abs=0.003)


def test_nothing_is_seen_behind_what_stands_or_is_not_there() -> None:
    for alpha, moved in ((torch.ones(5, 5), STILL), (torch.zeros(5, 5), (3.0, 0.0))):
        layer = Layer(torch.ones(1, 5, 5), alpha, place_px=(20, 20))
        assert seen_behind(layer, [(layer, moved)], (45, 45)) == 0.0


# --- batches, precision, gradients ------------------------------------------


def test_every_picture_has_its_own() -> None:
    pictures = torch.stack([BACKGROUND, OTHER, BACKGROUND])
    layers = [
        [Layer(OBJECT, MATTE, (10.0, 0.0))],
        [],
        [Layer(OTHER, SECOND, (0.0, 9.0)), Layer(OBJECT, MATTE)],
    ]
    options = {"exposure_s": [1.0, 2.0, 0.5], "velocity_px_s": [[3.0, 1.0], [0.0, 0.0], [0.0, 4.0]]}
    together = expose_layers(pictures, layers, **options)
    for place in range(3):
        alone = expose_layers(
            pictures[place : place + 1],
            layers[place],
            exposure_s=options["exposure_s"][place],
            velocity_px_s=options["velocity_px_s"][place],
        )
        close(together[place : place + 1], alone, 0.0)


@pytest.mark.parametrize("faint", [3e-5, -3e-5])
@pytest.mark.parametrize("along", [0, 1])
def test_motion_too_short_to_be_seen_is_none_along_its_axis(along: int, faint: float) -> None:
    """As a lens's projection leaves of motion that is straight."""

    def drifting(length: float, beside: float) -> Motion:
        return (beside, length) if along else (length, beside)

    found = seen(drifting(14.0, faint), drifting(-12.0, -faint))
    close(found, seen(drifting(14.0, 0.0), drifting(-12.0, 0.0)), 2e-5)


def test_gradients_reach_an_axis_along_which_nothing_moves() -> None:
    """At rest along an axis interpolation has a kink: the gradient is that of either side, or between."""

    def loss(velocity: Motion | Tensor) -> Tensor:
        layer = Layer(OBJECT, MATTE, velocity)
        found = expose_layers(BACKGROUND[None], [layer], exposure_s=1.0, velocity_px_s=(-12.0, 0.0))
        return (found * OTHER[None]).sum()

    velocity = torch.tensor([14.1, 0.0], dtype=torch.float64, requires_grad=True)
    loss(velocity).backward()
    assert velocity.grad is not None
    step = 1e-2
    before, rest, after = (float(loss((14.1, at))) for at in (-step, 0.0, step))
    slopes = (rest - before) / step, (after - rest) / step
    assert min(map(abs, slopes)) > 0.05
    assert min(slopes) - 0.01 <= float(velocity.grad[1]) <= max(slopes) + 0.01


def test_single_precision_is_as_good() -> None:
    layer = Layer(OBJECT.float(), MATTE.float(), (14.0, 10.0))
    found = expose_layers(BACKGROUND[None].float(), [layer], exposure_s=1.0, velocity_px_s=(-12.0, 6.0))
    assert found.dtype == torch.float32
    close(found.double(), seen((14.0, 10.0), (-12.0, 6.0)), 2e-5)


@pytest.mark.parametrize("background", [STILL, (-6.0, 3.0)])
def test_gradients_reach_light_matte_and_velocities(background: Motion) -> None:
    light, alpha = OBJECT.clone().requires_grad_(), (0.98 * MATTE + 0.01).requires_grad_()
    velocity = torch.tensor([9.3, 4.1], dtype=torch.float64, requires_grad=True)
    weights = OTHER[None]

    def loss(velocity: Tensor, own: Tensor, matte: Tensor) -> Tensor:
        layer = Layer(own, matte, velocity)
        options = {"exposure_s": 1.0, "velocity_px_s": background}
        return (expose_layers(BACKGROUND[None], [layer], **options) * weights).sum()

    loss(velocity, light, alpha).backward()
    step = 1e-3
    for axis in range(2):
        by = torch.zeros(2, dtype=torch.float64)
        by[axis] = step
        with torch.no_grad():
            there, back = (loss(velocity + sign * by, light, alpha) for sign in (1, -1))
        assert velocity.grad is not None
        assert float(velocity.grad[axis]) == pytest.approx(
            float((there - back) / (2 * step)), rel=0.02, abs=0.02
        )
    for tensor in (light, alpha):
        assert tensor.grad is not None
        assert bool(torch.isfinite(tensor.grad).all())
        assert float(tensor.grad.abs().max()) > 0


# --- bad input --------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"alpha": torch.full((4, 5), 1.5)}, "layer: alpha: values span"),
        ({"alpha": torch.ones(5, 4)}, "must be equal"),
        ({"light": torch.ones(4, 5)}, r"layer: light: shape must be \(C, h, w\)"),
        ({"light": torch.full((1, 4, 5), math.nan)}, "layer: light: contains NaN"),
        ({"velocity_px_s": (1.0, 2.0, 3.0)}, "layer: velocity_px_s"),
        ({"velocity_px_s": (math.inf, 0.0)}, "layer: velocity_px_s"),
        ({"place_px": (1 << 30, 0)}, "layer: place_px"),
    ],
)
def test_layers_that_are_none(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Layer(**({"light": torch.ones(1, 4, 5), "alpha": torch.ones(4, 5)} | change))  # type: ignore[arg-type]


def test_what_does_not_go_together() -> None:
    layer = Layer(torch.ones(2, 4, 5), torch.ones(4, 5))
    with pytest.raises(ValueError, match="must be 1 or the background's 3"):
        expose_layers(BACKGROUND[None], [layer], exposure_s=1.0)
    with pytest.raises(ValueError, match="a sequence of them for each of 1 pictures"):
        expose_layers(BACKGROUND[None], [[], []], exposure_s=1.0)
    with pytest.raises(TypeError, match="float32 or float64"):
        Layer(torch.ones(1, 4, 5, dtype=torch.uint8), torch.ones(4, 5))
    long = Layer(torch.ones(1, 4, 5), torch.ones(4, 5), (9000.0, 0.0))
    with pytest.raises(ValueError, match="takes at most 4096"):
        expose_layers(BACKGROUND[None], [long], exposure_s=1.0, velocity_px_s=(0.0, 3.0))


def test_motions_beyond_what_a_plane_holds() -> None:
    """6e4 px along both axes would want 58 GB before a background at rest."""
    layer = Layer(torch.ones(1, 4, 5), torch.ones(4, 5), (6e6, 6e6))
    with pytest.raises(ValueError, match=r"displacement_px: 30008 px .* at most 268435456 are"):
        expose_layers(torch.ones(1, 1, 9, 11), [layer], exposure_s=0.01)


def test_what_a_naive_blend_is_wrong_by() -> None:
    """All blurred, blended by the blurred matte: a (1 - a) outside and (1 - a)^2 inside, 1/4 at the edge, .1514 RMS
    over the band; the ghost that is left is as sharp as the object. White of 20 px before black, 10 px of motion."""
    finer, width = 16, 60
    x = (torch.arange(width * finer, dtype=torch.float64) + 0.5) / finer - width / 2
    alpha = (x.abs() < 10).double()[None]
    light = torch.ones(1, *alpha.shape, dtype=torch.float64)
    black = torch.zeros(1, *light.shape, dtype=torch.float64)
    exact = expose_layers(black, [Layer(light, alpha, (10.0 * finer, 0.0))], exposure_s=1.0)
    a = motion_blur(alpha[None, None], (10.0 * finer, 0.0))
    naive = a * a + (1 - a) * alpha
    error = (naive - exact).abs()[0, 0, 0]
    assert float(error.amax()) == pytest.approx(0.25, abs=0.01)
    band = (x.abs() > 5) & (x.abs() < 15)
    assert float(error[band].square().mean().sqrt()) == pytest.approx(0.1514, abs=1e-3)
