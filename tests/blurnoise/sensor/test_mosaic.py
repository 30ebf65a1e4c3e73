"""Mosaics: which light reaches which pixel, one plane of it, and one field of noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from generic_filters import behind_generic_filters

from blurnoise import Camera, ExposedScene, Exposure, develop, photoelectrons, plan, simulate
from blurnoise.optics import radiometry
from blurnoise.optics.colour import FilterCurves, inverse
from blurnoise.optics.radiometry import colour_shares, filter_electrons
from blurnoise.picture.develop import develop_8bit, in_channels
from blurnoise.picture.steps import magnification
from blurnoise.scene import scene as exposure_module

IMX250 = Camera.preset("imx250")
IMX250C = Camera.preset("imx250c")
CURVES = FilterCurves(red=0.3, green=0.5, blue=0.2, clear=0.6)
CONDITIONS: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 50.0}
PATTERNS = ["RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]


def camera(cfa: str, **changes: Any) -> Camera:
    curves = {"quantum_efficiency": CURVES} if cfa not in ("none", "mono") else {}
    return replace(IMX250, **{"cfa": cfa, **curves, **changes})


def light(height: int = 15, width: int = 21, count: int = 2) -> torch.Tensor:
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("cfa", ["RGGB", "GRBG", "GBRG", "BGGR"])
def test_each_pixel_keeps_its_filters_colour(cfa: str) -> None:
    """Written out pixel by pixel; odd sides."""
    seen, picture = radiometry.on_sensor(light(), camera(cfa)), light()
    assert seen.shape == (2, 1, 15, 21)
    share = {"R": 0.3 / 0.5, "G": 1.0, "B": 0.2 / 0.5}
    for y in range(15):
        for x in range(21):
            letter = cfa[2 * (y % 2) + x % 2]
            expected = picture[:, "RGB".index(letter), y, x] * share[letter]
            torch.testing.assert_close(seen[:, 0, y, x], expected)


def test_a_shifted_picture_is_seen_through_the_shifted_pattern() -> None:
    """By one column RGGB is GRBG, by one row GBRG, by both BGGR."""
    seen = radiometry.on_sensor(light(), camera("RGGB"))
    for cfa, (down, right) in {"GRBG": (0, 1), "GBRG": (1, 0), "BGGR": (1, 1)}.items():
        shifted = radiometry.on_sensor(light()[..., down:, right:], camera(cfa))
        assert torch.equal(shifted, seen[..., down:, right:])


@pytest.mark.parametrize("cfa", PATTERNS)
@pytest.mark.parametrize("illuminant", ["D55", "planck:2856"])
def test_white_gives_each_filter_its_electrons(cfa: str, illuminant: str) -> None:
    """Whatever the matrix, of colour pictures and grey ones."""
    taker = camera(cfa, ccm=None if cfa == "RCCC" else IMX250C.ccm)
    electrons = filter_electrons(taker, illuminant)
    expected = torch.tensor([electrons[letter] for letter in cfa]) / max(electrons.values())
    for channels in (1, 3):
        seen = radiometry.on_sensor(torch.ones(1, channels, 4, 6), taker, illuminant)
        torch.testing.assert_close(seen[0, 0, :2, :2].flatten(), expected)
        dn = simulate(
            torch.ones(1, channels, 4, 6), taker, illuminant=illuminant, noise=False, quantised=False,
            exposure_s=0.001, illuminance_lux=10.0,
        )  # fmt: skip
        told = (dn[0, 0, :2, :2].flatten() - taker.black_level_dn) / taker.system_gain_dn_per_e
        torch.testing.assert_close(
            told, torch.tensor([electrons[letter] for letter in cfa]) * 0.01, rtol=1e-3, atol=1e-3
        )
    assert photoelectrons(taker, 10.0, 0.001, illuminant) == pytest.approx(max(electrons.values()) * 0.01)


def test_colours_outside_the_cameras_are_no_light() -> None:
    rows = ((2.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    taker = camera("RGGB", ccm=rows)
    assert inverse(taker.ccm)[0] == pytest.approx((0.5, 0.5, 0.0))
    wide = camera("RGGB", ccm=((0.5, 0.5, 0.0), *rows[1:]))  # its inverse: 2 R - G
    picture = torch.tensor([[0.2, 0.9, 0.1], [0.9, 0.2, 0.1]]).view(2, 3, 1, 1).expand(-1, -1, 4, 4)
    seen = radiometry.on_sensor(picture, wide)
    assert seen[:, 0, 0, 0].tolist() == pytest.approx([0.0, 1.6 * 0.6])
    assert radiometry.peak(wide) == pytest.approx(1.2)  # red 2 behind a filter of 0.6
    assert radiometry.peak(IMX250) == 1.0


def test_one_plane_of_colours() -> None:
    """ "mono": the shares that light and curve give; grey stays; "none": the tensor itself."""
    taker = camera("mono", quantum_efficiency=0.5)
    shares = torch.tensor(colour_shares(taker))
    assert float(shares.min()) > 0.2
    expected = torch.einsum("c,bchw->bhw", shares, light())[:, None]
    torch.testing.assert_close(radiometry.on_sensor(light(), taker), expected)
    torch.testing.assert_close(radiometry.on_sensor(light()[:, :1], taker), light()[:, :1])
    picture = light()
    assert radiometry.on_sensor(picture, IMX250) is picture


@pytest.mark.parametrize("cfa", ["mono", "RGGB", "RCCC"])
def test_other_numbers_of_channels_are_refused(cfa: str) -> None:
    for channels in (2, 4):
        with pytest.raises(
            ValueError, match=rf"image: has {channels} channels; cfa = '{cfa}' needs 1 .* or 3"
        ):
            simulate(torch.rand(1, channels, 8, 8), camera(cfa), **CONDITIONS)


@pytest.mark.parametrize("cfa", ["mono", "GRBG"])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_one_field_of_noise_whatever_the_batch(cfa: str, fidelity: Any) -> None:
    """One plane; picture i depends on seed i; lights apart, so that plans differ; PRNU per pixel."""
    taker = camera(cfa, prnu=0.02, dsnu_e=2.0)
    given: dict[str, Any] = {"exposure_s": 0.01, "fidelity": fidelity, "velocity_px_s": (300.0, 50.0)}
    dn = simulate(light(), taker, illuminance_lux=[0.01, 50.0], generator=[1, 2], **given)
    assert dn.shape == (2, 1, 15, 21)
    for item, lux in enumerate((0.01, 50.0)):
        alone = simulate(light()[item][None], taker, illuminance_lux=lux, generator=[item + 1], **given)
        assert torch.equal(alone[0], dn[item])


def test_variance_of_the_plane_is_that_of_its_electrons() -> None:
    """Flat grey: at each filter K^2 (n + read^2) + 1/12; n values, 5 sqrt(2 / n)."""
    taker = camera("RGGB")
    dn = simulate(torch.full((1, 3, 400, 400), 0.5), taker, encoding="linear", generator=[7], **CONDITIONS)
    for place, letter in enumerate("RGGB"):
        site = dn[0, 0, place // 2 :: 2, place % 2 :: 2].double()
        electrons = 0.5 * filter_electrons(taker)[letter] * 0.5
        expected = taker.system_gain_dn_per_e**2 * (electrons + taker.read_noise_e**2) + 1 / 12
        assert float(site.var()) == pytest.approx(expected, rel=5 * (2 / site.numel()) ** 0.5)
        mean_dn = electrons * taker.system_gain_dn_per_e + taker.black_level_dn
        assert float(site.mean()) == pytest.approx(mean_dn, abs=5 * (expected / site.numel()) ** 0.5)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("jpeg_quality", [None, 80])
@pytest.mark.parametrize("cfa", ["none", "mono", "RGGB", "RCCB", "RCCC"])
def test_scenes_and_simulate_give_the_same_bits(cfa: str, jpeg_quality: int | None, channels: int) -> None:
    """Frames in the channels of their picture, developed for their light, at gains of both kinds."""
    coded = (light(33, 47, 1)[0, :channels].permute(1, 2, 0) * 255).round().byte().numpy()
    taker = camera(cfa, jpeg_quality=jpeg_quality, prnu=0.01, dark_current_e_s=50.0)
    if taker.cfa not in ("none", "mono"):
        taker = replace(taker, quantum_efficiency=behind_generic_filters(0.6))  # whose ratios are the light's
    scene = ExposedScene.of_picture(np.ascontiguousarray(coded), illuminant="planck:3000")
    at = [Exposure(taker, 0.004, lux, (900.0, -300.0), gain_db=27.0, seed=5) for lux in (20.0, 60.0)]
    at.append(Exposure(taker, 0.02, 60.0, seed=6))
    for exposure, frame in zip(at, scene.frames(at), strict=True):
        by, digital_db = exposure.amplified
        dn = simulate(
            torch.from_numpy(coded).permute(2, 0, 1)[None] / 255, by,
            exposure_s=exposure.exposure_s, illuminance_lux=exposure.illuminance_lux,
            velocity_px_s=exposure.velocity_px_s, generator=[exposure.seed], illuminant="planck:3000",
            tolerance_dn=0.1 / 10 ** (digital_db / 20) / magnification(by, "planck:3000"),
        )  # fmt: skip
        seen = in_channels(develop_8bit(dn, by, digital_db, "planck:3000"), channels)
        assert frame.picture.shape == coded.shape
        assert np.array_equal(frame.picture, seen[0].permute(1, 2, 0).numpy())


def test_light_outside_red_green_blue_is_planned_for() -> None:
    """Bounds are of the brightest that a plane may be."""
    wide = camera("RGGB", ccm=((0.5, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    told = {name: {each.name: each for each in plan(by, **CONDITIONS).stages} for name, by in
            (("wide", wide), ("plain", camera("RGGB")))}  # fmt: skip
    ratio = told["wide"]["shot noise"].contribution_dn / told["plain"]["shot noise"].contribution_dn
    assert ratio == pytest.approx(1.2**0.5)


def test_what_is_left_out_counts_as_colours_magnify_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes ask for plans at the brightest that a plane may be; frames, by how much they are to be magnified."""
    asked: list[tuple[float, float]] = []
    real = exposure_module.plan_at

    def watched(at: Any, tolerance_dn: float) -> Any:
        asked.append((at.white_e, tolerance_dn))
        return real(at, tolerance_dn)

    monkeypatch.setattr(exposure_module, "plan_at", watched)
    wide = camera("RGGB", ccm=((0.5, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    scene, white_e = ExposedScene(light(count=1)), photoelectrons(wide, 50.0, 0.01)
    scene.expose(wide, generator=[1], **CONDITIONS)
    next(scene.frames([Exposure(wide, 0.01, 50.0)]))
    assert asked[0] == pytest.approx((1.2 * white_e, 0.1))
    assert asked[1] == pytest.approx((1.2 * white_e, 0.1 / magnification(wide)))
    assert magnification(wide) == pytest.approx(2.5)  # blue's gain, 0.5 / 0.2


def test_gradients_go_through_the_mosaic() -> None:
    """Those of the picture against differences: one pixel's red moves its own site's number."""
    picture = light(6, 8, 1).double().requires_grad_()
    taker = camera("RGGB", ccm=IMX250C.ccm)
    options: dict[str, Any] = {"encoding": "linear", "noise": False, "quantised": False, **CONDITIONS}

    def total(image: torch.Tensor) -> torch.Tensor:
        weights = torch.linspace(1, 2, 48, dtype=torch.float64).view(1, 1, 6, 8)
        return (develop(simulate(image, taker, **options), taker, encoding="linear") * weights).sum()

    total(picture).backward()
    assert picture.grad is not None
    step = torch.zeros_like(picture)
    step[0, 1, 2, 3] = 1e-4
    assert torch.isfinite(picture.grad).all()
    low, high = (float(total((picture + s * step).detach().requires_grad_()).detach()) for s in (-1, 1))
    assert float(picture.grad[0, 1, 2, 3]) == pytest.approx((high - low) / 2e-4, rel=1e-3)
