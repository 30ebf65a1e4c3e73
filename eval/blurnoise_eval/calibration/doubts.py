"""Doubts about fitted figures: effects in the frames that the model of photon transfer does not have."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration import checks, patterns
from blurnoise_eval.calibration.counts import MOST_MISSING, missing_numbers
from blurnoise_eval.calibration.frames import Floats, Folder
from blurnoise_eval.calibration.labels import light_of
from blurnoise_eval.calibration.levels import Level, columns, noise_of_mean
from blurnoise_eval.calibration.patterns import DarkPattern
from blurnoise_eval.calibration.rounding import PLAIN_DN2, SHEPPARD_DN2
from blurnoise_eval.calibration.transfer import SURELY, Transfer, drift, straight

LEAST_DRIFT = 0.1  # relative change of the dark current over the dark frames
LEAST_HOT = 1.1  # DSNU with hot pixels over DSNU without
LEAST_CURVE = 0.03  # exponent of the signal in the gain: a gamma of 0.97
LEAST_STRAY = 0.1  # light in dark frames, as a share of the dark current
LEAST_UNEVEN = 0.2  # relative spread of the dark current over the picture
_BLOCKS = 8  # along each side


@dataclass(frozen=True)
class Doubt:
    """figures: names of the doubtful figures; margin: by which the interval of the first grows on both sides;
    reaches: what intervals hold in any case, by figure.

    >>> Doubt(("dsnu_e",), "hot pixels").margin
    0.0
    """

    figures: tuple[str, ...]
    text: str
    margin: float = 0.0
    reaches: Mapping[str, float] = field(default_factory=dict)

    def widen(self, estimates: dict[str, Estimate]) -> None:
        """Widen intervals by the margin, and to what they have to reach.

        >>> estimates = {"dsnu_e": Estimate(1.0, 0.9, 1.1)}
        >>> Doubt(("dsnu_e",), "hot pixels", margin=0.5).widen(estimates)
        >>> estimates["dsnu_e"].low, estimates["dsnu_e"].high
        (0.4, 1.6)
        >>> Doubt(("dsnu_e",), "clamped", reaches={"dsnu_e": 2.0}).widen(estimates)
        >>> estimates["dsnu_e"].low, estimates["dsnu_e"].high
        (0.4, 2.0)
        """
        name = self.figures[0]
        if self.margin and (estimate := estimates.get(name)):
            low, high = max(0.0, estimate.low - self.margin), estimate.high + self.margin
            estimates[name] = replace(estimate, low=low, high=high)
        for name, value in self.reaches.items():
            if estimate := estimates.get(name):
                low, high = min(estimate.low, value), max(estimate.high, value)
                estimates[name] = replace(estimate, low=low, high=high)


def warming(dark: Sequence[Level], fit: Transfer) -> Doubt | None:
    """The sensor warms (or cools): later dark frames of one exposure are brighter, in proportion to the exposure.

    Over n levels the dark current changes by at least n times its change within one. A straight line through the
    means of the levels takes n + 1 times that for dark current.
    """
    if math.isnan(fit.dark.slope):
        return _settling(dark)
    rate, error = drift(dark)
    change = abs(fit.dark.change) or abs(rate) * len(dark)
    if abs(rate) < SURELY * error or not change >= LEAST_DRIFT * abs(fit.dark.slope):  # nor where it is NaN
        return None
    does, get = ("warms", "brighter") if rate > 0 else ("cools", "darker")
    return Doubt(
        ("dark_current_e_s", "black_level_dn", "read_noise_e"),
        f"the sensor {does}: successive dark frames of one exposure get {get}, and the dark current changes by "
        f"about {change / fit.gain:.2g} e-/s in all; wait until the temperature is constant",
        (change / 2 if fit.dark.change else (1 + 1 / len(dark)) * change) / fit.gain,
    )


def _settling(dark: Sequence[Level]) -> Doubt | None:
    """Dark frames of one exposure get steadily brighter or darker, beyond their scatter."""
    for level in dark:
        order = np.arange(level.frames) - (level.frames - 1) / 2
        power, freedom = float(order @ order), level.frames - 2
        slope = float(order @ level.means_dn / power)
        rest = np.array(level.means_dn) - level.mean_dn - slope * order
        if freedom < 3 or abs(slope) < SURELY * math.sqrt(float(rest @ rest) / freedom / power):
            continue
        does, get = ("warms", "brighter") if slope > 0 else ("cools", "darker")
        change = abs(slope) * (level.frames - 1)
        text = f"the sensor {does}: successive frames of {level} get {get}, by {change:.2g} DN in all"
        return Doubt(("black_level_dn",), f"{text}; wait until the temperature is constant", change / 2)
    return None


def hot_pixels(pattern: DarkPattern, fit: Transfer) -> Doubt | None:
    """Pixels are far outside the fixed pattern of the others; a DSNU with them would describe neither."""
    with_them = math.sqrt(fit.spread_dn2 + pattern.outlying_dn2)
    if not pattern.outliers or fit.spread_dn2 <= 0 or with_them < LEAST_HOT * math.sqrt(fit.spread_dn2):
        return None
    share = 100 * pattern.outliers / pattern.pixels
    return Doubt(
        ("dsnu_e", "dark_current_e_s"),
        f"hot pixels: {pattern.outliers} ({share:.2g} %) are far outside the dark pattern; DSNU and PRNU exclude "
        f"them (DSNU would be {with_them / fit.gain:.3g} e- with them), the mean dark current includes them",
    )


def stretched(levels: Sequence[Level], gain: float) -> Doubt | None:
    """Numbers between frequent ones never occur: they were stretched after the converter, which adds rounding."""
    never, possible = missing_numbers([level.counts for level in levels])
    if never <= MOST_MISSING * possible:
        return None
    steps = " to ".join(
        f"{step:.3g}" for step in sorted({f(level.step_dn for level in levels) for f in (min, max)})
    )
    coarse = [level for level in levels if level.coarse]
    rounding = f"numbers are {steps} DN apart, and the variance of that rounding is subtracted"
    if coarse:
        least = f"the noise is below 0.4 of a step in {coarse[0]}"
        rounding += f" ({least}, where it is not known well)"
    return Doubt(
        ("read_noise_e", "system_gain_dn_per_e", "dsnu_e"),
        f"{never} of {possible} numbers never occur between frequent ones: they were stretched after the converter "
        f"(digital gain, tone curve, LinearizationTable); {rounding}; use raw frames",
        max((level.step_dn for level in coarse), default=0.0) / math.sqrt(12) / gain,
    )


def clamped(dark: Sequence[Level], fit: Transfer) -> Doubt | None:
    """The noise of a dark level is cut off at a number; the normal distribution of the pixels above is wider."""
    # With little noise, few electrons of dark charge look like the upper half of a wider distribution.
    certain = [level for level in dark if level is dark[0] or level.variance_dn2 > PLAIN_DN2]
    found = [(level, cut) for level in certain for cut in [checks.cut_at(level)] if cut is not None]
    if not found:
        return None
    level, cut = found[0]
    counts = level.counts.astype(float)
    share = level.share(cut)
    end, step = checks.normal_cut(
        np.array([counts[: cut + 1].sum(), *counts[cut + 1 :][counts[cut + 1 :] > 0]])
    )
    # As far above the number's end as its share says, and three deviations of that.
    black_dn = cut + 0.5 - float((end[0] + 3 / math.sqrt(level.pixels)) / step[0])
    noise_e, read_e = 1 / float(step[0]) / fit.gain, math.sqrt(fit.read_dn2) / fit.gain
    by_others = f"by the pixels above, read noise and DSNU are {noise_e:.3g} e- together"
    return Doubt(
        ("read_noise_e", "dsnu_e", "black_level_dn"),
        f"black seems clamped: {100 * share:.3g} % of the pixels of {level} are {cut} DN, hardly any below; "
        f"{by_others}; raise the black level of the camera",
        # A normal distribution that is cut at a small share loses up to this share of its deviation.
        max(noise_e - read_e, read_e * min(share, checks.MOST_CUT)),
        {"dsnu_e": noise_e, "black_level_dn": black_dn},
    )


def tone_curve(dark: Sequence[Level], flat: Sequence[Level], fit: Transfer) -> Doubt | None:
    """Noise does not grow as shot noise does, in proportion to the signal.

    For a linear camera the variance over the signal is K at any signal; after a power law of exponent gamma it is
    proportional to the signal to the power 1 - 1 / gamma, and the signal to the light to the power gamma.
    dark: by rising exposure; flat: the fitted levels.
    """
    dark_s, dark_dn2 = columns(dark, "exposure_s", "variance_dn2")
    names = ("exposure_s", "mean_dn", "variance_dn2", "variance_error_dn2")
    exposure, mean, variance, error = columns(flat, *names)
    signal, shot = mean - fit.dark.at(exposure), variance - np.interp(exposure, dark_s, dark_dn2)
    used = (signal > 0) & (shot > SURELY * error)
    if fit.rounding:  # the dark frames' variance depends on where between two numbers their mean lies
        shot, error = variance - fit.at(fit.dark.at(exposure)), np.hypot(error, fit.error(0, 1))
        used &= (shot > 0) & (variance - 1 / 12 > SHEPPARD_DN2)
    if used.sum() < 3 or np.ptp(np.log(signal[used])) < math.log(2):
        return None
    logs = np.log(signal[used])
    line = straight(logs, np.log(shot[used] / signal[used]), error[used] / shot[used])
    power, span = line.slope, float(np.ptp(logs))
    if abs(power) < max(LEAST_CURVE, SURELY * line.slope_error):
        return None
    light, _ = light_of([level.taken for level in flat])
    lit = used & (light > 0)
    if len(np.unique(light[lit])) > 1:
        gamma = np.polyfit(np.log(light[lit]), np.log(signal[lit]), 1)[0]
        if (1 - 1 / gamma) / power < 0.5:  # the means have no such curve; a sensor's own variance may bend
            return None
    return Doubt(
        ("system_gain_dn_per_e", "read_noise_e", "dark_current_e_s", "dsnu_e"),
        f"not linear: variance / signal is proportional to the signal to the power {power:+.2f}, as after a tone "
        f"curve (gamma {1 / (1 - power):.2f}) or noise reduction; gain and all values in electrons may be off by "
        f"{100 * abs(power) * span:.0f} %; use raw frames",
        fit.gain * abs(power) * span,
    )


def stray_light(
    files: Folder, dark: Sequence[Level], bright: Sequence[Level], light: Floats, fit: Transfer
) -> Doubt | None:
    """Light in the dark frames: their growth follows the sensitivity of the pixels, or is uneven over the picture.

    light (H, W): mean of the flat levels ``bright``. Sensitivity is light minus dark. Growth, DN/s, and sensitivity
    use different dark frames (every other one, and those in between), so that they have no noise in common.
    """
    black = fit.dark
    if not black.slope > SURELY * black.slope_error:  # nor where it is NaN
        return None
    exposure, variance, count = columns(dark, "exposure_s", "variance_dn2", "frames")
    centred = exposure - exposure.mean()
    slope = centred / (centred @ centred)
    at_light = 1 / len(dark) + slope * (columns(bright, "exposure_s")[0].mean() - exposure.mean())
    halves = [
        np.stack([np.mean([*files.planes(frames[half::2])], axis=0) for frames in files.dark])
        for half in (0, 1)
    ]
    growth, growth_again = (np.tensordot(slope, half, 1) for half in halves)
    dark_at_light = np.tensordot(at_light, halves[1], 1)
    signal = float((light - dark_at_light).mean())
    noise = noise_of_mean(bright) + float((variance / (count // 2) * at_light**2).sum())
    grown = patterns.without_shading(growth)
    sensitivity = patterns.without_shading((light - dark_at_light) / signal)
    used = ~(patterns.outlying(grown) | patterns.outlying(sensitivity))
    grown, sensitivity = grown[used], sensitivity[used]
    power = float(sensitivity @ sensitivity)
    rate, error = float(grown @ sensitivity) / power, float(grown.std()) / math.sqrt(power)
    true_share = 1 - noise / signal**2 * len(sensitivity) / power  # of its variance that is not noise
    if rate > SURELY * error and rate > LEAST_STRAY * true_share * black.slope and true_share > 0.05:
        of_dark = min(1.0, rate / true_share / black.slope)
        what = f"{100 * of_dark:.0f} % of the dark current is proportional to the sensitivity of the pixels to light"
    else:
        one, other = (_blocks(values) for values in (growth, growth_again))
        common, random = float(np.cov(one, other)[0, 1]), float((one - other).var()) / 2
        of_dark = math.sqrt(max(0.0, common)) / black.slope
        if of_dark <= LEAST_UNEVEN or common <= random:
            return None
        what = f"the dark current varies over the picture by {100 * of_dark:.0f} % RMS (or the sensor itself glows)"
    text = f"light in dark frames: {what}; cover the lens"
    return Doubt(("dark_current_e_s", "dsnu_e"), text, of_dark * black.slope / fit.gain)


def _blocks(growth: Floats) -> Floats:
    """Medians of blocks of the picture, for each site of a mosaic."""
    down, across = (side // (2 * _BLOCKS) for side in growth.shape)
    cropped = growth[: 2 * _BLOCKS * down, : 2 * _BLOCKS * across]
    blocks = cropped.reshape(_BLOCKS, down, 2, _BLOCKS, across, 2)
    return np.asarray(np.median(blocks, (1, 4))).ravel()
