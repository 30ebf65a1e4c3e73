"""Flicker of pulsed lamps: closed forms of a lamp whose phase drifts evenly, and of waves."""

import math

import pytest
import torch

from blurnoise import Pwm
from blurnoise.metrics.flicker import detection_index, mitigation_probability, modulation_index


def drifting(exposure_s, count=1000, frequency_hz=90.0, duty=0.25):
    """Light factors of frames whose phases are spread evenly, so that shares are probabilities."""
    starts = torch.arange(count, dtype=torch.float64) / count / frequency_hz
    return Pwm(frequency_hz, duty).factor(torch.full((count,), exposure_s), starts)


def test_a_lamp_that_misses_frames_is_seen_in_the_others():
    """Of exposure T: dark in 1 - D - f T of the frames, lit by some of a pulse in the rest."""
    means = 10 + 90 * drifting(0.002)
    lit = 0.25 + 90 * 0.002
    assert float(modulation_index(means).value) == pytest.approx((370 - 10) / (370 + 10), rel=1e-6)
    # Of the ramps at both ends of a pulse, 1 DN of 360 is not yet seen.
    assert float(detection_index(means, off=10.0).value) == pytest.approx(lit - 2 * 0.18 / 360, abs=2e-3)
    assert float(detection_index(means, off=10.0, threshold=18.0).value) == pytest.approx(
        lit - 0.18, abs=2e-3
    )


def test_a_lamp_over_whole_periods_does_not_flicker():
    means = drifting(2 / 90)
    assert float(modulation_index(means).value) == pytest.approx(0.0, abs=1e-6)
    assert float(mitigation_probability(means).value) == 1.0


def test_of_a_sine_the_share_near_its_mean_is_an_arcsine():
    wave = 1 + 0.5 * torch.sin(torch.arange(2000, dtype=torch.float64) * 2 * math.pi / 2000)
    found = mitigation_probability(100 * wave)
    assert float(found.value) == pytest.approx(2 / math.pi * math.asin(0.2), abs=2e-3)
    assert float(mitigation_probability(100 * wave, tolerance=0.25).value) == pytest.approx(1 / 3, abs=2e-3)
    assert float(modulation_index(wave).value) == pytest.approx(0.5)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Binomial, p 0.95, n 1500: 3.5 sigma; of a normal's 10 %."""
    truth = math.erf(10 / 8 / math.sqrt(2))
    means = 100 + 8 * torch.randn(1500, 200, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    found = mitigation_probability(means)
    covered = float(((found.low < truth) & (found.high > truth)).double().mean())
    assert 0.93 <= covered <= 0.975
    assert float(found.value.mean()) == pytest.approx(truth, abs=0.005)


def test_series_are_told_apart_and_flagged():
    means = torch.tensor([[100.0, 100.0, 100.0], [10.0, 100.0, 10.0], [1.0, math.nan, 1.0]])
    for found in (
        mitigation_probability(means),
        detection_index(means, off=torch.tensor([100.0, 10.0, 1.0])),
    ):
        assert found.flags["not_finite"].tolist() == [False, False, True]
        assert found.flags["too_few_frames"].all()
        assert torch.isnan(found.value).tolist() == torch.isnan(found.low).tolist() == [False, False, True]
    assert detection_index(means, off=torch.tensor([100.0, 10.0, 1.0])).value[:2].tolist() == [
        0,
        pytest.approx(1 / 3),
    ]
    assert torch.isnan(modulation_index(means).value).tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("call", "given", "message"),
    [
        (modulation_index, {"means": torch.ones(1)}, "means: must be of two frames or more"),
        (detection_index, {"means": torch.ones(4), "off": 0.0}, "off: must be > 0"),
        (detection_index, {"means": torch.ones(2, 4), "off": torch.ones(3)}, "off: shape"),
        (mitigation_probability, {"means": torch.ones(4), "tolerance": 0.0}, "tolerance"),
    ],
)
def test_wrong_arguments_are_named(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(**given)
