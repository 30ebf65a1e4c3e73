"""Analytic moments against frames."""

import math

import pytest
import torch
from made_frames import from_photons

from blurnoise import Camera

BASE = Camera.preset("imx250").with_figures(
    name="bench",
    quantum_efficiency=0.5,
    full_well_e=9000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=4.0,
    dark_current_e_s=300.0,
    black_level_dn=60.0,
    prnu=0.02,
    dsnu_e=15.0,
    dark_reference_c=20.0,
    dark_doubling_c=8.0,
)
PIXELS = 200_000


def frames(camera, mean_photons, **options):
    photons = torch.full((1, 1, 1, PIXELS), mean_photons, dtype=torch.float64)
    pattern = camera.sensor.fixed_pattern((1, 1, PIXELS), seed=3)
    given = {"exposure_s": 0.1, "temperature_c": 36.0, "generator": [5], "fixed_pattern": pattern}
    return from_photons(photons, camera, **given, **options)


def expected(camera, mean_photons):
    """Mean and variance after rounding: K^2 (read^2 + dark + photo) + 1/12 DN^2 (EMVA 1288 eq. 13), and the pattern.

    At 36 degrees, two doublings of 8 degrees above 20.
    """
    sensor = camera.sensor
    photo_e, dark_e = 0.5 * mean_photons, 0.1 * 4 * sensor.dark_current_e_s
    pattern = (sensor.prnu * photo_e) ** 2 + sensor.dsnu_e**2
    variance_e2 = photo_e + dark_e + sensor.read_noise_e**2 + pattern
    k = sensor.system_gain_dn_per_e
    return sensor.black_level_dn + k * (photo_e + dark_e), k**2 * variance_e2 + 1 / 12


def check(dn, expected_mean, variance):
    """Mean within 5 s / sqrt(n), variance within 5 s^2 sqrt((kurtosis - 1) / n), measured kurtosis."""
    n, mean = dn.numel(), float(dn.mean())
    kurtosis = float(((dn - mean) ** 4).mean() / dn.var() ** 2)
    assert mean == pytest.approx(expected_mean, abs=5 * math.sqrt(variance / n) + 1e-9)
    tolerance = 5 * variance * math.sqrt(max(kurtosis - 1, 1) / n)
    assert float(dn.var()) == pytest.approx(variance, abs=tolerance + 0.005)


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("mean_photons", [0.0, 3.0, 60.0, 1000.0, 9000.0])
@pytest.mark.parametrize("read_noise_e", [4.0, 2.0])
def test_frame_moments(mean_photons, read_noise_e, fidelity):
    camera = BASE.with_figures(read_noise_e=read_noise_e)
    check(frames(camera, mean_photons, fidelity=fidelity), *expected(camera, mean_photons))


@pytest.mark.parametrize(
    ("figure", "photons"),
    [("system_gain_dn_per_e", 9000.0), ("prnu", 9000.0), ("dark_current_e_s", 0.0), ("dsnu_e", 0.0)],
)
def test_a_tenth_off_would_be_noticed(figure, photons):
    wrong = BASE.with_figures(**{figure: 1.1 * BASE.figure(figure)})
    with pytest.raises(AssertionError):
        check(frames(BASE, photons), *expected(wrong, photons))
