"""Fit of a camera to a folder of dark and flat frames: its figures, each with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blurnoise._core.checks import integer
from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration import bend, checks, levels, structure, transfer
from blurnoise_eval.calibration.bend import Bend
from blurnoise_eval.calibration.checks import Doubt
from blurnoise_eval.calibration.formats import RawLayout
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Floats, Folder, Size, refuse
from blurnoise_eval.calibration.levels import Level, Pattern, columns, level_of
from blurnoise_eval.calibration.structure import Stack
from blurnoise_eval.calibration.transfer import Linearity, Transfer

_MOST_FOR_PATTERN = 8  # levels whose mean frames are read again, for PRNU
_FREE = 4.0  # deviations of noise below the limit, at which clipping leaves the variance alone
UNITS = {
    "system_gain_dn_per_e": "DN/e-", "read_noise_e": "e-", "row_noise_e": "e-", "column_noise_e": "e-",
    "dark_current_e_s": "e-/s", "black_level_dn": "DN", "black_level_drift_dn": "DN", "prnu": "", "prnu_row": "",
    "prnu_column": "", "dsnu_e": "e-", "dsnu_row_e": "e-", "dsnu_column_e": "e-", "full_well_e": "e-",
    "quantum_efficiency": "", "linearity_error": "",
}  # fmt: skip
"""What is measured at the lowest gain, in the order of tables."""
AT_GAIN = ("system_gain_dn_per_e", "read_noise_e", "black_level_dn")
"""What is measured at every gain."""


@dataclass(frozen=True)
class Measurement:
    """A camera as its frames show it. estimates: by the camera's field, and ``linearity_error``, a fraction.

    dark, flat: levels of the lowest gain, lowest_db, in steps of the converter; used: places of the flat ones that
    were fitted. gains: by dB above the lowest, estimates of ``AT_GAIN``. bend: None where the line holds. clip_dn:
    where flat frames clip, None if nowhere. size_px: (width, height). cfa: the mosaic, None without one.
    bits_given: whether the user gave the bit depth. notes: assumptions beside the figures. doubts: why some of them
    may be wrong.
    """

    estimates: dict[str, Estimate]
    dark: Sequence[Level]
    flat: Sequence[Level]
    used: Sequence[int]
    fit: Transfer
    lowest_db: float
    gains: Mapping[float, Mapping[str, Estimate]]
    bend: Bend | None
    linearity: Linearity | None
    size_px: Size
    cfa: str | None
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

    def rows(self) -> Iterator[tuple[str, Estimate | None, str]]:
        """Of a table of figures: name, None where it is not available, and unit."""
        for name, unit in UNITS.items():
            yield name, self.estimates.get(name), unit
        for gain_db, figures in self.gains.items():
            for name, estimate in figures.items():
                yield f"{name}, {gain_db + self.lowest_db:g} dB", estimate, UNITS[name]
        if self.bend:
            for share, factor in zip(self.bend.shares, self.bend.factors, strict=True):
                yield f"photon_transfer at {100 * share:.0f} %", factor, ""


def measure(
    folder: Path | Folder,
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
    files = folder if isinstance(folder, Folder) else Folder(folder, layout, cfa)
    bit_depth = bit_depth or files.bit_depth
    taken, *others = [_Taken(files.at_gain(gain_db)) for gain_db in files.gains_db]
    highest_dn = max(level.highest_dn for each in (taken, *others) for level in (*each.dark, *each.flat))
    bits = bit_depth or next(bits for bits in (8, 10, 12, 14, 16) if highest_dn < 2**bits)
    refuse(
        highest_dn >= 2**bits,
        f"bit_depth = {bits}: allows numbers up to {2**bits - 1}, but the frames contain {highest_dn}",
    )
    fitted = _fitted(taken, 2.0**bits - 1)
    found, clip_dn, dark, flat = fitted.fit, fitted.clip_dn, taken.dark, taken.flat

    mean_dn, signal = columns(flat, "mean_dn")[0], taken.signal(found)
    top_dn = (clip_dn or max(flat[place].mean_dn for place in fitted.used)) - found.dark.offset
    linear = transfer.linearity(flat, signal, top_dn)
    noise, fixed = taken.noise, structure.dark_pattern(taken.stack.halves)
    estimates = found.estimates(dark[0].pixels, taken.own(found), fixed.lines)
    terms = {
        "row_noise_e": noise.row, "column_noise_e": noise.column,
        "dsnu_row_e": fixed.row, "dsnu_column_e": fixed.column,
    }  # fmt: skip
    gains = {}
    for each in others:
        at_this = _fitted(each, 2.0**bits - 1).fit
        at_gain = at_this.estimates(dark[0].pixels, each.own(at_this))
        gains[each.gain_db - taken.gain_db] = {name: at_gain[name] for name in AT_GAIN}
    estimates |= {name: found.rms_e(*variance) for name, variance in terms.items()}
    if clip_dn is not None:
        estimates["full_well_e"] = found.electrons(top_dn, found.dark.offset_error)
    if linear:
        checks.check_linearity(flat, linear)
        estimates["linearity_error"] = linear.error
        if linear.light == "photons":
            estimates["quantum_efficiency"] = found.electrons(*linear.responsivity)

    chosen = sorted(fitted.used, key=lambda place: flat[place].frames * mean_dn[place])[-_MOST_FOR_PATTERN:]
    stack = Stack()
    light = sum((taken.lit(place, stack)[1] for place in chosen), np.zeros(())) / len(chosen)
    hot = levels.hot_pixels(taken.dark_mean)
    response = structure.light_pattern(stack.halves, taken.stack.halves, hot)
    for name, variance in (
        ("prnu", response.pixel),
        ("prnu_row", response.row),
        ("prnu_column", response.column),
    ):
        estimates[name] = transfer.term(*variance)
    warming = checks.warming(dark, found)
    if not warming:
        estimates["black_level_drift_dn"] = taken.drift
    stray, first = None, warming or fitted.tone
    if not first:
        whole = taken.files.whole()  # also of a mosaic, whose filters show light in the dark
        if files.place is not None:
            means = [np.mean([*whole.planes(whole.flat[place])], axis=0) for place in chosen]
            light = np.mean(means, axis=0)
        stray = checks.stray_light(whole, dark, [flat[place] for place in chosen], light, found)
    seen = (first, checks.hot_pixels(fitted.pattern, found), stray, checks.combed([*dark, *flat]))
    doubts = [doubt for doubt in seen if doubt]
    doubts += [Doubt(("quantum_efficiency", "cfa"), text) for text in files.doubts]
    for doubt in doubts:
        doubt.widen(estimates)
    return Measurement(
        estimates=estimates, dark=dark, flat=flat, used=fitted.used, fit=found, lowest_db=files.gains_db[0],
        gains=gains,
        bend=fitted.bend, linearity=linear, size_px=files.size_px,
        cfa=None if files.place is None else files.cfa, bit_depth=bits, bits_given=bit_depth is not None,
        clip_dn=clip_dn, doubts=doubts,
        notes=[*files.notes, *checks.remarks(dark, flat), *_notes(found, files)],
    )  # fmt: skip


class _Taken:
    """The frames of one gain: levels, and what dark ones have in rows, columns and pixels.

    The means of dark levels are as uncertain as their frames' means scatter.
    """

    def __init__(self, files: Folder) -> None:
        self.files, self.stack, self.gain_db = files, Stack(), files.dark[0][0].gain_db
        dark, self.dark_mean = [], np.zeros(())
        for frames in files.dark:
            level, mean = level_of(self.stack.passing(files.planes(frames)), frames[0])
            dark.append(level)
            self.dark_mean = self.dark_mean + (mean - level.mean_dn) / len(files.dark)
        self.noise = noise = self.stack.temporal(dark)
        self.drift, variance = self.stack.drift(dark, noise)
        if self.drift.value:
            dark = [replace(level, mean_error_dn=math.sqrt(variance / level.frames)) for level in dark]
        height, width = self.stack.shape
        self._lines_dn2 = math.hypot(
            noise.row[0] * math.sqrt(2 / height), noise.column[0] * math.sqrt(2 / width)
        )
        self.dark = [self._of_lines(level) for level in dark]
        self.line = transfer.dark_line(self.dark)
        self.flat = [self.lit(place)[0] for place in range(len(files.flat))]

    def lit(self, place: int, stack: Stack | None = None) -> tuple[Level, Floats]:
        """A flat level and its mean frame, read; ``stack`` takes its frames, too."""
        frames = self.files.flat[place]
        planes = self.files.planes(frames)
        dark_dn = self.line.at(frames[0].exposure_s)
        level, mean = level_of(stack.passing(planes) if stack else planes, frames[0], dark_dn)
        error = math.hypot(level.mean_error_dn, self.drift.value / math.sqrt(level.frames))
        return replace(self._of_lines(level), mean_error_dn=error), mean

    def _of_lines(self, level: Level) -> Level:
        """The level, whose variance is as uncertain as that of so few rows and columns."""
        error = math.hypot(level.variance_error_dn2, self._lines_dn2 / math.sqrt(level.frames - 1))
        return replace(level, variance_error_dn2=error)

    def own(self, fit: Transfer) -> structure.Uncertain:
        """Share of the variance in the dark that is the pixels' own, not of whole rows or columns."""
        (lines_dn2, error_dn2), dark_dn2 = self.noise.lines, max(fit.read_dn2, 1e-9)
        return max(0.0, 1 - lines_dn2 / dark_dn2), error_dn2 / dark_dn2

    def signal(self, fit: Transfer) -> Floats:
        """Means of the flat levels less those in the dark."""
        exposure, mean_dn = columns(self.flat, "exposure_s", "mean_dn")
        return mean_dn - fit.dark.at(exposure)


@dataclass(frozen=True)
class _Fitted:
    """Photon transfer of one gain; pattern: of its dark frames; tone: the doubt that a tone curve explains it."""

    fit: Transfer
    pattern: Pattern
    clip_dn: float | None
    used: Sequence[int]
    bend: Bend | None
    tone: Doubt | None


def _fitted(taken: _Taken, full_scale_dn: float) -> _Fitted:
    """By the straight part of the curve. Raises ``ValueError`` for levels that cannot be used."""
    dark, flat = taken.dark, taken.flat
    dim = checks.too_dim(dark, flat)
    checks.check_levels(dark, [level for place, level in enumerate(flat) if place not in dim])
    clip_dn, used = checks.clipping(flat, taken.line.offset, full_scale_dn)
    used = [place for place in used if place not in dim]
    few = f"frames: {len(dim)} of {len(flat)} flat levels are too dim; {FEWEST_FLAT} brighter ones are needed"
    refuse(len(used) < FEWEST_FLAT, few)
    checks.check_noise([flat[place] for place in used])
    pattern = levels.dark_pattern(taken.stack.halves)
    fit = transfer.fit(dark, [flat[place] for place in used], pattern)
    tone = checks.tone_curve(dark, [flat[place] for place in used], fit)
    limit_dn = clip_dn or full_scale_dn
    whole = [level for level in flat if level.mean_dn + _FREE * math.sqrt(fit.at(level.mean_dn)) < limit_dn]
    curve = bend.bend_of(whole, fit, limit_dn - fit.dark.offset, tone=tone is not None)
    if curve:
        tone, used = None, [place for place in used if flat[place].mean_dn <= curve.straight_dn]
        fit = transfer.fit(dark, [flat[place] for place in used], pattern)
    return _Fitted(fit, pattern, clip_dn, used, curve, tone)


def _notes(fit: Transfer, files: Folder) -> list[str]:
    """What was assumed, and what else to know of the figures."""
    bounds = "; these, black level and dark current are bounds only"
    bounds = bounds if fit.noise_dn < transfer.TWO_NUMBERS_DN else ""
    dark = f"the noise in the dark, {fit.noise_dn:.2g} DN, is smaller than the rounding"
    hidden = "the camera subtracts the dark signal; the dark current is measured from the variance"
    measured_dn = fit.dark.offset * files.scale.step
    stated_dn = measured_dn if files.black_dn is None else files.black_dn
    other = abs(measured_dn - stated_dn) > max(2.0, 0.05 * stated_dn)
    blacks = (
        f"the dark frames have a black level of {measured_dn:.4g} DN, but the files state {stated_dn:g} DN"
    )
    every = (
        (other, f"{blacks}; are the numbers still those of the sensor?"),
        (files.scale.text, f"{files.scale.text}; the converter's own counts are measured"),
        (fit.rounding, f"{dark}; read noise and DSNU assume normal noise{bounds}"),
        (fit.hidden_dn2_s[0] > 0, hidden),
        (fit.widened, "the variances scatter more than expected about the line; the intervals are widened"),
    )
    return [text for applies, text in every if applies]
