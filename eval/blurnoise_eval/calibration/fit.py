"""Fit of a camera to a folder of dark and flat frames: its figures, each with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blurnoise._core.checks import integer
from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration import checks, levels
from blurnoise_eval.calibration.checks import Doubt, Linearity, Z
from blurnoise_eval.calibration.frames import Folder, Size
from blurnoise_eval.calibration.levels import Floats, Level, columns, level_of
from blurnoise_eval.calibration.transfer import TWO_NUMBERS_DN, Transfer, dark_line, fit

_DEPTHS = (8, 10, 12, 14, 16)
_MOST_FOR_PATTERN = 8  # levels whose mean frames are read again, for PRNU


@dataclass(frozen=True)
class Measurement:
    """A camera as its frames show it. estimates: by the camera's field, and ``linearity_error``, a fraction.

    dark, flat: levels in steps of the converter; used: places of the flat ones that were fitted. clip_dn: where
    flat frames clip, None if nowhere. size_px: (width, height). bits_stated: whether the user gave the bit depth.
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
    bits_stated: bool
    clip_dn: float | None
    notes: Sequence[str]
    doubts: Sequence[Doubt]

    @property
    def frames(self) -> str:
        """How many there were, in words."""
        flat, dark = (sum(level.frames for level in levels) for levels in (self.flat, self.dark))
        return f"{flat} flat and {dark} dark frames"


def measure(folder: Path, *, bit_depth: int | None = None, raw_size_px: Size | None = None) -> Measurement:
    """The camera whose frames lie in ``folder``. bit_depth: of the converter; None takes the fewest bits that fit.

    Raises ``ValueError`` naming the file or level that cannot be used, and why.
    """
    if bit_depth is not None:
        integer("bit_depth", bit_depth, 1, 16)
    files = Folder(folder, raw_size_px)
    dark, dark_mean = [], np.zeros(())
    for frames in files.dark:
        level, mean = level_of(files.planes(frames), frames[0])
        dark.append(level)
        dark_mean = dark_mean + (mean - level.mean_dn) / len(files.dark)
    line = dark_line(dark)

    def lit(place: int) -> tuple[Level, Floats]:
        first = files.flat[place][0]
        return level_of(files.planes(files.flat[place]), first, line.at(first.exposure_s))

    flat = [lit(place)[0] for place in range(len(files.flat))]
    bits = _depth(max(level.highest_dn for level in [*dark, *flat]), bit_depth)
    checks.check_levels(dark, flat)
    clip_dn, usable = checks.clipping(flat, line.offset, 2.0**bits - 1)
    used = [flat[place] for place in usable]
    checks.check_noise(used)

    pattern = levels.dark_pattern(dark_mean, dark)
    found = fit(dark, used, pattern)
    exposure, mean_dn = columns(flat, "exposure_s", "mean_dn")
    signal = mean_dn - found.dark.at(exposure)
    top_dn = (max(level.mean_dn for level in used) if clip_dn is None else clip_dn) - found.dark.offset
    linear = checks.linearity(flat, signal, top_dn)
    estimates = _estimates(found, dark[0].pixels)
    if clip_dn is not None:
        estimates["full_well_e"] = _in_electrons(top_dn, found.dark.offset_error, found)
    if linear:
        estimates["linearity_error"] = linear.error
        if linear.by_photons:
            estimates["quantum_efficiency"] = _in_electrons(linear.slope, linear.slope_error, found)

    chosen = sorted(usable, key=lambda place: mean_dn[place])[-_MOST_FOR_PATTERN:]
    bright, light = [flat[place] for place in chosen], np.zeros_like(dark_mean)
    for place in chosen:
        light += lit(place)[1]
    light /= len(chosen)
    response = levels.response_pattern(
        light - dark_mean, levels.noise_of_mean(bright) + levels.noise_of_mean(dark)
    )
    power = float(signal[chosen].mean()) ** 2
    estimates["prnu"] = _root(response.fixed_dn2 / power, response.error_dn2 / power)
    first = checks.warming(dark, found) or checks.tone_curve(dark, used, found)
    stray = None if first else checks.stray_light(files, dark, bright, light, found)
    doubts = [doubt for doubt in (first, checks.hot_pixels(pattern, found), stray) if doubt]
    for doubt in doubts:
        doubt.widen(estimates)
    return Measurement(
        estimates=estimates,
        dark=dark,
        flat=flat,
        used=usable,
        fit=found,
        linearity=linear,
        size_px=files.size_px,
        bit_depth=bits,
        bits_stated=bit_depth is not None,
        clip_dn=clip_dn,
        notes=[
            note for note, applies in _notes(found, files.step_dn, len(flat) - len(used)).items() if applies
        ],
        doubts=doubts,
    )


def _depth(highest_dn: int, stated: int | None) -> int:
    if stated is None:
        return next(bits for bits in _DEPTHS if highest_dn < 2**bits)
    if highest_dn >= 2**stated:
        raise ValueError(f"bit_depth = {stated}: frames hold {highest_dn:g}; must be at most {2**stated - 1}")
    return stated


def _estimates(fit: Transfer, pixels: int) -> dict[str, Estimate]:
    gain, black = fit.gain, fit.dark
    # these pixels are a sample: their mean is the camera's to within the pattern's spread over its root
    black_error = math.hypot(black.offset_error, math.sqrt(fit.spread_dn2 / pixels))
    read, spread = fit.read_dn2 / gain**2, fit.spread_dn2 / gain**2
    found = {
        "system_gain_dn_per_e": _normal(gain, fit.error(1), 0.0),
        "read_noise_e": _root(read, fit.error(-2 * read / gain, 1 / gain**2)),
        "black_level_dn": _normal(black.offset, black_error),
        "dsnu_e": _root(spread, fit.error(-2 * spread / gain, 0, 1 / gain**2)),
    }
    if math.isfinite(black.slope):
        current = _in_electrons(black.slope, black.slope_error, fit)
        value, low, high = (max(0.0, each) for each in (current.value, current.low, current.high))
        current = Estimate(value, low, high)
        if fit.hidden_dn2_s:
            more = fit.hidden_dn2_s / gain**2
            error = math.hypot(fit.hidden_error_dn2_s / gain**2, 2 * more * fit.error(1) / gain)
            half = (current.high - current.low) / 2
            current = _normal(current.value + more, math.hypot(error, half / Z), 0.0)
        found["dark_current_e_s"] = current
    if (noise_dn := math.sqrt(fit.read_dn2)) < TWO_NUMBERS_DN:
        # what would go with as much noise as two numbers could have and hide
        hidden = TWO_NUMBERS_DN / max(noise_dn, 0.01)
        least = {"read_noise_e": TWO_NUMBERS_DN / gain}
        for name in {"read_noise_e", "dsnu_e", "dark_current_e_s"} & {*found}:
            most = max(found[name].high, hidden * found[name].value, least.get(name, 0.0))
            found[name] = Estimate(found[name].value, 0.0, most)
        found["black_level_dn"] = Estimate(black.offset, black.offset - 0.5, black.offset + 0.5)
    return found


def _normal(value: float, error: float, least: float = -math.inf) -> Estimate:
    return Estimate(value, max(least, value - Z * error), value + Z * error)


def _root(square: float, error: float) -> Estimate:
    """The root of a square that is known with a normal error, at least 0."""
    value, low, high = (
        math.sqrt(max(0.0, each)) for each in (square, square - Z * error, square + Z * error)
    )
    return Estimate(value, low, high)


def _in_electrons(dn: float, error_dn: float, fit: Transfer) -> Estimate:
    value = dn / fit.gain
    return _normal(value, math.hypot(error_dn, value * fit.error(1)) / fit.gain)


def _notes(fit: Transfer, step: int, left_out: int) -> dict[str, bool]:
    """Notes, and whether they apply."""
    noise_dn = math.sqrt(fit.read_dn2)
    bounds = ", and are bounds only, with black level and dark current" if noise_dn < TWO_NUMBERS_DN else ""
    return {
        f"all numbers are multiples of {step}: counted in steps of {step}": step > 1,
        "dark frames of one exposure: dark current cannot be told, and is part of the black level": math.isnan(
            fit.dark.slope
        ),
        f"noise in the dark is {noise_dn:.2g} DN before rounding, which rules there: read noise and DSNU rest on "
        f"the noise being normal{bounds}": fit.rounding,
        f"{left_out} flat levels near or beyond saturation are left out of the fit": left_out > 0,
        "the variances scatter beyond chance about the line: intervals are widened to what is seen": fit.widened,
        "noise in the dark grows with exposure and the mean does not, as where the camera takes it off: dark "
        "current is that of the variance": fit.hidden_dn2_s > 0,
    }
