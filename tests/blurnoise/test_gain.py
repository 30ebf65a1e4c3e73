"""Gain: closed forms, loops that close, and what it may not be."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from blurnoise import AutoExposure, Camera, plan, simulate
from blurnoise.optics.camera import Capture, ConversionGain, MeasuredGain
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.scene.hdr import captured, fuse, noise_e

IMX250 = Camera.preset("imx250")
DUAL = replace(
    IMX250,
    read_noise_e=6.0,
    read_noise_post_share=0.5,
    conversion_gains=(ConversionGain(12.0, 2500.0, 1.5, 0.8),),
)
MEASURED = replace(
    IMX250,
    system_gain_dn_per_e=0.4,
    row_noise_e=0.49,
    gains=(
        MeasuredGain(0.0, 0.4, 2.45, 6.0),
        MeasuredGain(6.0, 0.9, 2.0, 8.0),
        MeasuredGain(18.0, 2.5, 0.5, 4.0),
    ),
)


@given(st.floats(0.0, 24.0))
def test_analogue_gain_multiplies_k_and_divides_what_comes_after(gain_db: float) -> None:
    g, (camera, digital_db) = 10 ** (gain_db / 20), IMX250.at_gain(gain_db)
    assert digital_db == 0
    assert camera.system_gain_dn_per_e == pytest.approx(g * IMX250.system_gain_dn_per_e, rel=1e-12)
    share = IMX250.read_noise_post_share
    expected = 2.45 * math.sqrt(1 - share + share / g**2)
    assert camera.read_noise_e == pytest.approx(expected, rel=1e-12)
    assert camera.saturation_e == pytest.approx(IMX250.saturation_e / g, rel=1e-9)  # the converter's limit


def test_the_3_45_um_pregius_is_quieter_by_a_tenth_at_24_db() -> None:
    ratio = IMX250.at_gain(24.0).camera.read_noise_e / IMX250.read_noise_e
    assert ratio == pytest.approx(2.0 / 2.2, abs=0.005)  # 2.2 and 2.0 e- in the manual


def test_beyond_the_amplifier_gain_is_digital_and_noise_stays() -> None:
    at_24, (camera, digital_db) = IMX250.at_gain(24.0).camera, IMX250.at_gain(36.0)
    assert (camera, digital_db) == (at_24, pytest.approx(12.0))
    assert IMX250.at_gain(0.0) == (IMX250, 0.0)
    assert IMX250.at_gain(-6.0) == (IMX250, -6.0)


def test_a_switch_of_conversion_gain_changes_well_and_noise_not_brightness() -> None:
    below, above = (DUAL.at_gain(gain_db).camera for gain_db in (11.999, 12.0))
    assert above.system_gain_dn_per_e == pytest.approx(below.system_gain_dn_per_e, rel=2e-4)
    assert below.read_noise_e == pytest.approx(6 * math.sqrt(0.5 + 0.5 / 10 ** (11.999 / 10)))
    assert (above.full_well_e, above.read_noise_e) == (2500.0, pytest.approx(1.5))
    later = DUAL.at_gain(18.0).camera.read_noise_e
    assert later == pytest.approx(1.5 * math.sqrt(0.2 + 0.8 / 10**0.6))  # 6 dB beyond the switch


@pytest.mark.parametrize(
    ("gain_db", "gain_dn_per_e", "read_noise_e", "black_level_dn"),
    [
        (3.0, math.sqrt(0.4 * 0.9), math.sqrt(2.45 * 2.0), 7.0),
        (6.0, 0.9, 2.0, 8.0),
        (9.0, 0.9**0.75 * 2.5**0.25, 2.0**0.75 * 0.5**0.25, 7.0),
        (18.0, 2.5, 0.5, 4.0),
        (24.0, 2.5 * 10**0.3, 0.5, 4.0),  # beyond the last row
    ],
)
def test_measured_gains_are_interpolated_in_db(
    gain_db: float, gain_dn_per_e: float, read_noise_e: float, black_level_dn: float
) -> None:
    """By hand; row noise keeps its share of read noise, and a row of the camera's own figures may be left out."""
    for camera in (MEASURED, replace(MEASURED, gains=MEASURED.gains[1:])):
        found, digital_db = camera.at_gain(gain_db)
        assert digital_db == 0
        assert found.system_gain_dn_per_e == pytest.approx(gain_dn_per_e, rel=1e-12)
        assert found.read_noise_e == pytest.approx(read_noise_e, rel=1e-12)
        assert found.black_level_dn == pytest.approx(black_level_dn, rel=1e-12)
        assert found.row_noise_e == pytest.approx(0.2 * read_noise_e, rel=1e-12)
        assert found.at_gain(0.0).camera == found
    assert MEASURED.at_gain(0.0).camera == MEASURED
    assert MEASURED.at_gain(30.0) == (MEASURED.at_gain(24.0).camera, pytest.approx(6.0))


def test_plans_and_cameras_say_whether_gain_is_measured() -> None:
    assert MEASURED.gain_law == "measured at 0, 6, 18 dB, interpolated"
    assert IMX250.gain_law == "K times 10^(dB/20), read noise of two terms"
    assert DUAL.gain_law == "K times 10^(dB/20), read noise of two terms for each conversion gain"
    for camera, measured in ((MEASURED, True), (IMX250, False)):
        stages = plan(camera.at_gain(9.0).camera, exposure_s=0.01, illuminance_lux=1.0).stages
        (how,) = (each.how for each in stages if each.name == "read noise")
        assert ("measured at gains" in how) == measured


def test_automatic_gain_reaches_its_target_by_the_measured_gains() -> None:
    """The mean above black over the range, at the gain that is set; and no more than the camera has."""
    light = {"mean_light": 0.2, "illuminance_lux": 1.0, "exposure_s": 0.01}
    found = AutoExposure().setting(MEASURED, **light)
    taker, digital_db = MEASURED.at_gain(found.gain_db)
    signal_dn = taker.system_gain_dn_per_e * 0.2 * 0.01 * electrons_per_lux_s(taker) * 10 ** (digital_db / 20)
    assert 0 < found.gain_db < 48
    assert signal_dn / (4095 - taker.black_level_dn) == pytest.approx(0.18, rel=1e-9)
    assert found.reading == pytest.approx(0.18, rel=1e-9)
    assert found.gain_db != pytest.approx(AutoExposure().setting(IMX250, **light).gain_db, abs=0.5)
    assert AutoExposure().setting(MEASURED, **light | {"illuminance_lux": 1e-3}).gain_db == 48.0
    assert AutoExposure().setting(MEASURED, **light | {"illuminance_lux": 1e5}).gain_db == 0.0


def test_two_measured_gains_on_one_exposure_fuse_to_the_electrons_of_the_first() -> None:
    """Flat light: 20 000 pixels, each capture with K and black level of its own row."""
    captures = (Capture(gain_db=18.0, sensitivity=2.0), Capture(gain_db=6.0))
    frames = captured(torch.full((1, 1, 100, 200), 0.5), MEASURED, captures, exposure_s=0.01, illuminance_lux=5.0,
                      generator=[1])  # fmt: skip
    electrons = 0.5 * 0.05 * 2.0 * electrons_per_lux_s(MEASURED)
    spread = noise_e(MEASURED, captures, electrons) / math.sqrt(20_000)
    assert float(fuse(frames, MEASURED, captures).mean()) == pytest.approx(electrons, abs=5 * spread)


def test_the_bend_stays_with_the_charge() -> None:
    """6.02 dB halve what fills the converter: a point at 0.4 of the range is at 0.8, one at 0.8 beyond it."""
    bent = replace(IMX250, photon_transfer=((0.4, 0.9), (0.8, 0.3)))
    found = bent.at_gain(20 * math.log10(2)).camera
    assert [share for share, _ in found.photon_transfer] == pytest.approx([0.8, 1.0], rel=1e-9)
    for charge_e in (100.0, 4000.0, 5000.0):
        assert found.variance_factor(charge_e) == pytest.approx(bent.variance_factor(charge_e), rel=1e-9)


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"analogue_gain_max_db": 50.0}, "analogue_gain_max_db = 50.0: must be <= gain_max_db, 48"),
        ({"read_noise_post_share": 1.5}, "read_noise_post_share = 1.5"),
        ({"conversion_gains": (ConversionGain(30.0, 2500.0, 1.5),)}, "up to analogue_gain_max_db, 24"),
        ({"conversion_gains": (ConversionGain(0.0, 2500.0, 1.5),)}, "above 0"),
        (
            {"conversion_gains": (ConversionGain(9.0, 9.0, 1.0), ConversionGain(6.0, 9.0, 1.0))},
            "must increase",
        ),
        (
            {"gains": MEASURED.gains[1:], "conversion_gains": DUAL.conversion_gains},
            "conversion_gains must be empty",
        ),
        ({"gains": MEASURED.gains}, "gains: .* at 0 dB must repeat the camera's own system_gain_dn_per_e"),
        ({"gains": MEASURED.gains[2:0:-1]}, "must increase, up to analogue_gain_max_db, 24"),
        ({"gains": (MeasuredGain(30.0, 2.5, 0.5, 4.0),)}, "up to analogue_gain_max_db, 24"),
        (
            {"gains": (MeasuredGain(6.0, 2.5, 0.5, 5000.0),)},
            "black_level_dn = 5000.0: must be finite and >= 0",
        ),
        ({"photon_transfer": ((0.5, 1.0), (0.4, 1.0))}, "signal_share are .* must increase"),
        ({"photon_transfer": ((0.5, 1.0), (1.1, 1.0))}, "signal_share from 0 to 1"),
    ],
)
def test_gains_that_cannot_be_are_named(figures: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(IMX250, **figures)  # type: ignore[arg-type]


@pytest.mark.parametrize("gain_db", [48.1, -121.0, math.nan])
def test_gain_beyond_the_camera_is_an_error(gain_db: float) -> None:
    with pytest.raises(ValueError, match="gain_db"):
        IMX250.at_gain(gain_db)


def test_files_keep_conversion_gains_measured_ones_and_the_bend(tmp_path: Path) -> None:
    for camera in (DUAL, replace(MEASURED, photon_transfer=((0.2, 1.0), (0.9, 0.5)))):
        camera.save(tmp_path / "camera.yaml")
        assert Camera.load(tmp_path / "camera.yaml") == camera
    (tmp_path / "bad.yaml").write_text(
        "base: imx250\nconversion_gains: [{from_db: 6.0, full_well_e: 2000.0}]\n"
    )
    with pytest.raises(ValueError, match=r"conversion_gains: missing read_noise_e"):
        Camera.load(tmp_path / "bad.yaml")


@pytest.mark.parametrize("doublings", [1, 2, 3])
def test_exposure_traded_for_gain_costs_3_01_db_per_doubling_where_shot_noise_rules(doublings: int) -> None:
    quiet = replace(IMX250, read_noise_e=0.0, read_noise_post_share=0.0, bit_depth=16, black_level_dn=0.0,
                    system_gain_dn_per_e=65535 / 10715)  # fmt: skip
    exposure_s = 0.016
    snr, dn = [], []
    for count in (0, doublings):
        camera = quiet.at_gain(count * 20 * math.log10(2)).camera
        flat = torch.full((1, 1, 300, 400), 0.18)
        frame = simulate(flat, camera, exposure_s=exposure_s / 2**count, illuminance_lux=40.0,
                         encoding="linear", generator=[count], fidelity="full").double()  # fmt: skip
        snr.append(20 * math.log10(float(frame.mean() / frame.std())))
        dn.append(float(frame.mean()))
    # Over 120 000 pixels a standard deviation is known to 0.2 % or 0.018 dB, a difference to 0.025: five of them.
    assert snr[0] - snr[1] == pytest.approx(doublings * 10 * math.log10(2), abs=0.13)
    assert dn[1] == pytest.approx(dn[0], rel=1.5e-3)  # 99 e- or more in 120 000 pixels: 2.9e-4, five of them
