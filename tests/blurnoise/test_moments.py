"""Analytic moments against frames, step by step."""

import math

import pytest
import stage_moments
import torch
from made_frames import from_photons
from stage_moments import Moments

from blurnoise import Camera
from blurnoise.light.resolved import Resolved
from blurnoise.sensor import stages

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
)
PIXELS = 200_000


def frames(camera, mean_photons, **options):
    photons = torch.full((1, 1, 1, PIXELS), mean_photons, dtype=torch.float64)
    pattern = camera.sensor.fixed_pattern((1, 1, PIXELS), seed=3)
    given = {"exposure_s": 0.1, "temperature_c": 36.0, "generator": [5], "fixed_pattern": pattern}
    return from_photons(photons, camera, **given, **options)


def check(dn, law):
    """Mean within 5 s / sqrt(n), variance within 5 s^2 sqrt((kurtosis - 1) / n), measured kurtosis."""
    n, mean, variance = dn.numel(), float(dn.mean()), float(law.variance + law.pattern_variance)
    kurtosis = float(((dn - mean) ** 4).mean() / dn.var() ** 2)
    assert mean == pytest.approx(float(law.mean), abs=5 * math.sqrt(variance / n) + 1e-9)
    tolerance = 5 * variance * math.sqrt(max(kurtosis - 1, 1) / n)
    assert float(dn.var()) == pytest.approx(variance, abs=tolerance + 0.005)


def expected(camera, mean_photons):
    """After rounding: var_y = K^2 (read^2 + dark + photo) + 1/12 DN^2 (EMVA 1288 eq. 13)."""
    one = torch.ones(1, dtype=torch.float64)
    at = Resolved(camera, one * 0.1, one * 36.0, white_e=one * mean_photons * 0.5)
    moments = Moments(one, 0 * one, 0 * one)
    for stage in stages.STAGES:
        moments = stage_moments.after(stage, moments, at)
    return moments


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("mean_photons", [0.0, 3.0, 60.0, 1000.0, 9000.0])
@pytest.mark.parametrize("read_noise_e", [4.0, 2.0])
def test_frame_moments(mean_photons, read_noise_e, fidelity):
    camera = BASE.with_figures(read_noise_e=read_noise_e)
    check(frames(camera, mean_photons, fidelity=fidelity), expected(camera, mean_photons))


@pytest.mark.parametrize(
    ("figure", "photons"),
    [("system_gain_dn_per_e", 9000.0), ("prnu", 9000.0), ("dark_current_e_s", 0.0), ("dsnu_e", 0.0)],
)
def test_a_tenth_off_would_be_noticed(figure, photons):
    wrong = BASE.with_figures(**{figure: 1.1 * BASE.figure(figure)})
    with pytest.raises(AssertionError):
        check(frames(BASE, photons), expected(wrong, photons))
