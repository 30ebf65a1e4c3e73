"""Limits: what rules leave of exposure times, and what they say when they leave nothing."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.program.limits import Limits


def ms(times: tuple[float, ...]) -> list[float]:
    return [round(1e3 * time, 4) for time in times]


def test_frames_less_read_out() -> None:
    times = Limits(fps=50.0, readout_s=0.004).candidates(1e-3, 1.0)
    assert times[0] == 1e-3
    assert times[-1] == pytest.approx(0.016)
    assert np.diff(np.log2(times)).max() <= 1 / 8 + 1e-9


def test_whole_periods() -> None:
    assert ms(Limits(mains_hz=50.0).candidates(1e-4, 1.0)) == [10, 20, 30]
    assert ms(Limits(mains_hz=60.0).candidates(1e-4, 1.0)) == [8.3333, 16.6667, 25, 33.3333]


def test_banding_only_if_said() -> None:
    times = Limits(mains_hz=50.0, banding=True).candidates(1e-4, 1.0)
    assert [time for time in ms(times) if time > 9.99] == [10, 20, 30]
    assert min(times) == pytest.approx(1e-4)


def test_leds() -> None:
    assert min(Limits(led=True).candidates(1e-4, 1.0)) == pytest.approx(1 / 90)
    assert ms(Limits(led=True, mains_hz=50.0).candidates(1e-4, 1.0)) == [20, 30]
    assert ms(Limits(led=True, mains_hz=50.0, banding=True).candidates(1e-4, 1.0)) == [20, 30]


def test_whole_lines() -> None:
    line_s = 14.8e-6
    times = np.array(Limits(line_time_s=line_s, led=True).candidates(1e-4, 1.0)) / line_s
    assert np.abs(times - times.round()).max() < 1e-6
    assert times.min() * line_s >= 1 / 90


def test_settles_on_what_is_allowed_and_not_longer() -> None:
    limits = Limits(mains_hz=50.0)
    assert limits.settled(0.029) == pytest.approx(0.02)
    assert limits.settled(0.003) == pytest.approx(0.01)  # the shortest there is
    assert limits.settled(0.2) == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("rules", "named"),
    [
        (
            {"fps": 100.0, "readout_s": 0.002, "mains_hz": 50.0},
            r"anti-flicker 50 Hz.*any light.*10 ms.*leave 8 ms",
        ),
        ({"fps": 100.0, "led": True}, r"led.*any light.*11.11 ms.*leave 10 ms"),
        ({"fps": 60.0, "led": True, "mains_hz": 50.0}, r"anti-flicker 50 Hz and led.*20 ms"),
        ({"banding": True}, "banding.*--anti-flicker"),
        ({"mains_hz": 55.0}, "mains_hz = 55"),
    ],
)
def test_rules_that_leave_nothing_are_named(rules: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Limits(**rules)
