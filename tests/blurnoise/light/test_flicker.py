"""Flicker: closed forms over the phase, whole periods, drawn phases, masks and rows."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from blurnoise.light.flicker import Flicker, Pwm

LED = Pwm(90.0, 0.1)
PHASES = (torch.arange(200_000).double() + 0.5) / 200_000


def shares(pwm: Pwm, exposure_s: float) -> torch.Tensor:
    """Of exposures that begin evenly over a period."""
    return pwm.duty * pwm.factor(exposure_s, PHASES / pwm.frequency_hz)


@pytest.mark.parametrize(("exposure_ms", "dark"), [(0.5, 0.855), (1.0, 0.81), (5.0, 0.45), (10.0, 0.0)])
def test_share_of_dark_frames(exposure_ms: float, dark: float) -> None:
    seen = shares(LED, exposure_ms / 1e3)
    assert LED.dark_probability(exposure_ms / 1e3) == pytest.approx(dark, abs=1e-9)
    assert float((seen <= 1e-12).double().mean()) == pytest.approx(dark, abs=1e-4)


@example(exposure_ms=7.0, duty=0.13)
@example(exposure_ms=13.0, duty=0.71)
@given(
    exposure_ms=st.floats(0.05, 60.0),
    duty=st.floats(0.02, 0.98),
)
def test_the_law_is_that_of_evenly_spread_phases(exposure_ms: float, duty: float) -> None:
    lamp, exposure_s = Pwm(90.0, duty), exposure_ms / 1e3
    on_s = shares(lamp, exposure_s) * exposure_s
    least, most = lamp.extremes(exposure_s)
    steps = 1 / (len(PHASES) * lamp.frequency_hz * exposure_s * duty)  # by which neighbours differ
    assert float(on_s.mean()) == pytest.approx(duty * exposure_s, rel=1e-4)
    assert float(on_s.min()) / exposure_s / duty == pytest.approx(least, abs=2 * steps + 1e-9)
    assert float(on_s.max()) / exposure_s / duty == pytest.approx(most, abs=2 * steps + 1e-9)


@pytest.mark.parametrize("periods", [1, 2, 7])
def test_whole_periods_hold_the_duty_whatever_the_phase(periods: int) -> None:
    seen = shares(LED, periods / 90.0)
    assert float((seen - 0.1).abs().max()) < 1e-9
    assert LED.extremes(periods / 90.0) == pytest.approx((1.0, 1.0))


def test_a_moment_is_light_or_dark() -> None:
    assert sorted(set(shares(LED, 0.0).tolist())) == [0.0, 1.0]
    assert LED.extremes(0.0) == (0.0, pytest.approx(10.0))


def test_a_lamp_that_is_always_on_changes_no_bit() -> None:
    light = torch.rand(1, 3, 5, 7)
    assert Flicker(Pwm(100.0, 1.0, 0.3)).on(light, 0.003) is light


def test_phase_is_a_draw_of_its_own() -> None:
    drawn = torch.tensor([LED.with_phase_of(seed).phase for seed in range(2000)])
    assert LED.with_phase_of(7) == LED.with_phase_of(7)
    assert float(drawn.mean()) == pytest.approx(0.5, abs=5 / math.sqrt(12 * 2000))  # 5 deviations of the mean
    assert float(drawn.min()) >= 0
    assert float(drawn.max()) < 1


def test_the_mask_says_where() -> None:
    light, mask = torch.full((1, 1, 4, 6), 0.5), torch.zeros(4, 6)
    mask[1, 2], mask[2, 4] = 1.0, 0.25
    seen = Flicker(LED, mask).on(light, 0.001)  # the pulse has begun: 10 times the mean light
    assert float(seen[0, 0, 1, 2]) == pytest.approx(5.0)
    assert float(seen[0, 0, 2, 4]) == pytest.approx(0.5 * (1 + 0.25 * 9))
    assert float((seen != light).sum()) == 2


def test_rows_that_begin_later_see_bands() -> None:
    """One period of the lamp is 1 / (f t_row) rows."""
    rows = Flicker(LED, row_time_s=1 / (90 * 100)).on(torch.ones(1, 1, 500, 1), 0.001).flatten()
    torch.testing.assert_close(rows[:400], rows[100:])
    assert len(rows[:100].unique()) > 10
    assert float(rows[:100].mean()) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Pwm(0.0, 0.1), "frequency_hz = 0.0: must be"),
        (lambda: Pwm(90.0, 0.0), "duty = 0.0: must be"),
        (lambda: Pwm(90.0, 1.2), "duty = 1.2: must be"),
        (lambda: Pwm(90.0, 0.1, -0.1), "phase = -0.1: must be"),
        (lambda: LED.factor(-1.0), "exposure_s = -1.0: must be"),
        (lambda: Flicker(LED, torch.ones(3, 2)).on(torch.ones(1, 1, 2, 3), 1.0), "mask: shape is"),
        (lambda: Flicker(LED, 2 * torch.ones(2, 3)).on(torch.ones(1, 1, 2, 3), 1.0), "mask: must lie"),
    ],
)
def test_bad_input(call: object, message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        call()  # type: ignore[operator]
    assert "\n" not in str(error.value)
