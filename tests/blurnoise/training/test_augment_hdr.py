"""Several captures and pulsed lamps in the augmentation: noise in closed form, missed pulses, one item at a time."""

import importlib.util
import math
from typing import Any

import numpy as np
import pytest
import torch
from batches import one_of, pictures

from blurnoise import Camera, RandomExposure, develop, simulate
from blurnoise.camera.captures import Capture, staggered
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.light.lamp import Pwm
from blurnoise.picture import fusion
from blurnoise.training.pictures import expose_pictures
from blurnoise.training.ranges import ExposureRanges

IMX250 = Camera.preset("imx250")
FINE = IMX250.with_figures(bit_depth=16, system_gain_dn_per_e=(65535 - 6) / 10715)  # no rounding to speak of
THREE = FINE.with_figures(name="three", captures=staggered(16, 256))
LED = Pwm(90.0, 0.1)
AT: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 80.0}


def electrons(camera, mean_e, count=4, size=170):
    """Of the first capture, as the augmentation shows them where all light is alike; white is 2 mean_e."""
    aug = RandomExposure(
        camera, encoding="linear", white_e=2 * mean_e, exposure_s=0.01, speed_px_s=0.0, p=1.0
    )
    return aug(torch.full((count, 1, size, size), 0.5, dtype=torch.float64)) * 2 * mean_e


@pytest.mark.parametrize(("mean_e", "capture"), [(5000.0, 0), (60_000.0, 1), (1_000_000.0, 2)])
def test_fused_electrons_have_the_noise_of_the_capture_that_counts(mean_e, capture):
    """R sqrt(n / R + sigma^2) of capture k alone, within five deviations of 115 600 pixels'; no bias."""
    torch.manual_seed(1)
    seen = electrons(THREE, mean_e)
    ratio = (1, 16, 256)[capture]
    noise_e = ratio * math.sqrt(mean_e / ratio + 2.45**2)
    assert float(seen.std()) == pytest.approx(noise_e, rel=5 / math.sqrt(2 * seen.numel()) + 2e-3)
    assert float(seen.mean()) == pytest.approx(
        mean_e, abs=5 * noise_e / math.sqrt(seen.numel()) + 1e-4 * mean_e
    )


@pytest.mark.parametrize("share", [0.75, 1.5])
def test_snr_dips_where_the_second_capture_takes_over(share):
    """At 0.75 and 1.5 of the first one's well: 39.0 and 30.0 dB."""
    torch.manual_seed(2)
    mean_e = share * 10_715
    seen = electrons(THREE, mean_e)
    found_db = 20 * math.log10(float(seen.mean() / seen.std()))
    assert found_db == pytest.approx(fusion.snr_db(THREE, mean_e), abs=0.06)
    assert found_db == pytest.approx({0.75: 39.0, 1.5: 30.0}[share], abs=0.1)


@pytest.mark.parametrize(("exposure_ms", "duty"), [(0.5, 0.1), (5.0, 0.1), (2.0, 0.4)])
def test_the_share_of_pictures_that_miss_the_lamp_is_known(exposure_ms, duty):
    """max(0, 1 - f T - D) of 3000 pictures, within five deviations; what is no target stays lit."""
    torch.manual_seed(3)
    where = {"lamp_hz": 90.0, "lamp_duty": duty, "lamp_lights": "targets"}
    aug = RandomExposure(
        FINE, encoding="linear", exposure_s=exposure_ms / 1e3, white_e=5000.0, speed_px_s=0.0, p=1.0, **where
    )
    masks = torch.zeros(3000, 1, 2, 4)
    masks[..., :2] = 1.0
    seen = aug(torch.full((3000, 1, 2, 4), 0.5), masks=masks)
    dark = (seen[..., :2].amax((1, 2, 3)) < 0.02).double().mean()
    expected = Pwm(90.0, duty).dark_probability(exposure_ms / 1e3)
    assert float(dark) == pytest.approx(expected, abs=5 * math.sqrt(expected * (1 - expected) / 3000))
    assert float(seen[..., 2:].min()) > 0.1


def test_a_picture_depends_on_its_own_camera_lamp_and_seed_alone():
    image, masks = pictures(4, 3, 30, 41), torch.zeros(4, 1, 30, 41)
    for item in range(4):
        masks[item, :, 8 + item : 20, 10 + item : 25] = 1.0
    cameras = ["imx250", THREE, Camera.preset("imx250c").with_figures(captures=staggered(16)), THREE]
    lamps = [LED.with_phase_of(1), None, LED.with_phase_of(2), LED.with_phase_of(3)]
    given: dict[str, Any] = {
        "exposure_s": torch.tensor([0.002, 0.02, 0.004, 0.003]),
        "illuminance_lux": torch.tensor([50.0, 90.0, 300.0, 9000.0]),
        "speed_px_s": torch.tensor([400.0, 300.0, 500.0, 700.0]),
        "gain_db": torch.tensor([0.0, 6.0, 0.0, 6.0]),
    }
    more = {"lamp": lamps, "lamp_lights": "targets", "moves": ["targets", "all", "background", "all"]}
    together = expose_pictures(image, cameras, masks=masks, generator=[5, 6, 7, 8], **given, **more)
    for item in range(4):
        own = {name: value[item : item + 1] for name, value in (given | more | {"masks": masks}).items()
               if name != "lamp_lights"}  # fmt: skip
        alone = expose_pictures(
            image[item : item + 1], cameras[item], generator=[5 + item], lamp_lights="targets", **own
        )
        assert torch.equal(alone, together[item : item + 1]), item


def test_captures_lamps_and_shakes_are_replayed():
    aug = RandomExposure([THREE, "imx250"], lamp_hz=(80, 120), lamp_duty=0.2, shake_px=(1, 4), p=1.0)
    image = pictures(3, 3, 24, 31)
    first = aug(image)
    assert torch.equal(aug(image, params=aug._params), first)
    assert 80 <= float(aug._params["lamp_hz"].min()) < float(aug._params["lamp_hz"].max()) <= 120
    one = one_of(aug._params, 1)
    assert torch.equal(aug(image[1:2], params=one), first[1:2])
    assert not torch.equal(aug(image), first)


@pytest.mark.parametrize("gain_db", [6.0, 30.0])
def test_one_capture_with_a_gain_is_the_camera_at_that_gain(gain_db):
    image = pictures(2, 3, 24, 31)
    given: dict[str, Any] = {**AT, "generator": [1, 2]}
    seen = expose_pictures(
        image, IMX250.with_figures(captures=(Capture(gain_db=6.0),)), gain_db=gain_db, **given
    )
    reader, digital_db = IMX250.at_gain(6.0 + gain_db)
    assert torch.equal(seen, develop(simulate(image, reader, **given), reader, gain_db=digital_db))


@pytest.mark.parametrize("lights", ["all", "targets"])
def test_a_lamp_lights_targets_that_move_before_their_background(lights):
    """Its factor at rest is the factor of the cut-out, too: 1 ms from the pulse on, all of it lit."""
    image, masks = torch.full((1, 1, 40, 60), 0.5), torch.zeros(1, 1, 40, 60)
    masks[..., 10:30, 20:40] = 1.0
    lamp = {"lamp": LED, "lamp_lights": lights, "masks": masks, "encoding": "linear", "generator": [1]}
    at: dict[str, Any] = {"exposure_s": 0.001, "illuminance_lux": 4.0, "moves": "targets"}
    moved = expose_pictures(image, FINE, speed_px_s=4000.0, **at, **lamp)
    still = expose_pictures(image, FINE, speed_px_s=0.0, **at, **lamp)
    middle = moved[..., 15:25, 25:35].mean() / still[..., 15:25, 25:35].mean()
    assert float(middle) == pytest.approx(1.0, abs=0.03)
    per_white = electrons_per_lux_s(FINE) * 0.001 * 4.0 / FINE.sensor.saturation_e
    assert float(still[..., 15:25, 25:35].mean()) == pytest.approx(5 * per_white, rel=0.05)


def test_torchvision_and_albumentations_take_lamps_and_captures():
    if importlib.util.find_spec("torchvision") is None or importlib.util.find_spec("albumentations") is None:
        pytest.skip("torchvision or albumentations is not installed")
    import albumentations
    import torchvision_ops

    torchvision_ops.detectors()
    from torchvision import tv_tensors

    from blurnoise import albumentations as ours
    from blurnoise.training.torchvision import RandomExposureV2

    ranges: dict[str, Any] = {"exposure_s": 0.001, "white_e": 5000.0, "speed_px_s": 0.0, "p": 1.0}
    ranges |= {"lamp_hz": 90.0, "lamp_duty": 0.1, "lamp_lights": "targets", "encoding": "linear"}
    mask = np.zeros((8, 10), np.uint8)
    mask[:, :5] = 1
    torch.manual_seed(1)
    transform = RandomExposureV2(THREE, **ranges)
    compose = albumentations.Compose([ours.RandomExposure(THREE, **ranges)], seed=4)
    given = torch.full((1, 8, 10), 0.5)
    dark, count = np.zeros(2), 60
    for _ in range(count):
        seen, _ = transform(tv_tensors.Image(given), tv_tensors.Mask(torch.from_numpy(mask)[None]))
        other = compose(image=np.full((8, 10, 3), 0.5, np.float32), mask=mask)["image"].transpose(2, 0, 1)
        dark += [float(each[0, :, :5].mean()) < 0.02 for each in (seen, other)]
        assert min(float(each[0, :, 5:].min()) for each in (seen, other)) > 0.3
    expected = LED.dark_probability(0.001)
    assert dark / count == pytest.approx(expected, abs=5 * math.sqrt(expected * (1 - expected) / count))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lamp_hz": 0.0}, "lamp_hz = 0.0: must be finite and >= 0.001"),
        ({"lamp_hz": 90.0, "lamp_duty": (0.0, 0.5)}, "lamp_duty = 0.0: must be finite and > 0 and <= 1"),
        ({"lamp_hz": 90.0, "lamp_lights": "lamps"}, "lamp_lights = 'lamps': must be one of 'all', 'targets'"),
        (
            {"camera": IMX250.with_figures(captures=(Capture(), Capture(16.0, start_s=0.02))), "exposure_s": 0.03},
            "captures: number 2, 20 to 21.875 ms, overlaps number 1, 0 to 30 ms",
        ),
        ({"camera": IMX250.with_figures(captures=(Capture(), Capture(0.5)))}, "captures: number 2 saturates at"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_named(given, message):
    with pytest.raises(ValueError, match=message):
        ExposureRanges(**given)


def test_a_lamp_of_the_function_is_checked():
    with pytest.raises(TypeError, match="lamp: must be"):
        expose_pictures(pictures(1, 1, 4, 5), IMX250, lamp=[90.0], **AT)  # type: ignore[list-item]
    with pytest.raises(ValueError, match="lamp: got 2; must be one, or 3"):
        expose_pictures(pictures(3, 1, 4, 5), IMX250, lamp=[LED, None], **AT)
