"""Pulsed lamps: the law of their light over random phase, and what they refuse."""

import math

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from blurnoise import Pwm

LED = Pwm(90.0, 0.1)
PHASES = (torch.arange(200_000).double() + 0.5) / 200_000


def shares(pwm, exposure_s):
    """Of exposures that begin evenly over a period."""
    return pwm.duty * pwm.factor(exposure_s, PHASES / pwm.frequency_hz)


@pytest.mark.parametrize(("exposure_ms", "dark"), [(0.5, 0.855), (5.0, 0.45), (10.0, 0.0)])
def test_share_of_dark_frames(exposure_ms, dark):
    seen = shares(LED, exposure_ms / 1e3)
    assert LED.dark_probability(exposure_ms / 1e3) == pytest.approx(dark, abs=1e-9)
    assert float((seen <= 1e-12).double().mean()) == pytest.approx(dark, abs=1e-4)


@settings(max_examples=10, deadline=None)
@example(exposure_ms=7.0, duty=0.13)
@example(exposure_ms=13.0, duty=0.71)
@given(exposure_ms=st.floats(0.05, 60.0), duty=st.floats(0.02, 0.98))
def test_the_law_is_that_of_evenly_spread_phases(exposure_ms, duty):
    lamp, exposure_s = Pwm(90.0, duty), exposure_ms / 1e3
    on_s = shares(lamp, exposure_s) * exposure_s
    least, most = lamp.extremes(exposure_s)
    steps = 1 / (len(PHASES) * lamp.frequency_hz * exposure_s * duty)  # by which neighbours differ
    assert float(on_s.mean()) == pytest.approx(duty * exposure_s, rel=1e-4)
    assert float(on_s.min()) / exposure_s / duty == pytest.approx(least, abs=2 * steps + 1e-9)
    assert float(on_s.max()) / exposure_s / duty == pytest.approx(most, abs=2 * steps + 1e-9)


def test_phase_is_a_draw_of_its_own():
    drawn = torch.tensor([LED.with_phase_of(seed).phase for seed in range(2000)])
    assert LED.with_phase_of(7) == LED.with_phase_of(7)
    assert float(drawn.mean()) == pytest.approx(0.5, abs=5 / math.sqrt(12 * 2000))  # 5 deviations of the mean
    assert float(drawn.min()) >= 0
    assert float(drawn.max()) < 1


def test_rows_that_begin_later_see_bands():
    """One period of the lamp is 1 / (f t_row) rows."""
    starts_s = torch.arange(500).double() / (90 * 100)
    rows = LED.factor(0.001, starts_s)
    torch.testing.assert_close(rows[:400], rows[100:])
    assert len(rows[:100].unique()) > 10
    assert float(rows[:100].mean()) == pytest.approx(1.0, abs=0.02)
