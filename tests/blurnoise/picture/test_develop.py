"""Development: numbers of every type, mosaics, tone curves, JPEG: what comes back, noise, and both routes."""

import math
from typing import Any

import cv2
import kornia
import numpy as np
import pytest
import torch

from blurnoise import Camera, develop, simulate
from blurnoise._core.lookup import look_up
from blurnoise.camera import colour
from blurnoise.camera.colour import FilterCurves, srgb_from_linear
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.picture import steps
from blurnoise.picture.develop import develop_8bit, in_channels, tabulated
from blurnoise.picture.steps import demosaic
from blurnoise.scene.exposure import Exposure
from blurnoise.training.pictures import expose_pictures

CAMERA = Camera.preset("ar0237").with_figures(black_level_dn=64.0)
NUMBERS = torch.arange(0, CAMERA.sensor.full_scale_dn + 1, 7)[None, None]
LIT = {"exposure_s": 0.01, "illuminance_lux": 50.0}
IMX250, IMX250C = Camera.preset("imx250"), Camera.preset("imx250c")
AR0231 = ((1.3671875, -0.0546875, -0.3125), (-0.53125, 1.4609375, 0.0703125), (-0.578125, -0.25, 1.828125))
CURVES = FilterCurves(red=0.3, green=0.4, blue=0.25, clear=0.9)
EVEN = FilterCurves(0.4, 0.4, 0.4, 0.4)
BAYER = ["RGGB", "GRBG", "GBRG", "BGGR"]
METHODS: list[Any] = ["bilinear", "edge"]


def camera(cfa="RGGB", **changes):
    ccm = None if cfa == "RCCC" else AR0231
    return IMX250.with_figures(**{"cfa": cfa, "quantum_efficiency": CURVES, "ccm": ccm, **changes})


def flat(rgb, height=9, width=11):
    return torch.tensor(rgb).view(1, 3, 1, 1).expand(-1, -1, height, width)


def filling(taker, illuminant="D55", share=0.9):
    """Light with which white is ``share`` of the range."""
    sensor = taker.sensor
    range_e = (sensor.full_scale_dn - sensor.black_level_dn) / sensor.system_gain_dn_per_e
    lux = share * range_e / (0.01 * electrons_per_lux_s(taker, illuminant))
    return {"exposure_s": 0.01, "illuminance_lux": lux, "illuminant": illuminant}


@pytest.mark.parametrize("kind", [torch.int16, torch.int64, torch.uint16, torch.float64])
@pytest.mark.parametrize("encoding", ["srgb", "linear"])
def test_integers_are_digital_numbers(kind, encoding):
    expected = develop(NUMBERS.float(), CAMERA, encoding=encoding)  # type: ignore[arg-type]
    assert float(expected.max()) > 0.99
    found = develop(NUMBERS.to(kind), CAMERA, encoding=encoding)  # type: ignore[arg-type]
    assert found.dtype == (kind if kind.is_floating_point else torch.float32)
    assert torch.equal(found.float(), expected)
    assert torch.equal(develop_8bit(NUMBERS.to(kind), CAMERA), develop_8bit(NUMBERS.float(), CAMERA))


@pytest.mark.parametrize("kind", [torch.float32, torch.float64, torch.int64])
def test_numbers_beyond_the_converter_are_its_ends(kind):
    """A float beyond 2**31, as an integer of 32 bits, would be a negative number: black instead of white."""
    dn = torch.tensor([-5, 1 << 40, 1 << 20], dtype=torch.int64).to(kind)
    assert develop(dn, CAMERA).tolist() == pytest.approx([0.0, 1.0, 1.0])
    assert look_up(torch.tensor([3.0, 4.0]), dn).tolist() == [3.0, 4.0, 4.0]


def test_what_inference_kept_serves_gradients():
    camera = CAMERA.with_figures(prnu=0.0123, dsnu_e=1.5, read_noise_e=0.5, name="kept")
    picture = torch.full((1, 3, 21, 17), 0.5)
    with torch.inference_mode():
        first = develop(simulate(picture, camera, **LIT, generator=[1]), camera)
        assert all(not kept.is_inference() for kept in camera.sensor.fixed_pattern((3, 21, 17), 0))
    lux = torch.tensor(50.0, requires_grad=True)
    dn = simulate(picture, camera, exposure_s=0.01, illuminance_lux=lux, generator=[1])
    develop(dn, camera).mean().backward()
    assert lux.grad is not None
    assert float(lux.grad) > 0
    assert float((develop(dn, camera).detach() - first).abs().mean()) < 0.1


CHAINS = {
    "simulate": lambda image: simulate(image, CAMERA, **LIT, generator=[1, 2]),
    "expose_pictures": lambda image: expose_pictures(image, Exposure(CAMERA, **LIT)),
}


@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_compiled_code_breaks_its_graph_at_the_simulator(chain):
    picture = torch.rand(2, 3, 23, 31, generator=torch.Generator().manual_seed(3))

    def model(image):
        return 2 * chain(image / 2)

    try:
        assert torch.equal(torch.compile(model, backend="eager")(picture), model(picture))
    finally:
        torch._dynamo.reset()


def test_frames_that_were_not_rounded_keep_their_fractions_and_bytes_are_numbers():
    dn = torch.tensor([[[[252.7, 252.0, 253.0]]]], dtype=torch.float64)
    span = IMX250.sensor.full_scale_dn - IMX250.sensor.black_level_dn
    told = (develop(dn, IMX250, encoding="linear") * span + IMX250.sensor.black_level_dn).flatten().tolist()
    assert told == pytest.approx([252.7, 252.0, 253.0], abs=1e-9)
    eight = CAMERA.with_figures(bit_depth=8, black_level_dn=4.0)
    coded = torch.arange(256, dtype=torch.uint8)
    assert torch.equal(develop(coded, eight), develop(coded.float(), eight))


@pytest.mark.parametrize("illuminant", ["D55", "planck:2856"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cfa", [*BAYER, "RCCB"])
def test_flat_colours_come_back(cfa, method, illuminant):
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


@pytest.mark.parametrize("cfa", [*BAYER, "RCCC"])
def test_equal_filters_are_the_identity(cfa):
    """No matrix, equal curves, a constant: under every pattern what each camera of one plane gives."""
    at = {"noise": False, **LIT}
    grey = simulate(flat((0.4, 0.4, 0.4)), IMX250.with_figures(quantum_efficiency=0.4), **at)
    taker = camera(cfa, quantum_efficiency=EVEN, ccm=None)
    dn = simulate(flat((0.4, 0.4, 0.4)), taker, **at)
    assert torch.equal(dn, grey[:, :1])
    torch.testing.assert_close(develop(dn, taker), develop(grey, IMX250), rtol=0, atol=2e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("well", [1.0, 0.5])
def test_highlights_stay_white(method, well):
    """Light up to four times what fills the range, or a well below it: no tint, with noise as without."""
    taker = camera(demosaic=method, full_well_e=IMX250.sensor.full_well_e * well)
    levels = torch.linspace(0.05, 1.0, 40).view(-1, 1, 1, 1).expand(-1, 3, 10, 12)
    lit = {**filling(taker, share=4.0), "encoding": "linear"}
    seen = develop(simulate(levels, taker, noise=False, quantised=False, **lit), taker, encoding="linear")
    assert float((seen.amax(1) - seen.amin(1)).max()) < 3 / 4095 * 2.4
    noisy = develop(simulate(levels[25:], taker, generator=list(range(15)), **lit), taker)
    highest = srgb_from_linear(torch.tensor(steps.highest(taker))).expand_as(noisy)
    torch.testing.assert_close(noisy, highest, rtol=0, atol=1e-3)


def test_bilinear_is_kornias():
    """Within the border, where Kornia replicates; its pattern names count from the second row."""
    raw = torch.rand(2, 1, 20, 26, generator=torch.Generator().manual_seed(2))
    names = {"RGGB": "BG", "GRBG": "GB", "GBRG": "GR", "BGGR": "RG"}
    for cfa, name in names.items():
        expected = kornia.color.raw_to_rgb(raw, getattr(kornia.color.CFA, name))
        seen = demosaic(raw, cfa, "bilinear")
        torch.testing.assert_close(seen[..., 2:-2, 2:-2], expected[..., 2:-2, 2:-2])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cfa", ["RGGB", "GBRG", "RCCB", "RCCC"])
@pytest.mark.parametrize("size", [(2, 2), (3, 2), (33, 18)])
def test_integers_of_16_bits_are_the_formulas(size, cfa, method):
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


def test_made_up_steps_take_part(monkeypatch):
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
    monkeypatch.setattr(steps, "STEPS", (*steps.STEPS[:2], half, *steps.STEPS[2:-2]))
    halved = develop(dn, taker, encoding="linear")
    monkeypatch.undo()
    torch.testing.assert_close(halved, develop(dn, taker, encoding="linear") / 2, rtol=0, atol=1e-6)


def noisy_grey(taker, side=600):
    """Shot noise alone on grey, developed to linear light, green's variance before demosaicing being 1."""
    figures = {"read_noise_e": 0.0, "black_level_dn": 400.0, "full_well_e": 1e6, "bit_depth": 16}
    wide, white_e = taker.with_figures(**figures, system_gain_dn_per_e=0.03), 1e5
    lit = {"exposure_s": 1.0, "illuminance_lux": white_e / electrons_per_lux_s(wide), "encoding": "linear"}
    grey = torch.full((1, 3, side, side), 0.5)
    light = simulate(grey, wide, generator=[11], quantised=False, **lit).double()
    for step in steps.active(wide):
        light = step.apply(light, steps.Development(wide, encoding="linear"))
    per_electron = 0.03 / (wide.sensor.full_scale_dn - 400)
    return (light - light.mean((-2, -1), keepdim=True))[0] / (per_electron * (0.5 * white_e) ** 0.5)


def test_noise_after_a_colour_matrix():
    """Sigma' = M diag(g) M^T: AR0231's white balance 1.155, 1, 1.237 and matrix: 1.627, 1.587, 2.372, RG -.42."""
    curves = FilterCurves(red=0.5 / 1.155**2, green=0.5, blue=0.5 / 1.237**2)
    taker = camera(quantum_efficiency=curves)
    gains = np.array(steps.site_gains(taker))[[0, 1, 3]]
    assert gains**0.5 == pytest.approx((1.155, 1, 1.237), abs=1e-3)
    noise = noisy_grey(taker.with_figures(ccm=None))
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


@pytest.mark.parametrize("method", METHODS)
def test_derivatives_are_those_of_means(method):
    raw = torch.rand(1, 1, 6, 7, generator=torch.Generator().manual_seed(1)).double().requires_grad_()
    seen = demosaic(raw, "GBRG", method)
    torch.testing.assert_close(seen.detach(), demosaic(raw.detach(), "GBRG", method), rtol=0, atol=1e-7)
    gradients = [
        torch.autograd.grad(demosaic(raw, "GBRG", each).sum(), raw)[0] for each in (method, "bilinear")
    ]
    assert torch.equal(*gradients)
    (of_developed,) = torch.autograd.grad(develop(4000 * raw, camera(demosaic=method)).sum(), raw)
    assert torch.isfinite(of_developed).all()


def numbers(channels=3, side=24):
    """Digital numbers of something smooth, and noise."""
    y, x = torch.meshgrid(torch.arange(side), torch.arange(side + 3), indexing="ij")
    wave = 1800 + 1500 * torch.sin(x / 5.0) * torch.cos(y / 7.0)
    noise = 40 * torch.randn(2, channels, side, side + 3, generator=torch.Generator().manual_seed(1))
    return (wave + noise).round().clamp(0, 4095)


def test_points_are_joined_by_straight_lines():
    points = ((0.0, 0.1), (0.25, 0.5), (0.5, 0.5), (1.0, 0.9))
    light = torch.linspace(-0.5, 1.5, 81, dtype=torch.float64).requires_grad_()
    coded = colour.toned(light, points)
    at, values = np.array(points).T
    assert coded.detach().numpy() == pytest.approx(np.interp(light.detach().clamp(0, 1).numpy(), at, values))
    coded.sum().backward()
    assert light.grad is not None
    assert light.grad[[10, 29, 31]].tolist() == pytest.approx([0, 1.6, 0])  # at -0.25, below and above 0.25
    linear = colour.toned(light.detach(), ((0, 0), (1, 1)))
    torch.testing.assert_close(linear, light.detach().clamp(0, 1))


@pytest.mark.parametrize("curve", ["filmic", ((0.0, 0.0), (0.3, 0.7), (1.0, 1.0))])
def test_cameras_develop_by_their_curve(curve):
    taker = IMX250.with_figures(tone=curve)
    assert tabulated(taker)
    linear = develop(numbers(), taker, encoding="linear")
    assert torch.equal(linear, develop(numbers(), IMX250, encoding="linear"))
    torch.testing.assert_close(develop(numbers(), taker), colour.toned(linear, curve), rtol=0, atol=1e-6)
    assert not torch.equal(develop(numbers(), taker), develop(numbers(), IMX250))


@pytest.mark.parametrize(("taker", "channels"), [(IMX250, 3), (IMX250, 1), (IMX250C, 1)])
def test_jpeg_is_opencvs_round_trip(taker, channels):
    """Of the 8-bit picture, each by itself; in 8 bits as in floats."""
    dn = numbers(channels)
    clean = develop_8bit(dn, taker)
    for quality in (20, 95):
        filed = taker.with_figures(jpeg_quality=quality)
        assert not tabulated(filed)
        seen = develop_8bit(dn, filed)
        assert torch.equal((develop(dn, filed) * 255).round().byte(), seen)
        assert torch.equal(develop_8bit(dn[1:], filed)[0], seen[1])
        if clean.shape[1] == 3:
            given = np.ascontiguousarray(clean[0].permute(1, 2, 0).numpy()[..., ::-1])
            _, file = cv2.imencode(".jpg", given, [cv2.IMWRITE_JPEG_QUALITY, quality])
            back = cv2.imdecode(file, cv2.IMREAD_COLOR)[..., ::-1]
            assert np.array_equal(seen[0].permute(1, 2, 0).numpy(), back)
        assert float((seen.float() - clean.float()).abs().mean()) > 0.1
        linear = develop(dn, filed, encoding="linear")
        assert torch.equal(linear, develop(dn, taker, encoding="linear"))


def test_pictures_in_the_channels_of_others():
    colours = torch.tensor([200, 100, 50], dtype=torch.uint8).view(1, 3, 1, 1)
    assert in_channels(colours, 3) is colours
    assert in_channels(colours, 1).flatten().tolist() == [round(0.2126 * 200 + 0.7152 * 100 + 0.0722 * 50)]
    assert in_channels(colours[:, :1], 3).flatten().tolist() == [200, 200, 200]


@pytest.mark.parametrize(
    ("dn", "camera", "message"),
    [
        (torch.full((1, 3, 8, 8), 100.0), IMX250C, r"dn: shape is .*; cfa = 'RGGB' needs \(B, 1, H, W\)"),
        (torch.full((1, 1, 1, 8), 100.0), IMX250C, r"dn: shape is .*; cfa = 'RGGB' needs \(B, 1, H, W\)"),
        (torch.tensor([[math.nan, 1.0]]), CAMERA, "dn: contains NaN or Inf"),
        (torch.tensor([[-math.inf, 1.0]]), CAMERA, "dn: contains NaN or Inf"),
        (torch.zeros(1, 2, dtype=torch.bool), CAMERA, "dn: must be integers, float32 or float64, got torch"),
        (
            torch.zeros(1, 2, dtype=torch.float16),
            CAMERA,
            "dn: must be integers, float32 or float64, got torch",
        ),
    ],
)
def test_what_are_no_digital_numbers_is_named(dn, camera, message):
    for by in (develop, develop_8bit):
        with pytest.raises((TypeError, ValueError), match=message):
            by(dn, camera)
