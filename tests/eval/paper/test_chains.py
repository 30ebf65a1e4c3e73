"""The paper's chain, pixel by pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from blurnoise_eval.paper import measurement as chains

from blurnoise import charts
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.scene.scene import ExposedScene, Exposure

SIDE: Any = {"height_px": 320, "width_px": 320}


def test_the_paper_s_light_is_the_grey_of_coded_values() -> None:
    red, green, blue = srgb_from_linear(charts.stop_sign(50, **SIDE)[0])
    scene = ExposedScene.of_picture(chains.picture("paper", 50))
    assert scene.light.shape == (1, 3, 320, 320)
    for plane in scene.light[0]:
        torch.testing.assert_close(plane, 0.2989 * red + 0.5870 * green + 0.1140 * blue, atol=2e-5, rtol=0)


def test_the_paper_s_picture_is_linear_grey_with_one_noise() -> None:
    camera = chains.camera_of("paper")
    scene = ExposedScene.of_picture(chains.picture("paper", 50))
    (frame,) = scene.frames([Exposure(camera, 5e-3, 50.0)])
    assert (frame.picture == frame.picture[..., :1]).all()
    corner = frame.picture[:80, :80, 0]  # 18 % grey, coded as 0.461
    white = photoelectrons(camera, 50.0, 5e-3) * camera.system_gain_dn_per_e / camera.full_scale_dn * 255
    coded = float(srgb_from_linear(torch.tensor(0.18)))
    assert corner.mean() == pytest.approx(coded * white, rel=0.01)
    assert np.ptp(corner) > 0
