"""Photon transfer: gain, read noise, dark current, black level and fixed pattern from few frames, with intervals.

Model (EMVA 1288 release 4, linear): a level of mean m has the temporal variance V = V_r + K (m - b) + rounding, flat
or dark, where b is the mean in the dark at no exposure and V_r = (K read)^2; the dark mean is b + K d T. Shot noise
of light and of dark charge lie on one line, so dark frames need not have the exposures of the flat ones.

Where the variances of flat levels scatter about the line beyond chance, all of them are assumed to scatter by the
same DN^2, so that the fit approaches the unweighted one of EMVA 1288. Such levels are off together with their
neighbours, so intervals are then those of leaving out one of six successive groups of levels at a time (jackknife).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.labels import Light, light_of
from blurnoise_eval.calibration.levels import Level, columns
from blurnoise_eval.calibration.patterns import DarkPattern
from blurnoise_eval.calibration.rounding import PLAIN_DN2, TWO_NUMBERS_DN, rounded, spatial_variance
from blurnoise_eval.calibration.uncertain import Uncertain, Z

F = TypeVar("F", float, Floats)
SURELY = 5.0  # standard deviations above which an effect counts as present
SUSPICIOUS = 0.01  # probability of the scatter about a line below which the errors are widened to the scatter
NOTHING = Uncertain(0.0, 0.0)
_ROUNDS = 5  # of weighing and fitting
_GROUPS = 6  # of levels, for intervals
_SAGGING = 3  # brightest exposures
_ORIGIN = 0.01  # of the brightest signal
_PHASE_DN = 0.02  # of the mean, for the derivative of what rounding adds


@dataclass(frozen=True)
class FittedLine:
    """offset + slope x, with standard deviations; the slope is NaN if all x are equal.

    change: of the slope from the first to the last level, where that was fitted.

    >>> FittedLine(offset=10.0, slope=2.0, offset_error=0.1, slope_error=0.1).at(3.0)
    16.0
    """

    offset: float
    slope: float
    offset_error: float
    slope_error: float
    change: float = 0.0

    def at(self, x: F) -> F:
        """The value at x; the offset if there is no slope."""
        return self.offset + (0.0 if math.isnan(self.slope) else self.slope) * x


@dataclass(frozen=True)
class Transfer:
    """The fit, in DN and DN^2. covariance: of (gain, read_dn2, spread_dn2). rounding: whether it matters in the dark.

    dark: the dark mean over the exposure. widened: the variances scatter beyond chance, and the covariance is widened
    to that. hidden_dn2_s: dark charge that variances show and means do not. response: change of the dark mean over
    that before rounding, by which rounding weakens small offsets of rows, columns and frames.

    >>> line = FittedLine(10.0, 0.0, 0.1, 0.1)
    >>> transfer = Transfer(0.5, 4.0, 0.0, np.zeros((3, 3)), line, widened=False, rounding=False)
    >>> transfer.noise_dn, round(transfer.at(110.0), 3)  # 4 + 1/12 + 0.5 x 100
    (2.0, 54.083)
    """

    gain: float
    read_dn2: float
    spread_dn2: float
    covariance: Floats
    dark: FittedLine
    widened: bool
    rounding: bool
    hidden_dn2_s: Uncertain = NOTHING
    response: float = 1.0

    def error(self, gain: float, read_dn2: float = 0.0, spread_dn2: float = 0.0) -> float:
        """Standard deviation of a quantity with this gradient with respect to gain, read_dn2 and spread_dn2."""
        gradient = np.array([gain, read_dn2, spread_dn2])
        return math.sqrt(max(0.0, float(gradient @ self.covariance @ gradient)))

    @property
    def noise_dn(self) -> float:
        """Noise in the dark before rounding."""
        return math.sqrt(self.read_dn2)

    def at(self, mean_dn: F) -> F:
        """Temporal variance on the line at this mean."""
        return self.read_dn2 + 1 / 12 + self.gain * (mean_dn - self.dark.offset)

    def before_rounding(self, offset_dn2: Uncertain) -> Uncertain:
        """The variance of small offsets in the dark, from that after rounding."""
        return Uncertain(*(part / self.response**2 for part in offset_dn2))

    def electrons(self, signal_dn: Uncertain) -> Estimate:
        """A signal in electrons."""
        value = signal_dn.value / self.gain
        error = math.hypot(signal_dn.error, value * self.error(1)) / self.gain
        return Uncertain(value, error).interval()

    def rms_e(self, variance_dn2: Uncertain) -> Estimate:
        """The root of a variance in electrons."""
        square = variance_dn2.value / self.gain**2
        of_gain = 2 * square * self.error(1) / self.gain
        return Uncertain(square, math.hypot(variance_dn2.error / self.gain**2, of_gain)).term()

    def estimates(
        self,
        sampled_dn2: float,
        pixel_share: Uncertain,
        lines_dn2: Uncertain = NOTHING,
    ) -> dict[str, Estimate]:
        """The figures of the camera by the names of its fields.

        sampled_dn2: variance of the mean of the fixed pattern, which is a sample of few rows and columns.
        pixel_share: share of the variance in the dark that is not of whole rows or columns; lines_dn2: variance of
        rows and columns of the fixed pattern.
        """
        gain, black = self.gain, self.dark
        black_error = math.hypot(black.offset_error, math.sqrt(sampled_dn2))
        read, spread = self.read_dn2 / gain**2, (self.spread_dn2 - lines_dn2.value) / gain**2
        read_error = math.hypot(
            pixel_share.value * self.error(-2 * read / gain, 1 / gain**2), pixel_share.error * read
        )
        spread_error = math.hypot(self.error(-2 * spread / gain, 0, 1 / gain**2), lines_dn2.error / gain**2)
        figures = {
            "system_gain_dn_per_e": Uncertain(gain, self.error(1)).interval(0.0),
            "read_noise_e": Uncertain(pixel_share.value * read, read_error).root(),
            "black_level_dn": Uncertain(black.offset, black_error).interval(),
            "dsnu_e": Uncertain(spread, spread_error).term(),
        }
        if math.isfinite(black.slope):
            figures["dark_current_e_s"] = self._dark_current()
        if self.noise_dn < TWO_NUMBERS_DN:
            # bounds: these could be as large as what noise of two numbers can hide
            hidden = TWO_NUMBERS_DN / max(self.noise_dn, 0.01)
            for name in {"read_noise_e", "dsnu_e", "dark_current_e_s"} & {*figures}:
                least = 0.0 if name == "dark_current_e_s" else TWO_NUMBERS_DN / gain
                most = max(figures[name].high, hidden * figures[name].value, least)
                figures[name] = Estimate(figures[name].value, 0.0, most)
            figures["black_level_dn"] = Estimate(black.offset, black.offset - 0.5, black.offset + 0.5)
        return figures

    def _dark_current(self) -> Estimate:
        """From the means, plus what only the variances show."""
        shown = self.electrons(Uncertain(max(0.0, self.dark.slope), self.dark.slope_error))
        value, low, high = (max(0.0, end) for end in (shown.value, shown.low, shown.high))
        more, error = (part / self.gain**2 for part in self.hidden_dn2_s)
        if not more:
            return Estimate(value, low, high)
        error = math.hypot(error, 2 * more * self.error(1) / self.gain, (high - low) / 2 / Z)
        return Uncertain(value + more, error).interval(0.0)


def fit(dark: Sequence[Level], flat: Sequence[Level], pattern: DarkPattern) -> Transfer:
    """Fit photon transfer by weighted least squares over all levels. pattern: of the dark frames.

    A camera that subtracts the mean of shielded pixels hides dark charge from the mean, but not from the variance:
    the growth of dark variances with exposure beyond that of the dark means is subtracted from all variances first.
    """
    transfer, hidden = _fit(dark, flat, pattern), NOTHING
    exposure, variance, error = columns(dark, "exposure_s", "variance_dn2", "variance_error_dn2")
    line = straight(exposure, variance, np.maximum(error, 1e-9))
    for _ in range(3):  # the gain hardly depends on the correction, so this converges at once
        more = line.slope - transfer.gain * transfer.dark.slope
        if transfer.rounding or not more > SURELY * line.slope_error:  # nor where it is NaN
            break
        hidden = Uncertain(more, line.slope_error)
        every = [replace(x, variance_dn2=x.variance_dn2 - more * x.exposure_s) for x in (*dark, *flat)]
        transfer = _fit(every[: len(dark)], every[len(dark) :], pattern)
    return replace(transfer, hidden_dn2_s=hidden)


def _fit(dark: Sequence[Level], flat: Sequence[Level], pattern: DarkPattern) -> Transfer:
    """The fit to one set of variances; if rounding matters, it includes the dark line, on which rounding depends."""
    data = _Data(dark, flat, pattern)
    line, lowest, sloped = data.line, float(data.variance[: data.dark].min()), not math.isnan(data.line.slope)
    free = 4 + sloped if data.rounding else 3
    least = 1e-6 * float(data.variance.max() / data.mean.max())
    gain = max(straight(data.mean - line.offset, data.variance, data.error).slope, least)
    noise, spread = max(lowest - 1 / 12, 1e-3), max(pattern.fixed.value, 1e-4)
    values = np.array([gain, noise, spread, line.offset, line.slope if sloped else 0.0])
    sizes = [gain, max(lowest, 0.05), max(pattern.variance_dn2, 0.05)]
    scale = np.array([*sizes, 1.0, 1 / max(float(data.exposure_s.max()), 1e-9)])[:free]
    low = np.array([1e-3, 0, 0, -np.inf, -np.inf])[:free]
    if data.rounding:
        values = data.best_start(values)
    for step in range(_ROUNDS):
        if step:
            data.weigh(values)
        rest = values[free:]
        solution = least_squares(
            lambda unknown: data.residuals(np.append(unknown * scale, rest)),  # noqa: B023  # called here
            np.maximum(values[:free] / scale, low), bounds=(low, np.inf), x_scale="jac",
        )  # fmt: skip
        values = np.append(solution.x * scale, rest)
    residuals = data.residuals(values)
    # without rounding, the spread of the pattern is determined by itself and always fits
    factor = _widened(residuals, free) if data.rounding else _widened(residuals[: len(data.variance)], 2)
    covariance = factor * np.linalg.pinv(solution.jac.T @ solution.jac)
    if data.scatter_dn2:
        covariance += _grouped(solution.jac, residuals, data.groups())
    covariance *= np.outer(scale, scale)
    if data.rounding:
        _, _, _, offset_error, slope_error = np.append(np.sqrt(np.diag(covariance)), math.nan)[:5]
        line = FittedLine(values[3], values[4] if sloped else math.nan, offset_error, slope_error)
    gain, read_dn2, spread_dn2 = values[:3].tolist()
    widened = factor > 1 or data.scatter_dn2 > 0
    response = data.response(values) if data.rounding else 1.0
    return Transfer(
        gain, read_dn2, spread_dn2, covariance[:3, :3], line, widened, data.rounding, response=response
    )


def _grouped(jacobian: Floats, residuals: Floats, groups: Sequence[NDArray[np.intp]]) -> Floats:
    """Covariance (k, k) of the jackknife that leaves out one group of the residuals (n,) at a time."""
    inverse, changes = np.linalg.pinv(jacobian.T @ jacobian), []
    for group in groups:
        part = jacobian[group]
        left = np.eye(len(group)) - part @ inverse @ part.T
        changes.append(inverse @ part.T @ np.linalg.pinv(left) @ residuals[group])
    count = len(groups)
    off = np.array(changes) - np.mean(changes, 0)
    few = (student.ppf(0.975, count - 1) / Z) ** 2  # so that 1.96 deviations are 95 %
    return np.asarray(few * (count - 1) / count * off.T @ off)


def _scatter(off: Floats, error: Floats) -> float:
    """Standard deviation beyond the errors of n values that are off a line; 0 if that is chance."""
    if chi2.sf(float(((off / error) ** 2).sum()), len(off) - 1) > SUSPICIOUS:
        return 0.0

    def excess(variance: float) -> float:
        return float((off**2 / (error**2 + variance)).sum()) - (len(off) - 1)

    return math.sqrt(brentq(excess, 0.0, float((off**2).sum())))


class _Data:
    """Means and variances of the levels to fit, the ``dark`` ones first, and the pattern of the dark frames."""

    def __init__(self, dark: Sequence[Level], flat: Sequence[Level], pattern: DarkPattern) -> None:
        names = ("exposure_s", "mean_dn", "variance_dn2", "mean_error_dn", "variance_error_dn2", "pixels")
        self.exposure_s, self.mean, self.variance, mean_error, noise, pixels = columns([*dark, *flat], *names)
        self.dark, self.pattern, self.line = len(dark), pattern, dark_line(dark)
        # Only there does rounding depend on where between two numbers the mean lies.
        self.rounding = float(self.variance[: self.dark].min()) - 1 / 12 < PLAIN_DN2
        self._counted = 1.5 / pixels  # variance of one pixel that is off by one
        self._measured = np.hypot(noise, self._counted)
        self._relative = np.maximum(noise / np.maximum(self.variance, 1e-9), 1e-6)
        self.error, self.scatter_dn2 = self._measured, 0.0
        self._black_error = mean_error  # an error of the mean counts as charge
        # rounding acts on these pixels, whose means are a sample of the pattern
        self._mean_error = np.hypot(mean_error, np.sqrt(pattern.variance_dn2 / pixels) + self._counted)

    def weigh(self, values: Floats) -> None:
        """Set errors relative to the expected variance, because levels that are low by chance would count more.

        If rounding matters, the measured errors are the least, and an error of the mean counts by what rounding makes
        of it. Flat levels have the scatter beyond chance in addition.
        """
        expected = self.model(values)[0]
        error = np.hypot(np.hypot(self._relative * expected, self._counted), values[0] * self._black_error)
        if self.rounding:
            low = expected < PLAIN_DN2
            moved = self.model(values, _PHASE_DN)[0] - self.model(values, -_PHASE_DN)[0]
            error = np.hypot(error, np.where(low, moved / (2 * _PHASE_DN) * self._black_error, 0.0))
            error = np.where(low, np.maximum(error, self._measured), error)
        self.scatter_dn2 = _scatter((self.variance - expected)[self.dark :], error[self.dark :])
        error[self.dark :] = np.hypot(error[self.dark :], self.scatter_dn2)
        if self.scatter_dn2:  # the shot noise of dark charge, a small signal, must not decide K instead
            charge_dn = np.maximum(self.mean[: self.dark] - values[3], 0.0)
            error[: self.dark] = np.hypot(error[: self.dark], values[0] * charge_dn)
        self.error = error

    def response(self, values: Floats) -> float:
        """Change of the dark mean over that before rounding; at least 5 %, below which offsets drown."""
        ends = [float(self.model(values, moved)[2].mean()) for moved in (-_PHASE_DN, _PHASE_DN)]
        return max(0.05, (ends[1] - ends[0]) / (2 * _PHASE_DN))

    def groups(self) -> list[NDArray[np.intp]]:
        """Indices of flat levels in groups of successive means."""
        order = self.dark + np.argsort(self.mean[self.dark :])
        return np.array_split(order, min(_GROUPS, len(order)))

    def model(self, values: Floats, moved_dn: float = 0.0) -> tuple[Floats, float, Floats]:
        """Variance at each level, variance over pixels of the dark mean frame, mean at each dark level.

        values: gain, read_dn2, spread_dn2, and offset and slope of the dark line, which rounding needs. moved_dn: of
        all means.
        """
        gain, read_dn2, spread_dn2, offset, slope = values
        if not self.rounding:
            variance = read_dn2 + 1 / 12 + gain * (self.mean - self.line.offset)
            return variance, spread_dn2, self.mean[: self.dark]
        means = np.concatenate([offset + slope * self.exposure_s[: self.dark], self.mean[self.dark :]])
        before = np.maximum(read_dn2 + gain * (means - offset), 0.0)
        # of flat levels, only those of little noise depend on rounding
        some = np.append(np.arange(self.dark), self.dark + np.flatnonzero(before[self.dark :] < PLAIN_DN2))
        spread = math.sqrt(max(spread_dn2, 0.0))
        mean, after, by_pixel = rounded(means[some] + moved_dn, before[some], spread)
        variance = before + 1 / 12
        variance[some] = after
        return variance, spatial_variance(by_pixel[: self.dark]), mean[: self.dark]

    def residuals(self, values: Floats) -> Floats:
        """Residuals of the variances, of the pattern and of the dark means, divided by their errors."""
        variance, spread, dark = self.model(values)
        pattern = (self.pattern.fixed.value - spread) / max(self.pattern.fixed.error, 1e-9)
        means = (self.mean[: self.dark] - dark) / self._mean_error[: self.dark]
        return np.concatenate([(self.variance - variance) / self.error, [pattern], means])

    def best_start(self, start: Floats) -> Floats:
        """The best of several starts for read noise and the phase of the black level: there are several minima."""
        gain, _, spread, offset, slope = start
        starts = [start]
        # Read noise from .04 DN on, in steps of half as much again; a black level anywhere between two numbers.
        for step, phase in product(range(8), (-0.4, -0.2, 0.0, 0.2, 0.4)):
            starts.append(np.array([gain, (0.04 * 1.5**step) ** 2, spread, offset + phase, slope]))
        return min(starts, key=lambda values: float((self.residuals(values) ** 2).sum()))


def dark_line(dark: Sequence[Level]) -> FittedLine:
    """Fit the dark mean over the exposure in seconds; levels by rising exposure.

    If the levels drift, dark current changes by the same amount from each level to the next.
    """
    exposure, mean, error = columns(dark, "exposure_s", "mean_dn", "mean_error_dn")
    # without noise, the mean of integers is known to one step in one pixel
    error = np.hypot(error, [1e-6 + 1 / (level.frames * level.pixels) for level in dark])
    rate, rate_error = drift(dark)
    if abs(rate) < SURELY * rate_error or len(np.unique(exposure)) < 4:
        return straight(exposure, mean, error)
    order = np.arange(len(dark)) - (len(dark) - 1) / 2
    design = [np.ones(len(dark)), exposure, exposure * order]
    (offset, slope, change), errors = _weighted_fit(design, mean, error)
    return FittedLine(offset, slope, errors[0], errors[1], change * len(dark))


def drift(dark: Sequence[Level]) -> Uncertain:
    """Change of the dark current from the first to the last frame of a level, DN/s, and its standard deviation."""
    exposure, change, variance, pixels = columns(dark, "exposure_s", "drift_dn", "variance_dn2", "pixels")
    (rate,), (error,) = _weighted_fit([exposure], change, np.sqrt(2 * variance / pixels + 1e-12))
    return Uncertain(rate, error)


def straight(x: Floats, y: Floats, error: Floats) -> FittedLine:
    """Fit a straight line to (x, y), weighted by the errors of y.

    >>> line = straight(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0]), np.ones(3))
    >>> round(line.offset, 6), round(line.slope, 6), round(float(line.at(10.0)), 6)
    (1.0, 2.0, 21.0)
    """
    design = [np.ones(len(x)), x][: len(np.unique(x))]
    values, errors = ([*numbers, math.nan][:2] for numbers in _weighted_fit(design, y, error))
    return FittedLine(*values, *errors)


def _weighted_fit(design: Sequence[Floats], y: Floats, error: Floats) -> tuple[list[float], list[float]]:
    """Factors (k,) of the k columns (n,) of the design that fit y (n,), and their standard deviations."""
    scaled, target = np.stack(design, 1) / error[:, None], y / error
    values, *_ = np.linalg.lstsq(scaled, target)
    factor = _widened(scaled @ values - target, len(values))
    covariance = factor * np.linalg.inv(scaled.T @ scaled)
    return values.tolist(), np.sqrt(np.diag(covariance)).tolist()


def _widened(residuals: Floats, fitted: int) -> float:
    """Factor of the variance for scatter beyond chance: chi-square per degree of freedom, or 1."""
    chi_square, freedom = float((residuals**2).sum()), len(residuals) - fitted
    if freedom < 1 or chi2.sf(chi_square, freedom) > SUSPICIOUS:
        return 1.0
    return max(1.0, chi_square / freedom)


@dataclass(frozen=True)
class Linearity:
    """Signal against light: slope in DN per unit of ``light``; x in that unit; deviation relative.

    responsivity: slope of the line through the origin. error: largest deviation from the line among the fitted
    levels, at level ``worst``. sags: the signal leaves the line well before saturation.
    """

    slope: float
    offset: float
    responsivity: Uncertain
    x: Floats
    deviation: Floats
    worst: int
    error: Estimate
    light: Light
    sags: bool = False

    def sagging(self, others: Linearity) -> bool:
        """Whether signals sag near saturation: this line is that of levels below 70 % of it, ``others`` are of all.

        It goes through the origin, unlike one after a tone curve, and the levels above lie ever further below it.
        """
        above = np.sort(self.x[self.x > 0])[-_SAGGING:]
        off = np.array([self.deviation[self.x == x].mean() for x in above])
        straight = self.error.value < others.error.value / 2
        begins = abs(self.offset) < _ORIGIN * self.slope * float(self.x.max())
        return bool(straight and begins and (off[-1] < 0) and (np.diff(off) < 0).all())


def linearity(flat: Sequence[Level], signal: Floats, top_dn: float) -> Linearity | None:
    """Fit signal against light as EMVA 1288 does (weights 1/signal), over 5 to 95 % of the signal ``top_dn``.

    signal (N,): mean of each level minus that in the dark. None if fewer than three levels are in that range.
    """
    x, light = light_of([level.taken for level in flat])
    (mean_error,) = columns(flat, "mean_error_dn")
    inside = (signal >= 0.05 * top_dn) & (signal <= 0.95 * top_dn)
    count = int(inside.sum())
    if len(np.unique(x[inside])) < 3:
        return None
    design = np.stack([x[inside], np.ones(count)], 1) / signal[inside, None]
    (slope, offset), *_ = np.linalg.lstsq(design, np.ones(count))
    line = slope * x + offset
    deviation = np.divide(signal - line, line, out=np.zeros_like(line), where=line > 0)
    worst = int(np.argmax(np.where(inside, np.abs(deviation), -1)))
    error = mean_error[inside] / signal[inside]
    scatter = math.hypot(float(deviation[inside].std(ddof=1)), float(np.sqrt((error**2).mean())))
    through_0 = x[inside] / signal[inside]
    rate = float(through_0.sum() / (through_0 @ through_0))
    rate_error = rate * math.hypot(float(rate * through_0.std(ddof=1)), scatter) / math.sqrt(count)
    off = Uncertain(abs(float(deviation[worst])), float(error.max())).interval(0.0)
    responsivity = Uncertain(rate, rate_error)
    return Linearity(float(slope), float(offset), responsivity, x, deviation, worst, off, light)
