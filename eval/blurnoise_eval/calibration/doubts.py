"""Doubts about frames: what makes a fit wrong although each level is sound by itself, and the figures it concerns.

A sensor that warms while its dark frames are taken, hot pixels, a tone curve, and light in dark frames. Exposures in
seconds, means and variances in steps of the converter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.calibration import lines
from blurnoise_eval.calibration.frames import Folder
from blurnoise_eval.calibration.levels import Floats, Level, columns
from blurnoise_eval.calibration.lines import SURELY
from blurnoise_eval.calibration.patterns import Pattern, noise_of_mean, outlying, without_shading
from blurnoise_eval.calibration.transfer import Transfer

LEAST_DRIFT = 0.1
"""Change of the dark current over the dark frames, of itself."""
LEAST_HOT = 1.1
"""DSNU with hot pixels over that without."""
LEAST_CURVE = 0.03
"""Exponent of the signal in the gain: a gamma of 0.97."""
LEAST_STRAY = 0.1
"""Light in dark frames, of the dark current."""
LEAST_UNEVEN = 0.2
"""Spread of the dark current over the picture, of itself."""
_BLOCKS = 8  # along each side


@dataclass(frozen=True)
class Doubt:
    """figures: names of those that are in doubt; margin: by how much the first one's interval grows to both sides."""

    figures: tuple[str, ...]
    text: str
    margin: float = 0.0


def widened(estimates: dict[str, Estimate], doubts: Sequence[Doubt]) -> dict[str, Estimate]:
    """The estimates with the doubts' margins."""
    found = dict(estimates)
    for doubt in doubts:
        if known := found.get(doubt.figures[0]):
            low, high = max(0.0, known.low - doubt.margin), known.high + doubt.margin
            found[doubt.figures[0]] = replace(known, low=low, high=high) if doubt.margin else known
    return found


def drift(dark: Sequence[Level], fit: Transfer) -> Doubt | None:
    """A sensor that warms (or cools): of one exposure the later dark frames are brighter, by the exposure's length.

    Over n levels dark current changes by n times what it changes within one, at least; a straight line through their
    means takes n + 1 times that for dark current.
    """
    rate, error = lines.drift(dark)
    if math.isnan(fit.dark.slope) or abs(rate) < SURELY * error:
        return None
    change = abs(fit.dark.change) or abs(rate) * len(dark)
    if change < LEAST_DRIFT * abs(fit.dark.slope):
        return None
    does, get = ("warms", "brighter") if rate > 0 else ("cools", "darker")
    return Doubt(
        ("dark_current_e_s", "black_level_dn", "read_noise_e"),
        f"the sensor {does}: dark frames of one exposure get {get} one after the other, and dark current changes by "
        f"about {change / fit.gain:.2g} e-/s over all; take them once the camera has settled",
        (change / 2 if fit.dark.change else (1 + 1 / len(dark)) * change) / fit.gain,
    )


def hot_pixels(pattern: Pattern, fit: Transfer) -> Doubt | None:
    """Pixels far outside the fixed pattern of the others, which make a DSNU that describes neither."""
    if not pattern.outliers or fit.spread_dn2 <= 0:
        return None
    with_them = math.sqrt(fit.spread_dn2 + pattern.outlying_dn2)
    if with_them < LEAST_HOT * math.sqrt(fit.spread_dn2):
        return None
    share = 100 * pattern.outliers / pattern.pixels
    return Doubt(
        ("dsnu_e", "dark_current_e_s"),
        f"hot pixels: {pattern.outliers} ({share:.2g} %) are far outside the dark pattern; DSNU is that of the "
        f"others ({with_them / fit.gain:.3g} e- with them), dark current is the mean with them",
    )


def tone_curve(dark: Sequence[Level], flat: Sequence[Level], fit: Transfer) -> Doubt | None:
    """Noise that does not grow as shot noise does, in proportion to the signal, whatever the lamp.

    Of a linear camera the variance over the signal is K at any signal; behind a power law of exponent gamma it goes
    with the signal to the power 1 - 1 / gamma. dark: by rising exposure; flat: the levels that are fitted.
    """
    dark_s, dark_dn2 = columns(dark, "exposure_s", "variance_dn2")
    exposure, mean, seen, error = columns(flat, "exposure_s", "mean_dn", "variance_dn2", "variance_error_dn2")
    signal, shot = mean - fit.dark.at(exposure), seen - np.interp(exposure, dark_s, dark_dn2)
    some = (signal > 0) & (shot > SURELY * error)
    if some.sum() < 3 or np.ptp(np.log(signal[some])) < math.log(2):
        return None
    logs = np.log(signal[some])
    line = lines.straight(logs, np.log(shot[some] / signal[some]), error[some] / shot[some])
    power, span = line.slope, float(np.ptp(logs))
    if abs(power) < LEAST_CURVE or abs(power) < SURELY * line.slope_error:
        return None
    return Doubt(
        ("system_gain_dn_per_e", "read_noise_e", "dark_current_e_s", "dsnu_e"),
        f"not linear: the variance over the signal goes with the signal to the power {power:+.2f}, as behind a tone "
        f"curve (gamma {1 / (1 - power):.2f}) or noise reduction; gain and all figures in electrons may be off by "
        f"{100 * abs(power) * span:.0f} %: take raw frames",
        fit.gain * abs(power) * span,
    )


def stray_light(
    files: Folder, dark: Sequence[Level], bright: Sequence[Level], light: Floats, fit: Transfer
) -> Doubt | None:
    """Light in the dark frames, by the pixels' own sensitivity, which dark charge does not know, or by its place.

    light (H, W): mean of the flat levels ``bright``. The growth of the dark, DN/s, is of every other frame, and of
    those between once more; the dark that is taken off the light is of the latter, so that no noise is in both.
    """
    black = fit.dark
    exposure, variance, count = columns(dark, "exposure_s", "variance_dn2", "frames")
    away = exposure - exposure.mean()
    if not black.slope > SURELY * black.slope_error:  # nor where it is NaN
        return None
    slope = away / (away @ away)
    at_light = 1 / len(dark) + slope * (columns(bright, "exposure_s")[0].mean() - exposure.mean())
    growth, again, beneath = (np.zeros_like(light) for _ in range(3))
    for frames, by, share in zip(files.dark, slope, at_light, strict=True):
        every, between = (files.mean(half) for half in (frames[::2], frames[1::2]))
        growth += every * by
        again += between * by
        beneath += between * share
    signal = float((light - beneath).mean())
    noise = noise_of_mean(bright) + float((variance / (count // 2) * at_light**2).sum())
    grown, seen = (without_shading(each) for each in (growth, (light - beneath) / signal))
    kept = ~(outlying(grown) | outlying(seen))
    grown, seen = grown[kept], seen[kept]
    power = float(seen @ seen)
    found, error = float(grown @ seen) / power, float(grown.std()) / math.sqrt(power)
    true_share = 1 - noise / signal**2 * len(seen) / power  # of what varies over the response
    if found > SURELY * error and found > LEAST_STRAY * true_share * black.slope and true_share > 0.05:
        of_dark = min(1.0, found / true_share / black.slope)
        text = (
            "light in dark frames: what grows with exposure there follows the pixels' sensitivity to light; about "
            f"{100 * of_dark:.0f} % of the dark current is light: cover the lens"
        )
    else:
        one, other = (_blocks(each) for each in (growth, again))
        common, own = float(np.cov(one, other)[0, 1]), float((one - other).var()) / 2
        of_dark = math.sqrt(max(0.0, common)) / black.slope
        if of_dark <= LEAST_UNEVEN or common <= own:
            return None
        text = (
            "light in dark frames, or a glow of the camera's own: dark current differs over the picture by "
            f"{100 * of_dark:.0f} % RMS: cover the lens"
        )
    return Doubt(("dark_current_e_s", "dsnu_e"), text, of_dark * black.slope / fit.gain)


def _blocks(growth: Floats) -> Floats:
    """Medians of blocks of the picture, of each of the four places of a mosaic."""
    down, across = (side // (2 * _BLOCKS) for side in growth.shape)
    cut = growth[: 2 * _BLOCKS * down, : 2 * _BLOCKS * across]
    blocks = cut.reshape(_BLOCKS, down, 2, _BLOCKS, across, 2).transpose(0, 3, 2, 5, 1, 4)
    medians: Floats = np.median(blocks.reshape(4 * _BLOCKS**2, -1), -1)
    return medians
