"""EMVA 1288 by the package ``emva1288``, where its conditions hold; what it finds, with errors of our own.

The package fits without weights and tells no errors; those here follow from its formulas and the levels' errors.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.calibration.levels import Level
from blurnoise_eval.calibration.transfer import Z, root

Floats = NDArray[np.float64]
FEWEST = 50
"""Exposures that the standard asks for, dark and flat each, up to saturation."""


class Found(NamedTuple):
    """What the package says: by the camera's field; how to call it."""

    estimates: dict[str, Estimate]
    method: str


class _Numpy:
    """NumPy with a function that the package calls and that NumPy 2 has dropped."""

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    @staticmethod
    def asfarray(values: Any) -> Floats:
        return np.asarray(values, dtype=float)


def conditions(dark: Sequence[Level], flat: Sequence[Level], saturated: bool) -> bool:
    """Whether there are as many exposures as the standard asks for, each dark and flat, up to saturation."""
    dark_s = [level.exposure_s for level in dark]
    return saturated and len(flat) >= FEWEST and dark_s == [level.exposure_s for level in flat]


def analysis(dark: Sequence[Level], flat: Sequence[Level]) -> Found | None:
    """System gain, read noise and dark current; None without the package. Levels by rising exposure."""
    try:
        process: Any = import_module("emva1288.process")
    except ImportError:
        return None
    process.routines.np = _Numpy()
    exposure, mean_d, noise_d = _columns(dark)
    _, mean, noise = _columns(flat)
    temporal = {
        "texp": exposure * 1e9,  # the package's unit is ns
        "u_p": exposure * 1e9,  # no figure taken from it here depends on the light's unit
        "u_y": mean,
        "s2_y": noise,
        "u_ydark": mean_d,
        "s2_ydark": noise_d,
    }
    results = process.Results1288({"temporal": temporal, "spatial": {}}, loglevel=logging.WARNING)
    gain, read_e, dark_e_s = (float(getattr(results, name)) for name in ("K", "sigma_d", "u_I_mean"))
    last = int(results.index_sensitivity_max) + 1
    signal, above = (mean - mean_d)[:last], (noise - noise_d)[:last]
    weight = signal / (signal @ signal)
    gain_error = _error(
        weight, np.hypot(_errors(flat), _errors(dark))[:last], above - gain * signal, len(signal) - 1
    )
    centred = exposure - exposure.mean()
    slope = centred / (centred @ centred)
    offset = 1 / len(exposure) - exposure.mean() * slope
    square_error = _error(offset, _errors(dark), _residuals(exposure, noise_d), len(exposure) - 2)
    mean_error = np.array([level.mean_error_dn for level in dark])
    slope_error = _error(slope, mean_error, _residuals(exposure, mean_d), len(exposure) - 2)
    read = read_e**2
    estimates = {
        "system_gain_dn_per_e": Estimate(gain, gain - Z * gain_error, gain + Z * gain_error),
        "read_noise_e": root(read, math.hypot(square_error / gain**2, 2 * read * gain_error / gain)),
    }
    if math.isfinite(dark_e_s):
        error = math.hypot(slope_error / gain, dark_e_s * gain_error / gain)
        estimates["dark_current_e_s"] = Estimate(
            max(0.0, dark_e_s), max(0.0, dark_e_s - Z * error), max(0.0, dark_e_s + Z * error)
        )
    return Found(estimates, f"EMVA 1288 by the package emva1288 {version('emva1288')}")


def _columns(levels: Sequence[Level]) -> tuple[Floats, Floats, Floats]:
    rows = [(level.exposure_s, level.mean_dn, level.variance_dn2) for level in levels]
    exposure, mean, variance = np.array(rows).T
    return exposure, mean, variance


def _errors(levels: Sequence[Level]) -> Floats:
    return np.array([level.variance_error_dn2 for level in levels])


def _residuals(x: Floats, y: Floats) -> Floats:
    return y - np.polyval(np.polyfit(x, y, 1), x)


def _error(weight: Floats, error: Floats, residuals: Floats, freedom: int) -> float:
    """Of the sum of weight times values: by their errors or by their scatter, whichever is more."""
    known = float(np.sqrt(((weight * error) ** 2).sum()))
    seen = float(np.sqrt(((weight * residuals) ** 2).sum() * len(residuals) / freedom))
    return max(known, seen)
