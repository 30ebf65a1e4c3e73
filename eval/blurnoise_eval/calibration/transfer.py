"""Photon transfer: gain, read noise, dark current, black level and fixed pattern from few frames, with intervals.

Model (EMVA 1288 release 4, linear): a level of mean m has the temporal variance V = V_r + K (m - b) + rounding, flat
or dark, with b the mean in the dark at no exposure and V_r = (K read)^2; the dark mean is b + K d T. Shot noise of
light and of dark charge lie on one line, so dark frames need not have the flat ones' exposures.

Rounding adds 1/12 DN^2 from about 0.7 DN of noise on. Below, the variance depends on where between two numbers the
mean lies: at 0.25 DN rounding adds -0.017 to 0.188 DN^2. Pixels whose means differ (DSNU) average over it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr
from scipy.stats import chi2

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.levels import Level, Pattern, columns
from blurnoise_eval.calibration.structure import Uncertain, Z

F = TypeVar("F", float, Floats)
SURELY = 5.0  # standard deviations from which on something is there
SUSPICIOUS = 0.01  # probability of the scatter about a line below which its errors are widened to the scatter
PLAIN_DN2 = 0.7**2
"""Variance before rounding from which on it adds 1/12: the first term left out is 2e^(-2 pi^2 0.49), 0.01 %."""
TWO_NUMBERS_DN = 0.2
"""Noise before rounding below which dark pixels hold two numbers at most (a third is 5 deviations away half of the
time): their shares tell the noise's ratio to black level, DSNU and dark current, but none of the four."""
_LEAST_DN2 = 1e-8
_WIDEST_DN = 4.0  # of a spread; beyond it all phases are equally frequent anyway
_NODES = np.linspace(-4, 4, 161)
_WEIGHTS = np.exp(-_NODES * _NODES / 2) / np.exp(-_NODES * _NODES / 2).sum()
_REACH = np.arange(-6.0, 7.0)


@dataclass(frozen=True)
class Line:
    """offset + slope x, with standard deviations; slope NaN where there is one x only.

    change: of the slope over all levels, about the slope, where that was fitted.
    """

    offset: float
    slope: float
    offset_error: float
    slope_error: float
    change: float = 0.0

    def at(self, x: F) -> F:
        """Its value; the offset where there is no slope."""
        return self.offset + (0.0 if math.isnan(self.slope) else self.slope) * x


def normal(value: float, error: float, least: float = -math.inf) -> Estimate:
    """A value with a normal error, whose interval ends at ``least``."""
    return Estimate(value, max(least, value - Z * error), value + Z * error)


def root(square: float, error: float) -> Estimate:
    """The root of a square that is known with a normal error, at least 0."""
    ends = (square, square - Z * error, square + Z * error)
    value, low, high = (math.sqrt(max(0.0, each)) for each in ends)
    return Estimate(value, low, high)


def term(square: float, error: float) -> Estimate:
    """As ``root``; 0 where its interval includes 0, as of a term that a camera need not have."""
    found = root(square, error)
    return found if found.low > 0 else replace(found, value=0.0)


@dataclass(frozen=True)
class Transfer:
    """The fit, in DN and DN^2. covariance: of (gain, read_dn2, spread_dn2). rounding: it rules in the dark.

    dark: the dark mean over the exposure. widened: the variances scatter beyond chance, and the covariance was
    widened for that. hidden_dn2_s: dark charge that variances show and means do not, and its deviation.
    """

    gain: float
    read_dn2: float
    spread_dn2: float
    covariance: Floats
    dark: Line
    widened: bool
    rounding: bool
    hidden_dn2_s: tuple[float, float] = (0.0, 0.0)

    def error(self, gain: float, read_dn2: float = 0.0, spread_dn2: float = 0.0) -> float:
        """Standard deviation of what has this gradient with respect to gain, read_dn2 and spread_dn2."""
        along = np.array([gain, read_dn2, spread_dn2])
        return math.sqrt(max(0.0, float(along @ self.covariance @ along)))

    @property
    def noise_dn(self) -> float:
        """Noise in the dark before rounding."""
        return math.sqrt(self.read_dn2)

    def at(self, mean_dn: F) -> F:
        """Temporal variance of a level of this mean, on the line."""
        return self.read_dn2 + 1 / 12 + self.gain * (mean_dn - self.dark.offset)

    def electrons(self, dn: float, error_dn: float) -> Estimate:
        """Of a signal in DN."""
        value = dn / self.gain
        return normal(value, math.hypot(error_dn, value * self.error(1)) / self.gain)

    def rms_e(self, square_dn2: float, error_dn2: float) -> Estimate:
        """Of a term's variance in DN^2."""
        square = square_dn2 / self.gain**2
        return term(square, math.hypot(error_dn2 / self.gain**2, 2 * square * self.error(1) / self.gain))

    def estimates(
        self, pixels: int, own: Uncertain = (1.0, 0.0), pattern_dn2: Uncertain = (0.0, 0.0)
    ) -> dict[str, Estimate]:
        """The camera's figures by the names of its fields. pixels: of a frame.

        own: share of the noise in the dark that is not of whole rows or columns; pattern_dn2: variance of those of
        the fixed pattern.
        """
        gain, black = self.gain, self.dark
        # these pixels are a sample: their mean is the camera's to within the pattern's spread over its root
        black_error = math.hypot(black.offset_error, math.sqrt(self.spread_dn2 / pixels))
        read, spread = self.read_dn2 / gain**2, (self.spread_dn2 - pattern_dn2[0]) / gain**2
        read_error = math.hypot(own[0] * self.error(-2 * read / gain, 1 / gain**2), own[1] * read)
        spread_error = math.hypot(self.error(-2 * spread / gain, 0, 1 / gain**2), pattern_dn2[1] / gain**2)
        found = {
            "system_gain_dn_per_e": normal(gain, self.error(1), 0.0),
            "read_noise_e": root(own[0] * read, read_error),
            "black_level_dn": normal(black.offset, black_error),
            "dsnu_e": term(spread, spread_error),
        }
        if math.isfinite(black.slope):
            current = self.electrons(black.slope, black.slope_error)
            value, low, high = (max(0.0, each) for each in (current.value, current.low, current.high))
            found["dark_current_e_s"] = Estimate(value, low, high)
            more, error = (each / gain**2 for each in self.hidden_dn2_s)
            if more:
                error = math.hypot(error, 2 * more * self.error(1) / gain, (high - low) / 2 / Z)
                found["dark_current_e_s"] = normal(value + more, error, 0.0)
        if self.noise_dn < TWO_NUMBERS_DN:
            # what would go with as much noise as two numbers could have and hide
            hidden = TWO_NUMBERS_DN / max(self.noise_dn, 0.01)
            for name in {"read_noise_e", "dsnu_e", "dark_current_e_s"} & {*found}:
                least = TWO_NUMBERS_DN / gain if name == "read_noise_e" else 0.0
                most = max(found[name].high, hidden * found[name].value, least)
                found[name] = Estimate(found[name].value, 0.0, most)
            found["black_level_dn"] = Estimate(black.offset, black.offset - 0.5, black.offset + 0.5)
        return found


def fit(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> Transfer:
    """Weighted least squares over all levels. pattern: of the dark frames' mean.

    A camera that takes the mean of shielded pixels off hides dark charge from the mean, not from the variance: what
    dark variances grow with exposure beyond the dark mean's growth is taken off all variances first.
    """
    found, hidden = _fit(dark, flat, pattern), (0.0, 0.0)
    exposure, seen, error = columns(dark, "exposure_s", "variance_dn2", "variance_error_dn2")
    line = straight(exposure, seen, np.maximum(error, 1e-9))
    for _ in range(3):  # the gain hardly depends on it
        more = line.slope - found.gain * found.dark.slope
        if found.rounding or not more > SURELY * line.slope_error:  # nor where it is NaN
            break
        hidden = more, line.slope_error
        every = [replace(x, variance_dn2=x.variance_dn2 - more * x.exposure_s) for x in (*dark, *flat)]
        found = _fit(every[: len(dark)], every[len(dark) :], pattern)
    return replace(found, hidden_dn2_s=hidden)


def _fit(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> Transfer:
    """The fit of one set of variances; where rounding rules, the dark line is fitted along, as both depend on it."""
    data = _Data(dark, flat, pattern)
    line, lowest, sloped = data.line, float(data.seen[: data.dark].min()), not math.isnan(data.line.slope)
    free = 4 + sloped if data.rounding else 3
    least = 1e-6 * float(data.seen.max() / data.mean.max())
    gain = max(straight(data.mean - line.offset, data.seen, data.error).slope, least)
    noise, spread = max(lowest - 1 / 12, 1e-3), max(pattern.fixed_dn2, 1e-4)
    values = np.array([gain, noise, spread, line.offset, line.slope if sloped else 0.0])
    sizes = [gain, max(lowest, 0.05), max(pattern.variance_dn2, 0.05)]
    scale = np.array([*sizes, 1.0, 1 / max(float(data.exposure_s.max()), 1e-9)])[:free]
    low = np.array([1e-3, 0, 0, -np.inf, -np.inf])[:free]
    if data.rounding:
        values = data.best_start(values)
    for _ in range(3):
        rest = values[free:]
        found = least_squares(
            lambda unknown: data.residuals(np.append(unknown * scale, rest)),  # noqa: B023  # called here
            np.maximum(values[:free] / scale, low), bounds=(low, np.inf), x_scale="jac",
        )  # fmt: skip
        values = np.append(found.x * scale, rest)
        data.weigh(data.model(values)[0], float(values[0]))
    residuals = data.residuals(values)
    # where rounding does not rule, the pattern, and its spread, always fit
    factor = _widened(residuals, free) if data.rounding else _widened(residuals[: len(data.seen)], 2)
    covariance = factor * np.linalg.pinv(found.jac.T @ found.jac) * np.outer(scale, scale)
    if data.rounding:
        _, _, _, offset_error, slope_error = np.append(np.sqrt(np.diag(covariance)), math.nan)[:5]
        line = Line(values[3], values[4] if sloped else math.nan, offset_error, slope_error)
    gain, read_dn2, spread_dn2 = values[:3].tolist()
    return Transfer(gain, read_dn2, spread_dn2, covariance[:3, :3], line, factor > 1, data.rounding)


class _Data:
    """Means and variances of the levels to fit, ``dark`` of them first, and the dark pattern."""

    def __init__(self, dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> None:
        names = ("exposure_s", "mean_dn", "variance_dn2", "mean_error_dn", "variance_error_dn2", "pixels")
        self.exposure_s, self.mean, self.seen, mean_error, noise, pixels = columns([*dark, *flat], *names)
        self.dark, self.pattern, self.line = len(dark), pattern, dark_line(dark)
        self.rounding = float(self.seen[: self.dark].min()) - 1 / 12 < PLAIN_DN2
        self._counted = 1.5 / pixels  # variance of one pixel that is off by one
        self._relative = np.maximum(noise / np.maximum(self.seen, 1e-9), 1e-6)
        self.error = np.hypot(noise, self._counted)
        self._black_error = mean_error  # of a mean that is taken for charge
        # rounding acts on the pixels that there are, whose means are a sample of the pattern
        self._mean_error = np.hypot(mean_error, np.sqrt(pattern.variance_dn2 / pixels) + self._counted)

    def weigh(self, expected: Floats, gain: float) -> None:
        """Errors relative to the expected variance, as what happens to be low would count more; at least the
        measured ones where rounding rules."""
        error = np.hypot(np.hypot(self._relative * expected, self._counted), gain * self._black_error)
        self.error = np.where(expected < PLAIN_DN2, np.maximum(error, self.error), error)

    def model(self, values: Floats) -> tuple[Floats, float, Floats]:
        """Variance at each level, variance over pixels of the dark mean, mean at each dark level.

        values: gain, read_dn2, spread_dn2, the dark line's offset and slope, of which rounding takes the means.
        """
        gain, read_dn2, spread_dn2, offset, slope = values
        if not self.rounding:
            variance = read_dn2 + 1 / 12 + gain * (self.mean - self.line.offset)
            return variance, spread_dn2, self.mean[: self.dark]
        means = np.concatenate([offset + slope * self.exposure_s[: self.dark], self.mean[self.dark :]])
        before = np.maximum(read_dn2 + gain * (means - offset), 0.0)
        mean, after, by_pixel = rounded(means, before, math.sqrt(max(spread_dn2, 0.0)))
        return after, spatial_variance(by_pixel[: self.dark]), mean[: self.dark]

    def residuals(self, values: Floats) -> Floats:
        """Of the variances, of the pattern and of the dark means, over their errors."""
        variance, spread, dark = self.model(values)
        pattern = (self.pattern.fixed_dn2 - spread) / max(self.pattern.error_dn2, 1e-9)
        means = (self.mean[: self.dark] - dark) / self._mean_error[: self.dark]
        return np.concatenate([(self.seen - variance) / self.error, [pattern], means])

    def best_start(self, start: Floats) -> Floats:
        """Of starts over read noise and the phase of the black level the best: there are several minima."""
        gain, _, spread, offset, slope = start
        tries = [start]
        for step, phase in product(range(8), (-0.4, -0.2, 0.0, 0.2, 0.4)):
            tries.append(np.array([gain, (0.04 * 1.5**step) ** 2, spread, offset + phase, slope]))
        return min(tries, key=lambda each: float((self.residuals(each) ** 2).sum()))


def dark_line(dark: Sequence[Level]) -> Line:
    """The dark mean over the exposure in seconds, of levels by rising exposure.

    Where the levels drift, dark current is taken to change evenly from one level to the next.
    """
    exposure, mean, error = columns(dark, "exposure_s", "mean_dn", "mean_error_dn")
    # a mean of whole numbers that hardly vary is known no better than to one pixel
    error = np.hypot(error, [1e-6 + 1 / (level.frames * level.pixels) for level in dark])
    rate, rate_error = drift(dark)
    if abs(rate) < SURELY * rate_error or len(np.unique(exposure)) < 4:
        return straight(exposure, mean, error)
    place = np.arange(len(dark)) - (len(dark) - 1) / 2
    design = [np.ones(len(dark)), exposure, exposure * place]
    (offset, slope, change), errors = _weighted_fit(design, mean, error)
    return Line(offset, slope, errors[0], errors[1], change * len(dark))


def drift(dark: Sequence[Level]) -> tuple[float, float]:
    """How dark current changes within a level, DN/s from its first frame to its last, and its standard deviation."""
    exposure, change, variance, pixels = columns(dark, "exposure_s", "drift_dn", "variance_dn2", "pixels")
    (rate,), (error,) = _weighted_fit([exposure], change, np.sqrt(2 * variance / pixels + 1e-12))
    return rate, error


def straight(x: Floats, y: Floats, error: Floats) -> Line:
    """Weighted straight line through (x, y)."""
    design = [np.ones(len(x)), x][: len(np.unique(x))]
    values, errors = ([*each, math.nan][:2] for each in _weighted_fit(design, y, error))
    return Line(*values, *errors)


def _weighted_fit(design: Sequence[Floats], y: Floats, error: Floats) -> tuple[list[float], list[float]]:
    """Factors (k,) of the k columns (n,) whose sum is next to y (n,), and their standard deviations."""
    scaled, of = np.stack(design, 1) / error[:, None], y / error
    values, *_ = np.linalg.lstsq(scaled, of)
    factor = _widened(scaled @ values - of, len(values))
    covariance = factor * np.linalg.inv(scaled.T @ scaled)
    return values.tolist(), np.sqrt(np.diag(covariance)).tolist()


def _widened(residuals: Floats, fitted: int) -> float:
    """By how much a variance grows for scatter beyond chance: chi-square per degree of freedom, or 1."""
    chi_square, freedom = float((residuals**2).sum()), len(residuals) - fitted
    if freedom < 1 or chi2.sf(chi_square, freedom) > SUSPICIOUS:
        return 1.0
    return max(1.0, chi_square / freedom)


def rounded(mean_dn: Floats, variance_dn2: Floats, spread_dn: float) -> tuple[Floats, Floats, Floats]:
    """What rounding makes of normal noise; pixels' means are normal, too, about ``mean_dn`` by ``spread_dn``.

    Returns mean and variance, (N,), averages over the pixels, and the mean number by pixel, (N, nodes).
    """
    places = mean_dn[:, None] + min(spread_dn, _WIDEST_DN) * _NODES
    sigma = np.sqrt(np.clip(variance_dn2, _LEAST_DN2, PLAIN_DN2))[:, None, None]
    off = np.round(places)[..., None] + _REACH - places[..., None]
    share = ndtr((off + 0.5) / sigma) - ndtr((off - 0.5) / sigma)
    shift = (share * off).sum(-1)
    variance = (share * off * off).sum(-1) - shift**2
    low = variance_dn2 < PLAIN_DN2
    mean = np.where(low, mean_dn + shift @ _WEIGHTS, mean_dn)
    after = np.where(low, variance @ _WEIGHTS, variance_dn2 + 1 / 12)
    return mean, after, np.where(low[:, None], places + shift, places)


def spatial_variance(pixel_dn: Floats) -> float:
    """Variance over pixels of the mean over rows of ``pixel_dn`` (N, nodes)."""
    mean = pixel_dn.mean(0)
    return float(((mean - mean @ _WEIGHTS) ** 2) @ _WEIGHTS)


@dataclass(frozen=True)
class Linearity:
    """Signal against light: slope in DN per unit of ``light``; x in that unit, deviation a fraction.

    responsivity: slope of the line through the origin, which a camera without an offset of its own has. error:
    largest deviation from the line among the levels that it is fitted to, which is at ``worst``.
    """

    slope: float
    offset: float
    responsivity: Uncertain
    x: Floats
    deviation: Floats
    worst: int
    error: Estimate
    light: Literal["photons", "lux s", "s"]


def linearity(flat: Sequence[Level], signal: Floats, top_dn: float) -> Linearity | None:
    """Signal against light by EMVA 1288's fit (weights 1/signal) over 5 to 95 % of ``top_dn``, a signal.

    signal (N,): mean of each level less that in the dark. None where fewer than three levels are in that range.
    """
    x, lux, photons, mean_error = columns(
        flat, "exposure_s", "illuminance_lux", "photons_per_px", "mean_error_dn"
    )
    light: Literal["photons", "lux s", "s"] = "s"
    if not np.isnan(photons).any():
        x, light = photons, "photons"
    elif len(np.unique(lux)) > 1 and not np.isnan(lux).any():
        x, light = lux * x, "lux s"
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
    off = normal(abs(float(deviation[worst])), float(error.max()), least=0.0)
    return Linearity(float(slope), float(offset), (rate, rate_error), x, deviation, worst, off, light)
