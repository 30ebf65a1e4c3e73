"""Causes of trajectories: shakes, bumps, logs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from blurnoise.motion.trajectory import from_rates, from_text, shake

FOCAL_PX = 1662.77  # 1920 px over 60 degrees


@pytest.mark.parametrize("seed", [0, 1, 2**62])
def test_shake_goes_as_far_as_stated(seed: int) -> None:
    path = shake(seed, 20.0, 0.01, duration_s=0.03)
    knots, durations = path.window(-0.005, 0.005)
    assert float(np.ptp(knots, axis=1).max()) == pytest.approx(20.0)
    steps = np.hypot(*np.diff(knots)) / durations
    assert steps[1:-1].std() < 1e-6 * steps.mean()  # its speed is kept: time fixes the length
    assert path == shake(seed, 20.0, 0.01, duration_s=0.03)
    assert path != shake(seed + 1, 20.0, 0.01, duration_s=0.03)
    left, top, right, bottom = path.seen(0.004).box
    assert max(right - left, bottom - top) < 20.0


def test_shakes_turn() -> None:
    """Their lengths over their extents: 1 of straight ones; among 40 there are straight and tangled ones."""
    ratios = []
    for seed in range(40):
        knots, _ = shake(seed, 10.0, 0.01).window(-0.005, 0.005)
        ratios.append(np.hypot(*np.diff(knots)).sum() / 10.0)
    assert min(ratios) < 2.0
    assert max(ratios) > 4.0
    ends = np.array(
        [np.subtract(*shake(seed, 10.0, 0.01).window(-0.005, 0.005)[0].T[[-1, 0]]) for seed in range(40)]
    )
    assert abs(np.exp(1j * np.arctan2(*ends.T)).mean()) < 0.5  # in all directions; 1/sqrt(40) = 0.16


def test_nose_up_moves_the_picture_down_and_turning_left_right() -> None:
    time = np.linspace(-0.02, 0.02, 9)
    rates = np.stack([np.full(9, 0.3), np.full(9, -0.2), np.full(9, 5.0)])
    x, y = np.ptp(from_rates(time, rates, focal_px=1000.0).window(-0.005, 0.005)[0], axis=1)
    assert (x, y) == pytest.approx((2.0, 3.0))
    path = from_rates(time, rates, focal_px=1000.0)
    assert path.x_px[-1] > path.x_px[0]
    assert path.y_px[-1] > path.y_px[0]


def test_rates_are_linear_between_readings() -> None:
    """A rate that grows by 2 rad/s^2: f t^2 of angle, which trapezoids at the readings alone would make straight."""
    time = np.arange(-3, 4) * 0.01
    rates = np.stack([2.0 * time, 0 * time, 0 * time])
    path = from_rates(time, rates, focal_px=1000.0)
    at = np.linspace(-0.03, 0.03, 49)
    y = np.interp(at, path.time_s, path.y_px)
    np.testing.assert_allclose(y - y[24], 1000.0 * at**2, atol=2e-3)


def test_logs(tmp_path: Path) -> None:
    places, rates = tmp_path / "places.csv", tmp_path / "rates.csv"
    places.write_text("# a comment\ntime_s,x_px,y_px\n100.00,0,1\n100.01,2,1\n100.02,5,3\n", encoding="utf-8")
    path = from_text(places.read_text(), str(places))
    assert path.time_s == pytest.approx((-0.01, 0.0, 0.01))
    assert path.y_px == (1.0, 1.0, 3.0)
    rates.write_text("time_s,wx_deg_s,wy_deg_s\n0,10,0\n0.01,10,0\n0.02,10,0\n", encoding="utf-8")
    along = from_text(rates.read_text(), str(rates), focal_px=FOCAL_PX)
    assert np.ptp(along.window(-0.005, 0.005)[0], axis=1) == pytest.approx((0.0, 2.902), abs=1e-3)
    with pytest.raises(ValueError, match=r"rates.csv: focal_px: must be the camera's"):
        from_text(rates.read_text(), str(rates))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("[" * 200_000, "field larger than field limit"),
        ("time_s,x_px\n0,1\n1,2\n", "must be time_s and x_px, y_px or"),
        ("time_s,x_px,y_px\n0,1,1\n0,2,2\n", "must be at least two times that increase"),
        ("time_s,x_px,y_px\n0,1,left\n", "must hold numbers"),
        ("time_s,x_px,y_px\n0,1,nan\n1,1,1\n", "y_px = nan: must be finite"),
        ("time_s,x_px,y_px\n0,1\n", "as many values in every row"),
        ("time_ms,x_px,y_px\n0,1,1\n1,2,2\n", "must hold time_s"),
        ("time_s,wx,wy\n0,1,1\n1,2,2\n", "wx_rad_s, wy_rad_s or in deg_s"),
        ("time_s,x_px,y_px,wx_rad_s,wy_rad_s\n0,1,1,0,0\n1,2,2,0,0\n", "must be places or rates, not both"),
    ],
)
def test_what_is_no_log(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=f"log.csv: .*{words}"):
        from_text(path.read_text(), str(path))


def test_figures_out_of_range() -> None:
    with pytest.raises(ValueError, match="duration_s"):
        shake(1, 10.0, 0.01, duration_s=0.001)
    for time, rates in ((3, (2, 3)), (3, (3, 4)), (1, (3, 1)), (0, (3, 0))):
        with pytest.raises(
            ValueError, match=r"time_s, rates_rad_s: shapes are .* must be \(K,\), \(3, K\), K >= 2"
        ):
            from_rates(np.arange(float(time)), np.zeros(rates), focal_px=1.0)


def test_a_gyroscope_s_offset_is_harmless() -> None:
    """0.1 degrees/s at f = 1663 px: 0.03 px in 10 ms."""
    rates = np.zeros((3, 31))
    rates[1] = math.radians(0.1)
    (left, top, right, bottom) = (
        from_rates(np.linspace(-0.015, 0.015, 31), rates, focal_px=FOCAL_PX).seen(0.01).box
    )
    assert right - left == pytest.approx(0.03, abs=0.002)
    assert bottom == top == 0
