"""Checks of levels before anything is fitted: clipped, flickering, filtered or lossy, not linear.

Each complaint is one line that names the level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.calibration.frames import FEWEST_FLAT
from blurnoise_eval.calibration.levels import Floats, Level, columns

Z = 1.959964
"""Of a normal number, two-sided 95 %."""
MOST_FLICKER = 0.02
"""Spread of the means of a level's frames, of the signal; below it they are brought to one light."""
MOST_ROWS = 0.02
"""Part of the temporal variance that the rows of a flat frame may share beyond those of a dark one."""
MOST_CORRELATION = 0.15
MOST_LINEARITY_ERROR = 0.05
CLIPPED = 5e-4
"""Share of pixels at the limit from which a level is left out: at 3.3 deviations the variance is 0.1 % low."""
PILED = 5e-3
USED = 0.7
"""Of saturation: the levels that EMVA 1288 fits."""


@dataclass(frozen=True)
class Linearity:
    """Signal against light: slope in DN per second, or per photon; x in that unit, deviation a fraction.

    error: largest deviation from the line among levels of 5 to 95 % of saturation.
    """

    slope: float
    slope_error: float
    offset: float
    x: Floats
    deviation: Floats
    error: Estimate
    by_photons: bool


def check_dark(dark: Sequence[Level]) -> None:
    """Raise ``ValueError`` where dark levels are cut off at 0."""
    for level in dark:
        zero, noise = level.share(0), math.sqrt(level.variance_dn2)
        if level.highest_dn == 0 or (zero > PILED and level.mean_dn + 0.5 < 3 * noise):
            raise ValueError(
                f"{level}: clipped, {100 * zero:.3g} % of its pixels are 0; raise the camera's black level"
            )


def check_light(flat: Sequence[Level], dark: Sequence[Level]) -> None:
    """Raise ``ValueError`` for flat levels whose frames flicker."""
    rows = max(0.0, *(level.row_share for level in dark))
    steady = "use a steady lamp, or exposures of whole periods"
    for level in flat:
        if level.lamp_spread > MOST_FLICKER:
            raise ValueError(
                f"{level}: flickering, its frames' light differs by {100 * level.lamp_spread:.2g} %; must be below "
                f"{100 * MOST_FLICKER:g} %: {steady}"
            )
        bands = level.row_share > rows + MOST_ROWS + 5 / math.sqrt(level.pixels)
        if bands and level.share(level.highest_dn) < PILED:
            share = f"{100 * level.row_share:.2g} %"
            raise ValueError(f"{level}: flickering in bands, its rows share {share} of the noise: {steady}")


def check_noise(flat: Sequence[Level]) -> None:
    """Raise ``ValueError`` where neighbours' noise is alike, as demosaicing, denoising and lossy formats leave it."""
    for level in flat:
        most = MOST_CORRELATION + 5 / math.sqrt(level.pixels)
        if level.variance_dn2 > 0.5 and abs(level.correlation) > most:
            raise ValueError(
                f"{level}: filtered or lossy, the noise of neighbouring pixels correlates by "
                f"{level.correlation:.2f}; must be the sensor's own numbers, "
                "not demosaiced, denoised, resized or compressed"
            )
        if level.variance_dn2 == 0:
            raise ValueError(f"{level}: its frames are all the same; must be taken one after the other")


def clipping(flat: Sequence[Level], dark_dn: float, full_scale_dn: float) -> tuple[float | None, list[int]]:
    """The number at which flat frames clip, None where none does, and the places of the levels to fit.

    A level clips where many pixels hold the largest number of all frames and far fewer the next, or where that is
    the converter's last; also where the variance has fallen below half of the greatest at a lower mean, as it does
    above the peak that EMVA 1288 calls saturation. Raises ``ValueError`` if too few are left.
    """
    top = max(level.highest_dn for level in flat)
    piled = [level for level in flat if level.share(top) > PILED]
    peak = max(flat, key=lambda level: level.variance_dn2)
    fallen = [
        level for level in flat if level.mean_dn > peak.mean_dn and level.variance_dn2 < peak.variance_dn2 / 2
    ]
    clip: float | None = None
    if any(top == full_scale_dn or level.share(top) > 2 * level.share(top - 1) for level in piled):
        clip = float(top)
    elif fallen:
        clip = max(level.mean_dn for level in fallen)
    limit = full_scale_dn if clip is None else clip
    whole = [
        place
        for place, level in enumerate(flat)
        if level not in fallen and level.counts[math.ceil(limit) :].sum() < CLIPPED * level.counts.sum()
    ]
    if clip is not None:
        linear = [place for place in whole if flat[place].mean_dn - dark_dn <= USED * (clip - dark_dn)]
        whole = linear if len(linear) >= FEWEST_FLAT else whole
    if len(whole) < FEWEST_FLAT:
        raise ValueError(
            f"frames: clipped, {len(flat) - len(whole)} of {len(flat)} flat levels reach {limit:g} DN; must be "
            f"{FEWEST_FLAT} or more below it: shorter exposures, or less light"
        )
    return clip, whole


def linearity(flat: Sequence[Level], signal: Floats, top_dn: float) -> Linearity | None:
    """Signal against light by EMVA 1288's fit (weights 1/signal) over 5 to 95 % of ``top_dn``, a signal.

    signal (N,): mean of each level less that in the dark. None where fewer than three levels are in that range.
    Raises ``ValueError`` where a level is off by more than 5 %.
    """
    by_photons = all(level.photons_per_px is not None for level in flat)
    x, mean_error = columns(flat, "photons_per_px" if by_photons else "exposure_s", "mean_error_dn")
    inside = (signal >= 0.05 * top_dn) & (signal <= 0.95 * top_dn)
    count = int(inside.sum())
    if len(np.unique(x[inside])) < 3:
        return None
    design = np.stack([x[inside], np.ones(count)], 1) / signal[inside, None]
    (slope, offset), *_ = np.linalg.lstsq(design, np.ones(count))
    line = slope * x + offset
    deviation = np.divide(signal - line, line, out=np.zeros_like(line), where=line > 0)
    place = int(np.argmax(np.where(inside, np.abs(deviation), -1)))
    worst = float(deviation[place])
    if abs(worst) > MOST_LINEARITY_ERROR:
        over = "light" if by_photons else "exposure"
        raise ValueError(
            f"{flat[place]}: not linear, its signal is {100 * worst:+.2g} % off the line over {over}; "
            f"must be within {100 * MOST_LINEARITY_ERROR:g} %: raw numbers without gamma, and a steady lamp"
        )
    error = mean_error[inside] / signal[inside]
    scatter = math.hypot(float(deviation[inside].std(ddof=1)), float(np.sqrt((error**2).mean())))
    slope_error, margin = abs(float(slope)) * scatter / math.sqrt(count), Z * float(error.max())
    off = Estimate(abs(worst), max(0.0, abs(worst) - margin), abs(worst) + margin)
    return Linearity(float(slope), slope_error, float(offset), x, deviation, off, by_photons)
