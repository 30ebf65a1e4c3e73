"""Fit of a camera to a folder of dark and flat frames: its figures, each with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blurnoise._core.checks import integer
from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration import bend, checks, doubts, patterns, row_gain, standard, transfer
from blurnoise_eval.calibration.bend import Bend
from blurnoise_eval.calibration.doubts import Doubt
from blurnoise_eval.calibration.formats import RawLayout
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Floats, Folder, Size
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.levels import Level, columns, level_of
from blurnoise_eval.calibration.patterns import DarkPattern
from blurnoise_eval.calibration.rounding import TWO_NUMBERS_DN
from blurnoise_eval.calibration.standard import StandardFigures
from blurnoise_eval.calibration.temporal import FrameMeans
from blurnoise_eval.calibration.transfer import Linearity, Transfer
from blurnoise_eval.calibration.uncertain import Uncertain, Z

_MOST_FOR_PATTERN = 8  # levels whose frames are read again for PRNU
_FREE = 4.0  # deviations of the noise below the limit, where clipping leaves the variance unchanged
UNITS = {
    "system_gain_dn_per_e": "DN/e-", "read_noise_e": "e-", "row_noise_e": "e-", "column_noise_e": "e-",
    "parity_noise_e": "e-", "row_gain_noise": "", "row_gain_rows": "rows", "dark_current_e_s": "e-/s",
    "black_level_dn": "DN", "black_level_drift_dn": "DN", "prnu": "", "prnu_row": "", "prnu_column": "",
    "dsnu_e": "e-", "dsnu_row_e": "e-", "dsnu_column_e": "e-", "full_well_e": "e-", "quantum_efficiency": "",
    "linearity_error": "",
}  # fmt: skip
"""The figures that are measured at the lowest gain, in the order of tables."""
AT_GAIN = ("system_gain_dn_per_e", "read_noise_e", "black_level_dn")
"""The figures that are measured at every gain."""


@dataclass(frozen=True)
class Measurement:
    """A camera, measured from frames. estimates: by the camera's field, and ``linearity_error``, a fraction.

    dark, flat: levels of the lowest gain, lowest_db, in steps of the converter; used: indices of the flat levels that
    were fitted. gains: by dB above the lowest, estimates of ``AT_GAIN``. bend: None if the variances follow the line.
    clip_dn: where flat frames clip, None if they do not. size_px: (width, height). cfa: the mosaic, None without one.
    bits_given: whether the user gave the bit depth. standard: the figures as EMVA 1288 defines them. notes:
    assumptions. doubts: why figures may be wrong.
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
    standard: StandardFigures
    notes: Sequence[str]
    doubts: Sequence[Doubt]

    @property
    def frames(self) -> str:
        """Number of frames, in words."""
        flat, dark = (sum(level.frames for level in levels) for levels in (self.flat, self.dark))
        return f"{flat} flat and {dark} dark frames"

    @property
    def temperature_c(self) -> float | None:
        """Mean temperature of the sensor in the dark levels, None if unknown."""
        every = [level.taken.temperature_c for level in self.dark]
        celsius = [temperature_c for temperature_c in every if temperature_c is not None]
        return sum(celsius) / len(celsius) if celsius else None

    def rows(self) -> Iterator[tuple[str, Estimate | None, str]]:
        """Rows of a table of figures: name, estimate (None if not available) and unit."""
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
    leave_out: Sequence[str] = (),
) -> Measurement:
    """Measure the camera that took the frames of ``folder``. bit_depth: of the converter; None: the fewest bits that
    fit. layout, cfa, leave_out: as for :class:`Folder`.

    Raises ``ValueError`` that names the file or level that cannot be used, and the reason.
    """
    if bit_depth is not None:
        integer("bit_depth", bit_depth, 1, 16)
    files = folder if isinstance(folder, Folder) else Folder(folder, layout, cfa, leave_out)
    bit_depth = bit_depth or files.bit_depth
    lowest, *others = [_GainFrames(files.at_gain(gain_db)) for gain_db in files.gains_db]
    highest_dn = max(level.highest_dn for frames in (lowest, *others) for level in frames.levels)
    bits = bit_depth or next(bits for bits in (8, 10, 12, 14, 16) if highest_dn < 2**bits)
    allowed = f"bit_depth = {bits}: allows numbers up to {2**bits - 1}, but the frames contain {highest_dn}"
    refuse(highest_dn >= 2**bits, allowed)
    curve = _fit(lowest, 2.0**bits - 1)
    fit, dark, flat = curve.fit, lowest.dark, lowest.flat
    estimates, linear = _estimates(lowest, curve)
    gains = {}
    for frames in others:
        of_gain = _fit(frames, 2.0**bits - 1).fit
        figures = of_gain.estimates(frames.sampled_dn2, frames.pixel_share(of_gain))
        gains[frames.gain_db - lowest.gain_db] = {name: figures[name] for name in AT_GAIN}

    # EMVA 1288 measures PRNU at half of saturation, and levels are used to 70 % of it.
    signal = lowest.signal(fit)
    away = np.abs(signal - 0.5 / checks.USED * signal[curve.used].max())
    weight = columns(flat, "frames")[0] / (1 + away / signal.max())
    chosen = sorted(curve.used, key=lambda index: weight[index])[-_MOST_FOR_PATTERN:]
    means = FrameMeans()
    light = sum((lowest.read_flat(index, means)[1] for index in chosen), np.zeros(())) / len(chosen)
    response = patterns.light_lines(means.halves, lowest.means.halves, patterns.hot_pixels(lowest.dark_mean))
    variances = {"prnu": response.pixel, "prnu_row": response.row, "prnu_column": response.column}
    estimates |= {name: variance.term() for name, variance in variances.items()}
    warming = doubts.warming(dark, fit)
    if not warming:
        value, low, high = (getattr(lowest.drift, end) / fit.response for end in ("value", "low", "high"))
        estimates["black_level_drift_dn"] = Estimate(value, low, high)
    candidates = [
        warming or curve.tone,
        doubts.hot_pixels(curve.pattern, fit),
        None if warming or curve.tone else _stray_light(lowest, chosen, light, fit),
        doubts.clamped(dark, fit),
        doubts.stretched([*dark, *flat], fit.gain),
        *(Doubt(("quantum_efficiency", "cfa"), text) for text in files.doubts),
    ]
    found = [doubt for doubt in candidates if doubt]
    for doubt in found:
        doubt.widen(estimates)
    return Measurement(
        estimates=estimates, dark=dark, flat=flat, used=curve.used, fit=fit, lowest_db=files.gains_db[0],
        gains=gains, bend=curve.bend, linearity=linear, size_px=files.size_px,
        cfa=None if files.site is None else files.cfa, bit_depth=bits, bits_given=bit_depth is not None,
        clip_dn=curve.clip_dn, doubts=found,
        standard=standard.figures_of_frames(dark, flat, lowest.means.halves, means.halves),
        notes=[*files.notes, *checks.remarks(dark, flat), *_notes(fit, files), *_sag(flat, linear)],
    )  # fmt: skip


class _GainFrames:
    """The frames of one gain: their levels, and the temporal noise of the dark ones.

    The mean of a dark level is as uncertain as the means of its frames scatter.
    """

    def __init__(self, files: Folder) -> None:
        self.files, self.means, self.gain_db = files, FrameMeans(), files.dark[0][0].gain_db
        dark, self.dark_mean = [], np.zeros(())
        for frames in files.dark:
            level, mean = level_of(self.means.add(files.planes(frames)), frames[0])
            # Each level's own mean is taken off, so that exposures of any length average to one pattern.
            dark.append(level)
            self.dark_mean = self.dark_mean + (mean - level.mean_dn) / len(files.dark)
        self.noise = noise = self.means.noise(dark)
        # In a mosaic, neighbours of one colour are two columns apart.
        self.parity = self.means.parity_noise(noise) if files.site is None else Uncertain(0.0, 0.0)
        self.drift, variance = self.means.drift(dark, noise)
        self.offset = patterns.dark_lines(self.means.halves)
        self.sampled_dn2 = self.offset.of_mean(self.means.shape)
        # frames also differ by the mean of their rows and columns
        self._mean_dn2 = variance if self.drift.value else noise.of_mean(self.means.shape)
        dark = [self._wandering(level) for level in dark]
        height, width = self.means.shape
        self._lines_dn2 = math.hypot(
            noise.row.value * math.sqrt(2 / height), noise.column.value * math.sqrt(2 / width)
        )
        self.dark = [self._widened(level) for level in dark]
        self.line = transfer.dark_line(self.dark)
        self.flat_lines = FrameMeans()
        self.flat = [self.read_flat(index, self.flat_lines)[0] for index in range(len(files.flat))]

    @property
    def levels(self) -> list[Level]:
        """All levels."""
        return [*self.dark, *self.flat]

    def read_flat(self, index: int, means: FrameMeans | None = None) -> tuple[Level, Floats]:
        """Read a flat level and its mean frame; ``means`` adds its frames."""
        frames = self.files.flat[index]
        planes = self.files.planes(frames)
        dark_dn = self.line.at(frames[0].exposure_s)
        level, mean = level_of(means.add(planes) if means else planes, frames[0], dark_dn)
        return self._wandering(self._widened(level)), mean

    def _wandering(self, level: Level) -> Level:
        """The level, with the uncertainty of its mean by what whole frames of dark levels differ."""
        error = math.hypot(level.mean_error_dn, math.sqrt(self._mean_dn2 / level.frames))
        return replace(level, mean_error_dn=error)

    def _widened(self, level: Level) -> Level:
        """The level, with the uncertainty of a variance from n rows and columns."""
        error = math.hypot(level.variance_error_dn2, self._lines_dn2 / math.sqrt(level.frames - 1))
        return replace(level, variance_error_dn2=error)

    def pixel_share(self, fit: Transfer) -> Uncertain:
        """Share of the variance in the dark that belongs to pixels, not to whole rows or columns."""
        lines_dn2, dark_dn2 = fit.before_rounding(self.noise.lines), max(fit.read_dn2, 1e-9)
        if self.parity.value > Z * self.parity.error:
            parity = fit.before_rounding(self.parity)
            lines_dn2 = Uncertain(lines_dn2.value + parity.value, math.hypot(lines_dn2.error, parity.error))
        return Uncertain(max(0.0, 1 - lines_dn2.value / dark_dn2), lines_dn2.error / dark_dn2)

    def row_gain(self, fit: Transfer, used: Sequence[int]) -> tuple[Uncertain, Estimate]:
        """Variance of the row gain, relative, and its length in rows, of the ``used`` flat levels."""
        rows_dn2, width, spectra = max(0.0, self.noise.row.value), self.means.shape[1], []
        for index in used:
            level = self.flat[index]
            floor_dn2 = rows_dn2 + max(0.0, level.variance_dn2 - rows_dn2) / width
            rows = self.flat_lines.lines[index][0]
            spectra.append(row_gain.spectrum_of(rows, fit.dark.at(level.exposure_s), floor_dn2))
        return row_gain.row_gain(spectra)

    def without_row_gain(self, fit: Transfer, used: Sequence[int]) -> list[Level]:
        """The flat levels without the variance of the row gain, which grows with the squared signal."""
        (square, _), rows = self.row_gain(fit, used)
        if not square:
            return self.flat
        added_dn2 = square * self.signal(fit) ** 2
        # of rows that are correlated over a length L, every 2 L count as one
        chance = math.sqrt(2 * max(1.0, 2 * rows.value) / self.means.shape[0])
        return [
            replace(
                level,
                variance_dn2=level.variance_dn2 - added,
                variance_error_dn2=math.hypot(
                    level.variance_error_dn2, chance * added / math.sqrt(level.frames - 1)
                ),
            )
            for level, added in zip(self.flat, added_dn2.tolist(), strict=True)
        ]

    def signal(self, fit: Transfer) -> Floats:
        """Means of the flat levels minus those in the dark."""
        exposure, mean_dn = columns(self.flat, "exposure_s", "mean_dn")
        return mean_dn - fit.dark.at(exposure)


@dataclass(frozen=True)
class _TransferCurve:
    """Photon transfer of one gain; pattern: of the dark frames; tone: the doubt that the frames have a tone curve."""

    fit: Transfer
    pattern: DarkPattern
    clip_dn: float | None
    used: Sequence[int]
    bend: Bend | None
    tone: Doubt | None


def _fit(frames: _GainFrames, full_scale_dn: float) -> _TransferCurve:
    """Fit the straight part of the curve. Raises ``ValueError`` for levels that cannot be used."""
    dark, flat = frames.dark, frames.flat
    dim = checks.too_dim(dark, flat)
    checks.check_levels(dark, [level for index, level in enumerate(flat) if index not in dim])
    few = f"frames: {len(dim)} of {len(flat)} flat levels are too dim; {FEWEST_FLAT} brighter ones are needed"
    refuse(len(flat) - len(dim) < FEWEST_FLAT, few)
    clip_dn, used = checks.clipping(flat, frames.line.offset, full_scale_dn, dim)
    checks.check_noise([flat[index] for index in used])
    pattern = patterns.dark_pattern(frames.means.halves)
    fit = transfer.fit(dark, [flat[index] for index in used], pattern)
    flat = frames.without_row_gain(fit, used)
    if flat is not frames.flat:
        fit = transfer.fit(dark, [flat[index] for index in used], pattern)
    tone = doubts.tone_curve(dark, [flat[index] for index in used], fit)
    limit_dn = clip_dn or full_scale_dn
    whole = [level for level in flat if level.mean_dn + _FREE * _noise_dn(level, fit) < limit_dn]
    curve = bend.bend_of(whole, fit, limit_dn - fit.dark.offset, tone=tone is not None)
    tone = None if curve else tone  # a bend explains what looked like a tone curve
    if curve and curve.straight_dn:
        used = [index for index in used if flat[index].mean_dn <= curve.straight_dn]
        fit = transfer.fit(dark, [flat[index] for index in used], pattern)
    return _TransferCurve(fit, pattern, clip_dn, used, curve, tone)


def _noise_dn(level: Level, fit: Transfer) -> float:
    """Noise of a level; where clipping has taken more than half of its variance, that of the line."""
    return math.sqrt(max(level.variance_dn2, fit.at(level.mean_dn) / 2))


def _estimates(frames: _GainFrames, curve: _TransferCurve) -> tuple[dict[str, Estimate], Linearity | None]:
    """The figures that follow from levels and dark frames, without PRNU, and the linearity."""
    fit, flat = curve.fit, frames.flat
    brightest_dn = max(flat[index].mean_dn for index in curve.used)
    top_dn = (curve.clip_dn or brightest_dn) - fit.dark.offset
    signal = frames.signal(fit)
    linear = transfer.linearity(flat, signal, top_dn)
    offset = frames.offset
    lines_dn2 = fit.before_rounding(offset.lines)
    estimates = fit.estimates(frames.sampled_dn2, frames.pixel_share(fit), lines_dn2)
    for name, variance in (
        ("row_noise_e", frames.noise.row),
        ("column_noise_e", frames.noise.column),
        ("parity_noise_e", frames.parity),
        ("dsnu_row_e", offset.row),
        ("dsnu_column_e", offset.column),
    ):
        estimates[name] = fit.rms_e(fit.before_rounding(variance))
    square, rows = frames.row_gain(fit, curve.used)
    estimates |= {"row_gain_noise": square.term()} | ({"row_gain_rows": rows} if square.value else {})
    if curve.clip_dn is not None:
        estimates["full_well_e"] = fit.electrons(Uncertain(top_dn, fit.dark.offset_error))
    if linear:
        others = [index for index in range(len(flat)) if index != linear.worst]
        rest = transfer.linearity([flat[index] for index in others], signal[others], top_dn)
        lower = transfer.linearity(flat, signal, checks.USED * top_dn)
        if linear.error.value > checks.MOST_LINEARITY_ERROR and lower and lower.sagging(linear):
            linear = replace(lower, sags=True)
        checks.check_linearity(flat, linear, rest)
        estimates["linearity_error"] = linear.error
        if linear.light == "photons":
            estimates["quantum_efficiency"] = fit.electrons(linear.responsivity)
    return estimates, linear


def _stray_light(frames: _GainFrames, chosen: Sequence[int], light: Floats, fit: Transfer) -> Doubt | None:
    """The doubt that light reached the dark frames. light (H, W): mean of the ``chosen`` flat levels."""
    whole = frames.files.whole()  # all sites of a mosaic, whose filters show light
    if frames.files.site is not None:
        light = np.mean([np.mean([*whole.planes(whole.flat[index])], axis=0) for index in chosen], axis=0)
    return doubts.stray_light(whole, frames.dark, [frames.flat[index] for index in chosen], light, fit)


def _sag(flat: Sequence[Level], linear: Linearity | None) -> list[str]:
    """A note where the signal sags below the line of light before saturation."""
    if linear is None or not linear.sags:
        return []
    first = next(i for i, off in enumerate(linear.deviation) if off < -checks.MOST_LINEARITY_ERROR)
    text = f"the signal sags before saturation: that of {flat[first]} is {linear.deviation[first]:.1%} off the line"
    return [f"{text} of the darker levels; the camera's light is linear until it clips"]


def _notes(fit: Transfer, files: Folder) -> list[str]:
    """Assumptions, and what else the user should know."""
    bounds = "; these, black level and dark current are bounds only"
    bounds = bounds if fit.noise_dn < TWO_NUMBERS_DN else ""
    dark = f"the noise in the dark, {fit.noise_dn:.2g} DN, is smaller than the rounding"
    hidden = "the camera subtracts the dark signal; the dark current is measured from the variance"
    measured_dn = fit.dark.offset * files.scale.step
    header_dn = measured_dn if files.black_dn is None else files.black_dn
    other = abs(measured_dn - header_dn) > max(2.0, 0.05 * header_dn)
    blacks = (
        f"the dark frames have a black level of {measured_dn:.4g} DN, but the files state {header_dn:g} DN"
    )
    notes = (
        (other, f"{blacks}; are the numbers still those of the sensor?"),
        (files.scale.text, f"{files.scale.text}; the converter's own counts are measured"),
        (fit.rounding, f"{dark}; read noise and DSNU assume normal noise{bounds}"),
        (fit.hidden_dn2_s.value > 0, hidden),
        (fit.widened, "the variances scatter more than expected about the line; the intervals are widened"),
    )
    return [text for applies, text in notes if applies]
