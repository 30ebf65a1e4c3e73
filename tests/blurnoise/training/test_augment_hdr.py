"""Several captures and pulsed lamps in the augmentation: noise in closed form, missed pulses, one item at a time."""

import math
from typing import Any

import pytest
import torch
from batches import pictures
from exposures import exposed

from blurnoise import Camera, RandomExposure, develop, simulate
from blurnoise.camera.captures import Capture, staggered
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.light.lamp import Pwm
from blurnoise.training.ranges import ExposureRanges

IMX250 = Camera.preset("imx250")
FINE = IMX250.with_figures(bit_depth=16, system_gain_dn_per_e=(65535 - 6) / 10715)  # no rounding to speak of
THREE = FINE.with_figures(name="three", captures=staggered(16, 256))
LED = Pwm(90.0, 0.1)
AT: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 80.0}


@pytest.mark.parametrize(("exposure_ms", "duty"), [(0.5, 0.1), (5.0, 0.1), (2.0, 0.4)])
def test_the_share_of_pictures_that_miss_the_lamp_is_known(exposure_ms, duty):
    """max(0, 1 - f T - D) of 1200 pictures, within five deviations; what is no target stays lit."""
    torch.manual_seed(3)
    where = {"lamp_hz": 90.0, "lamp_duty": duty, "lamp_lights": "targets"}
    aug = RandomExposure(
        FINE, encoding="linear", exposure_s=exposure_ms / 1e3, white_e=5000.0, speed_px_s=0.0, p=1.0, **where
    )
    masks = torch.zeros(1200, 1, 2, 4)
    masks[..., :2] = 1.0
    seen = aug(torch.full((1200, 1, 2, 4), 0.5), masks=masks)
    dark = (seen[..., :2].amax((1, 2, 3)) < 0.02).double().mean()
    expected = Pwm(90.0, duty).dark_probability(exposure_ms / 1e3)
    assert float(dark) == pytest.approx(expected, abs=5 * math.sqrt(expected * (1 - expected) / 1200))
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
    together = exposed(image, cameras, masks=masks, seeds=[5, 6, 7, 8], **given, **more)
    for item in range(4):
        own = {name: value[item : item + 1] for name, value in (given | more | {"masks": masks}).items()
               if name != "lamp_lights"}  # fmt: skip
        alone = exposed(image[item : item + 1], cameras[item], seeds=[5 + item], lamp_lights="targets", **own)
        assert torch.equal(alone, together[item : item + 1]), item


@pytest.mark.parametrize("gain_db", [6.0, 30.0])
def test_one_capture_with_a_gain_is_the_camera_at_that_gain(gain_db):
    image = pictures(2, 3, 24, 31)
    seen = exposed(
        image, IMX250.with_figures(captures=(Capture(gain_db=6.0),)), gain_db=gain_db, seeds=[1, 2], **AT
    )
    reader, digital_db = IMX250.at_gain(6.0 + gain_db)
    assert torch.equal(
        seen, develop(simulate(image, reader, generator=[1, 2], **AT), reader, gain_db=digital_db)
    )


@pytest.mark.parametrize("lights", ["all", "targets"])
def test_a_lamp_lights_targets_that_move_before_their_background(lights):
    """Its factor at rest is the factor of the cut-out, too: 1 ms from the pulse on, all of it lit."""
    image, masks = torch.full((1, 1, 40, 60), 0.5), torch.zeros(1, 1, 40, 60)
    masks[..., 10:30, 20:40] = 1.0
    lamp = {"lamp": LED, "lamp_lights": lights, "masks": masks, "encoding": "linear"}
    at: dict[str, Any] = {"exposure_s": 0.001, "illuminance_lux": 4.0, "moves": "targets"}
    moved = exposed(image, FINE, speed_px_s=4000.0, **at, **lamp)
    still = exposed(image, FINE, speed_px_s=0.0, **at, **lamp)
    middle = moved[..., 15:25, 25:35].mean() / still[..., 15:25, 25:35].mean()
    assert float(middle) == pytest.approx(1.0, abs=0.03)
    per_white = electrons_per_lux_s(FINE) * 0.001 * 4.0 / FINE.sensor.saturation_e
    assert float(still[..., 15:25, 25:35].mean()) == pytest.approx(5 * per_white, rel=0.05)


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
