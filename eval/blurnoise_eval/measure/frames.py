"""MeasureComparison of real frames with simulated frames of the same light, at levels that the fit did not use.

Only the sensor is simulated (:func:`blurnoise.sensor.readout.read_out`): its light has the smooth shading of the real
mean frame, and the mean that a straight line through the other levels predicts.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from blurnoise._core import rng
from blurnoise._core.checks import integer
from blurnoise.camera import Camera
from blurnoise.camera.colour import PLANES
from blurnoise.camera.radiometry import dark_electrons
from blurnoise.metrics.values import Estimate
from blurnoise.sensor.readout import read_out
from blurnoise_eval.calibration import fit, standard, to_camera
from blurnoise_eval.calibration.checks import CLIPPED, USED
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.formats import RawLayout
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Folder
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.levels import level_of
from blurnoise_eval.calibration.listing import FrameFile
from blurnoise_eval.calibration.rounding import PLAIN_DN2, rounded
from blurnoise_eval.calibration.standard import FAIL, PASS, StandardRow
from blurnoise_eval.calibration.temporal import FrameMeans
from blurnoise_eval.calibration.uncertain import Z
from blurnoise_eval.measure import classifier
from blurnoise_eval.measure.comparison import DIFFERS, SMALL, MeasureComparison, corrected
from blurnoise_eval.measure.statistics import (
    MEAN,
    STATISTICS,
    VARIANCE,
    Floats,
    FrameStack,
    Statistic,
    compare_levels,
    compare_scatter,
)

MOST_PX = 2048  # of larger frames the middle is compared, so many pixels along a side
FEWEST_DARK = 6  # levels, from which on half of them are compared only
FEWEST_FLAT_FITTED = 2 * FEWEST_FLAT - 1  # levels, of which every other one is fitted
HEADLINE = (MEAN, VARIANCE)
"""Statistics that decide whether simulated frames behave like the real ones."""
_WANDER = 4.0  # standard errors of the mean, within which a black level may have wandered
_DIM = 0.05  # of the brightest signal: below it, relative errors of the mean are those of the black level


@dataclass(frozen=True)
class LevelPair:
    """The frames of one level, real and simulated."""

    name: str
    kind: str
    real: FrameStack
    simulated: FrameStack


@dataclass(frozen=True)
class Validation:
    """The comparison of real with simulated frames.

    fitted: the fit to the other levels, None where the camera was given. pairs: the levels that were compared. auc:
    by kind of frames, the classifier's score for real against simulated frames, and for real against real ones.
    standard: figures of all levels as EMVA 1288 defines them, beside the camera's.
    """

    camera: Camera
    fitted: Measurement | None
    standard: Sequence[StandardRow]
    comparisons: Sequence[MeasureComparison]
    auc: dict[str, tuple[Estimate, Estimate]]
    pairs: Sequence[LevelPair]
    notes: Sequence[str]

    def of(self, kind: str, measure: str | None = None) -> list[MeasureComparison]:
        """The comparisons of dark or flat frames, of all measures or one, level by level."""
        return [
            comparison
            for comparison in self.comparisons
            if comparison.kind == kind and measure in (None, comparison.measure.name)
        ]

    def largest(self, measure: str) -> float:
        """Largest difference of a measure at flat levels that are not dim, or NaN."""
        levels = [level for level in self.of("flat", measure) if level.level not in self._dim]
        differences = [level.difference.value for level in levels if level.difference.available]
        return max(differences, key=abs, default=math.nan)

    @property
    def of_standard(self) -> str:
        """How many figures of the standard pass, and which fail."""
        passed, failed = (
            [row for row in self.standard if row.verdict == verdict] for verdict in (PASS, FAIL)
        )
        names = f": {', '.join(row.title for row in failed)}" if failed else ""
        return f"Of the figures of EMVA 1288, {len(passed)} pass and {len(failed)} fail{names}."

    @property
    def _dim(self) -> set[str]:
        """Flat levels whose relative errors say little about the camera."""
        flat = [pair for pair in self.pairs if pair.kind == "flat"]
        signal = {pair.name: pair.real.mean_dn - self.camera.sensor.black_level_dn for pair in flat}
        brightest = max(signal.values(), default=0.0)
        return {name for name, level in signal.items() if level < _DIM * brightest}

    @property
    def answer(self) -> str:
        """The first sentences: largest differences, significant differences, and the result of the classifier."""
        decisive = [level for level in self.comparisons if level.measure in HEADLINE]
        verb = "differ from" if any(level.verdict == DIFFERS for level in decisive) else "behave like"
        largest = {measure.name: self.largest(measure.name) for measure in HEADLINE}
        within = [f"{name} within {100 * abs(x):.2g} %" for name, x in largest.items() if math.isfinite(x)]
        dim = len(self._dim)
        count = len(self.of("flat", VARIANCE.name)) - dim
        levels = f"{count} {'levels' if self.fitted is None else 'held-out levels'}"
        levels += f" (and {dim} dim ones)" if dim else ""
        text = f"Simulated frames {verb} the real frames: {', '.join(within)} at {levels}. "
        significant = "; ".join(filter(None, map(self._differing, ("flat", "dark"))))
        text += f"Significant differences: {significant}." if significant else ""
        small = sum(level.verdict == SMALL for level in self.comparisons)
        if small:
            which = "Other differences" if significant else "Differences"
            text += f" {which} of the variance are below {100 * VARIANCE.tolerance:g} % ({small} levels)."
        elif not significant:
            text += "There are no significant differences."
        scores = [
            f"{separation.value:.2f} on {kind} frames ({floor.value:.2f} for real frames among themselves)"
            for kind, (separation, floor) in self.auc.items()
            if separation.available
        ]
        if scores:
            text += f" A classifier separates them with AUC {' and '.join(scores)}; 0.5 means not at all."
        return text

    def _differing(self, kind: str) -> str:
        """Measures that differ, and at how many levels; the octaves of spectra count together."""
        verdicts: dict[str, list[bool]] = {}
        for comparison in self.of(kind):
            measure = comparison.measure
            octave = isinstance(measure, Statistic) and measure.octave
            name = "octaves of spectra" if octave else measure.title.split(", DN")[0]
            verdicts.setdefault(name, []).append(comparison.verdict == DIFFERS)
        counts = [f"{name} ({sum(of)} of {len(of)})" for name, of in verdicts.items() if any(of)]
        return f"on {kind} frames {', '.join(counts)}" if counts else ""


def validate(
    folder: Path, camera: Camera | None = None, *, base: str = "imx250", layout: RawLayout | None = None,
    cfa: str | None = None, leave_out: Sequence[str] = (), seed: int = 0,
) -> Validation:  # fmt: skip
    """Compare the frames of ``folder`` with simulated ones; without a camera, one is fitted to every other level.

    Compared are the levels of the lowest gain; of a mosaic the green pixels, as :func:`.fit.measure` takes them.
    Raises ``ValueError`` for frames that cannot be used, as that does.
    """
    seed = integer("seed", seed, 0, rng.LAST_SEED)
    every = Folder(folder, layout, cfa, leave_out)
    lowest_db, notes = every.gains_db[0], [note for note in every.notes if note.endswith("left out")]
    files, fitted = every.at_gain(lowest_db), None
    if len(every.gains_db) > 1:
        notes.append(f"the frames have several gains; those at {lowest_db:g} dB are compared")
    levels, lit = [*files.dark, *files.flat], files.flat
    if camera is None:
        half, levels, note = _split(files)
        notes += note
        fitted = fit.measure(half)
        camera = to_camera.camera_of(fitted, "fitted on every other level", base=base)
        lit = half.flat
    else:
        unlike = (
            f"camera = {camera.name}: has the colour filters {camera.sensor.cfa}, but the frames have none"
        )
        mono = files.site is None and camera.sensor.cfa not in PLANES
        refuse(mono, f"{unlike}; use another camera, or set --cfa")
        camera = _at_gain(camera, lowest_db)
    light = _LightLine(camera, [(frames[0], _frames(files, frames)) for frames in lit])
    if not light.fitted:
        notes.append("the light is taken from the mean of each level, so the means are not compared")
    uncertainty = _Uncertainty(camera, light, fitted, _dark_scatter(files))
    pairs, comparisons = list[LevelPair](), list[MeasureComparison]()
    measured = [] if fitted is None else [*fitted.dark, *fitted.flat]
    means = {"dark": FrameMeans(), "flat": FrameMeans()}
    stacks: dict[str, list[FrameStack]] = {
        "dark": [],
        "flat": [],
    }  # simulated with the camera's own black level
    # fixed patterns are those of levels that the standard uses for K, not of wells that are nearly full
    brightest_dn = camera.sensor.black_level_dn + USED * (
        camera.sensor.clip_dn - camera.sensor.black_level_dn
    )
    for level in levels:
        first, planes = level[0], _frames(files, level)
        whole = planes.astype(np.uint16)
        measured.append(level_of(whole, first, camera.sensor.black_level_dn)[0])
        name = f"{first.kind} {first.exposure_s * 1e3:g} ms"
        if (planes >= camera.sensor.clip_dn).mean() > CLIPPED:
            notes.append(f"{name}: is clipped and not compared")
            continue
        if first.kind == "dark" or planes.mean() <= brightest_dn or not means["flat"].lines:
            deque(means[first.kind].add(whole), maxlen=0)
        real = FrameStack(planes)
        simulated = FrameStack(_simulated(camera, first, real, light, seed))
        errors = uncertainty.of(simulated, first.kind)
        of_level = compare_levels(real, simulated, errors, kind=first.kind, level=name)
        stacks[first.kind].append(simulated)
        if blacks_dn := _blacks_dn(camera, first, real, errors["mean"], light.electrons(first, real.mean_dn)):
            # only the mean, and how it scatters, are compared with those of the camera's own black level
            simulated = FrameStack(_simulated(camera, first, real, light, seed, blacks_dn))
            of_level[1:] = compare_levels(real, simulated, errors, kind=first.kind, level=name)[1:]
        pairs.append(LevelPair(name, first.kind, real, simulated))
        # without a line of light, the simulated mean is the real one by construction
        comparisons += of_level if light.fitted or first.kind == "dark" else of_level[1:]
    by_kind = {kind: [pair for pair in pairs if pair.kind == kind] for kind in ("dark", "flat")}
    refuse(not by_kind["flat"], "frames: all flat levels are clipped; one or more must be below saturation")
    if unlit := by_kind["dark"]:
        comparisons.append(compare_scatter([pair.real for pair in unlit], stacks["dark"], "dark"))
    auc = {kind: _separation(of_kind, seed) for kind, of_kind in by_kind.items() if of_kind}
    dark, flat = ([level for level in measured if level.taken.kind == kind] for kind in ("dark", "flat"))
    found = standard.figures_of_frames(dark, flat, means["dark"].halves, means["flat"].halves)
    return Validation(camera, fitted, standard.rows(found, camera), corrected(comparisons), auc, pairs, notes)


def _split(files: Folder) -> tuple[Folder, list[list[FrameFile]], list[str]]:
    """The half of the levels to fit, the levels to compare, and notes."""
    few = f"frames: {len(files.flat)} flat levels; must be {FEWEST_FLAT_FITTED} or more without --camera"
    refuse(len(files.flat) < FEWEST_FLAT_FITTED, f"{few}, as a camera is fitted on every other one")
    half, dark = copy(files), files.dark
    half.flat = files.flat[::2]
    if len(dark) < FEWEST_DARK:
        return half, [*dark, *files.flat[1::2]], ["the dark levels were also used for the fit"]
    half.dark = dark[::2]
    return half, [*dark[1::2], *files.flat[1::2]], []


def _separation(pairs: Sequence[LevelPair], seed: int) -> tuple[Estimate, Estimate]:
    """The classifier's score for real against simulated frames, and for real against real ones."""
    real = [pair.real.frames for pair in pairs]
    simulated = [pair.simulated.frames for pair in pairs]
    return classifier.separation(real, simulated, seed), classifier.separation_of_halves(real, seed)


def _at_gain(camera: Camera, lowest_db: float) -> Camera:
    """The camera at the gain of the frames, which counts from the lowest gain that the camera was measured at."""
    zero_db = to_camera.lowest_gain_db(camera)
    highest_db = zero_db + camera.sensor.analogue_gain_max_db
    refuse(
        not zero_db <= lowest_db <= highest_db,
        f"frames: gain_db = {lowest_db:g}; must be {zero_db:g} to {highest_db:g} for the camera {camera.name}",
    )
    return camera.at_gain(lowest_db - zero_db).camera


def _frames(files: Folder, frames: Sequence[FrameFile]) -> Floats:
    """The frames of a level (N, H, W), of large ones the middle."""
    planes = np.stack([*files.planes(frames)]).astype(np.float64)
    top, left = (
        max(0, side - MOST_PX) // 4 * 2 for side in planes.shape[1:]
    )  # even, to keep a mosaic's sites
    return planes[:, top : top + MOST_PX, left : left + MOST_PX]


def _dark_scatter(files: Folder) -> float:
    """Standard deviation of the means of dark frames within their levels, DN."""
    means = [[float(plane.mean()) for plane in files.planes(frames)] for frames in files.dark]
    freedom = sum(len(level) - 1 for level in means)
    return math.sqrt(sum(float(np.var(level)) * len(level) for level in means) / freedom)


class _LightLine:
    """Mean electrons as a straight line over photons per pixel, or over exposure time. All levels weigh the same.

    scatter: relative standard deviation of the levels about the line.
    """

    def __init__(self, camera: Camera, levels: Sequence[tuple[FrameFile, Floats]]) -> None:
        self._camera = camera
        self._photons = all(frame.photons_per_px is not None for frame, _ in levels)
        known = [
            (self._x(frame), self._measured(frame, float(planes.mean())))
            for frame, planes in levels
            if (planes >= camera.sensor.clip_dn).mean() <= CLIPPED
        ]
        x, electrons = np.array(known).T if known else np.empty((2, 0))
        used = electrons > 0
        self.fitted = len(np.unique(x[used])) >= 3
        self.scatter = 0.0
        if self.fitted:
            x, electrons = x[used], electrons[used]
            self._slope, self._offset = np.polyfit(x, electrons, 1, w=1 / electrons)
            off = electrons / (self._slope * x + self._offset) - 1
            self.scatter = math.sqrt(float((off * off).sum()) / (len(x) - 2))

    def electrons(self, frame: FrameFile, mean_dn: float) -> float:
        """Mean photo-electrons of a level, by the line, or without a line by their own mean."""
        if frame.kind == "dark":
            return 0.0
        line = self._slope * self._x(frame) + self._offset if self.fitted else self._measured(frame, mean_dn)
        return max(0.0, float(line))

    def _x(self, frame: FrameFile) -> float:
        return float(frame.photons_per_px or 0.0) if self._photons else frame.exposure_s

    def _measured(self, frame: FrameFile, mean_dn: float) -> float:
        """Electrons of a mean, without black level and dark charge."""
        camera = self._camera
        charge = (mean_dn - camera.sensor.black_level_dn) / camera.sensor.system_gain_dn_per_e
        return charge - dark_electrons(camera, frame.exposure_s, camera.sensor.dark_reference_c)


def _blacks_dn(
    camera: Camera, frame: FrameFile, real: FrameStack, mean_error: float, electrons: float
) -> list[float] | None:
    """The black level of each dark or dim frame, where rounding makes the noise depend on it.

    None where rounding adds the same to any noise, and where the camera's black level is wrong beyond chance:
    mean_error is the relative standard error of the mean. electrons: of the light.
    """
    sensor = camera.sensor
    charge_e = electrons + dark_electrons(camera, frame.exposure_s, sensor.dark_reference_c)
    variance = np.array([sensor.dark_variance_dn2(charge_e) - 1 / 12])
    if variance[0] > PLAIN_DN2:
        return None
    spread_dn, dark_dn = (sensor.system_gain_dn_per_e * each for each in (sensor.dsnu_total_e, charge_e))
    spread_dn = math.hypot(spread_dn, float(real.surface.std()))
    # where the mean after rounding is that of a frame; it rises with the black level
    blacks = sensor.black_level_dn + np.linspace(-1.0, 1.0, 401)
    means = rounded(blacks + dark_dn, np.repeat(variance, len(blacks)), spread_dn)[0]
    own_dn = float(np.interp(sensor.black_level_dn, blacks, means))
    if abs(own_dn - real.mean_dn) > _WANDER * mean_error * real.mean_dn:
        return None
    return [max(0.0, float(black)) for black in np.interp(real.frame_means, means, blacks)]


def _simulated(
    camera: Camera,
    frame: FrameFile,
    real: FrameStack,
    light: _LightLine,
    seed: int,
    blacks_dn: Sequence[float] = (),
) -> Floats:
    """As many frames as there are real ones. blacks_dn: of each, in place of the camera's and its drift."""
    electrons = light.electrons(frame, real.mean_dn)
    shading = np.ones_like(real.mean)
    if electrons:
        charge = dark_electrons(camera, frame.exposure_s, camera.sensor.dark_reference_c)
        dark_dn = camera.sensor.black_level_dn + camera.sensor.system_gain_dn_per_e * charge
        shading = np.maximum(real.surface - dark_dn, 0.0)
        shading = shading / shading.mean()
    scene = torch.from_numpy(electrons * shading).float().expand(len(real.frame_means), 1, -1, -1)
    stream = rng.derived(seed, f"validate {frame.kind} {frame.exposure_s} {electrons}")
    seeds = rng.item_seeds(torch.Generator().manual_seed(stream), len(scene))
    whole = camera.with_figures(black_level_drift_dn=0.0) if blacks_dn else camera
    parts = [
        (scene[number : number + 1], whole.with_figures(black_level_dn=black_dn), seeds[number : number + 1])
        for number, black_dn in enumerate(blacks_dn)
    ] or [(scene, camera, seeds)]
    dn = [
        read_out(
            some,
            of_frames,
            exposure_s=frame.exposure_s,
            temperature_c=camera.sensor.dark_reference_c,
            fixed_pattern=camera.sensor.fixed_pattern((1, *real.mean.shape), seed),
            generator=own,
            fidelity="full",
        )
        for some, of_frames, own in parts
    ]
    return torch.cat(dn)[:, 0].numpy().astype(np.float64)


@dataclass(frozen=True)
class _Uncertainty:
    """Standard errors of what a camera predicts: of its fit, the lamp, a drifting black level, and of few rows and
    columns.

    Each row (column) has one fixed value, and in each frame one value of noise. So mean and variance of a picture are
    as uncertain as those of H (W) values, whatever the number of pixels. dark_scatter_dn: standard deviation of the
    means of dark frames within their levels.
    """

    camera: Camera
    light: _LightLine
    fitted: Measurement | None
    dark_scatter_dn: float

    def of(self, simulated: FrameStack, kind: str) -> dict[str, float]:
        """Standard errors at a level, on the scales of the differences, by the name of the statistic."""
        gain, mean_dn = self.camera.sensor.system_gain_dn_per_e, max(simulated.mean_dn, 1e-9)
        signal = max(0.0, mean_dn - self.camera.sensor.black_level_dn)
        variance = float((simulated.noise**2).mean())
        errors = {"mean": self._of_mean(simulated, signal, mean_dn, kind)}
        if variance:
            relative = gain * gain / variance
            rows, columns = (self._of_lines(name, simulated) * relative for name in ("row", "column"))
            errors |= {"variance": math.hypot(rows, columns), "correlation_x": rows, "correlation_y": columns}
        if self.fitted is not None and variance:
            line = self.fitted.fit.error(signal, 1.0) / variance
            errors["variance"] = math.hypot(errors["variance"], line)
            octaves = [measure.name for measure in STATISTICS if measure.octave]
            errors |= {name: line for name in octaves if name.startswith("noise")}
        return errors

    def _of_mean(self, simulated: FrameStack, signal: float, mean_dn: float, kind: str) -> float:
        """Relative standard error of the mean."""
        sensor, (height, width) = self.camera.sensor, simulated.mean.shape
        drift = math.hypot(self.dark_scatter_dn, sensor.black_level_drift_dn)
        drift /= math.sqrt(len(simulated.frame_means))
        gain = sensor.system_gain_dn_per_e
        rows = math.hypot(gain * sensor.dsnu_row_e, signal * sensor.prnu_row) / math.sqrt(height)
        columns = math.hypot(gain * sensor.dsnu_column_e, signal * sensor.prnu_column) / math.sqrt(width)
        pattern = math.sqrt(2) * math.hypot(rows, columns)  # of the real and of the simulated frames
        black_dn = 0.0
        if self.fitted is not None:
            black = self.fitted.estimates["black_level_dn"]
            black_dn = (black.high - black.low) / 2 / Z
        lamp = self.light.scatter if kind == "flat" else 0.0
        return math.hypot(drift / mean_dn, pattern / mean_dn, black_dn / mean_dn, lamp)

    def _of_lines(self, lines: str, simulated: FrameStack) -> float:
        """Standard error of the variance of row (column) noise, electrons squared, and of its fit."""
        name, count = f"{lines}_noise_e", simulated.mean.shape[lines == "column"]
        pairs = len(simulated.frame_means) // 2
        noise_e = float(self.camera.figure(name))
        sampled = math.sqrt(2) * math.sqrt(2 / (pairs * count)) * noise_e**2
        if self.fitted is None or name not in self.fitted.estimates:
            return sampled
        figure = self.fitted.estimates[name]
        return math.hypot(sampled, (figure.high**2 - figure.low**2) / 2 / Z)
