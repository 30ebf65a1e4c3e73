"""What is wrong with frames: refusals before anything is fitted, and doubts about what was fitted.

Each refusal is one line that names the level. Exposures in seconds, means and variances in steps of the converter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration import counts, levels
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Floats, Folder, refuse
from blurnoise_eval.calibration.levels import Level, Pattern, columns
from blurnoise_eval.calibration.transfer import PLAIN_DN2, SURELY, Linearity, Transfer, drift, straight

MOST_FLICKER = 0.02  # spread of the means of a level's frames, of the signal
LEAST_LAMP = 0.005  # of it
CHANCE = 4.0  # standard deviations that two frames' means may differ by
MOST_ROWS = 0.02  # of the temporal variance, that rows of a flat frame may share beyond those of a dark one
MOST_CORRELATION = 0.15
MOST_LINEARITY_ERROR = 0.05
CLIPPED = 5e-4  # of pixels at the limit, from which a level is left out: at 3.3 deviations the variance is 0.1 % low
PILED = 5e-3
MOST_UNLIKE = 0.3  # of the light of a level's frames, from which on no lamp explains it
MOST_FALLEN = 0.1  # of a level's light at a longer exposure
MOST_OFF = 0.2  # of a dark level's own signal, off the line of the others
LEAST_OFF = 0.5  # of its noise, and beyond this many scatters of the others:
MOST_SCATTERS = 10.0
MOST_MISSING = 0.05  # of the numbers between frequent ones, that never occur
USED = 0.7  # of saturation: the levels that EMVA 1288 fits
LEAST_DRIFT = 0.1  # change of the dark current over the dark frames, of itself
LEAST_HOT = 1.1  # DSNU with hot pixels over that without
LEAST_CURVE = 0.03  # exponent of the signal in the gain: a gamma of 0.97
LEAST_STRAY = 0.1  # light in dark frames, of the dark current
LEAST_UNEVEN = 0.2  # spread of the dark current over the picture, of itself
_BLOCKS = 8  # along each side


def too_dim(dark: Sequence[Level], flat: Sequence[Level]) -> list[int]:
    """Places of flat levels whose frames differ by more than a lamp's may, but no more than dark ones do."""
    steady = _steady(dark, flat)
    return [place for place, level in enumerate(flat) if level.lamp_spread > MOST_FLICKER and steady[place]]


def _steady(dark: Sequence[Level], flat: Sequence[Level]) -> list[bool]:
    """Of which flat levels the frames differ by no more than the black level's scatter in dark ones explains."""
    scatter = levels.frame_scatter(dark)
    chance = [math.hypot(scatter, math.sqrt(level.variance_dn2 / level.pixels)) for level in flat]
    return [
        bool(np.ptp(level.means_dn) <= CHANCE * math.sqrt(2) * each)
        for level, each in zip(flat, chance, strict=True)
    ]


def remarks(dark: Sequence[Level], flat: Sequence[Level]) -> list[str]:
    """What else to know of the levels."""
    dim = too_dim(dark, flat)
    of_lamp = zip(flat, _steady(dark, flat), strict=True)
    lamp = max((level.lamp_spread for level, steady in of_lamp if not steady), default=0.0)
    names = "; ".join(str(flat[place]) for place in dim)
    every = (
        (
            dim,
            f"left out: {len(dim)} flat levels that are too dim to check the lamp: {names}",
        ),
        (
            lamp > LEAST_LAMP,
            f"the light of the lamp varies by up to {lamp:.1%} within a level; this is subtracted from the noise",
        ),
    )
    return [text for applies, text in every if applies]


def check_levels(dark: Sequence[Level], flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` where dark levels are cut off, levels do not rise with time, or flat ones flicker."""
    for level in dark:
        _check_cut(level)
    _check_order(dark, flat)
    _check_dark(dark)
    rows = MOST_ROWS + max(0.0, *(level.row_share for level in dark))
    lamp = "use a constant lamp, or exposures of whole periods"
    for level in flat:
        unlike = f"the means of its frames are {min(level.means_dn):.4g} to {max(level.means_dn):.4g} DN"
        others = "are some of another exposure or kind, by names, headers or frames.csv?"
        refuse(level.lamp_spread > MOST_UNLIKE, f"{level}: {unlike}; {others}")
        differs = (
            f"the light of its frames varies by {level.lamp_spread:.2%}; must be below {MOST_FLICKER:.0%}"
        )
        refuse(level.lamp_spread > MOST_FLICKER, f"{level}: flicker: {differs}; {lamp}")
        bands = level.row_share > rows + 5 / math.sqrt(level.pixels) and level.share(level.highest_dn) < PILED
        share = f"rows have {level.row_share:.2%} of the noise in common"
        refuse(bands, f"{level}: flicker in bands: {share}; {lamp}")


def _check_cut(level: Level) -> None:
    """Raise ``ValueError`` where a dark level's noise is cut off, at 0 or at a black level above it.

    Of a normal distribution of variance V, sampled at steps g, number n - g has the share of n, squared, over that of
    n + g times exp(-g^2 / V); of pixels that differ more.
    """
    lowest, following = [*np.flatnonzero(level.counts)[:2], 0][:2]
    share, variance = level.share(lowest), level.variance_dn2
    shown = f"{level}: is clipped, {100 * share:.3g} % of its pixels are {lowest}"
    at_zero = share > PILED and level.mean_dn + 0.5 < 3 * math.sqrt(variance)
    black = "raise the black level of the camera"
    refuse(not lowest and (level.highest_dn == 0 or at_zero), f"{shown}; {black}")
    if (
        lowest and following and variance > PLAIN_DN2 and share > PILED
    ):  # else rounding leaves two or three numbers
        gap = following - lowest
        below = level.counts[lowest] ** 2 / level.counts[following] * math.exp(-(gap**2) / variance)
        cut = f"{shown}, none below, as after an offset was subtracted and another added; use raw frames, or {black}"
        refuse(below > SURELY**2, cut)


def _check_order(dark: Sequence[Level], flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` where a flat level is darker than one of less exposure, or a dark one brighter than it."""
    times = "are exposure times and kinds right, in names, headers or frames.csv?"
    even = {(each.photons_per_px, each.illuminance_lux, each.wavelength_nm) for each in flat}
    of_time = even == {(None, None, None)}
    base = min(level.mean_dn for level in dark)
    for shorter, longer in pairwise(flat):
        fallen = shorter.mean_dn - longer.mean_dn > MOST_FALLEN * (shorter.mean_dn - base)
        means = f"its mean is {longer.mean_dn:.4g} DN, but {shorter.mean_dn:.4g} DN of {shorter}"
        refuse(of_time and fallen, f"{longer}: {means}; {times}")
    for level in dark:
        for lit in flat if of_time else ():
            under = lit.exposure_s >= level.exposure_s and level.mean_dn - lit.mean_dn > lit.mean_dn - base
            far = level.mean_dn - lit.mean_dn > SURELY * math.sqrt(level.variance_dn2)
            refuse(
                under and far,
                f"{level}: its mean is {level.mean_dn:.4g} DN, but {lit.mean_dn:.4g} DN of {lit}; {times}",
            )


def _check_dark(dark: Sequence[Level]) -> None:
    """Raise ``ValueError`` where frames of a dark level are unlike, or one level is off the line of all others.

    That line is Theil and Sen's, which a wrong exposure does not bend.
    """
    base = min(min(level.means_dn) for level in dark)
    for level in dark:
        apart = float(np.ptp(level.means_dn))
        unlike = f"the means of its frames are {min(level.means_dn):.4g} to {max(level.means_dn):.4g} DN"
        others = "are some of another exposure or kind, by names, headers or frames.csv?"
        wide = apart > max(MOST_UNLIKE * (level.mean_dn - base), SURELY * math.sqrt(level.variance_dn2))
        refuse(wide, f"{level}: {unlike}; {others}")
    exposure, mean, variance = columns(dark, "exposure_s", "mean_dn", "variance_dn2")
    if len({*exposure.tolist()}) < max(5, len(dark)):
        return
    one, other = np.triu_indices(len(dark), 1)
    slope = float(np.median((mean[other] - mean[one]) / (exposure[other] - exposure[one])))
    black = float(np.median(mean - slope * exposure))
    off = mean - slope * exposure - black
    least = np.maximum(MOST_OFF * slope * exposure, LEAST_OFF * np.sqrt(variance))
    far = np.abs(off) > np.maximum(least, MOST_SCATTERS * 1.4826 * np.median(np.abs(off)))
    for place in np.flatnonzero(far).tolist() if far.sum() == 1 else ():
        means = f"its mean is {mean[place]:.4g} DN, but {mean[place] - off[place]:.4g} DN by the other dark levels"
        refuse(True, f"{dark[place]}: {means}; is its exposure time right, in names, headers or frames.csv?")


def check_noise(flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` where neighbours' noise is alike, as demosaicing, denoising and lossy formats leave it."""
    for level in flat:
        alike = abs(level.correlation) > MOST_CORRELATION + 5 / math.sqrt(level.pixels)
        raw = "must be raw numbers of the sensor, not demosaiced, denoised, resized or compressed"
        why = f"the noise of neighbouring pixels has a correlation of {level.correlation:.2f}"
        refuse(alike and level.variance_dn2 > 0.5, f"{level}: {why}; {raw}")
        same = f"{level}: all frames are equal; each frame must be a new exposure"
        refuse(level.variance_dn2 == 0, same)


def check_linearity(flat: Sequence[Level], found: Linearity) -> None:
    """Raise ``ValueError`` where a level is off the line by more than 5 %."""
    worst, over = found.deviation[found.worst], "exposure" if found.light == "s" else "light"
    why = f"its signal is {worst:+.2%} off the line over {over}; must be within {MOST_LINEARITY_ERROR:.0%}"
    raw = "use raw numbers without gamma, a constant lamp and right exposure times"
    refuse(abs(worst) > MOST_LINEARITY_ERROR, f"{flat[found.worst]}: is not linear: {why}; {raw}")


def clipping(flat: Sequence[Level], dark_dn: float, full_scale_dn: float) -> tuple[float | None, list[int]]:
    """The number at which flat frames clip, None where none does, and the places of the levels to fit.

    A level clips where many pixels hold the largest number of all frames and far fewer the next, or where that is
    the converter's last; also where the variance has fallen below half of the greatest at a lower mean, as it does
    above the peak that EMVA 1288 calls saturation. Raises ``ValueError`` if too few are left.
    """
    top = max(level.highest_dn for level in flat)
    piled = [level for level in flat if level.share(top) > PILED]
    peak = max(flat, key=lambda level: level.variance_dn2)
    brighter = [level for level in flat if level.mean_dn > peak.mean_dn]
    fallen = [level for level in brighter if level.variance_dn2 < peak.variance_dn2 / 2]
    clip: float | None = None
    if any(top == full_scale_dn or level.share(top) > 2 * level.share(top - 1) for level in piled):
        clip = float(top)
    elif fallen:
        clip = max(level.mean_dn for level in fallen)
    limit = full_scale_dn if clip is None else clip
    held = [level.counts[math.ceil(limit) :].sum() / level.counts.sum() for level in flat]
    whole = [place for place, level in enumerate(flat) if level not in fallen and held[place] < CLIPPED]
    if clip is not None:
        linear = [place for place in whole if flat[place].mean_dn - dark_dn <= USED * (clip - dark_dn)]
        whole = linear if len(linear) >= FEWEST_FLAT else whole
    lost = f"{len(flat) - len(whole)} of {len(flat)} flat levels reach {limit:g} DN"
    must = f"{FEWEST_FLAT} or more must stay below it; use shorter exposures or less light"
    refuse(len(whole) < FEWEST_FLAT, f"frames: are clipped: {lost}; {must}")
    return clip, whole


@dataclass(frozen=True)
class Doubt:
    """figures: names of those that are in doubt; margin: by how much the first one's interval grows to both sides."""

    figures: tuple[str, ...]
    text: str
    margin: float = 0.0

    def widen(self, estimates: dict[str, Estimate]) -> None:
        """Add the margin to the first figure's interval."""
        name = self.figures[0]
        if self.margin and (known := estimates.get(name)):
            low, high = max(0.0, known.low - self.margin), known.high + self.margin
            estimates[name] = replace(known, low=low, high=high)


def warming(dark: Sequence[Level], fit: Transfer) -> Doubt | None:
    """A sensor that warms (or cools): of one exposure the later dark frames are brighter, by the exposure's length.

    Over n levels dark current changes by n times what it changes within one, at least; a straight line through their
    means takes n + 1 times that for dark current.
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
    """Dark frames of one exposure that get brighter or darker one after the other, beyond their scatter."""
    for level in dark:
        place = np.arange(level.frames) - (level.frames - 1) / 2
        slope = float(place @ level.means_dn / (place @ place))
        rest = np.array(level.means_dn) - level.mean_dn - slope * place
        freedom = level.frames - 2
        if freedom < 3 or abs(slope) < SURELY * math.sqrt(
            float(rest @ rest) / freedom / float(place @ place)
        ):
            continue
        does, get = ("warms", "brighter") if slope > 0 else ("cools", "darker")
        change = abs(slope) * (level.frames - 1)
        text = f"the sensor {does}: successive frames of {level} get {get}, by {change:.2g} DN in all"
        return Doubt(("black_level_dn",), f"{text}; wait until the temperature is constant", change / 2)
    return None


def hot_pixels(pattern: Pattern, fit: Transfer) -> Doubt | None:
    """Pixels far outside the fixed pattern of the others, which make a DSNU that describes neither."""
    with_them = math.sqrt(fit.spread_dn2 + pattern.outlying_dn2)
    if not pattern.outliers or fit.spread_dn2 <= 0 or with_them < LEAST_HOT * math.sqrt(fit.spread_dn2):
        return None
    share = 100 * pattern.outliers / pattern.pixels
    return Doubt(
        ("dsnu_e", "dark_current_e_s"),
        f"hot pixels: {pattern.outliers} ({share:.2g} %) are far outside the dark pattern; DSNU and PRNU exclude "
        f"them (DSNU would be {with_them / fit.gain:.3g} e- with them), the mean dark current includes them",
    )


def combed(every: Sequence[Level]) -> Doubt | None:
    """Numbers that never occur between frequent ones: the converter's were stretched, which adds rounding."""
    never, could = counts.missing([level.counts for level in every])
    if never <= MOST_MISSING * could:
        return None
    return Doubt(
        ("read_noise_e", "system_gain_dn_per_e", "dsnu_e"),
        f"{never} of {could} numbers never occur between frequent ones: they were stretched after the converter "
        "(digital gain, tone curve, LinearizationTable), so rounding adds more noise than is assumed; use raw frames",
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
    line = straight(logs, np.log(shot[some] / signal[some]), error[some] / shot[some])
    power, span = line.slope, float(np.ptp(logs))
    if abs(power) < max(LEAST_CURVE, SURELY * line.slope_error):
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
    """Light in the dark frames, by the pixels' own sensitivity, which dark charge does not know, or by its place.

    light (H, W): mean of the flat levels ``bright``. The growth of the dark, DN/s, is of every other frame, and of
    those between once more; the dark that is taken off the light is of the latter, so that no noise is in both.
    """
    black = fit.dark
    if not black.slope > SURELY * black.slope_error:  # nor where it is NaN
        return None
    exposure, variance, count = columns(dark, "exposure_s", "variance_dn2", "frames")
    away = exposure - exposure.mean()
    slope = away / (away @ away)
    at_light = 1 / len(dark) + slope * (columns(bright, "exposure_s")[0].mean() - exposure.mean())
    every, between = (
        np.stack([np.mean([*files.planes(frames[half::2])], axis=0) for frames in files.dark])
        for half in (0, 1)
    )
    growth, again = (np.tensordot(slope, each, 1) for each in (every, between))
    beneath = np.tensordot(at_light, between, 1)
    signal = float((light - beneath).mean())
    noise = levels.noise_of_mean(bright) + float((variance / (count // 2) * at_light**2).sum())
    grown, seen = (levels.without_shading(each) for each in (growth, (light - beneath) / signal))
    kept = ~(levels.outlying(grown) | levels.outlying(seen))
    grown, seen = grown[kept], seen[kept]
    power = float(seen @ seen)
    found, error = float(grown @ seen) / power, float(grown.std()) / math.sqrt(power)
    true_share = 1 - noise / signal**2 * len(seen) / power  # of what varies over the response
    if found > SURELY * error and found > LEAST_STRAY * true_share * black.slope and true_share > 0.05:
        of_dark = min(1.0, found / true_share / black.slope)
        what = f"{100 * of_dark:.0f} % of the dark current is proportional to the sensitivity of the pixels to light"
    else:
        one, other = (_blocks(each) for each in (growth, again))
        common, own = float(np.cov(one, other)[0, 1]), float((one - other).var()) / 2
        of_dark = math.sqrt(max(0.0, common)) / black.slope
        if of_dark <= LEAST_UNEVEN or common <= own:
            return None
        what = f"the dark current varies over the picture by {100 * of_dark:.0f} % RMS (or the sensor itself glows)"
    text = f"light in dark frames: {what}; cover the lens"
    return Doubt(("dark_current_e_s", "dsnu_e"), text, of_dark * black.slope / fit.gain)


def _blocks(growth: Floats) -> Floats:
    """Medians of blocks of the picture, of each of the four places of a mosaic."""
    down, across = (side // (2 * _BLOCKS) for side in growth.shape)
    cut = growth[: 2 * _BLOCKS * down, : 2 * _BLOCKS * across]
    blocks = cut.reshape(_BLOCKS, down, 2, _BLOCKS, across, 2)
    return np.asarray(np.median(blocks, (1, 4))).ravel()
