"""Captures and pulsed lamps: SNR at the switches, noise of the blend, ghosts in closed form; lamps row by row."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from exposed_frames import batched, raw_frames

from blurnoise import (
    AutoExposure,
    Camera,
    Exposure,
    Layer,
    Pwm,
    Scene,
    TakeOptions,
    Trajectory,
    develop,
    simulate,
    take,
    take_each,
)
from blurnoise.camera.captures import Capture, staggered
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.picture import fusion
from blurnoise.picture.fusion import fuse

IMX250 = Camera.preset("imx250")
WELL_E = 10715.0
FINE = IMX250.with_figures(
    bit_depth=16, system_gain_dn_per_e=(65535 - IMX250.sensor.black_level_dn) / WELL_E
)  # no rounding to speak of
LIT = {"exposure_s": 0.01, "illuminance_lux": 1.0}
CLEAN: dict[str, Any] = {"noise": False, "quantised": False}


def dual_gain(gain_db):
    """One exposure read at a gain and at 0 dB: nothing moves between the two."""
    return Capture(gain_db=gain_db), Capture(start_s=0.0)


def lit(camera, exposure_s=0.01):
    """Light under which white fills the well in the first exposure."""
    return {"exposure_s": exposure_s, "illuminance_lux": WELL_E / electrons_per_lux_s(camera) / exposure_s}


def having(captures, camera=FINE):
    return camera.with_figures(captures=tuple(captures))


def fused(light, camera, captures, **taken):
    """Electrons of the first capture."""
    return fuse(raw_frames(light, camera, captures, **{**lit(camera), **taken}), having(captures, camera))


def flat(electrons, captures, camera=FINE):
    """Fused electrons of an even scene, 120 000 pixels."""
    return fused(torch.full((1, 1, 300, 400), electrons / WELL_E), camera, captures, generator=[1]).double()


@pytest.mark.parametrize(
    ("ratio", "above_db", "range_db"), [(4, 34.27, 83.1), (16, 28.22, 95.1), (256, 15.64, 119.2)]
)
def test_snr_falls_at_the_switch_and_range_grows(ratio, above_db, range_db):
    assert fusion.snr_db(having((Capture(),)), WELL_E) == pytest.approx(40.30, abs=0.005)
    assert fusion.snr_db(having(staggered(ratio)), WELL_E) == pytest.approx(above_db, abs=0.006)
    assert fusion.dynamic_range_db(having((Capture(),))) == pytest.approx(71.1, abs=0.05)
    assert fusion.dynamic_range_db(having(staggered(ratio))) == pytest.approx(range_db, abs=0.05)


@pytest.mark.parametrize(("electrons", "std_e"), [(9300.0, 184.9), (10_000.0, 357.7), (20_000.0, 565.0)])
def test_the_blend_is_unbiased_and_its_noise_is_known(electrons, std_e):
    """5 deviations of a sample's of 120 000 pixels, and 1 % for weights that follow the noisy value."""
    seen = flat(electrons, staggered(16))
    assert float(seen.mean()) == pytest.approx(electrons, rel=1e-3)
    assert float(seen.std()) == pytest.approx(std_e, rel=5 / math.sqrt(2 * seen.numel()) + 0.002)
    if electrons != 10_000.0:  # where weights follow the noisy value most
        assert fusion.noise_e(having(staggered(16)), electrons) == pytest.approx(std_e, rel=0.01)


@pytest.mark.parametrize("second_db", [0.0, 6.0])
@pytest.mark.parametrize("share", [0.5, 0.875, 0.92])
def test_two_gains_on_one_exposure_share_their_noise_in_the_blend(second_db, share):
    captures = Capture(gain_db=12.0), Capture(gain_db=second_db, start_s=0.0)
    electrons = share * fusion.saturations_e(having(captures))[0]
    seen = float(flat(electrons, captures).std())
    assert fusion.noise_e(having(captures), electrons) == pytest.approx(
        seen, rel=5 / math.sqrt(240_000) + 0.006
    )


def test_dark_current_is_noise_of_every_capture():
    """6000 e- of it in the first exposure, 375 in the second; without them the first would have 22 e-, not 81."""
    warm = FINE.with_figures(dark_current_e_s=6e5, dark_reference_c=25.0, dark_doubling_c=8.0)
    for electrons in (500.0, 40_000.0):
        expected = fusion.noise_e(having(staggered(16), warm), electrons, dark_e=6000.0)
        found = float(flat(electrons, staggered(16), warm).std())
        assert found == pytest.approx(expected, rel=5 / math.sqrt(240_000))


@pytest.mark.parametrize(
    ("captures", "most"),
    [
        (staggered(4), 4),
        (staggered(16, 256), 256),
        ((Capture(gain_db=12.0), Capture(start_s=0.0), Capture(sensitivity=0.05, start_s=0.0)), 19),
    ],
)
def test_static_and_noise_free_it_is_linear_to_the_last_saturation(captures, most):
    light = torch.linspace(0, most, 501, dtype=torch.float64)[None, None, None]
    torch.testing.assert_close(fused(light, IMX250, captures, **CLEAN), light * WELL_E, rtol=1e-6, atol=1e-3)
    beyond = float(fused(2 * light[..., -1:], IMX250, captures, **CLEAN))
    assert beyond == pytest.approx(WELL_E * (20 if most == 19 else most), rel=1e-3)


def test_the_first_capture_is_the_plain_frame_to_the_bit():
    light = torch.rand(2, 3, 17, 23, generator=torch.Generator().manual_seed(1))
    at: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 60.0, "velocity_px_s": (400.0, -90.0)}
    seeds = {"generator": [4, 9]}
    several = IMX250.with_figures(captures=staggered(16))
    plain = simulate(light, IMX250, encoding="linear", **at, **seeds)
    first, second = simulate(light, several, encoding="linear", **at, **seeds)
    (alone,) = raw_frames(light, IMX250, (Capture(),), **at, **seeds)
    steady, _ = raw_frames(light, several, lamp=Pwm(90.0, 1.0), **at, **seeds)
    assert all(torch.equal(plain, frame) for frame in (alone, first, steady))
    expected = (plain - IMX250.sensor.black_level_dn) / IMX250.sensor.system_gain_dn_per_e
    torch.testing.assert_close(fuse([alone], IMX250), expected)
    last_alone = simulate(light[1:], several, encoding="linear", **at, generator=[9])
    assert torch.equal(torch.stack([first, second])[:, 1:], last_alone)


def test_gradients_pass_the_captures_and_their_fusion():
    """Against differences: light of one pixel in the fused picture, moving and under a lamp."""
    camera, light = (
        FINE.with_figures(captures=staggered(4)),
        torch.full((1, 1, 6, 9), 0.4, dtype=torch.float64),
    )
    exposure = Exposure(
        camera, **batched(lit(camera), 1), velocity_px_s=(300.0, 0.0), lamp=Pwm(90.0, 0.6), seed=[1]
    )
    options = TakeOptions(noise=False, quantised=False, encoding="linear", white=4.0)

    def pixel(light):
        return take(Scene(light), exposure, options).picture[0, 0, 3, 4]

    asked = light.clone().requires_grad_()
    pixel(asked).backward()
    step = torch.zeros_like(light)
    step[0, 0, 3, 3] = 1e-5
    low, high = (float(pixel((light + way * step).requires_grad_()).detach()) for way in (-1, 1))
    assert float(asked.grad[0, 0, 3, 3]) == pytest.approx((high - low) / 2e-5, rel=1e-4)
    assert float(asked.grad[0, 0, 3, 3]) > 0.01


def test_captures_share_electrons_on_one_exposure_and_draw_their_own_on_two():
    light = torch.full((1, 1, 120, 200), 0.2)
    for captures, low, high in ((dual_gain(12.0), 0.99, 1.0), (staggered(1), -0.03, 0.03)):
        frames = raw_frames(light, FINE, captures, generator=[4], **lit(FINE))
        assert low < float(torch.corrcoef(torch.stack(frames).flatten(1))[0, 1]) <= high


FINENESS = 16  # samples to a pixel, so that edges are where they are
X = (torch.arange(80 * FINENESS) + 0.5) / FINENESS - 40.0
MOVED: dict[str, Any] = {**CLEAN, "velocity_px_s": (1000.0 * FINENESS, 0.0)}


@pytest.mark.parametrize(
    ("captures", "edges"), [(staggered(16), [-13.75, -12.5, -4.92, 13.75]), (dual_gain(0.0), [-13.75, 13.75])]
)
def test_ghosts_of_a_bar(monkeypatch, captures, edges):
    """20 px wide, four times as bright as what saturates capture 1, moving 10 px during it; R = 16. Capture 1
    saturates to +-(w/2 + L(1/2 - 1/4)) = +-12.5; the bar of capture 2 begins at 5.31 - 10; between is a dark notch.
    """
    monkeypatch.setattr(fusion, "BLEND", (0.999, 1.0))
    light = torch.where(X.abs() < 10, 4.0, 0.0)[None, None, None]
    seen = fused(light, IMX250, captures, **MOVED).flatten() / WELL_E
    found = X[:-1][(seen[:-1] > 0.5) != (seen[1:] > 0.5)].tolist()
    assert found == pytest.approx(edges, abs=0.1)
    if len(edges) == 4:
        assert float(seen[(X > -12.4) & (X < -5.1)].abs().max()) < 0.05


def test_the_second_capture_lies_5_31_px_further_per_1000_px_s():
    """Read alone: centres (10 + 0.625) / 2 ms apart, and 1 px further for each ms of gap."""
    light = torch.where(X.abs() < 10, 0.5, 0.0)[None, None, None]
    for start_s, expected_px in ((None, 5.3125), (0.012, 7.3125)):
        captures = (Capture(), Capture(exposure_ratio=16, start_s=start_s))
        _, second = raw_frames(light, IMX250, captures, **lit(IMX250), **MOVED)
        weights = (second - IMX250.sensor.black_level_dn).flatten()
        assert float((weights * X).sum() / weights.sum()) == pytest.approx(expected_px, abs=0.02)


@pytest.mark.parametrize(("name", "full_well_e"), [("imx250", WELL_E), ("imx250c", 5000.0)])
def test_developed_white_is_white(name, full_well_e):
    """Of a mosaic, too, and where the well ends below the converter's range."""
    camera = Camera.preset(name).with_figures(full_well_e=full_well_e)
    light = torch.full((1, 3, 8, 10), 8.0)
    light[..., 5:] = 4.0
    camera = camera.with_figures(captures=staggered(16, 64))
    dn = torch.stack(raw_frames(light, camera, **lit(camera), **CLEAN))
    seen = develop(dn, camera, white_e=8 * WELL_E)
    assert seen.shape == light.shape
    assert float(seen[..., :3].min()) == pytest.approx(1.0, abs=1e-3)
    half = float(srgb_from_linear(torch.tensor(0.5)))
    assert float(seen[..., 8:].mean()) == pytest.approx(half, abs=2e-3)


LED = Pwm(90.0, 0.1)


@pytest.mark.parametrize(
    ("captures", "message"),
    [
        ((Capture(), Capture(16.0, start_s=0.005)), "number 2, 5 to 5.625 ms, overlaps number 1, 0 to 10 ms"),
        ((Capture(start_s=0.001),), "start_s of the first is 0.001; must be 0"),
        ((Capture(), Capture(0.5)), "number 2 saturates at 5358 e- of"),
    ],
)
def test_captures_that_cannot_be_taken_are_named(captures, message):
    with pytest.raises(ValueError, match=message) as error:
        raw_frames(torch.ones(1, 1, 2, 3), IMX250, captures, **LIT)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fuse([torch.ones(1, 1, 2, 3)], having(staggered(16))), "must be one per capture, 2"),
        (lambda: develop(torch.ones(1, 1, 2, 3), having(staggered(16))), r"must be \(2, B, C, H, W\)"),
        (lambda: develop(torch.ones(2, 1, 1, 2, 3), having(staggered(16))), "white_e: must be specified"),
        (lambda: Scene(torch.ones(1, 1, 2, 3), lamp_mask=torch.ones(3, 2)), "lamp_mask: shape is"),
        (lambda: Scene(torch.ones(1, 1, 2, 3), lamp_mask=2 * torch.ones(2, 3)), "lamp_mask: must lie"),
        (lambda: list(take_each(Scene(torch.ones(1, 1, 2, 3)), [0.01])), "exposure: must be a blurnoise"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_a_lamp_s_mask_says_which_pixels_it_lights():
    """Of light 0.5 a pulse of 0.1 at its start gives 10 times the mean; a pixel of share 1/4 gets a quarter of it."""
    mask = torch.zeros(4, 6)
    mask[1, 2], mask[2, 4] = 1.0, 0.25
    light = torch.full((1, 1, 4, 6), 0.02)
    at = {**lit(FINE, 0.001), **CLEAN}
    (dark,), (seen,) = (raw_frames(light, FINE, lamp=lamp, lamp_mask=mask, **at) for lamp in (None, LED))
    ratio = ((seen - FINE.sensor.black_level_dn) / (dark - FINE.sensor.black_level_dn))[0, 0]
    assert float(ratio[1, 2]) == pytest.approx(10.0, rel=1e-5)
    assert float(ratio[2, 4]) == pytest.approx(1 + 0.25 * 9, rel=1e-5)
    assert int((ratio - 1).abs().gt(1e-5).sum()) == 2


def test_pictures_without_a_lamp_have_layers_as_in_steady_light():
    layers = [Layer(torch.full((1, 3, 4), 0.7), torch.ones(3, 4), (300.0, 0.0), (2, 1))]
    scene = Scene(torch.full((2, 1, 8, 9), 0.3), layers=layers)
    times = torch.full((2,), 0.01)
    options = TakeOptions(("raw",))
    several = IMX250.with_figures(captures=staggered(16))
    steady, lit_by_lamp = (
        take(scene, Exposure(several, times, 50.0, seed=[1, 2], lamp=lamp), options).raw
        for lamp in (None, [None, LED])
    )
    for one, other in zip(steady, lit_by_lamp, strict=True):
        assert torch.equal(one[0], other[0])
        assert not torch.equal(one[1], other[1])


@pytest.mark.parametrize("captures", [(), staggered(4)])
def test_exposures_share_a_path_s_blur_only_if_they_last_alike(captures):
    """At rest but for the path, of which a longer exposure sees more."""
    scene = Scene(torch.rand(1, 1, 24, 31, generator=torch.Generator().manual_seed(1)))
    path = Trajectory((-0.1, 0.0, 0.1), (0.0, 80.0, 0.0), (0.0, 30.0, 0.0))
    camera = IMX250.with_figures(captures=captures)
    exposures = [
        Exposure(camera, exposure_s, 60.0, seed=1, trajectory=path) for exposure_s in (0.002, 0.01, 0.002)
    ]
    for exposure, frames in zip(exposures, take_each(scene, exposures), strict=True):
        (alone,) = take_each(scene, [exposure])
        assert torch.equal(frames.eight_bit, alone.eight_bit)


def test_a_path_goes_on_in_the_next_capture():
    """At rest in the first, then 16 000 px/s for 0.625 ms: 5 px further in the middle, 10 px of blur."""
    light = torch.where(X.abs() < 10, 0.5, 0.0)[None, None, None]
    path = Trajectory((-0.005, 0.005, 0.006), (0.0, 0.0, 16.0 * FINENESS), (0.0, 0.0, 0.0))
    frames = raw_frames(light, IMX250, staggered(16), trajectory=path, **lit(IMX250), **CLEAN)
    for frame, middle_px, blur_px in zip(frames, (0.0, 5.0), (0.0, 10.0), strict=True):
        weights = (frame - IMX250.sensor.black_level_dn).flatten()
        weights = weights / weights.sum()
        mean = float((weights * X).sum())
        assert mean == pytest.approx(middle_px, abs=0.02)
        assert float((weights * (X - mean) ** 2).sum()) == pytest.approx((20**2 + blur_px**2) / 12, rel=0.01)


def test_a_lamp_goes_on_from_capture_to_capture():
    """Lit from 10 to 11 ms: dark in the first capture, in the second, 10 to 10.625 ms, 20 times its mean."""
    lamp = Pwm(50.0, 0.05, 0.5)
    light = torch.full((1, 1, 2, 3), 0.02)
    first, second = raw_frames(light, FINE, staggered(16), lamp=lamp, **lit(FINE), **CLEAN)
    assert float(first.mean()) == pytest.approx(FINE.sensor.black_level_dn)
    seen = (second - FINE.sensor.black_level_dn) / FINE.sensor.system_gain_dn_per_e
    assert float(seen.mean()) == pytest.approx(20 * 0.02 * WELL_E / 16, rel=1e-4)


@pytest.mark.parametrize("shutter", ["rolling", "global-reset"])
@pytest.mark.parametrize("scan", ["down", "up"])
def test_rows_see_the_lamp_when_they_are_exposed(shutter, scan):
    """Against the lit time of each row, counted; what a global reset adds to a row's time adds to its light."""
    camera = FINE.with_figures(width_px=4, height_px=60, row_time_s=2e-4, shutter=shutter, scan=scan)
    light = torch.full((1, 1, 60, 4), 0.02)
    (seen,) = raw_frames(light, camera, lamp=LED, **lit(camera, 0.003), **CLEAN)
    order = torch.arange(60) if scan == "down" else torch.arange(59, -1, -1)
    start_s = order * 2e-4 * (shutter == "rolling")
    lasting_s = 0.003 + order * 2e-4 * (shutter == "global-reset")
    instants = start_s[:, None] + lasting_s[:, None] * (torch.arange(20_000).double() + 0.5) / 20_000
    on_s = ((90 * instants) % 1 < 0.1).double().mean(1) * lasting_s
    expected = 0.02 * WELL_E / 0.003 * on_s / 0.1
    found = (seen[0, 0, :, 0] - camera.sensor.black_level_dn) / camera.sensor.system_gain_dn_per_e
    torch.testing.assert_close(found.double(), expected, atol=2.0, rtol=2e-3)
    assert len(expected.unique()) > 5


def test_gain_changes_the_noise_of_a_fused_picture_and_not_its_brightness():
    """Beyond the amplifier, too, where one capture has digital gain."""
    camera = IMX250.with_figures(read_noise_post_share=0.9, captures=staggered(16))
    scene = Scene(torch.full((1, 1, 90, 90), 0.2))
    seen = [
        take(
            scene, Exposure(camera, 0.01, 1.0, gain_db=gain_db, seed=1), TakeOptions(encoding="linear")
        ).picture
        for gain_db in (0.0, 12.0, 40.0)
    ]
    assert [float(each.mean()) for each in seen] == pytest.approx([0.2] * 3, rel=0.01)
    assert float(seen[0].std()) > 1.05 * float(seen[1].std())
    amplified, digital_db = fusion.amplified(camera, 40.0)
    assert [capture.gain_db for capture in amplified.sensor.captures] == [24.0, 24.0]
    assert digital_db == 16.0


def test_automatic_exposure_meters_the_first_capture():
    """At 12 dB a quarter of the time; of half the sensitivity twice as long."""
    usual = AutoExposure(frame_rate_hz=1.0)
    plain = usual.setting(IMX250, mean_light=0.2, illuminance_lux=100.0)
    amplified = IMX250.with_figures(captures=dual_gain(20 * math.log10(4)))
    assert usual.setting(amplified, mean_light=0.2, illuminance_lux=100.0).exposure_s == pytest.approx(
        plain.exposure_s / 4
    )
    halved = IMX250.with_figures(captures=(Capture(sensitivity=0.5),))
    assert usual.setting(halved, mean_light=0.2, illuminance_lux=100.0).exposure_s == pytest.approx(
        plain.exposure_s * 2
    )


@pytest.mark.parametrize("name", ["imx250", "imx250m", "imx250c"])
def test_8_bits_are_the_picture_rounded(name):
    """Of one capture and of several, with and without a lamp; grey light comes back with its channels."""
    plain = Camera.preset(name)
    light = torch.rand(1, 3, 24, 31, generator=torch.Generator().manual_seed(1))
    scene = Scene(light)
    exposures = [
        Exposure(camera, 0.01, 60.0, (200.0, 0.0), gain_db=6.0, seed=4, lamp=lamp)
        for camera in (plain, plain.with_figures(captures=staggered(16)))
        for lamp in (None, LED)
    ]
    for exposure, frames in zip(exposures, take_each(scene, exposures), strict=True):
        (image,) = frames.images()
        picture = take(scene, exposure).picture
        alone = take(scene, exposure, TakeOptions(("8 bit",))).eight_bit
        assert torch.equal(alone, frames.eight_bit)
        assert image.shape == (24, 31, 3)
        assert np.abs(image / 255 - picture[0].permute(1, 2, 0).numpy()).max() <= 0.51 / 255


@pytest.mark.parametrize(("name", "range_db"), [("ar0132x3", 111.4), ("ovsplit", 114.2)])
def test_presets_reach_the_range_of_their_captures(name, range_db):
    camera = Camera.preset(name)
    assert fusion.dynamic_range_db(camera) == pytest.approx(range_db, abs=0.1)
    ends = fusion.saturations_e(camera)
    expected = [5890.0, 94_240.0, 1_507_840.0] if name == "ar0132x3" else [22_000 * 49 / 200, 22_000, 790_000]
    assert ends == pytest.approx(expected, rel=2e-3)
