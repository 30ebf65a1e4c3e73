"""The share of a picture's pixels at a limit of the sensor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.sweep.exposing import Scene, brightest, frames, snr_db

from blurnoise import Camera, Exposure, photoelectrons

IMX250 = Camera.preset("imx250")
SMALL_WELL = replace(IMX250, full_well_e=0.3 * IMX250.full_well_e)


@pytest.mark.parametrize("camera", [IMX250, SMALL_WELL])
@pytest.mark.parametrize(
    ("lux_s", "share"),
    # White: 6906 e- per lux s. 18 % grey reaches the small well (3.2 ke-) from 2.6 lux s on, the other from 8.5.
    [(0.1, 0.0), (2.0, 0.25), (15.0, 0.75)],
)
def test_share_of_values_at_the_well_or_at_full_scale(camera: Camera, lux_s: float, share: float) -> None:
    """A quarter white, half 18 % grey, a quarter black; noise of 1 % of the well moves no grey or black there."""
    picture = np.zeros((40, 52, 3), np.uint8)
    picture[:10] = 255
    picture[10:30] = 118  # sRGB of 0.18
    conditions = Conditions(exposure_s=0.01, illuminance_lux=lux_s / 0.01)
    (frame,) = frames(Scene(picture), [Cell("p", 0, conditions, 3)], camera)
    assert frame.saturated == pytest.approx(share, abs=0.002)


@pytest.mark.parametrize("name", ["imx250", "imx250c"])
@pytest.mark.parametrize("lux", [5000.0, 20_000.0])
def test_a_pixel_counts_once_if_any_of_its_colours_is_at_the_limit(name: str, lux: float) -> None:
    """10 lux s: a quarter white and a quarter red saturate, 5 % grey and black do not; demosaicing moves an edge by
    a pixel of 40 rows."""
    picture = np.zeros((40, 52, 3), np.uint8)
    picture[:10], picture[10:20, :, 0], picture[20:30] = 255, 255, 64
    for lux_s, share in ((10.0, 0.5), (0.5, 0.0)):
        at = Conditions(exposure_s=lux_s / lux, illuminance_lux=lux)
        (frame,) = frames(Scene(picture), [Cell("p", 0, at, 3)], Camera.preset(name))
        assert frame.saturated == pytest.approx(share, abs=0.03)


def test_an_untouched_picture_has_none() -> None:
    (frame,) = frames(Scene(np.full((8, 9, 3), 255, np.uint8)), [Cell("p", 0, None, 0)], IMX250)
    assert frame.saturated is None


def test_the_limit_follows_well_and_digital_gain() -> None:
    at = {"exposure_s": 0.01, "illuminance_lux": 50.0}
    full = brightest(*Exposure(IMX250, **at).amplified)
    assert full >= 254
    assert brightest(*Exposure(SMALL_WELL, **at).amplified) < 160
    assert brightest(*Exposure(SMALL_WELL, **at, gain_db=20.0).amplified) == 255
    assert brightest(*Exposure(IMX250, **at, gain_db=-6.02).amplified) == pytest.approx(
        188, abs=2
    )  # sRGB of a half


def test_signal_to_noise_has_shot_dark_and_read_noise() -> None:
    """EMVA 1288: white of 0.02 lux s beside 300 e- of dark charge, 10 e- of read noise and the rounding to codes."""
    camera = replace(IMX250, dark_current_e_s=3000.0, read_noise_e=10.0, prnu=0.0, dsnu_e=0.0)
    exposure = Exposure(camera, exposure_s=0.1, illuminance_lux=0.2, temperature_c=camera.dark_reference_c)
    white_e = photoelectrons(camera, 0.2, 0.1)
    gain = camera.system_gain_dn_per_e
    noise_e = math.sqrt(white_e + 300.0 + 10.0**2 + 1 / 12 / gain**2)
    assert snr_db(exposure, 1.0) == pytest.approx(20 * math.log10(white_e / noise_e), abs=1e-3)
