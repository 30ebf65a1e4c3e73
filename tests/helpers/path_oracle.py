"""Transfer functions of paths in closed form: of segments and of vibration.

Frequencies in cycles/px, fx right and fy down, and H = mean over time of exp(-2 pi i f . x), x in px.
"""

import math

import numpy as np
from scipy.special import jv

from blurnoise import Trajectory


def polyline_grid(fx, fy, knots_px, shares):
    """Of straight segments, exact, on a grid (h, w) of fy (h,) and fx (w,).

    knots_px: (2, K), x and y. shares: (K - 1,) of the exposure.
    """
    total = np.zeros((len(fy), len(fx)), np.complex128)
    middles, steps = (knots_px[:, 1:] + knots_px[:, :-1]) / 2, np.diff(knots_px)
    for (x, y), (dx, dy), share in zip(middles.T, steps.T, shares, strict=True):
        wave = np.exp(-2j * np.pi * (fy[:, None] * y + fx * x))
        total += share * np.sinc(fy[:, None] * dy + fx * dx) * wave
    return total


def vibration(along, frequency_hz, exposure_s, *, middle_s=0.0, phase_rad=0.0):
    """A sinusoid seen from ``middle_s`` - T/2 to ``middle_s`` + T/2, ``along`` = f . a in cycles; they broadcast.

    sum_k J_k(2 pi f . a) exp(-i k (2 pi nu t + phase)) sinc(k nu T); of whole periods J0 alone. MTF50 is then at
    0.242098 / a, the first 0 at 0.382740 / a. Of a small share nu T of a period it is a line of the length
    2 pi nu T a |cos(phase)|, another at each phase: there is no one MTF (Hadar, Fisher and Kopeika 1992).
    """
    x = 2 * np.pi * np.asarray(along, float)
    angle = 2 * np.pi * frequency_hz * np.asarray(middle_s, float) + phase_rad
    most = math.ceil(float(np.abs(x).max(initial=0.0))) + 30  # beyond, J_k is below 1e-16
    periods = frequency_hz * exposure_s
    total = jv(0, x) * np.ones_like(angle, np.complex128)
    for k in range(1, most):
        waves = np.exp(-1j * k * angle) + (-1) ** k * np.exp(1j * k * angle)
        total = total + jv(k, x) * np.sinc(k * periods) * waves
    return np.asarray(total)


def straight_path(velocity_px_s, duration_s):
    """Uniform motion, for exposures up to ``duration_s``."""
    time = np.array([-0.5, 0.5]) * duration_s
    return Trajectory.of(time, np.outer(velocity_px_s, time))
