"""Fit of a camera to a folder of dark and flat frames: its figures, each with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blurnoise._core.checks import integer
from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.calibration import checks, doubts, transfer
from blurnoise_eval.calibration.checks import Linearity, Z
from blurnoise_eval.calibration.doubts import Doubt
from blurnoise_eval.calibration.frames import Folder, Frame
from blurnoise_eval.calibration.levels import Floats, Level, columns, common_step, level_of
from blurnoise_eval.calibration.rounding import TWO_NUMBERS_DN
from blurnoise_eval.calibration.transfer import Transfer

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
    dark: tuple[Level, ...]
    flat: tuple[Level, ...]
    used: tuple[int, ...]
    fit: Transfer
    linearity: Linearity | None
    size_px: tuple[int, int]
    bit_depth: int
    bits_stated: bool
    clip_dn: float | None
    notes: tuple[str, ...]
    doubts: tuple[Doubt, ...]

    @property
    def frames(self) -> str:
        """How many there were, in words."""
        flat, dark = (sum(level.frames for level in levels) for levels in (self.flat, self.dark))
        return f"{flat} flat and {dark} dark frames"


def measure(
    folder: Path, *, bit_depth: int | None = None, raw_size_px: tuple[int, int] | None = None
) -> Measurement:
    """The camera whose frames lie in ``folder``. bit_depth: of the converter; None takes the fewest bits that fit.

    Raises ``ValueError`` naming the file or level that cannot be used, and why.
    """
    if bit_depth is not None:
        integer("bit_depth", bit_depth, 1, 16)
    files = Folder(folder, raw_size_px)
    checks.check_counts(files)
    dark, dark_mean = [], np.zeros(())
    for frames in files.dark:
        level, mean = level_of(files.planes(frames), frames[0])
        dark.append(level)
        dark_mean = dark_mean + (mean - level.mean_dn) / len(files.dark)
    line = transfer.dark_line(dark)

    def lit(frames: Sequence[Frame]) -> tuple[Level, Floats]:
        return level_of(files.planes(frames), frames[0], line.at(frames[0].exposure_s))

    flat = [lit(frames)[0] for frames in files.flat]
    step = common_step([*dark, *flat])
    dark, flat = ([level.in_steps(step) for level in levels] for levels in (dark, flat))
    bits = _depth(max(level.highest_dn for level in [*dark, *flat]), bit_depth)
    checks.check_dark(dark)
    checks.check_light(flat, dark)
    clipped = checks.clipping(flat, line.offset / step, 2.0**bits - 1)
    used = [flat[place] for place in clipped.usable]
    checks.check_noise(used)

    pattern = transfer.dark_pattern(dark_mean / step, dark)
    fit, hidden, hidden_error = _fit(dark, used, pattern)
    estimates = _estimates(fit, dark[0].pixels)
    notes = _notes(fit, step, len(flat) - len(used))
    if hidden:
        _add_hidden(estimates, fit, hidden, hidden_error)
        notes.append(
            "noise in the dark grows with exposure and the mean does not, as where the camera takes it off: dark "
            "current is that of the variance"
        )
    top_dn = max(level.mean_dn for level in used)
    if clipped.clip_dn is not None:
        top_dn = clipped.clip_dn
        estimates["full_well_e"] = _in_electrons(top_dn - fit.dark.offset, fit.dark.offset_error, fit)
    exposure, mean = columns(flat, "exposure_s", "mean_dn")
    linear = checks.linearity(flat, mean - fit.dark.at(exposure), top_dn - fit.dark.offset)
    if linear:
        estimates["linearity_error"] = linear.error
        if linear.by_photons:
            estimates["quantum_efficiency"] = _in_electrons(linear.slope, linear.slope_error, fit)

    chosen = sorted(clipped.usable, key=lambda place: flat[place].mean_dn)[-_MOST_FOR_PATTERN:]
    bright = [flat[place] for place in chosen]
    light: Floats = np.zeros_like(dark_mean)
    for place in chosen:
        light += lit(files.flat[place])[1]
    light /= len(chosen) * step
    estimates["prnu"] = _prnu(light - dark_mean / step, fit, bright, dark)
    doubted = [doubts.drift(dark, fit) or doubts.tone_curve(dark, used, fit)]
    stray = None if doubted[0] else _stray_light(files, light, bright, dark, step, fit)
    doubted += [doubts.hot_pixels(pattern, fit), stray]
    found = tuple(each for each in doubted if each)
    return Measurement(
        estimates=doubts.widened(estimates, found),
        dark=tuple(dark),
        flat=tuple(flat),
        used=clipped.usable,
        fit=fit,
        linearity=linear,
        size_px=files.size_px,
        bit_depth=bits,
        bits_stated=bit_depth is not None,
        clip_dn=clipped.clip_dn,
        notes=tuple(notes),
        doubts=found,
    )


def _fit(
    dark: Sequence[Level], used: Sequence[Level], pattern: transfer.Pattern
) -> tuple[Transfer, float, float]:
    """The fit, and the dark charge, DN^2/s, that variances show and means do not, with its error; 0 for none."""
    fit, hidden, hidden_error = transfer.fit(dark, used, pattern), 0.0, 0.0
    for _ in range(3):  # the gain hardly depends on it
        found, error = transfer.hidden_charge(dark, fit)
        if hidden == 0 and found < transfer.SURELY * error:
            break
        hidden, hidden_error = found, error
        fit = transfer.fit(_without(dark, hidden), _without(used, hidden), pattern)
    (exposure,) = columns([*dark, *used], "exposure_s")
    return replace(fit, expected_dn2=fit.expected_dn2 + hidden * exposure), hidden, hidden_error


def _without(levels: Sequence[Level], hidden_dn2_s: float) -> list[Level]:
    """The levels less the variance of dark charge that their means do not show."""
    return [
        replace(level, variance_dn2=level.variance_dn2 - hidden_dn2_s * level.exposure_s) for level in levels
    ]


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
        ends = max(0.0, current.low), max(0.0, current.high)
        found["dark_current_e_s"] = Estimate(max(0.0, current.value), *ends)
    if (noise_dn := math.sqrt(fit.read_dn2)) < TWO_NUMBERS_DN:
        # what would go with as much noise as two numbers could have and hide
        hidden = TWO_NUMBERS_DN / max(noise_dn, 0.01)
        for name in {"read_noise_e", "dsnu_e", "dark_current_e_s"} & {*found}:
            most = max(found[name].high, hidden * found[name].value)
            found[name] = replace(found[name], low=0.0, high=most)
        most = max(found["read_noise_e"].high, TWO_NUMBERS_DN / gain)
        found["read_noise_e"] = replace(found["read_noise_e"], high=most)
        found["black_level_dn"] = Estimate(black.offset, black.offset - 0.5, black.offset + 0.5)
    return found


def _add_hidden(estimates: dict[str, Estimate], fit: Transfer, hidden: float, error: float) -> None:
    shown = estimates["dark_current_e_s"]
    more = hidden / fit.gain**2
    margin = Z * math.hypot(error / fit.gain**2, 2 * more * fit.error(1) / fit.gain)
    margin = math.hypot(margin, (shown.high - shown.low) / 2)
    value = shown.value + more
    estimates["dark_current_e_s"] = Estimate(value, max(0.0, value - margin), value + margin)


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


def _prnu(light: Floats, fit: Transfer, flat: Sequence[Level], dark: Sequence[Level]) -> Estimate:
    """light: mean of the flat levels' mean frames less that of the dark ones'."""
    noise = transfer.noise_of_mean(flat) + transfer.noise_of_mean(dark)
    pattern = transfer.response_pattern(light, noise)
    exposure, mean = columns(flat, "exposure_s", "mean_dn")
    signal = float((mean - fit.dark.at(exposure)).mean())
    return _root(pattern.fixed_dn2 / signal**2, pattern.error_dn2 / signal**2)


def _stray_light(
    files: Folder, light: Floats, bright: Sequence[Level], dark: Sequence[Level], step: int, fit: Transfer
) -> Doubt | None:
    """light: mean of the flat levels ``bright``. The growth of the dark is of every other frame, the dark that is
    taken off the light of those between, so that no noise is in both."""
    exposure, variance, count = columns(dark, "exposure_s", "variance_dn2", "frames")
    away = exposure - exposure.mean()
    if not away.any():
        return None
    slope = away / (away @ away)
    at_light = 1 / len(dark) + slope * (columns(bright, "exposure_s")[0].mean() - exposure.mean())
    growth, again, black = np.zeros_like(light), np.zeros_like(light), np.zeros_like(light)
    for frames, by, beneath in zip(files.dark, slope, at_light, strict=True):
        every, between = (files.mean(half) / step for half in (frames[::2], frames[1::2]))
        growth += every * by
        again += between * by
        black += between * beneath
    signal = float((light - black).mean())
    noise = transfer.noise_of_mean(bright) + float((variance / (count // 2) * at_light**2).sum())
    return doubts.stray_light(growth, again, (light - black) / signal, noise / signal**2, fit)


def _depth(highest_dn: int, stated: int | None) -> int:
    if stated is None:
        return next(bits for bits in _DEPTHS if highest_dn < 2**bits)
    if highest_dn >= 2**stated:
        raise ValueError(f"bit_depth = {stated}: frames hold {highest_dn:g}; must be at most {2**stated - 1}")
    return stated


def _notes(fit: Transfer, step: int, left_out: int) -> list[str]:
    notes, noise_dn = [], math.sqrt(fit.read_dn2)
    if step > 1:
        notes.append(f"all numbers are multiples of {step}: counted in steps of {step}")
    if math.isnan(fit.dark.slope):
        notes.append(
            "dark frames of one exposure: dark current cannot be told, and is part of the black level"
        )
    if fit.rounding:
        bounds = (
            ", and are bounds only, with black level and dark current" if noise_dn < TWO_NUMBERS_DN else ""
        )
        notes.append(
            f"noise in the dark is {noise_dn:.2g} DN before rounding, which rules there: read noise and DSNU rest on "
            f"the noise being normal{bounds}"
        )
    if left_out:
        notes.append(f"{left_out} flat levels near or beyond saturation are left out of the fit")
    if fit.widened:
        notes.append(
            "the variances scatter beyond chance about the line: intervals are widened to what is seen"
        )
    return notes
