"""Photon transfer: gain, read noise, dark current, black level and fixed pattern from few frames.

Model (EMVA 1288 release 4, linear): a level of mean m has the temporal variance V = V_r + K (m - b) + rounding, flat
or dark, with b the mean in the dark at no exposure and V_r = (K read)^2; the dark mean is b + K d T. Shot noise of
light and of dark charge lie on one line, so dark frames need not have the flat ones' exposures.
Rounding adds 1/12 DN^2, and where noise is lower what :mod:`~blurnoise_eval.calibration.rounding` says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from blurnoise_eval.calibration.levels import Floats, Level, columns
from blurnoise_eval.calibration.lines import SURELY, Line, dark_line, straight, widened
from blurnoise_eval.calibration.patterns import Pattern
from blurnoise_eval.calibration.rounding import PLAIN_DN2, rounded, spatial_variance


@dataclass(frozen=True)
class Transfer:
    """The fit, in DN and DN^2. covariance: of (gain, read_dn2, spread_dn2). rounding: it rules in the dark.

    dark: the dark mean over the exposure. expected_dn2: the model's variance at each level that was fitted.
    widened: the variances scatter beyond chance, and the covariance was widened for that. hidden_dn2_s: dark charge
    that variances show and means do not, and its standard deviation; 0 for none.
    """

    gain: float
    read_dn2: float
    spread_dn2: float
    covariance: Floats
    dark: Line
    expected_dn2: Floats
    widened: bool
    rounding: bool
    hidden_dn2_s: float = 0.0
    hidden_error_dn2_s: float = 0.0

    def error(self, gain: float, read_dn2: float = 0.0, spread_dn2: float = 0.0) -> float:
        """Standard deviation of what has this gradient with respect to gain, read_dn2 and spread_dn2."""
        along = np.array([gain, read_dn2, spread_dn2])
        return math.sqrt(max(0.0, float(along @ self.covariance @ along)))


def fit(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> Transfer:
    """Weighted least squares over all levels. pattern: of the dark frames' mean.

    A camera that takes the mean of shielded pixels off hides dark charge from the mean, not from the variance: what
    dark variances grow with exposure beyond the dark mean's growth is taken off all variances first.
    """
    found, hidden, hidden_error = _fit(dark, flat, pattern), 0.0, 0.0
    for _ in range(3):  # the gain hardly depends on it
        if found.rounding or math.isnan(found.dark.slope):
            break
        exposure, seen, error = columns(dark, "exposure_s", "variance_dn2", "variance_error_dn2")
        line = straight(exposure, seen, np.maximum(error, 1e-9))
        more = line.slope - found.gain * found.dark.slope
        if hidden == 0 and more < SURELY * line.slope_error:
            break
        hidden, hidden_error = more, line.slope_error
        found = _fit(_without(dark, hidden), _without(flat, hidden), pattern)
    (exposure,) = columns([*dark, *flat], "exposure_s")
    expected = found.expected_dn2 + hidden * exposure
    return replace(found, expected_dn2=expected, hidden_dn2_s=hidden, hidden_error_dn2_s=hidden_error)


def _without(levels: Sequence[Level], hidden_dn2_s: float) -> list[Level]:
    return [
        replace(level, variance_dn2=level.variance_dn2 - hidden_dn2_s * level.exposure_s) for level in levels
    ]


def _fit(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> Transfer:
    """Each variance counts with its own error, relative to the model's variance rather than to its own, since what
    happens to be low would count more. Errors are widened where the scatter is beyond chance. Where rounding rules,
    the dark line is fitted along, because means and variances there depend on one another."""
    data = _Data(dark, flat, pattern)
    line, lowest = data.line, float(data.seen[: data.dark].min())
    rounding = lowest - 1 / 12 < PLAIN_DN2
    least = 1e-6 * float(data.seen.max() / data.mean.max())
    gain = max(straight(data.mean - line.offset, data.seen, data.error).slope, least)
    start = np.array([gain, max(lowest - 1 / 12, 1e-3), max(pattern.fixed_dn2, 1e-4)])
    scale = np.array([gain, max(lowest, 0.05), max(pattern.variance_dn2, 0.05)])
    if rounding:
        sloped = not math.isnan(line.slope)
        start = data.best_start(np.array([*start, line.offset, line.slope if sloped else 0.0]))
        scale = np.array([*scale, 1.0, 1 / max(float(data.exposure_s.max()), 1e-9)])
        start, scale = start[: 4 + sloped], scale[: 4 + sloped]
    low = np.array([1e-3, 0, 0, -np.inf, -np.inf][: len(start)])
    for _ in range(3):
        found = least_squares(
            lambda unknown: data.residuals(unknown * scale),
            np.maximum(start / scale, low),
            bounds=(low, np.inf),
            x_scale="jac",
        )
        start = found.x * scale
        data.weigh(data.model(start)[0])
    residuals = data.residuals(start)
    if not rounding:
        residuals = residuals[: len(data.seen)]  # the pattern always fits
    factor = widened(float((residuals**2).sum()), len(residuals) - (len(start) if rounding else 2))
    covariance = factor * np.linalg.pinv(found.jac.T @ found.jac) * np.outer(scale, scale)
    if rounding:
        values, errors = ([*each[3:], math.nan][:2] for each in (start, np.sqrt(np.diag(covariance))))
        line = Line(*values, *errors)
    gain, read_dn2, spread_dn2 = start[:3].tolist()
    expected = data.model(start)[0]
    return Transfer(gain, read_dn2, spread_dn2, covariance[:3, :3], line, expected, factor > 1, rounding)


class _Data:
    """Means and variances of the levels to fit, ``dark`` of them first, and the dark pattern."""

    def __init__(self, dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> None:
        names = ("exposure_s", "mean_dn", "variance_dn2", "mean_error_dn", "variance_error_dn2", "pixels")
        self.exposure_s, self.mean, self.seen, mean_error, noise, pixels = columns([*dark, *flat], *names)
        self.dark, self.pattern, self.line = len(dark), pattern, dark_line(dark)
        self._counted = 1.5 / pixels  # variance of one pixel that is off by one
        self._relative = np.maximum(noise / np.maximum(self.seen, 1e-9), 1e-6)
        self.error = np.hypot(noise, self._counted)
        # rounding acts on the pixels that there are, whose means are a sample of the pattern
        self._mean_error = np.hypot(mean_error, np.sqrt(pattern.variance_dn2 / pixels) + self._counted)

    def weigh(self, expected: Floats) -> None:
        """Take errors by the expected variance; at least the measured ones where rounding rules."""
        error = np.hypot(self._relative * expected, self._counted)
        self.error = np.where(expected < PLAIN_DN2, np.maximum(error, self.error), error)

    def model(self, values: Floats) -> tuple[Floats, float, Floats]:
        """Variance at each level, variance over pixels of the dark mean, mean at each dark level.

        values: gain, read_dn2, spread_dn2, and where rounding rules the dark line's offset and slope.
        """
        gain, read_dn2, spread_dn2 = values[:3]
        if len(values) == 3:
            variance = read_dn2 + 1 / 12 + gain * (self.mean - self.line.offset)
            return variance, spread_dn2, self.mean[: self.dark]
        offset, slope = values[3], values[4] if len(values) > 4 else 0.0
        means = np.concatenate([offset + slope * self.exposure_s[: self.dark], self.mean[self.dark :]])
        before = np.maximum(read_dn2 + gain * (means - offset), 0.0)
        after = rounded(means, before, math.sqrt(max(spread_dn2, 0.0)))
        return after.variance_dn2, spatial_variance(after.pixel_dn[: self.dark]), after.mean_dn[: self.dark]

    def residuals(self, values: Floats) -> Floats:
        """Of the variances, of the pattern, and where rounding rules of the dark means; over their errors."""
        variance, spread, dark = self.model(values)
        pattern = (self.pattern.fixed_dn2 - spread) / max(self.pattern.error_dn2, 1e-9)
        parts = [(self.seen - variance) / self.error, np.array([pattern])]
        if len(values) > 3:
            parts.append((self.mean[: self.dark] - dark) / self._mean_error[: self.dark])
        return np.concatenate(parts)

    def best_start(self, start: Floats) -> Floats:
        """Of starts over read noise and the phase of the black level the best: there are several minima."""
        tries = [
            np.array([start[0], (0.04 * 1.5**step) ** 2, start[2], start[3] + phase, start[4]])
            for step in range(8)
            for phase in (-0.4, -0.2, 0.0, 0.2, 0.4)
        ]
        return min([start, *tries], key=lambda each: float((self.residuals(each) ** 2).sum()))
