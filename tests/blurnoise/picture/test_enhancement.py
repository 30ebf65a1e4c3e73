"""Noise reduction, local tone mapping and sharpening: by formulas, by gain, and the same bits whoever asks."""

from typing import Any

import cv2
import numpy as np
import pytest
import torch

from blurnoise import Camera, Capture, Exposure, Scene, simulate, take_each
from blurnoise.camera.isp import Isp, LocalTone, NoiseReduction, Sharpening
from blurnoise.picture import steps
from blurnoise.picture.develop import develop, develop_8bit, tabulated
from blurnoise.picture.enhancement import by_image, denoised, locally_toned, sharpened, steepest
from blurnoise.picture.fusion import amplified

IMX250, IMX250C = Camera.preset("imx250"), Camera.preset("imx250c")
EACH: dict[str, Any] = {
    "noise_reduction": (NoiseReduction(luma_sigma_dn=8.0, chroma_sigma_dn=16.0),),
    "local_tone": LocalTone(clip_limit=2.0, tiles=4),
    "sharpening": (Sharpening(strength=1.5, threshold_dn=1.0, limit_dn=30.0),),
}


def colours(height=37, width=52, noise=12):
    """Waves and noise, (H, W, 3)."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:height, :width]
    waves = 120 + 60 * np.sin(x / 6.0 + np.arange(3)[:, None, None]) * np.cos(y / 9.0)
    return (
        (np.moveaxis(waves, 0, -1) + rng.normal(0, noise, (height, width, 3))).clip(0, 255).astype(np.uint8)
    )


def bilateral(plane, sigma_dn, sigma_px=1.5, reach=2):
    """By its formula: weights by distance within 2 pixels, sigma 1.5 pixels, and by difference."""
    framed = np.pad(plane.astype(float), reach, mode="reflect")
    height, width = plane.shape
    total, weights = np.zeros((2, height, width))
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            if down**2 + across**2 <= reach**2:
                there = framed[reach + down :, reach + across :][:height, :width]
                by_value = np.exp(-((there - plane) ** 2) / (2 * sigma_dn**2))
                weight = by_value * np.exp(-(down**2 + across**2) / (2 * sigma_px**2))
                total, weights = total + weight * there, weights + weight
    return total / weights


def test_noise_reduction_is_a_bilateral_filter():
    grey = colours()[..., 0]
    found = denoised(grey, NoiseReduction(luma_sigma_dn=20.0, chroma_sigma_dn=99.0))
    assert np.abs(found - bilateral(grey, 20.0)).max() < 0.51
    wide = denoised(grey, NoiseReduction(luma_sigma_dn=20.0, sigma_px=3.1))
    assert np.abs(wide - bilateral(grey, 20.0, 3.1, 4)).max() < 0.51


def test_sigmas_are_of_luma_and_of_chroma():
    image = colours()
    luma, *chroma = cv2.split(cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb))
    only = denoised(image, NoiseReduction(chroma_sigma_dn=30.0))
    after = cv2.split(cv2.cvtColor(only, cv2.COLOR_RGB2YCrCb))
    inside = (only > 0).all(-1) & (only < 255).all(-1)  # where no colour was cut
    assert np.abs(after[0].astype(int) - luma)[inside].max() <= 1
    for plane, before in zip(after[1:], chroma, strict=True):
        assert np.abs(plane - bilateral(before, 30.0))[inside].max() < 1.6  # rounded there and back


def test_white_noise_is_divided_by_three():
    """Of sigma 3.2 times the noise: 3.1, to the 5 % of 5 / sqrt(2 n) and of rounding to 8 bits."""
    noisy = np.random.default_rng(2).normal(128, 8, (400, 400)).round().astype(np.uint8)
    found = denoised(noisy, NoiseReduction(luma_sigma_dn=3.2 * 8))
    assert noisy.std() / found.std() == pytest.approx(3.15, rel=0.03)


def test_strength_lets_the_rest_of_the_picture_through():
    image = colours()
    full, most = (denoised(image, NoiseReduction(0.0, 20.0, 20.0, strength)) for strength in (1.0, 0.75))
    assert np.abs(most - (0.75 * full + 0.25 * image)).max() <= 0.5 + 0.75 * 0.5  # both are rounded


def test_noise_reduction_is_nowhere_steeper_than_its_bound():
    """Of a value among neighbours half of which are larger, half smaller, by any difference."""

    def middle(value, away):
        patch = np.where(np.arange(25).reshape(5, 5) % 2, 100.0 - away, 100.0 + away)
        patch[2, 2] = value
        return bilateral(patch, 10.0)[2, 2]

    slopes = [(middle(100.01, away) - middle(99.99, away)) / 0.02 for away in range(60)]
    assert 2.4 < max(slopes) < steepest(NoiseReduction())


def test_sharpening_adds_what_a_gaussian_takes_off():
    image = colours()
    taps = np.exp(-(np.arange(-8, 9) ** 2) / (2 * 1.2**2))
    kernel = np.outer(taps, taps) / taps.sum() ** 2
    luma = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(float)
    detail = luma - cv2.filter2D(luma, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
    expected = np.clip(image + 0.8 * detail[..., None], 0, 255)
    assert np.abs(sharpened(image, Sharpening(strength=0.8, sigma_px=1.2)) - expected).max() < 0.6


def test_sharpening_keeps_its_limit_and_leaves_what_is_below_its_threshold():
    image = colours()
    change = np.abs(sharpened(image, Sharpening(strength=4.0, limit_dn=7.0)).astype(int) - image)
    assert change.max() == 7
    faint = colours(noise=0)
    assert np.array_equal(sharpened(faint, Sharpening(strength=4.0, threshold_dn=9.0)), faint)
    assert not np.array_equal(sharpened(faint, Sharpening(strength=4.0)), faint)


def test_local_tone_is_no_steeper_than_its_limit_and_keeps_chroma():
    """Numbers 10 apart come to lie limit times as far apart, or once more by what was cut off; grey stays grey."""
    ramp = np.repeat(np.arange(100, 132, dtype=np.uint8)[None], 32, axis=0)
    for limit in (1.5, 4.0):
        toned = locally_toned(ramp, LocalTone(limit, 1))[0].astype(int)
        assert 10 * limit - 2 < (toned[10:] - toned[:-10]).max() <= 10 * (limit + 1) + 1
    grey = np.repeat(ramp[..., None], 3, -1)
    assert (np.ptp(locally_toned(grey, LocalTone(2.0)), axis=-1) == 0).all()


def numbers(camera, count=3):
    light = torch.from_numpy(np.moveaxis(colours(36, 52), -1, 0) / 255).float()[None].repeat(count, 1, 1, 1)
    at: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 60.0}
    return simulate(light, camera, generator=list(range(count)), **at)


@pytest.mark.parametrize("figure", EACH)
@pytest.mark.parametrize("camera", [IMX250, IMX250C], ids=lambda camera: camera.name)
def test_bits_depend_on_neither_batch_nor_threads_nor_dtype(camera, figure):
    taker = camera.with_figures(**{figure: EACH[figure]})
    dn = numbers(taker)
    seen = develop_8bit(dn, taker)
    assert not tabulated(taker)
    assert not torch.equal(seen, develop_8bit(dn, camera))
    assert torch.equal((develop(dn, taker) * 255).round().byte(), seen)
    assert torch.equal(develop_8bit(dn[1:2].int(), taker), seen[1:2])
    before = torch.get_num_threads(), cv2.getNumThreads()
    try:
        torch.set_num_threads(1)
        cv2.setNumThreads(1)
        assert torch.equal(develop_8bit(dn, taker), seen)
    finally:
        torch.set_num_threads(before[0])
        cv2.setNumThreads(before[1])


@pytest.mark.parametrize("figure", EACH)
def test_linear_pictures_stay_and_gradients_are_refused(figure):
    taker, dn = IMX250.with_figures(**{figure: EACH[figure]}), numbers(IMX250, 1)
    linear = develop(dn, taker, encoding="linear")
    assert torch.equal(linear, develop(dn, IMX250, encoding="linear"))
    with pytest.raises(ValueError, match=rf"{figure}: has no derivative; must be off"):
        develop(dn.requires_grad_(), taker)


def test_steps_come_behind_the_tone_curve_in_the_order_of_the_table():
    taker = IMX250C.with_figures(**EACH, jpeg_quality=80)
    names = [step.name for step in steps.active(taker)]
    assert names[-5:] == ["tone", "noise reduction", "local tone", "sharpening", "JPEG"]
    dn = numbers(taker, 1)
    plain = np.moveaxis(develop_8bit(dn, IMX250C)[0].numpy(), 0, -1)
    isp = taker.isp
    toned = locally_toned(denoised(plain, isp.noise_reduction[0]), EACH["local_tone"])
    enhanced = by_image(torch.from_numpy(np.moveaxis(sharpened(toned, isp.sharpening[0]), -1, 0)), np.copy)
    assert torch.equal(develop_8bit(dn, taker.with_figures(jpeg_quality=None))[0], enhanced)


def test_strengths_are_those_of_the_whole_gain():
    """30 dB of this camera: 24 before the converter, 6 behind it."""
    table = (NoiseReduction(0.0, 2.0, 4.0), NoiseReduction(20.0, 6.0, 12.0), NoiseReduction(40.0, 16.0, 32.0))
    by_gain, alone = (
        IMX250.with_figures(noise_reduction=rows) for rows in (table, (NoiseReduction(0.0, 11.0, 22.0),))
    )
    scene = Scene.of_picture(colours())
    found, expected = (
        next(iter(take_each(scene, [Exposure(camera, 0.004, 5.0, gain_db=30.0, seed=3)]))).eight_bit
        for camera in (by_gain, alone)
    )
    assert torch.equal(found, expected)
    merged = by_gain.with_figures(captures=(Capture(gain_db=6.0), Capture(exposure_ratio=16.0)))
    assert amplified(merged, 24.0).camera.isp.noise_reduction[0].luma_sigma_dn == pytest.approx(11.0)


def test_of_one_row_every_gain_is_the_same_and_outside_a_table_it_stays():
    rows = (Sharpening(6.0, 2.0, 1.0, 20.0), Sharpening(12.0, 1.0, 3.0, 10.0))
    isp = Isp(sharpening=rows)
    assert isp.at_gain(0.0).sharpening == rows[:1]
    assert isp.at_gain(99.0).sharpening == rows[1:]
    assert isp.at_gain(9.0).at_gain(0.0) == isp.at_gain(9.0)
    assert isp.at_gain(9.0).sharpening == (Sharpening(9.0, 1.5, 2.0, 15.0),)


def test_less_is_left_out_of_frames_that_are_sharpened():
    assert steps.magnification(IMX250.with_figures(sharpening=EACH["sharpening"])) == 2.5
    assert steps.magnification(IMX250.with_figures(**EACH)) == pytest.approx(2.5 * 3 * 2.6)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 3), (5, 1)])
def test_smallest_pictures_have_every_step(height, width):
    taker = IMX250.with_figures(**EACH)
    assert develop_8bit(torch.full((1, 3, height, width), 900.0), taker).shape == (1, 3, height, width)


@pytest.mark.parametrize("subsampling", ["4:4:4", "4:2:2", "4:2:0"])
def test_jpeg_has_its_subsampling(subsampling):
    """Stripes of red and green of equal luma: across and along, chroma is gone where it is averaged."""
    stripes = np.full((32, 32, 3), (150, 74, 60), np.uint8)
    stripes[:, ::2] = (50, 125, 60)
    kept = []
    for image in (stripes, stripes.transpose(1, 0, 2)):
        picture = torch.from_numpy(image.transpose(2, 0, 1).copy())[None]
        taker = IMX250.with_figures(jpeg_quality=95, jpeg_subsampling=subsampling)
        step = steps.active(taker)[-1]
        red = step.apply(picture, steps.Development(taker))[0, 0].float()
        kept.append(bool(red.std() > 30))
    assert kept == {"4:4:4": [True, True], "4:2:2": [False, True], "4:2:0": [False, False]}[subsampling]
