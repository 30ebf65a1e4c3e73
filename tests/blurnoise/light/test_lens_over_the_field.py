"""The lens's effects over the field: off, in the chain, in the plan, against what they stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from blurs import optical_blur
from kornia.augmentation import AugmentationSequential
from torch import Tensor

from blurnoise import Camera, RandomExposure, plan, simulate
from blurnoise.blur import convolution
from blurnoise.blur.over_the_field import TOLERANCE
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.light.lens import (
    DEFOCUS,
    DIFFRACTION,
    DISTORTION,
    LATERAL_COLOUR,
    MEASURED_MTF,
    VIGNETTING,
)
from blurnoise.light.motion import MOTION
from blurnoise.optics import lens as lenses
from blurnoise.optics.lens import Distortion, Lens, Mtf, RelativeIllumination
from blurnoise.optics.transfer import Optics

H, W = 61, 87
CAMERA = replace(Camera.preset("imx250"), width_px=2 * W, height_px=2 * H, hfov_deg=70.0)
BARREL = Distortion("opencv", (-0.2, 0.02, 0.001, -0.0005))
CURVE = RelativeIllumination((0.0, 0.5, 1.0), (1.0, 0.9, 0.4))
MTF = Mtf((0.1, 0.25, 0.5), (0.8, 0.45, 0.1), "cycles/px")
LENSES = {
    "distortion": Lens(distortion=BARREL),
    "fisheye": Lens(distortion=Distortion("fisheye", (0.01, 0.0, 0.0, 0.0))),
    "lateral colour": Lens(lateral_red=0.02, lateral_blue=-0.01),
    "defocus": Lens(field_curvature_px=2.0),
    "measured MTF": Lens(mtf=MTF),
    "vignetting": Lens(falloff_power=4.0),
    "own vignetting": Lens(relative_illumination=CURVE),
}
EVERY = Lens(2.0, 0.02, -0.01, 0.0, CURVE, BARREL, MTF)
LIT: dict[str, Any] = {"exposure_s": 0.005, "illuminance_lux": 50.0}


def picture(kind: torch.dtype = torch.float64, planes: int = 3, size: tuple[int, int] = (H, W)) -> Tensor:
    made = torch.rand(1, planes, *size, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return (made > 0.5).to(kind)


def at(camera: Camera, displacement_px: tuple[float, float] = (0.0, 0.0)) -> Conditions[Tensor]:
    return Conditions(camera, *[torch.zeros(1)] * 3, torch.tensor([displacement_px]))


def of(lens: Lens, **others: Any) -> Camera:
    return replace(CAMERA, lens=lens, **others)


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_off_is_bit_equal_to_a_chain_without(
    kind: torch.dtype, fidelity: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one transform with the lens and motion, as before."""
    calls: list[Any] = []
    real = convolution.exposure_blur
    monkeypatch.setattr(
        convolution, "exposure_blur", lambda *given, **options: calls.append(1) or real(*given, **options)
    )
    camera = replace(CAMERA, defocus_radius_px=1.2, diffraction_wavelength_um=0.55, f_number=2.8)
    frames: dict[str, Any] = {"velocity_px_s": (900.0, 300.0), "generator": [3], "fidelity": fidelity, **LIT}
    off = Lens(distortion=Distortion("opencv", (0.0, 0.0, 0.0, 0.0)))
    seen = [simulate(picture(kind), each, **frames) for each in (camera, replace(camera, lens=off))]
    assert len(calls) == 2
    monkeypatch.setattr(effects, "EFFECTS", (DEFOCUS, DIFFRACTION, MOTION))
    before = simulate(picture(kind), camera, **frames)
    assert all(torch.equal(each, before) for each in seen)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("border", ["reflect", "replicate", "circular", "constant"])
def test_on_changes_the_picture_and_the_plan_says_so(lens: str, border: Any) -> None:
    camera, name = of(LENSES[lens]), {"fisheye": "distortion", "own vignetting": "vignetting"}.get(lens, lens)
    light = picture()
    seen = effects.through(light, at(camera), border=border)
    assert seen.shape == light.shape
    assert torch.isfinite(seen).all()
    off = float((seen - light).square().mean().sqrt())
    assert off > 0.03
    told = {each.name: each for each in plan(camera, **LIT).stages}
    assert told[name].kept
    without = {each.name: each for each in plan(CAMERA, **LIT).stages}
    assert not without[name].kept
    assert without[name].contribution_dn == 0


@pytest.mark.parametrize(
    "effect", [DISTORTION, LATERAL_COLOUR, DEFOCUS, MEASURED_MTF, VIGNETTING], ids=lambda e: e.name
)
@pytest.mark.parametrize("strength", [1e-3, 0.03, 1.0])
def test_bounds_hold_for_the_worst_picture(effect: Any, strength: float) -> None:
    """A picture of the sensor's size, black and white without correlation, or white: never more than the bound."""
    s = strength
    lens = {
        "distortion": Lens(distortion=Distortion("opencv", (-0.2 * s, 0.0, 0.0, 0.001 * s))),
        "lateral colour": Lens(lateral_red=0.02 * s, lateral_blue=-0.01 * s),
        "defocus": Lens(field_curvature_px=2.0 * s),
        "measured MTF": Lens(mtf=Mtf((0.25, 0.5), (1 - 0.5 * s, 1 - 0.9 * s), "cycles/px")),
        "vignetting": Lens(falloff_power=4.0 * s),
    }[effect.name]
    camera = replace(of(lens), width_px=W, height_px=H)
    point = Conditions(camera, 0.01, 25.0, 1000.0, (0.0, 0.0))
    for light in (picture(), torch.ones(1, 3, H, W, dtype=torch.float64)):
        off = effects.through(light, at(camera)) - light
        found = float(off.square().mean((0, 2, 3)).sqrt().max())
        assert found <= 1.1 * effect.bound(point) + TOLERANCE
    assert (
        effect.bound(point) < 20 * strength
    )  # sqrt(6) times what noise loses by: the worst is a checkerboard


def test_what_is_small_is_left_out() -> None:
    faint = Lens(1e-3, 1e-9, 1e-9, 1e-6, None, Distortion("opencv", (1e-9, 0.0, 0.0, 0.0)))
    told = plan(of(faint), **LIT)
    assert {"distortion", "lateral colour", "defocus", "vignetting"} <= told.without
    frames: dict[str, Any] = {"noise": False, "quantised": False, **LIT}
    auto, full = (simulate(picture(), of(faint), fidelity=way, **frames) for way in ("auto", "full"))
    assert 0 < float((auto - full).square().mean().sqrt()) < 0.1
    assert torch.equal(auto, simulate(picture(), CAMERA, **frames))


@pytest.mark.slow
def test_field_curvature_adds_to_defocus() -> None:
    """In the centre the disc of the camera, in the corner 0: curvature may bring the corners into focus."""
    camera = of(Lens(field_curvature_px=-1.5), defocus_radius_px=1.5)
    light = picture(size=(H, W))
    seen = effects.through(light, at(camera))
    centre = optical_blur(light, Optics(1.5))
    assert float((seen - centre)[..., H // 2, W // 2].abs().max()) < 2e-3
    corner = (slice(None), slice(None), slice(0, 2), slice(0, 2))
    assert float((seen - light)[corner].abs().max()) < 0.02
    assert float((centre - light)[corner].abs().max()) > 0.1


def test_lateral_colour_moves_red_and_blue_against_green() -> None:
    """A dot 30 px right of the axis: red 1 % larger is 0.3 px further out; grey pictures have no colour."""
    camera, x = of(Lens(lateral_red=0.01, lateral_blue=-0.02)), torch.arange(W, dtype=torch.float64)
    dot = torch.exp(-(((x - W // 2 - 30) / 3) ** 2) / 2).expand(1, 3, H, W).contiguous()
    row = effects.through(dot, at(camera))[0, :, H // 2]
    places = (row * x).sum(1) / row.sum(1) - W // 2
    assert places.tolist() == pytest.approx([30.3, 30.0, 29.4], abs=0.01)
    grey = dot[:, :1].contiguous()
    assert effects.through(grey, at(camera)) is grey


def test_vignetting_is_the_field_s() -> None:
    light, camera = picture(torch.float32), of(Lens(falloff_power=4.0))
    expected = light * torch.from_numpy(lenses.light(camera.field, (H, W))).float()
    assert torch.equal(effects.through(light, at(camera)), expected)
    own = replace(camera, width_px=W, height_px=H)
    lost = 1 - float(effects.through(torch.ones(1, 1, H, W), at(own)).min())
    assert VIGNETTING.bound(Conditions(own, 0.01, 25.0, 1000.0)) == pytest.approx(lost, rel=1e-5)


def test_a_measured_mtf_blurs_as_the_law_that_it_samples() -> None:
    """Diffraction, measured at 200 frequencies: the same picture, in one transform with motion."""
    camera = replace(CAMERA, f_number=5.6, diffraction_wavelength_um=0.55)
    f = torch.linspace(0, 0.8, 200, dtype=torch.float64)
    values = camera.optics.response(f, torch.zeros_like(f))
    for unit, per in (("cycles/px", 1.0), ("lp/mm", 1e3 / camera.pixel_pitch_um)):
        measured = Mtf(tuple((f * per).tolist()), tuple(values.tolist()), unit)  # type: ignore[arg-type]
        of_curve = replace(camera, diffraction_wavelength_um=0.0, lens=Lens(mtf=measured))
        moved = (7.0, -2.0)
        off = effects.through(picture(), at(of_curve, moved)) - effects.through(picture(), at(camera, moved))
        assert float(off.square().mean().sqrt()) < 3e-4


def test_distortion_shows_the_scene_where_the_field_says() -> None:
    """A smooth scene, seen through barrel distortion, is that scene at the pixels' directions."""
    camera = of(Lens(distortion=BARREL))

    def scene(x: Any, y: Any) -> Tensor:
        return 0.5 + 0.3 * torch.sin(torch.as_tensor(x) * 0.3) * torch.cos(torch.as_tensor(y) * 0.2)

    y, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64) for n in (H, W)), indexing="ij")
    source_x, source_y = lenses.sources(camera.field, (H, W))
    seen = effects.through(scene(x, y)[None, None], at(camera))[0, 0]
    inside = torch.from_numpy((source_x > 12) & (source_x < W - 13) & (source_y > 12) & (source_y < H - 13))
    assert float((seen - scene(source_x, source_y))[inside].abs().max()) < 1e-4
    assert float((source_x - x.numpy()).max()) > 3


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 1), (7, 5)])
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_pictures_of_few_pixels(size: tuple[int, int], kind: torch.dtype) -> None:
    seen = simulate(picture(kind, size=size), of(EVERY), generator=[1], fidelity="full", **LIT)
    assert seen.shape == (1, 3, *size)
    assert seen.dtype == kind
    assert torch.isfinite(seen).all()


@pytest.mark.slow
def test_batches_are_their_pictures_and_gradients_reach_them() -> None:
    images = torch.rand(3, 3, 21, 33, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    frames: dict[str, Any] = {"noise": False, "quantised": False, **LIT}
    together = simulate(images, of(EVERY), **frames)
    alone = torch.cat([simulate(each[None], of(EVERY), **frames) for each in images])
    assert torch.equal(together, alone)
    small = images[:1, :, :3, :4].clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda light: effects.through(light, at(of(EVERY))), small)


def test_boxes_of_the_augmentation_follow() -> None:
    camera = of(Lens(distortion=BARREL))
    boxes = torch.tensor([[[5.0, 6.0, 20.0, 26.0], [40.0, 28.0, 46.0, 32.0]]])
    given: dict[str, Any] = {"exposure_s": 0.004, "illuminance_lux": 50.0, "speed_px_s": 0.0, "p": 1.0}
    seen = AugmentationSequential(RandomExposure(camera, **given), data_keys=["input", "bbox_xyxy"])
    _, moved = seen(picture(torch.float32), boxes)
    expected = camera.field.moved_boxes(boxes[0].double().numpy(), (H, W))
    assert float((boxes[0] - moved[0]).abs().max()) > 3
    torch.testing.assert_close(moved[0].double(), torch.from_numpy(expected), atol=0.2, rtol=0)
    plain = AugmentationSequential(RandomExposure(CAMERA, **given), data_keys=["input", "bbox_xyxy"])
    assert torch.equal(plain(picture(torch.float32), boxes)[1], boxes)
