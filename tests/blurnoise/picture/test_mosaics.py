"""From mosaics to pictures: what must come back, what highlights and noise become, and that both ways agree."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import kornia
import numpy as np
import pytest
import torch

from blurnoise import Camera, develop, simulate
from blurnoise.optics.colour import FilterCurves, srgb_from_linear
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.picture import steps
from blurnoise.picture.develop import develop_8bit
from blurnoise.picture.steps import demosaic

IMX250 = Camera.preset("imx250")
AR0231 = ((1.3671875, -0.0546875, -0.3125), (-0.53125, 1.4609375, 0.0703125), (-0.578125, -0.25, 1.828125))
CURVES = FilterCurves(red=0.3, green=0.4, blue=0.25, clear=0.9)
EVEN = FilterCurves(0.4, 0.4, 0.4, 0.4)
BAYER = ["RGGB", "GRBG", "GBRG", "BGGR"]
METHODS: list[Any] = ["bilinear", "edge"]


def camera(cfa: str = "RGGB", **changes: Any) -> Camera:
    ccm = None if cfa == "RCCC" else AR0231
    return replace(IMX250, **{"cfa": cfa, "quantum_efficiency": CURVES, "ccm": ccm, **changes})


def flat(rgb: tuple[float, float, float], height: int = 9, width: int = 11) -> torch.Tensor:
    return torch.tensor(rgb).view(1, 3, 1, 1).expand(-1, -1, height, width)


def filling(taker: Camera, illuminant: str = "D55", share: float = 0.9) -> dict[str, Any]:
    """Light with which white is ``share`` of the range."""
    range_e = (taker.full_scale_dn - taker.black_level_dn) / taker.system_gain_dn_per_e
    lux = share * range_e / (0.01 * electrons_per_lux_s(taker, illuminant))
    return {"exposure_s": 0.01, "illuminance_lux": lux, "illuminant": illuminant}


@pytest.mark.parametrize("illuminant", ["D55", "planck:2856"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cfa", [*BAYER, "RCCB"])
def test_flat_colours_come_back(cfa: str, method: Any, illuminant: str) -> None:
    """Without noise, to the rounding of numbers that gains and matrix magnify; odd sides, cold light and warm."""
    taker = camera(cfa, demosaic=method)
    for rgb in ((0.5, 0.3, 0.35), (0.2, 0.6, 0.3), (0.3, 0.4, 0.8), (1.0, 1.0, 1.0)):
        conditions = filling(taker, illuminant)
        dn = simulate(flat(rgb), taker, encoding="linear", noise=False, **conditions)
        seen = develop(dn, taker, encoding="linear", illuminant=illuminant)
        assert seen.shape == (1, 3, 9, 11)
        rounding = 1.5 * steps.magnification(taker, illuminant) / 2 / 4095 + 3e-5
        torch.testing.assert_close(seen, 0.9 * flat(rgb), rtol=0, atol=rounding)
        coded = develop(dn, taker, illuminant=illuminant)
        torch.testing.assert_close(coded, srgb_from_linear(seen), rtol=0, atol=1e-3)


def test_equal_filters_are_the_identity() -> None:
    """No matrix, equal curves, a constant: under every pattern what each camera of one plane gives."""
    grey = simulate(flat((0.4, 0.4, 0.4)), replace(IMX250, quantum_efficiency=0.4), noise=False,
                    exposure_s=0.01, illuminance_lux=50.0)  # fmt: skip
    for cfa in (*BAYER, "RCCC"):
        taker = camera(cfa, quantum_efficiency=EVEN, ccm=None)
        dn = simulate(flat((0.4, 0.4, 0.4)), taker, noise=False, exposure_s=0.01, illuminance_lux=50.0)
        assert torch.equal(dn, grey[:, :1])
        torch.testing.assert_close(develop(dn, taker), develop(grey, IMX250), rtol=0, atol=2e-4)


def test_rccc_is_grey_three_times() -> None:
    taker = camera("RCCC")
    dn = torch.randint(100, 4000, (2, 1, 7, 10), generator=torch.Generator().manual_seed(1)).float()
    seen = develop(dn, taker, encoding="linear")
    assert torch.equal(seen[:, 0], seen[:, 1])
    assert torch.equal(seen[:, 0], seen[:, 2])
    own = (dn - taker.black_level_dn) / (4095 - taker.black_level_dn)
    torch.testing.assert_close(seen[:, :1, 1::2], own[..., 1::2, :])
    cross = (own[..., 1, 4] + own[..., 3, 4] + own[..., 2, 3] + own[..., 2, 5]) / 4
    torch.testing.assert_close(seen[:, 0, 2, 4], cross[:, 0])
    torch.testing.assert_close(develop(dn, taker), srgb_from_linear(seen), rtol=0, atol=1e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("well", [1.0, 0.5])
def test_highlights_stay_white(method: Any, well: float) -> None:
    """Light up to four times what fills the range, or a well below it: no tint, with noise as without."""
    taker = camera(demosaic=method, full_well_e=IMX250.full_well_e * well)
    levels = torch.linspace(0.05, 1.0, 40).view(-1, 1, 1, 1).expand(-1, 3, 10, 12)
    conditions = {**filling(taker, share=4.0), "encoding": "linear"}
    mean = simulate(levels, taker, noise=False, quantised=False, **conditions)
    seen = develop(mean, taker, encoding="linear")
    assert float((seen.amax(1) - seen.amin(1)).max()) < 3 / 4095 * 2.4
    bright = levels[25:]
    noisy = develop(simulate(bright, taker, generator=list(range(15)), **conditions), taker)
    assert float((noisy.amax(1) - noisy.amin(1)).max()) < 1e-4
    level = steps.highest(taker)
    torch.testing.assert_close(
        noisy, srgb_from_linear(torch.tensor(level)).expand_as(noisy), rtol=0, atol=1e-3
    )


def test_a_grey_ramp_has_no_colour() -> None:
    """Bilinear means follow it; at its ends, where reflection bends it, they do not."""
    ramp = (0.1 + 0.01 * torch.arange(60.0)).expand(1, 3, 20, -1)
    taker = camera()
    seen = develop(
        simulate(ramp, taker, encoding="linear", noise=False, **filling(taker)), taker, encoding="linear"
    )
    inner = seen[..., 1:-1]
    assert float((inner.amax(1) - inner.amin(1)).max()) < 3 / 4095 * 2.4
    torch.testing.assert_close(inner, 0.9 * ramp[..., 1:-1], rtol=0, atol=3 / 4095)


def test_bilinear_is_kornias() -> None:
    """Within the border, where Kornia replicates; its pattern names count from the second row."""
    raw = torch.rand(2, 1, 20, 26, generator=torch.Generator().manual_seed(2))
    names = {"RGGB": "BG", "GRBG": "GB", "GBRG": "GR", "BGGR": "RG"}
    for cfa, name in names.items():
        expected = kornia.color.raw_to_rgb(raw, getattr(kornia.color.CFA, name))
        seen = demosaic(raw, cfa, "bilinear")
        torch.testing.assert_close(seen[..., 2:-2, 2:-2], expected[..., 2:-2, 2:-2])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cfa", [*BAYER, "RCCB", "RCCC"])
@pytest.mark.parametrize("size", [(2, 2), (2, 5), (3, 2), (16, 21), (33, 18)])
def test_integers_of_16_bits_are_the_formulas(size: tuple[int, int], cfa: str, method: Any) -> None:
    """Every size, every number, float32 against float64, whose way is the formulas."""
    taker = camera(cfa, demosaic=method, tone="filmic")
    dn = torch.randint(0, 4096, (2, 1, *size), generator=torch.Generator().manual_seed(5)).float()
    for gain_db in (0.0, 12.0):
        quick = develop(dn, taker, gain_db=gain_db)
        assert quick.dtype == torch.float32
        assert quick.is_contiguous(memory_format=torch.channels_last) or quick.numel() < 64  # in 16 bits
        slow = develop(dn.double(), taker, gain_db=gain_db)
        coded = 4 * 3.5 / 32768 * 12.92 * 10 ** (gain_db / 20) * 1.5  # steps, matrix, tone, gain
        torch.testing.assert_close(quick.double(), slow, rtol=0, atol=coded)
        assert torch.equal(develop_8bit(dn, taker, gain_db).float(), (quick * 255).round())
        assert torch.equal(develop(dn.short(), taker, gain_db=gain_db), quick)


def test_made_up_steps_take_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind a mosaic: pointwise ones in the table, others by the formulas; before it all by the formulas."""

    half = steps.PictureStep("half", lambda picture, at: picture / 2)
    turned = steps.PictureStep("turned", lambda picture, at: picture.flip(-1), pointwise=False)
    taker = camera()
    dn = torch.randint(300, 1000, (1, 1, 8, 9), generator=torch.Generator().manual_seed(5)).float()
    plain = develop(dn, taker)
    monkeypatch.setattr(steps, "STEPS", (*steps.STEPS, half, turned))
    torch.testing.assert_close(develop(dn, taker), plain.flip(-1) / 2)
    torch.testing.assert_close(develop(dn.double(), taker).float(), plain.flip(-1) / 2, rtol=0, atol=5e-3)
    assert torch.equal(develop_8bit(dn, taker), (plain.flip(-1) / 2 * 255).round().byte())
    monkeypatch.setattr(steps, "STEPS", (steps.BLACK_LEVEL, half, *steps.STEPS[1:-2]))
    halved = develop(dn, taker, encoding="linear")
    monkeypatch.undo()
    torch.testing.assert_close(halved, develop(dn, taker, encoding="linear") / 2, rtol=0, atol=1e-6)


def noisy_grey(taker: Camera, side: int = 600) -> torch.Tensor:
    """Shot noise alone on grey, developed to linear light, green's variance before demosaicing being 1."""
    wide = replace(
        taker,
        read_noise_e=0.0,
        black_level_dn=400.0,
        full_well_e=1e6,
        system_gain_dn_per_e=0.03,
        bit_depth=16,
    )
    white_e = 1e5
    lux = white_e / electrons_per_lux_s(wide)
    dn = simulate(torch.full((1, 3, side, side), 0.5), wide, encoding="linear", exposure_s=1.0,
                  illuminance_lux=lux, generator=[11], quantised=False)  # fmt: skip
    light = dn.double()
    at = steps.Development(wide, encoding="linear")
    for step in steps.active(wide):
        light = step.apply(light, at)
    per_electron = 0.03 / (wide.full_scale_dn - 400)
    return (light - light.mean((-2, -1), keepdim=True))[0] / (per_electron * (0.5 * white_e) ** 0.5)


def test_noise_of_bilinear_colours() -> None:
    """Mean pixel variance 5/8 of green's, 9/16 of red's and blue's; at low frequencies twice and four times."""
    noise = noisy_grey(camera(quantum_efficiency=EVEN, ccm=None))
    blocks = 20
    for channel, pixel, low in zip(noise, (9 / 16, 5 / 8, 9 / 16), (4.0, 2.0, 4.0), strict=True):
        # neighbours are correlated: as if one value in four were independent
        assert float(channel.var()) == pytest.approx(pixel, rel=5 * (2 / (channel.numel() / 4)) ** 0.5)
        means = channel.unfold(0, blocks, blocks).unfold(1, blocks, blocks).mean((-2, -1))
        # a block's border pixels share values with its neighbours' blocks: 5 % for 20 pixels
        expected = low / blocks**2
        assert float(means.var()) == pytest.approx(expected, rel=5 * (2 / means.numel()) ** 0.5 + 0.05)


def test_noise_after_a_colour_matrix() -> None:
    """Sigma' = M diag(g) M^T: AR0231's white balance 1.155, 1, 1.237 and matrix: 1.627, 1.587, 2.372, RG -.42."""
    curves = FilterCurves(red=0.5 / 1.155**2, green=0.5, blue=0.5 / 1.237**2)
    taker = camera(quantum_efficiency=curves)
    gains = np.array(steps.site_gains(taker))[[0, 1, 3]]
    assert gains**0.5 == pytest.approx((1.155, 1, 1.237), abs=1e-3)
    noise = noisy_grey(replace(taker, ccm=None))
    plane = np.diag(gains)  # shot noise of each filter after its gain
    mixed = np.array(AR0231) @ plane @ np.array(AR0231).T
    assert np.sqrt(np.diag(mixed)) == pytest.approx((1.627, 1.587, 2.372), abs=2e-3)
    assert mixed[0, 1] / np.sqrt(mixed[0, 0] * mixed[1, 1]) == pytest.approx(-0.42, abs=0.01)
    assert steps.magnification(taker) >= 2.372
    # Demosaiced channels share no values but of their own filter, so the law holds with their own variances.
    variances = np.diag([float(channel.var()) for channel in noise])
    assert np.diag(variances) == pytest.approx(gains * (9 / 16, 5 / 8, 9 / 16), rel=0.02)
    corrected = noisy_grey(taker).flatten(1).numpy()
    luma = np.array([0.2126, 0.7152, 0.0722]) @ corrected
    means = torch.from_numpy(luma).view(600, 600).unfold(0, 20, 20).unfold(1, 20, 20).mean((-2, -1))
    # 1.495 where green's own is 1 and a sensor for each colour gives 0.750: as in a quarter of the light
    assert 20 * float(means.std()) == pytest.approx(1.495, rel=5 * (1 / 2 / means.numel()) ** 0.5 + 0.03)
    covariance = np.array(AR0231) @ variances @ np.array(AR0231).T
    assert np.cov(corrected) == pytest.approx(covariance, rel=0.02, abs=0.02)


def test_wrong_shapes_are_named() -> None:
    for shape in ((1, 3, 8, 8), (8, 8), (1, 1, 1, 8)):
        for function in (develop, develop_8bit):
            with pytest.raises(ValueError, match=r"dn: shape is .*; cfa = 'RGGB' needs \(B, 1, H, W\)"):
                function(torch.full(shape, 100.0), camera())
    with pytest.raises(TypeError, match="illuminant = 5: must be"):
        develop(torch.ones(1, 1, 4, 4), camera(), illuminant=5)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", METHODS)
def test_derivatives_are_those_of_means(method: Any) -> None:
    raw = torch.rand(1, 1, 6, 7, generator=torch.Generator().manual_seed(1)).double().requires_grad_()
    seen = demosaic(raw, "GBRG", method)
    torch.testing.assert_close(seen.detach(), demosaic(raw.detach(), "GBRG", method), rtol=0, atol=1e-7)
    seen.sum().backward()
    smooth = raw.detach().clone().requires_grad_()
    demosaic(smooth, "GBRG", "bilinear").sum().backward()
    assert torch.equal(raw.grad, smooth.grad)  # type: ignore[arg-type]
    dn = (raw.detach() * 4000).requires_grad_()
    develop(dn, camera(demosaic=method)).sum().backward()
    assert dn.grad is not None
    assert torch.isfinite(dn.grad).all()
