"""Gain: closed forms, loops that close, and what it may not be."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blurnoise import AutoExposure, Camera
from blurnoise.camera.gain import ConversionGain, MeasuredGain
from blurnoise.camera.radiometry import electrons_per_lux_s

IMX250 = Camera.preset("imx250")
DUAL = IMX250.with_figures(
    read_noise_e=6.0,
    read_noise_post_share=0.5,
    conversion_gains=(ConversionGain(12.0, 2500.0, 1.5, 0.8),),
)
MEASURED = IMX250.with_figures(
    system_gain_dn_per_e=0.4,
    black_level_dn=6.0,
    row_noise_e=0.49,
    gains=(
        MeasuredGain(0.0, 0.4, 2.45, 6.0),
        MeasuredGain(6.0, 0.9, 2.0, 8.0),
        MeasuredGain(18.0, 2.5, 0.5, 4.0),
    ),
)


@given(st.floats(0.0, 24.0))
def test_analogue_gain_multiplies_k_and_divides_what_comes_after(gain_db):
    g, (camera, digital_db) = 10 ** (gain_db / 20), IMX250.at_gain(gain_db)
    assert digital_db == 0
    assert camera.sensor.system_gain_dn_per_e == pytest.approx(
        g * IMX250.sensor.system_gain_dn_per_e, rel=1e-12
    )
    share = IMX250.sensor.read_noise_post_share
    expected = 2.45 * math.sqrt(1 - share + share / g**2)
    assert camera.sensor.read_noise_e == pytest.approx(expected, rel=1e-12)
    assert camera.sensor.saturation_e == pytest.approx(IMX250.sensor.saturation_e / g, rel=1e-9)


def test_beyond_the_amplifier_gain_is_digital_and_noise_stays():
    at_24, (camera, digital_db) = IMX250.at_gain(24.0).camera, IMX250.at_gain(36.0)
    assert (camera, digital_db) == (at_24, pytest.approx(12.0))
    assert IMX250.at_gain(0.0) == (IMX250, 0.0)
    assert IMX250.at_gain(-6.0) == (IMX250, -6.0)


def test_a_switch_of_conversion_gain_changes_well_and_noise_not_brightness():
    below, above = (DUAL.at_gain(gain_db).camera for gain_db in (11.999, 12.0))
    assert above.sensor.system_gain_dn_per_e == pytest.approx(below.sensor.system_gain_dn_per_e, rel=2e-4)
    assert below.sensor.read_noise_e == pytest.approx(6 * math.sqrt(0.5 + 0.5 / 10 ** (11.999 / 10)))
    assert (above.sensor.full_well_e, above.sensor.read_noise_e) == (2500.0, pytest.approx(1.5))
    later = DUAL.at_gain(18.0).camera.sensor.read_noise_e
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
def test_measured_gains_are_interpolated_in_db(gain_db, gain_dn_per_e, read_noise_e, black_level_dn):
    """By hand; row noise keeps its share of read noise, and a row of the camera's own figures may be left out."""
    for camera in (MEASURED, MEASURED.with_figures(gains=MEASURED.sensor.gains[1:])):
        found, digital_db = camera.at_gain(gain_db)
        assert digital_db == 0
        assert found.sensor.system_gain_dn_per_e == pytest.approx(gain_dn_per_e, rel=1e-12)
        assert found.sensor.read_noise_e == pytest.approx(read_noise_e, rel=1e-12)
        assert found.sensor.black_level_dn == pytest.approx(black_level_dn, rel=1e-12)
        assert found.sensor.row_noise_e == pytest.approx(0.2 * read_noise_e, rel=1e-12)
        assert found.at_gain(0.0).camera == found
    assert MEASURED.at_gain(0.0).camera == MEASURED
    assert MEASURED.at_gain(30.0) == (MEASURED.at_gain(24.0).camera, pytest.approx(6.0))


@pytest.mark.parametrize(("lux", "gain_db"), [(1.0, None), (1e-3, 48.0), (1e5, 0.0)])
def test_automatic_gain_reaches_its_target_by_the_measured_gains(lux, gain_db):
    """The mean above black over the range, at the gain that is set; and no more than the camera has."""
    found = AutoExposure().setting(MEASURED, mean_light=0.2, illuminance_lux=lux, exposure_s=0.01)
    camera, digital_db = MEASURED.at_gain(found.gain_db)
    k = camera.sensor.system_gain_dn_per_e * 10 ** (digital_db / 20)
    signal_dn = k * 0.2 * lux * 0.01 * electrons_per_lux_s(camera)
    assert found.reading == pytest.approx(signal_dn / (4095 - camera.sensor.black_level_dn), rel=0.002)
    if gain_db is None:
        assert found.reading == pytest.approx(0.18, rel=1e-9)
    else:
        assert found.gain_db == gain_db


def test_the_bend_stays_with_the_charge():
    """6.02 dB halve what fills the converter: a point at 0.4 of the range is at 0.8, one at 0.8 beyond it."""
    bent = IMX250.with_figures(photon_transfer=((0.4, 0.9), (0.8, 0.3)))
    found = bent.at_gain(20 * math.log10(2)).camera
    assert [share for share, _ in found.sensor.photon_transfer] == pytest.approx([0.8, 1.0], rel=1e-9)
    for charge_e in (100.0, 4000.0, 5000.0):
        factor = bent.sensor.variance_factor(charge_e)
        assert found.sensor.variance_factor(charge_e) == pytest.approx(factor, rel=1e-9)


REFUSED = [
    ("must be <= gain_max_db, 48", {"analogue_gain_max_db": 50.0}),
    ("up to analogue_gain_max_db, 24", {"conversion_gains": (ConversionGain(30.0, 2500.0, 1.5),)}),
    ("above 0", {"conversion_gains": (ConversionGain(0.0, 2500.0, 1.5),)}),
    ("must increase", {"conversion_gains": (ConversionGain(9.0, 9.0, 1.0), ConversionGain(6.0, 9.0, 1.0))}),
    (
        "conversion_gains must be empty",
        {"gains": MEASURED.sensor.gains[1:], "conversion_gains": DUAL.sensor.conversion_gains},
    ),
    ("gains: .* at 0 dB must repeat the camera's own system_gain_dn_per_e", {"gains": MEASURED.sensor.gains}),
    ("must increase, up to analogue_gain_max_db, 24", {"gains": MEASURED.sensor.gains[2:0:-1]}),
    ("black_level_dn = 5000.0: must be finite", {"gains": (MeasuredGain(6.0, 2.5, 0.5, 5000.0),)}),
    ("signal_share are .* must increase", {"photon_transfer": ((0.5, 1.0), (0.4, 1.0))}),
    ("signal_share from 0 to 1", {"photon_transfer": ((0.5, 1.0), (1.1, 1.0))}),
]


def test_gains_that_cannot_be_are_named():
    for message, figures in REFUSED:
        with pytest.raises(ValueError, match=message):
            IMX250.with_figures(**figures)
    for gain_db in (48.1, -121.0, math.nan):
        with pytest.raises(ValueError, match="gain_db"):
            IMX250.at_gain(gain_db)


def test_files_keep_conversion_gains_measured_ones_and_the_bend(tmp_path):
    for camera in (DUAL, MEASURED.with_figures(photon_transfer=((0.2, 1.0), (0.9, 0.5)))):
        camera.save(tmp_path / "camera.yaml")
        assert Camera.load(tmp_path / "camera.yaml") == camera
