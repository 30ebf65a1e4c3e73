"""Checks of levels before the fit: each refusal is one line that names the level and the reason.

Exposures in seconds, means and variances in steps of the converter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.special import ndtr, ndtri

from blurnoise_eval.calibration.frames import FEWEST_FLAT, Floats
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.labels import PILED
from blurnoise_eval.calibration.levels import Level, columns, frame_scatter
from blurnoise_eval.calibration.rounding import PLAIN_DN2
from blurnoise_eval.calibration.transfer import SURELY, Linearity

MOST_FLICKER = 0.02  # range of the means of the frames of a level, relative to the signal
LEAST_LAMP = 0.005  # the same, for a note
CHANCE = 4.0  # standard deviations by which the means of two frames may differ
MOST_ROWS = 0.02  # share of temporal variance that rows of flat frames may have in common beyond dark ones
MOST_PERIODIC = 0.5  # share of their power in three frequencies
MOST_CORRELATION = 0.15
MOST_LINEARITY_ERROR = 0.05
CLIPPED = 5e-4  # share of pixels at the limit above which a level is left out: its variance is 0.1 % too low
MOST_CUT = 0.05  # share of the pixels at which noise is cut off; it is then 3 % too low
_FEW = 0.25  # of the pixels that noise would have below a number
_ABOVE = 2e-3  # share of the pixels: with noise from half a step on, more are beyond the next number
_SHORT = 0.35  # of the step before, in deviations of a normal distribution; equal for one
MOST_UNLIKE = 0.3  # relative difference of the light of the frames of a level, more than any lamp
MOST_FALLEN = 0.1  # relative loss of light at a longer exposure
MOST_OFF = 0.2  # of the signal of a dark level, off the line of the others
LEAST_OFF = 0.5  # of its noise, and also beyond this many scatters of the others:
MOST_SCATTERS = 10.0
USED = 0.7  # of saturation: the levels that EMVA 1288 fits
_OTHERS = "are some of another exposure or kind, by names, headers or frames.csv?"
_LAMP = "use a constant lamp, or exposures of whole periods"


def too_dim(dark: Sequence[Level], flat: Sequence[Level]) -> list[int]:
    """Indices of flat levels whose frames differ by more than the light of a lamp may, but no more than dark ones."""
    steady = _steady(dark, flat)
    return [index for index, level in enumerate(flat) if level.lamp_spread > MOST_FLICKER and steady[index]]


def _steady(dark: Sequence[Level], flat: Sequence[Level]) -> list[bool]:
    """For each flat level, whether the scatter of the black level explains the differences of its frames."""
    scatter = frame_scatter(dark)
    chance = [math.hypot(scatter, math.sqrt(level.variance_dn2 / level.pixels)) for level in flat]
    return [
        bool(np.ptp(level.means_dn) <= CHANCE * math.sqrt(2) * deviation)
        for level, deviation in zip(flat, chance, strict=True)
    ]


def remarks(dark: Sequence[Level], flat: Sequence[Level]) -> list[str]:
    """Notes on the levels."""
    dim, notes = too_dim(dark, flat), []
    if dim:
        names = "; ".join(str(flat[index]) for index in dim)
        notes.append(f"left out: {len(dim)} flat levels that are too dim to check the lamp: {names}")
    pairs = zip(flat, _steady(dark, flat), strict=True)
    lamp = max((level.lamp_spread for level, steady in pairs if not steady), default=0.0)
    if lamp > LEAST_LAMP:
        varies = f"the light of the lamp varies by up to {lamp:.1%} within a level"
        notes.append(f"{varies}; this is subtracted from the noise")
    return notes


def check_levels(dark: Sequence[Level], flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` if dark levels are cut off, levels do not rise with time, or flat levels flicker."""
    for level in dark:
        _check_cut(level)
    _check_order(dark, flat)
    _check_dark(dark)
    rows = MOST_ROWS + max(0.0, *(level.row_share for level in dark))
    for level in flat:
        refuse(level.lamp_spread > MOST_UNLIKE, f"{level}: {_range(level)}; {_OTHERS}")
        varies = (
            f"the light of its frames varies by {level.lamp_spread:.2%}; must be below {MOST_FLICKER:.0%}"
        )
        refuse(level.lamp_spread > MOST_FLICKER, f"{level}: flicker: {varies}; {_LAMP}")
        bands = level.row_share > rows + 5 / math.sqrt(level.pixels) and level.share(level.highest_dn) < PILED
        bands &= level.row_peak > MOST_PERIODIC  # else they are noise of the sensor, which is measured
        share = f"rows have {level.row_share:.2%} of the noise in common"
        refuse(bands, f"{level}: flicker in bands: {share}; {_LAMP}")


def _range(level: Level) -> str:
    return f"the means of its frames are {min(level.means_dn):.4g} to {max(level.means_dn):.4g} DN"


def _check_cut(level: Level) -> None:
    """Raise ``ValueError`` if much of the noise of a dark level is cut off, at 0 or at a black level above 0."""
    lowest, variance = int(np.flatnonzero(level.counts)[0]), level.variance_dn2
    black = "raise the black level of the camera"
    at_zero = level.share(0) > PILED and level.mean_dn + 0.5 < 3 * math.sqrt(variance)
    if at_zero and variance < PLAIN_DN2 and level.highest_dn:  # rounding may leave little else than 0 and 1
        ends, steps = normal_cut(level.counts[: level.highest_dn + 1].astype(float))
        at_zero = bool(ndtr(ends[0] - steps[0]) > PILED) if len(steps) else False
    refuse(not lowest and (level.highest_dn == 0 or at_zero), f"{_clipped(level, 0)}; {black}")
    cut = cut_at(level)
    if cut is not None and variance > PLAIN_DN2 and level.share(cut) > MOST_CUT:
        after = "as after an offset was subtracted and another added; use raw frames"
        raise ValueError(f"{_clipped(level, cut)}, hardly any below, {after}, or {black}")


def _clipped(level: Level, dn: int) -> str:
    return f"{level}: is clipped, {100 * level.share(dn):.3g} % of its pixels are {dn}"


def cut_at(level: Level) -> int | None:
    """The number at which the noise of a dark level is cut off, or None.

    For a normal distribution of variance V, sampled at steps g, the share of n - g is the squared share of n, divided
    by that of n + g, times exp(-g^2 / V); for pixels with different means it is larger. Few pixels below, as dead
    ones, are not the noise that is missing there. With little noise, rounding leaves two or three numbers; the share
    below the first one is then that of a normal distribution with the shares up to the first and the second.
    """
    numbers = np.flatnonzero(level.counts)
    counts, gaps = level.counts[numbers].astype(float), np.diff(numbers)
    below = np.cumsum(counts)[:-1] - counts[:-1]
    if level.variance_dn2 > PLAIN_DN2:
        expected = counts[:-1] ** 2 / counts[1:] * np.exp(-(gaps**2) / level.variance_dn2)
    else:
        up_to, step = normal_cut(counts)
        # Few pixels above may be hot; many hot ones make the next step far shorter than this one.
        above = 1 - np.cumsum(counts)[1:] / counts.sum()
        normal = (above > _ABOVE) & (np.append(step[1:], math.inf) > _SHORT * step)
        expected = np.where(normal, counts.sum() * ndtr(up_to - step), 0.0)
    piled = counts[:-1] > PILED * counts.sum()
    cut = np.flatnonzero(piled & (expected > SURELY**2) & (below < _FEW * expected))
    return int(numbers[cut[0]]) if len(cut) else None


def normal_cut(counts: Floats) -> tuple[Floats, Floats]:
    """For every number but the last, with these counts: how many deviations from the mean it ends, and a step has.

    >>> ends, steps = normal_cut(np.array([8413.0, 1573.0, 14.0]))  # 1, 3 deviations above the mean
    >>> ends.round(2).tolist(), steps.round(2).tolist()
    ([1.0, 2.99], [1.99, inf])
    """
    ends = ndtri(np.cumsum(counts) / counts.sum())
    return ends[:-1], np.diff(ends)


def _check_order(dark: Sequence[Level], flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` if a flat level is darker than one of shorter exposure, or than a dark level."""
    times = "are exposure times and kinds right, in names, headers or frames.csv?"
    taken = [level.taken for level in flat]
    if {(x.photons_per_px, x.illuminance_lux, x.wavelength_nm) for x in taken} != {(None, None, None)}:
        return  # the light is not proportional to the exposure
    base = min(level.mean_dn for level in dark)
    for shorter, longer in pairwise(flat):
        fallen = shorter.mean_dn - longer.mean_dn > MOST_FALLEN * (shorter.mean_dn - base)
        means = f"its mean is {longer.mean_dn:.4g} DN, but {shorter.mean_dn:.4g} DN of {shorter}"
        refuse(fallen, f"{longer}: {means}; {times}")
    for level in dark:
        for lit in flat:
            under = lit.exposure_s >= level.exposure_s and level.mean_dn - lit.mean_dn > lit.mean_dn - base
            far = level.mean_dn - lit.mean_dn > SURELY * math.sqrt(level.variance_dn2)
            means = f"its mean is {level.mean_dn:.4g} DN, but {lit.mean_dn:.4g} DN of {lit}"
            refuse(under and far, f"{level}: {means}; {times}")


def _check_dark(dark: Sequence[Level]) -> None:
    """Raise ``ValueError`` if the frames of a dark level differ, or one level is off the line of all others.

    The line is that of Theil and Sen, which one wrong exposure does not bend.
    """
    base = min(min(level.means_dn) for level in dark)
    for level in dark:
        least = max(MOST_UNLIKE * (level.mean_dn - base), SURELY * math.sqrt(level.variance_dn2))
        refuse(float(np.ptp(level.means_dn)) > least, f"{level}: {_range(level)}; {_OTHERS}")
    exposure, mean, variance = columns(dark, "exposure_s", "mean_dn", "variance_dn2")
    if len({*exposure.tolist()}) < max(5, len(dark)):
        return
    one, other = np.triu_indices(len(dark), 1)
    # Median of the slopes of all pairs: one wrong level is in few of them.
    slope = float(np.median((mean[other] - mean[one]) / (exposure[other] - exposure[one])))
    black = float(np.median(mean - slope * exposure))
    off = mean - slope * exposure - black
    least_off = np.maximum(MOST_OFF * slope * exposure, LEAST_OFF * np.sqrt(variance))
    far = np.flatnonzero(np.abs(off) > np.maximum(least_off, MOST_SCATTERS * 1.4826 * np.median(np.abs(off))))
    if len(far) == 1:  # with several, it is unknown which ones are wrong
        (index,) = far.tolist()
        means = f"its mean is {mean[index]:.4g} DN, but {mean[index] - off[index]:.4g} DN by the other dark levels"
        right = "is its exposure time right, in names, headers or frames.csv?"
        raise ValueError(f"{dark[index]}: {means}; {right}")


def check_noise(flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` if the noise of neighbours is correlated, as after demosaicing or compression."""
    for level in flat:
        alike = abs(level.correlation) > MOST_CORRELATION + 5 / math.sqrt(level.pixels)
        raw = "must be raw numbers of the sensor, not demosaiced, denoised, resized or compressed"
        why = f"the noise of neighbouring pixels has a correlation of {level.correlation:.2f}"
        refuse(alike and level.variance_dn2 > 0.5, f"{level}: {why}; {raw}")
        same = f"{level}: all frames are equal; each frame must be a new exposure"
        refuse(level.variance_dn2 == 0, same)


def check_linearity(flat: Sequence[Level], line: Linearity, others: Linearity | None) -> None:
    """Raise ``ValueError`` if a level is off the line by more than 5 %. others: the line without that level."""
    worst, over = line.deviation[line.worst], "exposure" if line.light == "s" else "light"
    why = f"its signal is {worst:+.2%} off the line over {over}; must be within {MOST_LINEARITY_ERROR:.0%}"
    advice = "use raw numbers without gamma, a constant lamp and right exposure times"
    if others and others.error.value <= MOST_LINEARITY_ERROR:
        right = "are its exposure and light right, in names, headers or frames.csv?"
        advice = f"the other levels are; {right} If not, --leave-out '{flat[line.worst]}'"
    refuse(abs(worst) > MOST_LINEARITY_ERROR, f"{flat[line.worst]}: is not linear: {why}; {advice}")


def beyond_peak(flat: Sequence[Level]) -> list[Level]:
    """The levels brighter than the one of the largest variance that have less than half of it: wells are full."""
    peak = max(flat, key=lambda level: level.variance_dn2)
    brighter = [level for level in flat if level.mean_dn > peak.mean_dn]
    return [level for level in brighter if level.variance_dn2 < peak.variance_dn2 / 2]


def clipping(
    flat: Sequence[Level], dark_dn: float, full_scale_dn: float, dim: Sequence[int] = ()
) -> tuple[float | None, list[int]]:
    """The number at which flat frames clip, None if they do not, and indices of the levels to fit, without ``dim``.

    A level clips if many pixels have the largest number of all frames and far fewer the next, or if that is the full
    scale of the converter; also if the variance falls below half of the largest at a lower mean, as it does above the
    peak that EMVA 1288 calls saturation. Raises ``ValueError`` if too few levels remain.
    """
    top = max(level.highest_dn for level in flat)
    piled = [level for level in flat if level.share(top) > PILED]
    peak = max(flat, key=lambda level: level.variance_dn2)
    fallen = beyond_peak(flat)
    clip: float | None = None
    if any(top == full_scale_dn or level.share(top) > 2 * level.share(top - 1) for level in piled):
        clip = float(top)
    elif fallen:
        clip = max(level.mean_dn for level in fallen)
    limit = full_scale_dn if clip is None else clip
    at_limit = [level.counts[math.ceil(limit) :].sum() / level.counts.sum() for level in flat]
    clipped = [level in fallen or share >= CLIPPED for level, share in zip(flat, at_limit, strict=True)]
    usable = [index for index in range(len(flat)) if not clipped[index] and index not in dim]
    # As EMVA 1288 does it; where that leaves too few levels, all that do not clip are used. Its saturation is the
    # peak of the variance; a peak that only levels that clip follow is the clipping itself.
    saturation_dn = peak.mean_dn if any(flat[index].mean_dn > peak.mean_dn for index in usable) else limit
    most_dn = dark_dn + USED * (saturation_dn - dark_dn)
    linear = [index for index in usable if flat[index].mean_dn <= most_dn]
    usable = linear if len(linear) >= FEWEST_FLAT else usable
    lost = f"{sum(clipped)} of {len(flat)} flat levels reach {limit:g} DN"
    must = f"{FEWEST_FLAT} or more must stay below it; use shorter exposures or less light"
    refuse(len(usable) < FEWEST_FLAT, f"frames: are clipped: {lost}; {must}")
    return clip, usable
