"""Mosaics: which light reaches which pixel, one plane of it, and one field of noise."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from generic_filters import behind_generic_filters

from blurnoise import Camera, Exposure, Scene, develop, photoelectrons, simulate, take_each
from blurnoise.camera import radiometry
from blurnoise.camera.colour import FilterCurves, inverse
from blurnoise.camera.radiometry import colour_shares, filter_electrons
from blurnoise.picture.develop import develop_8bit, in_channels
from blurnoise.picture.steps import magnification

IMX250 = Camera.preset("imx250")
IMX250C = Camera.preset("imx250c")
CURVES = FilterCurves(red=0.3, green=0.5, blue=0.2, clear=0.6)
CONDITIONS = {"exposure_s": 0.01, "illuminance_lux": 50.0}
PATTERNS = ["RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]


def camera(cfa, **changes):
    curves = {"quantum_efficiency": CURVES} if cfa not in ("none", "mono") else {}
    return IMX250.with_figures(**{"cfa": cfa, **curves, **changes})


def light(height=15, width=21, count=2):
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("cfa", ["RGGB", "GRBG", "GBRG", "BGGR"])
def test_each_pixel_keeps_its_filters_colour(cfa):
    seen, picture = radiometry.on_sensor(light(), camera(cfa)), light()
    assert seen.shape == (2, 1, 15, 21)
    share = {"R": 0.3 / 0.5, "G": 1.0, "B": 0.2 / 0.5}
    for y in range(15):
        for x in range(21):
            letter = cfa[2 * (y % 2) + x % 2]
            expected = picture[:, "RGB".index(letter), y, x] * share[letter]
            torch.testing.assert_close(seen[:, 0, y, x], expected)


@pytest.mark.parametrize("cfa", PATTERNS)
@pytest.mark.parametrize("illuminant", ["D55", "planck:2856"])
def test_white_gives_each_filter_its_electrons(cfa, illuminant):
    taker = camera(cfa, ccm=None if cfa == "RCCC" else IMX250C.isp.ccm)
    electrons = filter_electrons(taker, illuminant)
    expected = torch.tensor([electrons[letter] for letter in cfa]) / max(electrons.values())
    for channels in (1, 3):
        seen = radiometry.on_sensor(torch.ones(1, channels, 4, 6), taker, illuminant)
        torch.testing.assert_close(seen[0, 0, :2, :2].flatten(), expected)
    assert photoelectrons(taker, 10.0, 0.001, illuminant) == pytest.approx(max(electrons.values()) * 0.01)


def test_colours_outside_the_cameras_are_no_light():
    rows = ((2.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    taker = camera("RGGB", ccm=rows)
    assert inverse(taker.isp.ccm)[0] == pytest.approx((0.5, 0.5, 0.0))
    wide = camera("RGGB", ccm=((0.5, 0.5, 0.0), *rows[1:]))  # its inverse: 2 R - G
    picture = torch.tensor([[0.2, 0.9, 0.1], [0.9, 0.2, 0.1]]).view(2, 3, 1, 1).expand(-1, -1, 4, 4)
    seen = radiometry.on_sensor(picture, wide)
    assert seen[:, 0, 0, 0].tolist() == pytest.approx([0.0, 1.6 * 0.6])
    assert radiometry.peak(wide) == pytest.approx(1.2)  # red 2 behind a filter of 0.6
    assert radiometry.peak(IMX250) == 1.0


def test_one_plane_of_colours():
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
def test_other_numbers_of_channels_are_refused(cfa):
    with pytest.raises(ValueError, match=rf"image: has 2 channels; cfa = '{cfa}' needs 1 .* or 3"):
        simulate(torch.rand(1, 2, 8, 8), camera(cfa), **CONDITIONS)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(
    ("cfa", "jpeg_quality"), [("none", 80), ("mono", None), ("RGGB", 80), ("RCCB", None), ("RCCC", None)]
)
def test_scenes_and_simulate_give_the_same_bits(cfa, jpeg_quality, channels):
    """Frames in the channels of their picture, developed for their light, at gains of both kinds."""
    coded = (light(33, 47, 1)[0, :channels].permute(1, 2, 0) * 255).round().byte().numpy()
    taker = camera(cfa, jpeg_quality=jpeg_quality, prnu=0.01, dark_current_e_s=50.0, row_noise_e=9.0)
    if taker.sensor.cfa not in ("none", "mono"):
        taker = taker.with_figures(
            quantum_efficiency=behind_generic_filters(0.6)
        )  # whose ratios are the light's
    scene = Scene.of_picture(np.ascontiguousarray(coded))
    at = [Exposure(taker, 0.004, lux, (900.0, -300.0), gain_db=27.0, seed=5) for lux in (20.0, 60.0)]
    at.append(Exposure(taker, 0.02, 60.0, seed=6))
    at = [replace(one, illuminant="planck:3000") for one in at]
    for exposure, frame in zip(at, take_each(scene, at), strict=True):
        by, digital_db = exposure.amplified
        dn = simulate(
            torch.from_numpy(coded).permute(2, 0, 1)[None] / 255, by,
            exposure_s=exposure.exposure_s, illuminance_lux=exposure.illuminance_lux,
            velocity_px_s=exposure.velocity_px_s, generator=[exposure.seed], illuminant="planck:3000",
            tolerance_dn=0.1 / 10 ** (digital_db / 20) / magnification(by, "planck:3000"),
        )  # fmt: skip
        seen = in_channels(develop_8bit(dn, by, digital_db, "planck:3000"), channels)
        (image,) = frame.images()
        assert image.shape[:2] == coded.shape[:2]
        assert np.array_equal(in_channels(frame.eight_bit, channels), seen)


def test_exposures_of_two_spectra_are_not_read_together():
    scene = Scene(light(8, 12, 1)[:, :3])
    at = [Exposure(IMX250C, 0.01, 40.0, seed=1, illuminant=name) for name in ("D55", "planck:2856", "D55")]
    several = [frame.images()[0] for frame in take_each(scene, at)]
    for one, image in zip(at, several, strict=True):
        (alone,) = take_each(scene, [one])
        assert np.array_equal(alone.images()[0], image)
    assert not np.array_equal(several[0], several[1])


def test_gradients_go_through_the_mosaic():
    """Those of the picture against differences: one pixel's red moves its own site's number."""
    picture = light(6, 8, 1).double().requires_grad_()
    taker = camera("RGGB", ccm=IMX250C.isp.ccm)
    options = {"encoding": "linear", "noise": False, "quantised": False, **CONDITIONS}

    def total(image):
        weights = torch.linspace(1, 2, 48, dtype=torch.float64).view(1, 1, 6, 8)
        return (develop(simulate(image, taker, **options), taker, encoding="linear") * weights).sum()

    total(picture).backward()
    step = torch.zeros_like(picture)
    step[0, 1, 2, 3] = 1e-4
    low, high = (float(total((picture + s * step).detach().requires_grad_()).detach()) for s in (-1, 1))
    assert float(picture.grad[0, 1, 2, 3]) == pytest.approx((high - low) / 2e-4, rel=1e-3)
