"""The dark of the presets at their highest gain: it keeps its mean and variance, so the converter does not cut it."""

import math

import pytest
import torch
from exposed_frames import raw_frames

from blurnoise import Camera
from blurnoise.camera.camera_files import PRESETS

SIDES = 300, 401
# lin2024 repeats a tool whose baseline is 0: half of its dark is cut, as in the paper's pictures.
KEEPING = [name for name in PRESETS if name != "lin2024"]
# The converter may cut what a register leaves to it: 16 DN of the OV5647 are 2.4 sigma, which costs the variance
# 1.3 % and the mean .0024 sigma.
CUT_OF_MEAN, CUT_OF_VARIANCE = 0.003, 0.014


@pytest.mark.parametrize("name", KEEPING)
def test_the_dark_keeps_its_mean_and_variance_at_the_highest_gain(name):
    camera = Camera.preset(name)
    highest_db = camera.sensor.analogue_gain_max_db
    sensor = camera.at_gain(highest_db).camera.sensor
    dark = torch.zeros(1, 3, *SIDES)
    (frame,) = raw_frames(dark, camera, (), exposure_s=1e-3, illuminance_lux=1.0, gain_db=highest_db)
    n, variance_dn2 = frame.numel(), sensor.dark_variance_dn2()
    sigma_dn, dn = math.sqrt(variance_dn2), frame.double()
    assert abs(float(dn.mean()) - sensor.black_level_dn) < sigma_dn * (5 / math.sqrt(n) + CUT_OF_MEAN)
    assert float(dn.var()) == pytest.approx(variance_dn2, rel=5 * math.sqrt(2 / n) + CUT_OF_VARIANCE)


def test_the_tool_that_lin2024_repeats_cuts_half_of_the_dark():
    (frame,) = raw_frames(
        torch.zeros(1, 1, *SIDES), Camera.preset("lin2024"), exposure_s=1e-3, illuminance_lux=1.0
    )
    assert float((frame == 0).double().mean()) == pytest.approx(0.5, abs=0.02)
