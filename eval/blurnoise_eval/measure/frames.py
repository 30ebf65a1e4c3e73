"""Comparison of real frames with simulated frames at the same light, at levels that the fit did not use.

Simulated is the sensor alone (:func:`blurnoise.sensor.readout.read_out`): its light has the smooth shading of the
real mean frame, and the mean that a straight line through the other levels predicts.
"""

from __future__ import annotations

import math
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
from blurnoise_eval.calibration import fit, to_camera
from blurnoise_eval.calibration.checks import CLIPPED
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.formats import RawLayout, refuse
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Folder
from blurnoise_eval.calibration.listing import Frame
from blurnoise_eval.calibration.structure import Z
from blurnoise_eval.measure import classifier
from blurnoise_eval.measure.comparison import (
    DIFFERS,
    MEASURES,
    Comparison,
    Floats,
    Stack,
    compare,
    compare_scatter,
    corrected,
)

MOST_PX = 2048  # along a side: of larger frames their middle
FEWEST_DARK = 6  # levels, from which on half of them are held out, too
FEWEST_FLAT_FITTED = 2 * FEWEST_FLAT - 1  # levels, of which every other one is fitted
HEADLINE = ("mean", "variance")
"""Measures by which simulated frames behave like the real ones, or differ."""
_DIM = 0.05  # of the brightest level's signal, below which errors relative to the mean are those of the black level


@dataclass(frozen=True)
class Pair:
    """The frames of one level, real and simulated, (N, H, W), DN."""

    name: str
    kind: str
    real: Floats
    simulated: Floats


@dataclass(frozen=True)
class Validation:
    """What was compared with what. apart: by kind the AUC of real against simulated, and of real against real.

    fitted: of the camera that was fitted on the other levels, None where it was given. pairs: of the darkest and of
    some flat levels, to look at.
    """

    camera: Camera
    fitted: Measurement | None
    comparisons: Sequence[Comparison]
    apart: dict[str, tuple[Estimate, Estimate]]
    pairs: Sequence[Pair]
    notes: Sequence[str]

    def of(self, measure: str, kind: str) -> list[Comparison]:
        """The comparisons of a measure, level by level."""
        return [each for each in self.comparisons if (each.measure.name, each.kind) == (measure, kind)]

    def largest(self, measure: str, kind: str = "flat") -> float:
        """Largest difference of a measure, as it is, or NaN; of flat levels, of those that are not dim."""
        levels = self.of(measure, kind)
        if kind == "flat":
            levels = [each for each in levels if each.level not in self._dim]
        apart = [each.difference for each in levels if math.isfinite(each.difference)]
        return max(apart, key=abs, default=math.nan)

    @property
    def _dim(self) -> set[str]:
        """Flat levels, of which errors say little about the camera."""
        signal = {
            pair.name: float(pair.real.mean()) - self.camera.sensor.black_level_dn
            for pair in self.pairs
            if pair.kind == "flat"
        }
        brightest = max(signal.values(), default=0.0)
        return {name for name, each in signal.items() if each < _DIM * brightest}

    @property
    def answer(self) -> str:
        """The first sentences: largest differences, significant differences, and the result of the classifier."""
        differ = any(each.verdict == DIFFERS for each in self.comparisons if each.measure.name in HEADLINE)
        verb = "differ from" if differ else "behave like"
        held = "levels" if self.fitted is None else "held-out levels"
        dim = len(self._dim)
        count = len(self.of("variance", "flat")) - dim
        close = [
            f"{name} within {100 * abs(largest):.2g} %"
            for name in HEADLINE
            if math.isfinite(largest := self.largest(name))
        ]
        near = f"{', '.join(close)} at {count} {held}" + (f" (and {dim} dim ones)" if dim else "")
        rest = [self._differing(kind) for kind in ("flat", "dark")]
        rest = [text for text in rest if text]
        beyond = (
            f"Significant differences: {'; '.join(rest)}" if rest else "There are no significant differences"
        )
        scores = [
            f"{separation.value:.2f} on {kind} frames ({floor.value:.2f} for real frames among themselves)"
            for kind, (separation, floor) in self.apart.items()
            if separation.available
        ]
        classifier = (
            f" A classifier separates them with AUC {' and '.join(scores)}; 0.5 means not at all."
            if scores
            else ""
        )
        return f"Simulated frames {verb} the real frames: {near}. {beyond}.{classifier}"

    def _differing(self, kind: str) -> str:
        """What differs, and at how many levels; the octaves of spectra together."""
        by_name: dict[str, list[Comparison]] = {}
        for each in self.comparisons:
            name = "octaves of spectra" if each.measure.octave else each.measure.title.split(", DN")[0]
            by_name.setdefault(name, []).extend([each] * (each.kind == kind))
        counts = []
        for name, of in by_name.items():
            differing = sum(each.verdict == DIFFERS for each in of)
            counts += [f"{name} ({differing} of {len(of)})"] * (differing > 0)
        return f"on {kind} frames {', '.join(counts)}" if counts else ""


def validate(
    folder: Path, camera: Camera | None = None, *, base: str = "imx250", layout: RawLayout | None = None,
    cfa: str | None = None, seed: int = 0,
) -> Validation:  # fmt: skip
    """Compare the frames of ``folder`` with simulated ones; without a camera one is fitted on every other level.

    Compared are levels of the lowest gain; of a mosaic its green pixels, as :func:`.fit.measure` takes them. Raises
    ``ValueError`` for frames that cannot be used, as that does.
    """
    seed = integer("seed", seed, 0, rng.LAST_SEED)
    every = Folder(folder, layout, cfa)
    lowest_db, notes = every.gains_db[0], list[str]()
    files, fitted = every.at_gain(lowest_db), None
    if len(every.gains_db) > 1:
        notes.append(f"the frames have several gains; those at {lowest_db:g} dB are compared")
    dark, flat = files.dark, files.flat
    lit = flat
    if camera is None:
        few = f"frames: {len(flat)} flat levels; must be {FEWEST_FLAT_FITTED} or more without --camera"
        refuse(len(flat) < FEWEST_FLAT_FITTED, f"{few}, as a camera is fitted on every other one")
        half = copy(files)
        half.flat, flat = flat[::2], flat[1::2]
        if len(dark) >= FEWEST_DARK:
            half.dark, dark = dark[::2], dark[1::2]
        else:
            notes.append("the dark levels were also used for the fit")
        fitted = fit.measure(half)
        camera = to_camera.camera_of(fitted, "fitted on every other level", base=base)
        lit = half.flat
    else:
        unlike = (
            f"camera = {camera.name}: has the colour filters {camera.sensor.cfa}, but the frames have none"
        )
        refuse(
            files.place is None and camera.sensor.cfa not in PLANES,
            f"{unlike}; use another camera, or set --cfa",
        )
        camera = _at_gain(camera, lowest_db)
    light = _Light(camera, [(frames[0], _frames(files, frames)) for frames in lit])
    if not light.fitted:
        notes.append("the light is taken from the mean of each level, so the means are not compared")
    pairs, found = [], list[Comparison]()
    stacks: dict[str, list[tuple[Stack, Stack]]] = {"dark": [], "flat": []}
    means = [[float(plane.mean()) for plane in files.planes(frames)] for frames in files.dark]
    freedom = sum(len(level) - 1 for level in means)
    wandering = math.sqrt(sum(float(np.var(level)) * len(level) for level in means) / freedom)
    for frames in (*dark, *flat):
        first, planes = frames[0], _frames(files, frames)
        name = f"{first.kind} {first.exposure_s * 1e3:g} ms"
        if (planes >= camera.sensor.clip_dn).mean() > CLIPPED:
            notes.append(f"{name}: is clipped and not compared")
            continue
        real = Stack(planes)
        taken = _simulated(camera, first, real, light, seed)
        simulated = Stack(taken)
        pairs.append(Pair(name, first.kind, planes, taken))
        stacks[first.kind].append((real, simulated))
        errors = _errors(camera, first, simulated, light, fitted, wandering)
        level = compare(name, first.kind, real, simulated, errors)
        found += level if light.fitted or first.kind == "dark" else level[1:]
    refuse(not stacks["flat"], "frames: all flat levels are clipped; one or more must be below saturation")
    if stacks["dark"]:
        found.append(compare_scatter("dark", *zip(*stacks["dark"], strict=True)))
    apart = {}
    for kind in stacks:
        both = [(pair.real, pair.simulated) for pair in pairs if pair.kind == kind]
        if both:
            real_frames, simulated_frames = zip(*both, strict=True)
            tell = classifier.told_apart(real_frames, simulated_frames, seed)
            apart[kind] = (tell, classifier.real_apart(real_frames, seed))
    return Validation(camera, fitted, corrected(found), apart, pairs, notes)


def _at_gain(camera: Camera, lowest_db: float) -> Camera:
    """The camera at the gain of the frames. Its own gains count from the lowest that it was measured at."""
    zero_db = to_camera.lowest_gain_db(camera)
    highest_db = zero_db + camera.sensor.analogue_gain_max_db
    refuse(
        not zero_db <= lowest_db <= highest_db,
        f"frames: gain_db = {lowest_db:g}; must be {zero_db:g} to {highest_db:g} for the camera {camera.name}",
    )
    return camera.at_gain(lowest_db - zero_db).camera


def _frames(files: Folder, frames: Sequence[Frame]) -> Floats:
    """The frames of a level, or their middle; (N, H, W)."""
    planes = np.stack([*files.planes(frames)]).astype(np.float64)
    top, left = (max(0, side - MOST_PX) // 4 * 2 for side in planes.shape[1:])  # even: a mosaic stays
    return planes[:, top : top + MOST_PX, left : left + MOST_PX]


class _Light:
    """Mean electrons over photons per pixel, or exposure, as a straight line through levels; each counts equally."""

    def __init__(self, camera: Camera, levels: Sequence[tuple[Frame, Floats]]) -> None:
        self._camera = camera
        self._photons = all(frame.photons_per_px is not None for frame, _ in levels)
        known = [
            (self._x(frame), self.seen(frame, float(planes.mean())))
            for frame, planes in levels
            if (planes >= camera.sensor.clip_dn).mean() <= CLIPPED
        ]
        x, seen = np.array(known).T if known else np.empty((2, 0))
        used = seen > 0
        self.fitted = len(np.unique(x[used])) >= 3
        self.scatter = 0.0
        if self.fitted:
            x, seen = x[used], seen[used]
            self._slope, self._offset = np.polyfit(x, seen, 1, w=1 / seen)
            freedom = len(x) - 2
            off = seen / (self._slope * x + self._offset) - 1
            self.scatter = math.sqrt(float((off * off).sum()) / freedom)

    def _x(self, frame: Frame) -> float:
        return float(frame.photons_per_px or 0.0) if self._photons else frame.exposure_s

    def seen(self, frame: Frame, mean_dn: float) -> float:
        """Electrons of the light behind a mean, dark charge removed."""
        camera = self._camera
        charge = (mean_dn - camera.sensor.black_level_dn) / camera.sensor.system_gain_dn_per_e
        return charge - dark_electrons(camera, frame.exposure_s, camera.sensor.dark_reference_c)

    def electrons(self, frame: Frame, mean_dn: float) -> float:
        """Mean electrons of a level."""
        if frame.kind == "dark":
            return 0.0
        line = self._slope * self._x(frame) + self._offset if self.fitted else self.seen(frame, mean_dn)
        return max(0.0, float(line))


def _simulated(camera: Camera, frame: Frame, real: Stack, light: _Light, seed: int) -> Floats:
    """As many frames as there are real ones."""
    electrons = light.electrons(frame, real.mean_dn)
    shading = np.ones_like(real.mean)
    if electrons:
        dark = camera.sensor.black_level_dn + camera.sensor.system_gain_dn_per_e * dark_electrons(
            camera, frame.exposure_s, camera.sensor.dark_reference_c
        )
        shading = np.maximum(real.surface - dark, 0.0)
        shading = shading / shading.mean()
    scene = torch.from_numpy(electrons * shading).float().expand(len(real.frame_means), 1, -1, -1)
    stream = rng.derived(seed, f"validate {frame.kind} {frame.exposure_s} {electrons}")
    dn = read_out(
        scene,
        camera,
        exposure_s=frame.exposure_s,
        temperature_c=camera.sensor.dark_reference_c,
        fixed_pattern=camera.sensor.fixed_pattern((1, *real.mean.shape), seed),
        generator=torch.Generator().manual_seed(stream),
        fidelity="full",
    )
    return dn[:, 0].numpy().astype(np.float64)


def _errors(
    camera: Camera,
    frame: Frame,
    simulated: Stack,
    light: _Light,
    fitted: Measurement | None,
    wandering_dn: float,
) -> dict[str, float]:
    """Standard errors of what a camera predicts: of its fit, the lamp, a wandering black level, and of so few rows
    and columns.

    Each row (column) has one fixed value, and in each frame one of noise, so the picture's own mean and variance are
    those of H (W) values, whatever the number of pixels. wandering_dn: standard deviation of the real dark frames'
    means within their levels.
    """
    mean_dn, count = max(simulated.mean_dn, 1e-9), len(simulated.frame_means)
    height, width = simulated.mean.shape
    gain = camera.sensor.system_gain_dn_per_e
    signal = max(0.0, mean_dn - camera.sensor.black_level_dn)
    variance = float((simulated.noise**2).mean())
    both = math.sqrt(2)  # the real and the simulated
    wandering = math.hypot(wandering_dn, camera.sensor.black_level_drift_dn) / math.sqrt(count) / mean_dn
    dark_rows, dark_columns = gain * camera.sensor.dsnu_row_e, gain * camera.sensor.dsnu_column_e
    lit_rows, lit_columns = signal * camera.sensor.prnu_row, signal * camera.sensor.prnu_column
    pattern = both * math.hypot(
        math.hypot(dark_rows, lit_rows) / math.sqrt(height),
        math.hypot(dark_columns, lit_columns) / math.sqrt(width),
    )
    errors = {"mean": math.hypot(wandering, pattern / mean_dn, light.scatter * (frame.kind == "flat"))}
    if variance:
        pairs = count // 2
        rows, columns = (
            math.hypot(
                both * math.sqrt(2 / (pairs * lines)) * camera.figure(name) ** 2,
                _square_error(fitted, name),
            )
            * (gain * gain / variance)
            for name, lines in (("row_noise_e", height), ("column_noise_e", width))
        )
        errors |= {"variance": math.hypot(rows, columns), "correlation_x": rows, "correlation_y": columns}
    if fitted is None:
        return errors
    black = fitted.estimates["black_level_dn"]
    own = (black.high - black.low) / 2 / Z / mean_dn
    errors["mean"] = math.hypot(errors["mean"], own)
    if variance:
        line = fitted.fit.error(signal, 1.0) / variance
        errors["variance"] = math.hypot(errors["variance"], line)
        errors |= {each.name: line for each in MEASURES if each.octave and each.name.startswith("noise")}
    return errors


def _square_error(fitted: Measurement | None, name: str) -> float:
    """Standard error of the square of a fitted figure, 0 where it was given."""
    if fitted is None or name not in fitted.estimates:
        return 0.0
    figure = fitted.estimates[name]
    return (figure.high**2 - figure.low**2) / 2 / Z
