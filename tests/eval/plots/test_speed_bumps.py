"""Speed bumps: pitch rates as published, and what they do to the picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from blurnoise_eval.plots.speed_bumps import pitch_rate, speed_bump

FOCAL_PX = 1662.77  # 1920 px over 60 degrees


@pytest.mark.parametrize(
    ("bump", "deg_s", "px"), [((0.10, 3.7, 30 / 3.6), 26.5, 7.7), ((0.075, 0.9, 20 / 3.6), 11.0, 3.3)]
)
def test_bumps(bump: tuple[float, float, float], deg_s: float, px: float) -> None:
    """Rounded as published: half a unit of the last digit, of 11 deg/s half a degree."""
    _, rate = pitch_rate(*bump)
    assert math.degrees(np.abs(rate).max()) == pytest.approx(deg_s, abs=0.5 if deg_s == 11.0 else 0.05)
    left, top, right, bottom = speed_bump(*bump, focal_px=FOCAL_PX).seen(0.01).box
    assert bottom - top == pytest.approx(px, abs=0.05)
    assert right - left == 0


def test_figures_out_of_range() -> None:
    with pytest.raises(ValueError, match=r"height_m = 2\.0"):
        speed_bump(2.0, 1.0, 10.0, focal_px=1000.0)
