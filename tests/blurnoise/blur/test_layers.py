"""Objects before a background: against moments, where they are known to be simpler, and in the chain."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import segmentation
from brute_force import displaced, photograph, rms_dn
from exposed_frames import budget, raw_frames

from blurnoise import Camera, Layer, Scene, expose_layers, motion_blur, simulate
from blurnoise.blur import sub_exposures as blur_sub_exposures
from blurnoise.blur.layer import object_motion
from blurnoise.blur.layers import seen_behind
from blurnoise.camera.captures import staggered
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.light.motion import OBJECTS
from blurnoise.light.resolved import Resolved
from blurnoise.scene import cutting

STILL = (0.0, 0.0)


def disc(x, y, radius):
    down, across = torch.meshgrid(*(torch.arange(side, dtype=torch.float64) for side in SIZE), indexing="ij")
    return (radius + 0.5 - torch.hypot(across - x, down - y)).clamp(0, 1)


SIZE = (91, 122)
BACKGROUND, OBJECT, OTHER = (torch.from_numpy(photograph(*SIZE, seed, 3)[0]) for seed in (1, 2, 3))
MATTE, SECOND = disc(58.3, 44.6, 12.0), disc(68.0, 40.0, 9.0)


def seen(moved, background, *, light=OBJECT, alpha=MATTE):
    layer = Layer(light, alpha, moved)
    return expose_layers(BACKGROUND[None], [layer], exposure_s=1.0, velocity_px_s=background)


def close(one, other, tolerance=1e-9):
    torch.testing.assert_close(one, other, rtol=0, atol=tolerance)


CAMERA = Camera.preset("imx250")
ROLLING = CAMERA.with_figures(row_time_s=2e-5, shutter="rolling")
DARKER = 0.7 * torch.rand(1, 3, 61, 84, generator=torch.Generator().manual_seed(2))
SQUARE = Layer(torch.full((1, 16, 20), 0.9), torch.ones(16, 20), (1600.0, 0.0), (30, 20))
TAKEN: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 100.0}
MEAN: dict[str, Any] = {**TAKEN, "noise": False, "quantised": False, "encoding": "linear"}
WHITE = torch.ones(1, 10, 12, dtype=torch.float64)
BLACK = torch.zeros(1, 1, 40, 61, dtype=torch.float64)


@pytest.mark.parametrize(
    ("white", "background_px", "largest"), [(0.0, -10.0, 0.2488), (1.0, 5.0, 0.164), (1.0, 0.0, 0.0)]
)
def test_where_both_move_the_matte_formula_is_wrong_by_what_is_known(
    monkeypatch, white, background_px, largest
):
    """An object 20 px wide that moves 10 px: a black one, the background a step at its edge, and a white one before
    (1 + cos(2 pi x / 7)) / 2. Sixteen samples a pixel; the mean of 201 hard edges is a staircase to 0.0025.
    """
    finer, width = 16, 100
    x = (torch.arange(width * finer, dtype=torch.float64) + 0.5) / finer - width / 2  # 0: the object's middle
    behind = (1 + torch.cos(2 * math.pi * x / 7)) / 2 if white else (x < -10).double()
    alpha, background = (x.abs() < 10).double()[None], behind[None, None, None]
    light = torch.full((1, *alpha.shape), white, dtype=torch.float64)
    monkeypatch.setattr(blur_sub_exposures, "SPACING_PX", 0.05 * finer)
    moved, along = (10.0 * finer, 0.0), (background_px * finer, 0.0)
    found = expose_layers(background, [Layer(light, alpha, moved)], exposure_s=1.0, velocity_px_s=along)
    formula = motion_blur(light[None] * alpha, moved)
    formula = formula + (1 - motion_blur(alpha[None, None], moved)) * motion_blur(background, along)
    error = (found - formula)[..., 20 * finer : -20 * finer].abs().amax()
    assert float(error) == pytest.approx(largest, abs=0.004)


def exposure(background, objects, background_px, moments=128):
    """The mean light of (C, H, W), before it objects (light, alpha, displacement) of the picture's size."""
    total = np.zeros(background.shape)
    for t in (np.arange(moments) + 0.5) / moments - 0.5:
        seen = displaced(background.numpy(), *(t * along for along in background_px))
        for light, alpha, moved in objects:
            own, share = (
                displaced(each.numpy(), t * moved[0], t * moved[1]) for each in (light * alpha, alpha)
            )
            seen = own + (1 - share.clip(0, 1)) * seen
        total += seen
    return torch.from_numpy(total / moments)


def srgb_rms_dn(one, other):
    """In 8-bit sRGB numbers."""
    return rms_dn(srgb_from_linear(one).numpy(), srgb_from_linear(other).numpy())


@pytest.mark.slow
@pytest.mark.parametrize("background", [STILL, (8.0, 3.0)])
def test_objects_that_overlap_cover_each_other_as_they_pass(background):
    objects = [(OBJECT, MATTE, (24.0, 0.0)), (OTHER, SECOND, (-10.0, 6.0))]
    truth = exposure(BACKGROUND, objects, background)
    layers, middle = [Layer(*each) for each in objects], (..., slice(20, 70), slice(20, 100))
    for order, least, most in ((layers, 0, 0.6), (layers[::-1], 2, 99)):
        found = expose_layers(BACKGROUND[None], order, exposure_s=1.0, velocity_px_s=background)[0]
        assert least <= srgb_rms_dn(found[middle], truth[middle]) < most


@pytest.mark.parametrize(("length", "share"), [(10, 0.05), (30, 0.15), (75, 0.375), (200, 0.75)])
def test_the_share_that_is_seen_of_what_is_behind(length, share):
    layer = Layer(torch.ones(1, 50, 50), torch.ones(50, 50), place_px=(300, 300))
    for moved in ((length, 0.0), (0.0, -length)):
        assert seen_behind(layer, [(layer, moved)], (650, 650)) == pytest.approx(share, abs=0.003)


@pytest.mark.parametrize("background", [STILL, (-6.0, 3.0)])
def test_gradients_reach_light_matte_and_velocities(background):
    light, alpha = OBJECT.clone().requires_grad_(), (0.98 * MATTE + 0.01).requires_grad_()
    velocity = torch.tensor([9.3, 4.1], dtype=torch.float64, requires_grad=True)

    def loss(velocity):
        options = {"exposure_s": 1.0, "velocity_px_s": background}
        return (expose_layers(BACKGROUND[None], [Layer(light, alpha, velocity)], **options) * OTHER).sum()

    found, *others = torch.autograd.grad(loss(velocity), (velocity, light, alpha))
    for axis in range(2):
        by = 1e-3 * torch.eye(2, dtype=torch.float64)[axis]
        slope = float((loss(velocity + by) - loss(velocity - by)).detach()) / 2e-3
        assert float(found[axis]) == pytest.approx(slope, rel=0.02, abs=0.02)
    for gradient in others:
        assert bool(torch.isfinite(gradient).all())
        assert float(gradient.abs().max()) > 0


def test_at_rest_and_in_equal_motion_it_is_the_composite_and_everywhere_the_object():
    composite = (OBJECT * MATTE + (1 - MATTE) * BACKGROUND)[None]
    close(seen(STILL, STILL), composite)
    close(expose_layers(BACKGROUND[None], [Layer(OBJECT, MATTE, (500.0, 0.0))], exposure_s=0.0), composite)
    close(seen((7.0, -9.0), (7.0, -9.0)), motion_blur(composite, (7.0, -9.0)))
    every = torch.ones(SIZE, dtype=torch.float64)
    close(seen((14.0, 7.5), (9.0, -4.0), alpha=every), motion_blur(OBJECT[None], (14.0, 7.5)), 2e-3)
    close(seen((14.0, 7.5), (9.0, -4.0), alpha=0 * every), motion_blur(BACKGROUND[None], (9.0, -4.0)))


def test_the_rest_of_the_picture_is_untouched():
    """Beyond the window nothing differs, to the last bit, whether or not the background moves."""
    rows, columns = slice(30, 60), slice(44, 74)
    layer = Layer(OBJECT[:, rows, columns], MATTE[rows, columns], (10.0, 0.0), (44, 30))
    for background in (STILL, (5.0, 2.0)):
        plain = motion_blur(BACKGROUND[None], background)
        found = expose_layers(BACKGROUND[None], [layer], exposure_s=1.0, velocity_px_s=background)
        assert bool((found[..., :20] == plain[..., :20]).all())
        assert bool((found[..., 90:] == plain[..., 90:]).all())
        assert bool((found != plain)[..., 40:50, 50:60].any())


@pytest.mark.parametrize(
    ("moved_px", "left", "at", "light"),
    [(40.0, -14, 0, 0.3), (4.0, -100, 0, 0.0), (8.0, 0, 0, 1.0), (8.0, 1, 1, 0.56), (24.0, 46, 60, 0.38)],
)
@pytest.mark.parametrize("background", [STILL, (3.0, 2.0)])
def test_what_lies_outside_comes_in_and_what_meets_the_border_goes_on(moved_px, left, at, light, background):
    """12 px wide: all of it passes the border in 12 of 40 px; the third goes on beyond it, the last leaves.

    Empty margins of a layer as large as the picture are nothing.
    """
    given: dict[str, Any] = {"exposure_s": 1.0, "velocity_px_s": background}
    found = expose_layers(BLACK, [Layer(WHITE, WHITE[0], (moved_px, 0.0), (left, 15))], **given)
    assert float(found[0, 0, 20, at]) == pytest.approx(light, abs=0.03)
    if 0 < left < 50:
        whole = torch.zeros_like(BLACK[0])
        whole[:, 15:25, left : left + 12] = 1
        assert torch.equal(expose_layers(BLACK, [Layer(whole, whole[0], (moved_px, 0.0))], **given), found)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (700.0, -300.0)])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("defocus_px", [0.0, 2.5])
def test_simulate_exposes_what_layers_make(velocity, fidelity, defocus_px):
    """The lens blurs what the motions make, not the layers alone, whose mattes it would soften twice."""
    camera = CAMERA.with_figures(defocus_radius_px=defocus_px)
    light = expose_layers(DARKER, [SQUARE], exposure_s=0.01, velocity_px_s=velocity)
    found = simulate(DARKER, camera, **MEAN, layers=[SQUARE], velocity_px_s=velocity, fidelity=fidelity)
    torch.testing.assert_close(found, simulate(light.clamp(0, 1), camera, **MEAN), rtol=0, atol=2.0)
    without = simulate(DARKER, camera, **MEAN, velocity_px_s=velocity)
    assert float((found - without).abs().max()) > 100


def test_plans_keep_objects_and_bound_them():
    taken = {"exposure_s": 0.01, "illuminance_lux": 100.0}
    moving = budget(CAMERA, **taken, scene=Scene(DARKER, layers=[SQUARE]))
    row = {stage.name: stage for stage in moving.stages}["objects"]
    assert row.kept
    assert "matte formula" in row.how
    assert row.contribution_dn > 100
    assert "objects" not in moving.without
    both = budget(CAMERA, **taken, scene=Scene(DARKER, layers=[SQUARE]), displacement_px=(5.0, 0.0))
    assert "parts of 2 px" in {stage.name: stage for stage in both.stages}["objects"].how
    assert {stage.name: stage for stage in budget(CAMERA, **taken).stages}["objects"].contribution_dn == 0


@pytest.mark.parametrize(
    ("moved", "background"), [(0.02, 0.0), (0.3, 0.0), (1.0, 0.9), (6.0, -3.0), (40.0, 0.0)]
)
def test_the_bound_holds_for_black_and_white(moved, background):
    """Against one motion for all, the background's."""
    generator = torch.Generator().manual_seed(3)
    scene, light = (torch.randint(0, 2, (1, 1, 64, 80), generator=generator).double() for _ in range(2))
    alpha = torch.zeros(64, 80, dtype=torch.float64)
    alpha[20:40, 24:56] = torch.randint(0, 2, (20, 32), generator=generator).double()
    apart, along = (Layer(light[0], alpha, (speed, 0.0)) for speed in (moved, background))
    taken = {"exposure_s": 1.0, "velocity_px_s": (background, 0.0)}
    one, other = (expose_layers(scene, [layer], **taken) for layer in (apart, along))
    at = Resolved(CAMERA, 1.0, 25.0, 1.0, (background, 0.0), objects=(object_motion(apart, 1.0, (64, 80)),))
    assert float((one - other).square().mean().sqrt()) <= OBJECTS.bound(at)


def test_later_captures_have_it_further_on():
    """The second of two, 1/8 as long and right behind the first: its middle 0.5625 of an exposure later, 9 px."""
    taken = {name: value for name, value in MEAN.items() if name != "encoding"}
    frames = raw_frames(Scene(0 * DARKER, layers=[SQUARE]), CAMERA, staggered(8), **taken)
    middles = []
    for frame in frames:
        light = (frame - CAMERA.sensor.black_level_dn)[0, 0].sum(0)
        middles.append(float((light * torch.arange(84.0)).sum() / light.sum()))
    assert middles == pytest.approx([39.5, 48.5], abs=0.1)


ONE = {"light": torch.ones(1, 4, 5), "alpha": torch.ones(4, 5)}
SMALL = torch.zeros(1, 3, 9, 11)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Layer(**ONE | {"alpha": torch.full((4, 5), 1.5)}), "layer: alpha: values span"),
        (lambda: Layer(**ONE | {"alpha": torch.ones(5, 4)}), "must be equal"),
        (
            lambda: expose_layers(SMALL, [Layer(torch.ones(2, 4, 5), torch.ones(4, 5))], exposure_s=1.0),
            "must be 1 or the background's 3",
        ),
        (lambda: expose_layers(SMALL, [[], []], exposure_s=1.0), "a sequence of them for each of 1 pictures"),
        (
            lambda: expose_layers(SMALL, [Layer(**ONE, velocity_px_s=(6e6, 6e6))], exposure_s=0.01),
            r"displacement_px: 30008 px .* at most 268435456 are",
        ),
        (lambda: simulate(SMALL, ROLLING, **TAKEN, layers=[Layer(**ONE, velocity_px_s=(0.0, 9e6))]), "overtaken"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def box_of_light(*, soft):
    """A red square before a grey slope, and its matte; soft: its edges half a pixel."""
    left, top = (30.5, 20.5) if soft else (30, 20)
    matte = segmentation.of_box(left, top, 20, 16, (61, 84))
    behind, share = torch.linspace(0.2, 0.6, 84).expand(1, 3, 61, 84), torch.from_numpy(matte)
    return torch.tensor([0.8, 0.1, 0.05])[None, :, None, None] * share + (1 - share) * behind, matte


def test_an_object_is_cut_out_with_its_own_colours():
    """The mixed edge of the picture is no part of the object's colour: a plain blend would keep the grey."""
    light, matte = box_of_light(soft=True)
    cut = cutting.cut_out(light, [matte], [(100.0, 0.0)])
    (layer,) = cut.layers
    assert layer.place_px == (30, 20)
    assert tuple(layer.alpha.shape) == (17, 21)
    for channel, own in enumerate((0.8, 0.1, 0.05)):
        assert float((layer.light[channel][layer.alpha > 0] - own).abs().max()) < 1e-3
    assert float((light[0, 1, 28, 30] - 0.1).abs()) > 0.05


def test_what_is_behind_is_invented_there_alone():
    light, matte = box_of_light(soft=True)
    cut = cutting.cut_out(light, [matte], [(100.0, 0.0)])
    expected = torch.linspace(0.2, 0.6, (61, 84)[1]).expand(1, 3, 61, 84)
    assert bool((cut.background == light)[..., torch.from_numpy(~cut.invented)].all())
    assert float((cut.background - expected).abs().max()) < 0.08  # of a slope of 0.1 across the hole
    assert float((cut.background - expected).abs().mean()) < 0.005
    grown = np.zeros((61, 84), bool)
    grown[18:39, 28:53] = True
    assert (cut.invented == grown).all()


def test_an_object_at_the_border_goes_on():
    light = torch.full((1, 3, 61, 84), 0.5)
    matte = segmentation.of_box(0, 20, 12, 16, (61, 84))
    light[..., 20:36, :12] = 0.9
    light[..., 20:36, 0] = 0.7  # not mixed with anything: the object's own
    (layer,) = cutting.cut_out(light, [matte], [(0.0, 0.0)]).layers
    assert float((layer.light[:, 2:-2, 0] - 0.7).abs().max()) == 0.0


def test_what_cannot_be_cut_out():
    light, matte = box_of_light(soft=False)
    for wrong, message in (
        (np.zeros((61, 84), np.float32), "is empty"),
        (matte[1:], "must be the picture's"),
        (matte * np.float32(np.nan), "contains NaN or Inf"),
        (np.ones((61, 84), np.float32), "needs a plate"),
    ):
        with pytest.raises(ValueError, match=message):
            cutting.cut_out(light, [wrong], [(0.0, 0.0)])
    with pytest.raises(ValueError, match="plate: shape"):
        cutting.cut_out(light, [matte], [(0.0, 0.0)], light[..., 1:])
