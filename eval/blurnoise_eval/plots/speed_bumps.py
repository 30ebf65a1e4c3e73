"""Speed bumps: what the pitch of a car that drives over one does to its camera's picture."""

from __future__ import annotations

import math

import numpy as np

from blurnoise._core.checks import in_range
from blurnoise.motion.trajectory import Trajectory, from_rates
from blurnoise.optics.spectra import Floats

BODY_HZ, DAMPING, HOP_HZ, MASS_RATIO, WHEELBASE_M = 1.2, 0.3, 11.0, 10.0, 2.7
"""A quarter car, as assumed: frequency of its body on its springs and their damping, frequency of its wheel between
springs and tyre, mass of body over wheel, and how far the axles are apart."""


def speed_bump(
    height_m: float, length_m: float, speed_m_s: float, *, focal_px: float, duration_s: float = 0.1
) -> Trajectory:
    """A car over a half-sine bump: what its pitch does to the picture, time 0 where it pitches fastest.

    Two quarter cars of the figures above, the rear axle later by the wheelbase; heave (0.05 px at 20 m) is left out.
    """
    time, rate = pitch_rate(height_m, length_m, speed_m_s)
    middle = float(time[np.abs(rate).argmax()])
    half = in_range("duration_s", duration_s, 0.0, 2.0, above=True) / 2
    near = np.abs(time - middle) <= half + time[1]
    time, rate = time[near] - middle, rate[near]
    if time[0] > -half:  # level before the bump
        time, rate = np.append(-half - 1e-9, time), np.append(0.0, rate)
    still = np.zeros_like(rate)
    return from_rates(time, np.stack([rate, still, still]), focal_px=focal_px)


def pitch_rate(height_m: float, length_m: float, speed_m_s: float) -> tuple[Floats, Floats]:
    """Times, s, from when the front axle meets a half-sine bump, and the car's pitch rate, rad/s, nose up > 0."""
    from scipy.signal import lsim  # takes 0.5 s

    height = in_range("height_m", height_m, 0.0, 1.0)
    length = in_range("length_m", length_m, 0.01, 100.0)
    speed = in_range("speed_m_s", speed_m_s, 0.1, 100.0)
    step_s = 1e-4
    time = step_s * np.arange(math.ceil(((length + WHEELBASE_M) / speed + 1.0) / step_s), dtype=np.float64)
    spring, wheel = (2 * math.pi * BODY_HZ) ** 2, 1 / MASS_RATIO  # per mass of the body
    damper = 4 * math.pi * BODY_HZ * DAMPING
    tyre = wheel * (2 * math.pi * HOP_HZ) ** 2 - spring
    moves = np.array(
        [
            [0, 1, 0, 0],
            [-spring, -damper, spring, damper],
            [0, 0, 0, 1],
            [spring / wheel, damper / wheel, -(spring + tyre) / wheel, -damper / wheel],
        ]
    )
    car = moves, np.array([[0.0], [0.0], [0.0], [tyre / wheel]]), np.array([[0.0, 1.0, 0.0, 0.0]]), 0.0

    def body_speed(place_m: Floats) -> Floats:
        road = np.where((place_m > 0) & (place_m < length), height * np.sin(np.pi * place_m / length), 0.0)
        return np.asarray(lsim(car, road, time, interp=False)[1])

    front, rear = body_speed(speed * time), body_speed(speed * time - WHEELBASE_M)
    return time, (front - rear) / WHEELBASE_M
