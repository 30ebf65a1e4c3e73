"""Acutance and the response of a Siemens star, against closed forms of Gaussian blur."""

import math

import numpy as np
import pytest
import torch
from scipy.special import gamma, ive, ndtr, pbdv

from blurnoise import slanted_edge
from blurnoise.metrics.sharpness import acutance, star_response


def gaussian_edge(sigma_px, noise=0.0):
    """An edge at 5 degrees, sampled at points: its response is the Gaussian's alone."""
    y, x = np.mgrid[:120, :150] + 0.5
    distance = (x - 75) * math.cos(math.radians(5)) - (y - 60) * math.sin(math.radians(5))
    drawn = noise * np.random.default_rng(3).standard_normal(x.shape)
    return torch.from_numpy(0.2 + 0.5 * ndtr(distance / sigma_px) + drawn)[None]


def closed_acutance(sigma_px, px_per_degree):
    """Integrals of v^0.8 exp(-0.2 v), times exp(-b v²): the gamma function, and the parabolic cylinder's."""
    b = 2 * (math.pi * sigma_px / px_per_degree) ** 2
    blurred = (2 * b) ** -0.9 * gamma(1.8) * math.exp(0.04 / (8 * b)) * pbdv(-1.8, 0.2 / math.sqrt(2 * b))[0]
    return blurred / (gamma(1.8) / 0.2**1.8)


@pytest.mark.parametrize("px_per_degree", [20.0, 60.0])
@pytest.mark.parametrize("sigma_px", [0.7, 1.0, 2.5])
def test_acutance_of_a_gaussian_is_the_closed_form(sigma_px, px_per_degree):
    """The curve ends at 1 cycle/px: at 20 px per degree that leaves out 0.15 of the sensitivity."""
    found = acutance(slanted_edge(gaussian_edge(sigma_px), bootstrap=0), px_per_degree=px_per_degree)
    cut = torch.special.gammainc(torch.tensor(1.8), torch.tensor(0.2 * px_per_degree)).item()
    assert found.value == pytest.approx(closed_acutance(sigma_px, px_per_degree) / cut, rel=2e-3)


def test_acutance_has_an_interval_that_holds_it_in_noise():
    truth = closed_acutance(1.0, 60.0)
    found = acutance(slanted_edge(gaussian_edge(1.0, noise=0.01), bootstrap=200))
    assert 0.001 < found.high - found.low < 0.02
    assert abs(found.value - truth) < found.high - found.low
    assert math.isnan(acutance(slanted_edge(torch.full((1, 60, 60), 0.5), bootstrap=0)).value)


def wave_left(radius_px, cycles, sigma_px):
    """What a Gaussian leaves of a star's wave at a radius: exact on the plane, by Weber's integral."""
    z = radius_px**2 / (4 * sigma_px**2)
    return np.sqrt(math.pi * z / 2) * (ive((cycles - 1) / 2, z) + ive((cycles + 1) / 2, z))


def star(sigma_px, cycles=36, off=(0.0, 0.0), noise=0.0):
    y, x = np.mgrid[:241, :263] + 0.5
    right, up = x - 131.5 - off[0], 120.5 + off[1] - y
    wave = wave_left(np.hypot(right, up), cycles, sigma_px) * np.cos(cycles * np.arctan2(up, right) - 0.4)
    drawn = noise * np.random.default_rng(5).standard_normal(x.shape)
    return torch.from_numpy(0.45 * (1 + 0.7 * wave) + drawn)


@pytest.mark.parametrize(("cycles", "sigma_px"), [(36, 0.6), (36, 1.0), (36, 2.0), (72, 1.5)])
@pytest.mark.parametrize("off", [(0.0, 0.0), (1.3, -2.2)])
def test_the_response_of_a_star_is_the_closed_form(cycles, sigma_px, off):
    found = star_response(star(sigma_px, cycles, off), modulation=0.7)
    assert found.centre_px == pytest.approx((131.5 + off[0], 120.5 + off[1]), abs=0.01)
    truth = wave_left(cycles / (2 * math.pi * found.frequency.numpy()), cycles, sigma_px)
    assert found.power.clamp_min(0).sqrt().numpy() == pytest.approx(truth, abs=0.006)
    half = math.sqrt(math.log(2) / 2) / (math.pi * sigma_px)  # on a straight wave
    assert found.mtf50.value == pytest.approx(half, rel=0.01)


def test_without_the_charts_modulation_the_outer_ring_counts_as_one():
    """At 0.052 cycles/px a Gaussian of 1 px leaves 0.948; relative to that, 1/2 comes 0.007 later."""
    found = star_response(star(1.0))
    least = float(found.frequency[0])
    left = math.exp(-2 * (math.pi * least) ** 2)
    assert found.power[0] == 1
    half = math.sqrt(math.log(2 / left) / 2) / math.pi
    assert found.mtf50.value == pytest.approx(half, rel=0.01)
    assert half > 1.03 * math.sqrt(math.log(2) / 2) / math.pi


def test_noise_widens_the_interval_and_moves_nothing():
    """Modulation 0.7 of 0.45 in noise of 0.05: without its power taken off, the response would not fall to 0."""
    found = star_response(star(1.5, noise=0.05), modulation=0.7)
    truth = math.sqrt(math.log(2) / 2) / (math.pi * 1.5)
    assert found.mtf50.low < found.mtf50.value < found.mtf50.high
    assert abs(found.mtf50.value - truth) < found.mtf50.high - found.mtf50.low < 0.02
    lost = (
        found.frequency > 0.35
    )  # truth 2e-5 and less; a third of the noise's power, four errors of the mean
    error = float((found.error[lost] ** 2).mean().sqrt())
    assert abs(float(found.power[lost].mean())) < 4 * error / math.sqrt(int(lost.sum()))
    errors = (found.power - torch.exp(-((2 * math.pi * 1.5 * found.frequency) ** 2))) / found.error
    assert 0.6 < float(errors[found.frequency < 0.2].std()) < 1.5


@pytest.mark.parametrize(
    ("picture", "flag"),
    [
        (torch.full((200, 200), 0.5), "no_star"),
        (torch.zeros(200, 200), "no_star"),
        (gaussian_edge(1.0)[0], "no_star"),
        (star(6.0), "too_coarse"),
        (star(0.2), "never_reaches_50"),
    ],
)
def test_what_is_not_measured_has_a_flag(picture, flag):
    found = star_response(picture, modulation=0.7).mtf50
    assert math.isnan(found.value)
    assert found.flags == {flag}


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="picture: must be 48 px or more"):
        star_response(torch.zeros(40, 40), cycles=36)
    with pytest.raises(ValueError, match="cycles"):
        star_response(torch.zeros(200, 200), cycles=0)
    with pytest.raises(ValueError, match="modulation"):
        star_response(torch.zeros(200, 200), modulation=1.5)
    with pytest.raises(ValueError, match="px_per_degree"):
        acutance(slanted_edge(gaussian_edge(1.0), bootstrap=0), px_per_degree=0.0)
