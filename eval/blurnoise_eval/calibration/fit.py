"""Fit of a camera to a folder of dark and flat frames: its figures, each with a 95 % interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blurnoise._core.checks import integer
from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration import checks, levels, transfer
from blurnoise_eval.calibration.checks import Doubt
from blurnoise_eval.calibration.formats import RawLayout
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Floats, Folder, Size, refuse
from blurnoise_eval.calibration.levels import Level, columns, level_of
from blurnoise_eval.calibration.transfer import Linearity, Transfer

_MOST_FOR_PATTERN = 8  # levels whose mean frames are read again, for PRNU


@dataclass(frozen=True)
class Measurement:
    """A camera as its frames show it. estimates: by the camera's field, and ``linearity_error``, a fraction.

    dark, flat: levels in steps of the converter; used: places of the flat ones that were fitted. clip_dn: where
    flat frames clip, None if nowhere. size_px: (width, height). bits_given: whether the user gave the bit depth.
    notes: assumptions beside the figures. doubts: why some of them may be wrong.
    """

    estimates: dict[str, Estimate]
    dark: Sequence[Level]
    flat: Sequence[Level]
    used: Sequence[int]
    fit: Transfer
    linearity: Linearity | None
    size_px: Size
    bit_depth: int
    bits_given: bool
    clip_dn: float | None
    notes: Sequence[str]
    doubts: Sequence[Doubt]

    @property
    def frames(self) -> str:
        """How many there were, in words."""
        flat, dark = (sum(level.frames for level in levels) for levels in (self.flat, self.dark))
        return f"{flat} flat and {dark} dark frames"


def measure(
    folder: Path,
    *,
    bit_depth: int | None = None,
    layout: RawLayout | None = None,
    cfa: str | None = None,
) -> Measurement:
    """The camera whose frames lie in ``folder``. bit_depth: of the converter; None takes the fewest bits that fit.
    layout, cfa: as :class:`Folder` takes them.

    Raises ``ValueError`` naming the file or level that cannot be used, and why.
    """
    if bit_depth is not None:
        integer("bit_depth", bit_depth, 1, 16)
    files = Folder(folder, layout, cfa)
    files = files.at_gain(files.gains_db[0])
    dark, dark_mean = [], np.zeros(())
    for frames in files.dark:
        level, mean = level_of(files.planes(frames), frames[0])
        dark.append(level)
        dark_mean = dark_mean + (mean - level.mean_dn) / len(files.dark)
    dark = levels.with_wander(dark)
    line = transfer.dark_line(dark)

    def lit(place: int) -> tuple[Level, Floats]:
        first = files.flat[place][0]
        return level_of(files.planes(files.flat[place]), first, line.at(first.exposure_s))

    flat = [lit(place)[0] for place in range(len(files.flat))]
    highest_dn = max(level.highest_dn for level in [*dark, *flat])
    bit_depth = bit_depth or files.bit_depth
    bits = bit_depth or next(bits for bits in (8, 10, 12, 14, 16) if highest_dn < 2**bits)
    refuse(
        highest_dn >= 2**bits, f"bit_depth = {bits}: frames hold {highest_dn}; must be at most {2**bits - 1}"
    )
    dim = checks.too_dim(dark, flat)
    checks.check_levels(dark, [level for place, level in enumerate(flat) if place not in dim])
    clip_dn, usable = checks.clipping(flat, line.offset, 2.0**bits - 1)
    usable = [place for place in usable if place not in dim]
    few = f"frames: {len(dim)} of {len(flat)} flat levels are too dim; must be {FEWEST_FLAT} or more that are not"
    refuse(len(usable) < FEWEST_FLAT, few)
    used = [flat[place] for place in usable]
    checks.check_noise(used)

    pattern = levels.dark_pattern(dark_mean, dark)
    found = transfer.fit(dark, used, pattern)
    exposure, mean_dn = columns(flat, "exposure_s", "mean_dn")
    signal = mean_dn - found.dark.at(exposure)
    top_dn = (clip_dn or max(level.mean_dn for level in used)) - found.dark.offset
    linear = transfer.linearity(flat, signal, top_dn)
    estimates = found.estimates(dark[0].pixels)
    if clip_dn is not None:
        estimates["full_well_e"] = found.electrons(top_dn, found.dark.offset_error)
    if linear:
        checks.check_linearity(flat, linear)
        estimates["linearity_error"] = linear.error
        if linear.by_photons:
            estimates["quantum_efficiency"] = found.electrons(linear.slope, linear.slope_error)

    chosen = sorted(usable, key=lambda place: mean_dn[place])[-_MOST_FOR_PATTERN:]
    bright = [flat[place] for place in chosen]
    light = sum((lit(place)[1] for place in chosen), np.zeros(())) / len(chosen)
    noise = levels.noise_of_mean(bright) + levels.noise_of_mean(dark)
    response = levels.response_pattern(light - dark_mean, noise, levels.hot_pixels(dark_mean))
    power = float(signal[chosen].mean()) ** 2
    estimates["prnu"] = transfer.root(response.fixed_dn2 / power, response.error_dn2 / power)
    first = checks.warming(dark, found) or checks.tone_curve(dark, used, found)
    if files.place is not None:  # the filters show light in the dark
        files = files.whole()
        means = [np.mean([*files.planes(files.flat[place])], axis=0) for place in chosen]
        light = np.mean(means, axis=0)
    stray = None if first else checks.stray_light(files, dark, bright, light, found)
    doubts = [doubt for doubt in (first, checks.hot_pixels(pattern, found), stray) if doubt]
    for doubt in doubts:
        doubt.widen(estimates)
    notes = [*files.notes, *checks.remarks(dark, flat, dim), *_notes(found, files.step_dn)]
    return Measurement(
        estimates=estimates, dark=dark, flat=flat, used=usable, fit=found, linearity=linear, size_px=files.size_px,
        bit_depth=bits, bits_given=bit_depth is not None, clip_dn=clip_dn, notes=notes, doubts=doubts,
    )  # fmt: skip


def _notes(fit: Transfer, step: int) -> list[str]:
    """What was assumed, and what else to know of the figures."""
    bounds = ", and are bounds only, with black level and dark current"
    bounds = bounds if fit.noise_dn < transfer.TWO_NUMBERS_DN else ""
    dark = f"noise in the dark is {fit.noise_dn:.2g} DN before rounding, which rules there"
    hidden = "the camera takes dark charge off the mean: dark current is that of the variance"
    every = (
        (step > 1, f"all numbers are multiples of {step}: counted in steps of {step}"),
        (fit.rounding, f"{dark}: read noise and DSNU rest on the noise being normal{bounds}"),
        (fit.hidden_dn2_s[0] > 0, hidden),
        (fit.widened, "the variances scatter beyond chance about the line: intervals are widened for that"),
    )
    return [text for applies, text in every if applies]
