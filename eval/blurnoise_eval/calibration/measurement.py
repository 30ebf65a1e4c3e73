"""Measurement of a camera from a folder of dark and flat frames: its figures, each with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import integer
from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.calibration import doubts, soundness, transfer
from blurnoise_eval.calibration.doubts import Doubt
from blurnoise_eval.calibration.levels import Level, common_step, level_of
from blurnoise_eval.calibration.listing import Frame, frames_of, grouped
from blurnoise_eval.calibration.planes import Plane, read_plane
from blurnoise_eval.calibration.rounding import TWO_NUMBERS_DN
from blurnoise_eval.calibration.transfer import Line, Transfer, Z, root

Floats = NDArray[np.float64]
_DEPTHS = (8, 10, 12, 14, 16)
_MOST_FOR_PATTERN = 8  # levels whose mean frames are read again, for PRNU


@dataclass(frozen=True)
class Measurement:
    """What frames say of their camera. estimates: by the camera's field, and ``linearity_error``, a fraction.

    dark, flat: levels in steps of the converter; used: places of the flat ones that were fitted. clip_dn: where
    flat frames clip, None if nowhere. size_px: (width, height). bits_stated: whether the user said the bit depth.
    notes: what has to be known beside the figures. doubts: what makes some of them wrong.
    """

    estimates: dict[str, Estimate]
    dark: tuple[Level, ...]
    flat: tuple[Level, ...]
    used: tuple[int, ...]
    fit: Transfer
    linearity: soundness.Linearity | None
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


class _Folder:
    """Frames by level, read when they are wanted."""

    def __init__(self, folder: Path, raw_size_px: tuple[int, int] | None) -> None:
        levels = grouped(frames_of(folder))
        self.dark = [frames for (kind, *_), frames in levels.items() if kind == "dark"]
        self.flat = [frames for (kind, *_), frames in levels.items() if kind == "flat"]
        self.size_px: tuple[int, int] | None = None
        self._raw_size_px, self._bits = raw_size_px, 0

    def level(self, frames: Sequence[Frame], dark_dn: float = 0.0) -> tuple[Level, Floats]:
        """Statistics of these frames, and their mean."""
        first = frames[0]
        return level_of(first.kind, first.exposure_s, first.photons_per_px, self._planes(frames), dark_dn)

    def mean(self, frames: Sequence[Frame]) -> Floats:
        """The mean of these frames."""
        total = np.zeros(())
        for plane in self._planes(frames):
            total = total + plane
        return total / len(frames)

    def _planes(self, frames: Sequence[Frame]) -> Iterator[Plane]:
        for frame in frames:
            plane = read_plane(frame.path, self._raw_size_px)
            height, width = plane.shape
            if self.size_px is None:
                self.size_px, self._bits = (width, height), 8 * plane.itemsize
            if self.size_px != (width, height):
                first = "{} x {}".format(*self.size_px)
                raise ValueError(
                    f"{frame.path}: mixed sizes, {width} x {height} px; the frames before it: {first}"
                )
            if 8 * plane.itemsize != self._bits:
                depths = f"{8 * plane.itemsize} bits; the frames before it: {self._bits}"
                raise ValueError(f"{frame.path}: mixed depths, {depths}")
            yield plane


def measure(
    folder: Path, *, bit_depth: int | None = None, raw_size_px: tuple[int, int] | None = None
) -> Measurement:
    """The camera whose frames lie in ``folder``. bit_depth: of the converter; None takes the fewest bits that fit.

    Raises ``ValueError`` naming the file or level that cannot be used, and why.
    """
    if bit_depth is not None:
        integer("bit_depth", bit_depth, 1, 16)
    files = _Folder(folder, raw_size_px)
    soundness.check_counts([*files.dark, *files.flat])
    dark, total = [], np.zeros(())
    for frames in files.dark:
        level, mean = files.level(frames)
        dark.append(level)
        total = total + mean - level.mean_dn
    line = transfer.dark_line(dark, np.array([level.mean_dn for level in dark]))
    flat = [files.level(frames, line.at(frames[0].exposure_s))[0] for frames in files.flat]
    step = common_step([*dark, *flat])
    dark, flat = ([level.in_steps(step) for level in levels] for levels in (dark, flat))
    bits = _depth(max(level.highest_dn for level in [*dark, *flat]), bit_depth)
    soundness.check_dark(dark)
    soundness.check_flat(flat, dark)
    clipped = soundness.clipping(flat, line.offset / step, 2.0**bits - 1)
    used = [flat[place] for place in clipped.usable]
    soundness.check_noise(used)
    pattern = transfer.dark_pattern(total / (len(dark) * step), dark)
    fit = transfer.fit(dark, used, pattern)
    hidden, hidden_error = 0.0, 0.0
    for _ in range(3):  # the gain hardly depends on it
        found, error = transfer.hidden_charge(dark, fit)
        if hidden == 0 and found < transfer.SURELY * error:
            break
        hidden, hidden_error = found, error
        fit = transfer.fit(_without(dark, hidden), _without(used, hidden), pattern)
    exposures = np.array([level.exposure_s for level in [*dark, *used]])
    fit = replace(fit, expected_dn2=fit.expected_dn2 + hidden * exposures)
    top_dn = (
        max(level.mean_dn for level in used) if clipped.clip_dn is None else clipped.clip_dn
    ) - fit.dark.offset
    linear = soundness.linearity(flat, [fit.dark.at(level.exposure_s) for level in flat], top_dn)
    estimates = _estimates(fit, dark[0].pixels)
    chosen = sorted(clipped.usable, key=lambda place: flat[place].mean_dn)[-_MOST_FOR_PATTERN:]
    means = [files.level(files.flat[place], line.at(flat[place].exposure_s))[1] for place in chosen]
    bright = [flat[place] for place in chosen]
    light = np.sum(means, 0) / len(means) / step
    estimates["prnu"] = _prnu(light - total / len(dark) / step, fit.dark, bright, dark)
    varies = doubts.drift(dark, fit) or doubts.tone_curve(dark, used, fit)
    stray = None if varies else _stray_light(files, light, bright, dark, step, fit)
    doubted = tuple(each for each in (varies, doubts.hot_pixels(pattern, fit), stray) if each)
    notes = _notes(fit, step, dark, len(flat) - len(used))
    if hidden:
        estimates["dark_current_e_s"] = _with_hidden(estimates["dark_current_e_s"], fit, hidden, hidden_error)
        notes.append(
            "noise in the dark grows with exposure and the mean does not, as where the camera takes it off: dark "
            "current is that of the variance"
        )
    gain = estimates["system_gain_dn_per_e"]
    if clipped.clip_dn is not None:
        estimates["full_well_e"] = _over_gain(clipped.clip_dn - fit.dark.offset, fit.dark.offset_error, gain)
    if linear:
        estimates["linearity_error"] = Estimate(
            linear.worst, max(0.0, linear.worst - linear.error), linear.worst + linear.error
        )
        if linear.by_photons:
            estimates["quantum_efficiency"] = _over_gain(linear.slope, linear.slope_error, gain)
    return Measurement(
        estimates=doubts.widened(estimates, doubted),
        dark=tuple(dark),
        flat=tuple(flat),
        used=clipped.usable,
        fit=fit,
        linearity=linear,
        size_px=files.size_px or (0, 0),
        bit_depth=bits,
        bits_stated=bit_depth is not None,
        clip_dn=clipped.clip_dn,
        notes=tuple(notes),
        doubts=doubted,
    )


def _estimates(fit: Transfer, pixels: int) -> dict[str, Estimate]:
    gain, black = fit.gain, fit.dark
    gain_error = fit.error((1, 0, 0))
    # these pixels are a sample: their mean is the camera's to within the pattern's spread over its root
    black_error = math.hypot(black.offset_error, math.sqrt(fit.spread_dn2 / pixels))
    estimates = {
        "system_gain_dn_per_e": Estimate(gain, max(0.0, gain - Z * gain_error), gain + Z * gain_error),
        "read_noise_e": root(
            fit.read_dn2 / gain**2, fit.error((-2 * fit.read_dn2 / gain**3, 1 / gain**2, 0))
        ),
        "black_level_dn": Estimate(
            black.offset, black.offset - Z * black_error, black.offset + Z * black_error
        ),
        "dsnu_e": root(fit.spread_dn2 / gain**2, fit.error((-2 * fit.spread_dn2 / gain**3, 0, 1 / gain**2))),
    }
    if math.isfinite(black.slope):
        told = _over_gain(black.slope, black.slope_error, estimates["system_gain_dn_per_e"])
        estimates["dark_current_e_s"] = Estimate(
            max(0.0, told.value), max(0.0, told.low), max(0.0, told.high)
        )
    return _as_bounds(estimates, fit) if math.sqrt(fit.read_dn2) < TWO_NUMBERS_DN else estimates


def _as_bounds(estimates: dict[str, Estimate], fit: Transfer) -> dict[str, Estimate]:
    """Where dark pixels hold two numbers only: what would go with as much noise as they could have and hide."""
    hidden = TWO_NUMBERS_DN / max(math.sqrt(fit.read_dn2), 0.01)
    loose = {
        name: Estimate(told.value, 0.0, max(told.high, hidden * told.value))
        for name, told in estimates.items()
        if name in ("read_noise_e", "dsnu_e", "dark_current_e_s")
    }
    read, black = loose["read_noise_e"], estimates["black_level_dn"]
    loose["read_noise_e"] = Estimate(read.value, 0.0, max(read.high, TWO_NUMBERS_DN / fit.gain))
    loose["black_level_dn"] = Estimate(black.value, black.value - 0.5, black.value + 0.5)
    return estimates | loose


def _without(levels: Sequence[Level], hidden_dn2_s: float) -> list[Level]:
    """The levels less the variance of dark charge that their means do not show."""
    return [
        replace(level, variance_dn2=level.variance_dn2 - hidden_dn2_s * level.exposure_s) for level in levels
    ]


def _with_hidden(shown: Estimate, fit: Transfer, hidden: float, error: float) -> Estimate:
    more = hidden / fit.gain**2
    margin = Z * math.hypot(error / fit.gain**2, 2 * more * fit.error((1, 0, 0)) / fit.gain)
    margin = math.hypot(margin, (shown.high - shown.low) / 2)
    value = shown.value + more
    return Estimate(value, max(0.0, value - margin), value + margin)


def _over_gain(dn: float, error_dn: float, gain: Estimate) -> Estimate:
    value = dn / gain.value
    margin = math.hypot(Z * error_dn / gain.value, value * (gain.high - gain.low) / 2 / gain.value)
    return Estimate(value, value - margin, value + margin)


def _prnu(light: Floats, black: Line, flat: Sequence[Level], dark: Sequence[Level]) -> Estimate:
    """light: mean of the flat levels' mean frames less that of the dark ones'."""
    noise = transfer.noise_of_mean(flat) + transfer.noise_of_mean(dark)
    pattern = transfer.response_pattern(light, noise)
    signal = float(np.mean([level.mean_dn - black.at(level.exposure_s) for level in flat]))
    return root((pattern.variance_dn2 - noise) / signal**2, pattern.error_dn2 / signal**2)


def _stray_light(
    files: _Folder, light: Floats, bright: Sequence[Level], dark: Sequence[Level], step: int, fit: Transfer
) -> Doubt | None:
    """light: mean of the flat levels ``bright``. The growth of the dark is of every other frame, the dark that is
    taken off the light of those between, so that no noise is in both."""
    exposure = np.array([level.exposure_s for level in dark])
    away = exposure - exposure.mean()
    if not away.any():
        return None
    slope = away / (away @ away)
    at_light = 1 / len(dark) + slope * (np.mean([level.exposure_s for level in bright]) - exposure.mean())
    growth, again, black = np.zeros_like(light), np.zeros_like(light), np.zeros_like(light)
    for frames, by, beneath in zip(files.dark, slope, at_light, strict=True):
        growth += files.mean(frames[::2]) * (by / step)
        rest = files.mean(frames[1::2])
        again += rest * (by / step)
        black += rest * (beneath / step)
    signal = float((light - black).mean())
    noise = transfer.noise_of_mean(bright)
    noise += sum(
        level.variance_dn2 / (level.frames // 2) * by**2 for level, by in zip(dark, at_light, strict=True)
    )
    response = (light - black) / signal
    return doubts.stray_light(growth, again, response, noise / signal**2, fit.dark, fit.gain)


def _depth(highest_dn: float, stated: int | None) -> int:
    if stated is None:
        return next(bits for bits in _DEPTHS if highest_dn < 2**bits)
    if highest_dn >= 2**stated:
        raise ValueError(f"bit_depth = {stated}: frames hold {highest_dn:g}; must be at most {2**stated - 1}")
    return stated


def _notes(fit: Transfer, step: int, dark: Sequence[Level], left_out: int) -> list[str]:
    notes, loose = [], math.sqrt(fit.read_dn2) < TWO_NUMBERS_DN
    if step > 1:
        notes.append(f"all numbers are multiples of {step}: counted in steps of {step}")
    if math.isnan(fit.dark.slope):
        notes.append(
            "dark frames of one exposure: dark current cannot be told, and is part of the black level"
        )
    if fit.rounding:
        notes.append(
            f"noise in the dark is {math.sqrt(fit.read_dn2):.2g} DN before rounding, which rules there: read noise "
            "and DSNU rest on the noise being normal"
            + (", and are bounds only, with black level and dark current" if loose else "")
        )
    if left_out:
        notes.append(f"{left_out} flat levels near or beyond saturation are left out of the fit")
    if transfer.widened(fit.chi_square, fit.freedom) > 1:
        notes.append(
            "the variances scatter beyond chance about the line: intervals are widened to what is seen"
        )
    return notes
