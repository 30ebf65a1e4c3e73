"""Trial of a fitted camera: its frames, simulated at every level of the fit, against the frames of the fit.

Domain: steps of the converter. Compared are the statistics of a level: mean, temporal variance, shares of whole rows
and columns, and the mean in the dark. The simulated light is even and grows as the fitted line says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.stats import norm

from blurnoise._core import rng
from blurnoise.camera import Camera
from blurnoise.camera.radiometry import dark_electrons
from blurnoise.sensor.readout import read_out
from blurnoise_eval.calibration.checks import CLIPPED, beyond_peak
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.levels import Level, level_of
from blurnoise_eval.calibration.rounding import TWO_NUMBERS_DN
from blurnoise_eval.calibration.uncertain import Z

SIDE_PX = 160  # of the simulated frames: their variance is known to 1 %
_MOST_FLAT, _MOST_DARK = 24, 8  # levels; a few seconds
_MOST_FRAMES = 4
_MOST_ROWS = 1024
_CHANCE = 0.01  # probability that any level of a camera without fault misses its interval
_DIM = 0.05  # of the brightest signal, as for the linearity
_SMALL = 0.01  # relative difference of the variance that is no miss
_SMALL_DN = 0.05  # of means
_SMALL_SHARE = 0.001  # of the variance that whole rows or columns have in common


@dataclass(frozen=True)
class Miss:
    """A quantity of a level: captured, simulated, and the half width of the interval of their difference.

    >>> miss = Miss("variance", "DN²", "flat 10 ms", captured=110.0, simulated=100.0, interval=5.0)
    >>> miss.ratio
    2.0
    """

    quantity: str
    unit: str
    level: str
    captured: float
    simulated: float
    interval: float

    @property
    def ratio(self) -> float:
        """The difference over its interval; above 1 it is a miss."""
        return abs(self.captured - self.simulated) / self.interval


def misses(measurement: Measurement, camera: Camera, seed: int = 0) -> list[str]:
    """One line for each quantity of the frames that the camera misses, at the level that misses most.

    measurement: of the frames; camera: made of it. Raises as the simulation does.
    """
    whole = [level for level in measurement.flat if not _clips(level, measurement)]
    flat, dark = _some(whole, _MOST_FLAT), _some(measurement.dark, _MOST_DARK)
    pairs = [(level, _simulated(measurement, camera, level, seed)) for level in (*dark, *flat)]
    sure = float(norm.isf(_CHANCE / 2 / (2 * len(pairs) + 4)))
    every = [miss for pair in pairs for miss in _compared(measurement, *pair, sure)]
    for kind in ("dark", "flat"):
        of_kind, correlated = [pair for pair in pairs if pair[0].taken.kind == kind], kind == "flat"
        every += _lines(of_kind, kind, sure, correlated=correlated and camera.sensor.row_gain_noise > 0)
    lines = []
    for quantity in dict.fromkeys(miss.quantity for miss in every):
        of = [miss for miss in every if miss.quantity == quantity]
        off = [miss for miss in of if miss.ratio > 1]
        if off:
            worst = max(off, key=lambda miss: miss.ratio)
            count = f" at {len(off)} of {len(of)} levels" if len(of) > 1 else ""
            where = f"{worst.quantity}{worst.unit}{count}; {worst.level}"
            numbers = f"{worst.captured:.4g} captured, {worst.simulated:.4g} simulated"
            lines.append(f"misses its frames: {where}: {numbers}, ± {worst.interval:.2g}")
    return lines


def _some(levels: Sequence[Level], most: int) -> list[Level]:
    """At most so many of the levels, evenly among them, the first and the last included."""
    chosen = np.linspace(0, len(levels) - 1, min(most, len(levels))).round().astype(int).tolist()
    return [levels[index] for index in chosen]


def _lines(pairs: Sequence[tuple[Level, Level]], kind: str, sure: float, *, correlated: bool) -> list[Miss]:
    """What whole rows and columns have of the variance, on average over levels of one kind.

    correlated: whether neighbouring rows are.
    """
    found = []
    for lines in ("row", "column") if pairs else ():
        shares = np.array([[getattr(level, f"{lines}_share") for level in pair] for pair in pairs])
        captured, simulated = shares.mean(0).tolist()
        # each of the simulated lines has a mean of its own in every level
        chance = (1 / SIDE_PX + abs(simulated)) * math.sqrt(2 / (SIDE_PX * len(pairs)))
        if lines == "row" and correlated:  # and rows, of which few are independent
            chance = max(chance, float((shares[:, 0] - shares[:, 1]).std()) / math.sqrt(len(pairs)))
        interval = _SMALL_SHARE + sure * chance
        title = f"the share of whole {lines}s in the variance of {kind} frames"
        found.append(Miss(title, "", f"mean of {len(pairs)} levels", captured, simulated, interval))
    return found


def _clips(level: Level, measurement: Measurement) -> bool:
    """Whether more pixels clip than the variance bears."""
    limit = measurement.clip_dn or 2**measurement.bit_depth - 1
    return level in beyond_peak(measurement.flat) or bool(
        level.counts[math.ceil(limit) :].sum() > CLIPPED * level.counts.sum()
    )


def _rows(measurement: Measurement, camera: Camera) -> int:
    """Rows of simulated frames: as many as the frames have, where neighbouring rows are correlated."""
    captured = measurement.size_px[1] // (2 if measurement.cfa else 1)
    return max(SIDE_PX, min(captured, _MOST_ROWS)) if camera.sensor.row_gain_noise else SIDE_PX


def _electrons(measurement: Measurement, camera: Camera, level: Level) -> float:
    """Mean photo-electrons of a level, by the line of signal over light, or without one by its mean."""
    if level.taken.kind == "dark":
        return 0.0
    signal_dn, linear = level.mean_dn - measurement.fit.dark.at(level.exposure_s), measurement.linearity
    if linear:
        index = next(index for index, one in enumerate(measurement.flat) if one is level)
        signal_dn = linear.slope * float(linear.x[index]) + linear.offset
    return max(0.0, float(signal_dn)) / camera.sensor.system_gain_dn_per_e


def _simulated(measurement: Measurement, camera: Camera, level: Level, seed: int) -> Level:
    """The level in as many simulated frames as there are, four at most."""
    sensor, electrons = camera.sensor, _electrons(measurement, camera, level)
    count = min(level.frames, _MOST_FRAMES)
    shape = (_rows(measurement, camera), SIDE_PX)
    stream = rng.derived(seed, f"trial {level}")
    dn = read_out(
        torch.full((count, 1, *shape), electrons),
        camera,
        exposure_s=level.exposure_s,
        temperature_c=sensor.dark_reference_c,
        fixed_pattern=sensor.fixed_pattern((1, *shape), seed),
        generator=torch.Generator().manual_seed(stream),
        fidelity="full",
    )
    charge_e = dark_electrons(camera, level.exposure_s, sensor.dark_reference_c)
    dark_dn = sensor.black_level_dn + sensor.system_gain_dn_per_e * charge_e
    return level_of(dn[:, 0].numpy().astype(np.uint16), level.taken, dark_dn)[0]


def _compared(measurement: Measurement, level: Level, simulated: Level, sure: float) -> list[Miss]:
    """Mean and variance of a level; of a dim one, neither. sure: standard deviations of chance in an interval."""
    fit, estimates, lit = measurement.fit, measurement.estimates, level.taken.kind == "flat"
    signal_dn = max(0.0, level.mean_dn - fit.dark.offset)
    brightest_dn = max(one.mean_dn for one in measurement.flat) - fit.dark.offset
    if (lit and signal_dn < _DIM * brightest_dn) or (not lit and fit.noise_dn < TWO_NUMBERS_DN):
        return []  # dark frames of two numbers give bounds, which no single camera can meet
    found = []
    if not lit or measurement.linearity:
        black, drift = estimates["black_level_dn"], estimates.get("black_level_drift_dn")
        drift_dn = drift.high * math.sqrt(1 / level.frames + 1 / simulated.frames) if drift else 0.0
        chance_dn = math.hypot(
            drift_dn, level.mean_error_dn, simulated.mean_error_dn, (black.high - black.low) / 2 / Z
        )
        line_dn = 0.0
        if (
            lit
        ):  # the lamp, the line of light, and fixed patterns of few rows and columns in the simulated frames
            # of two frames of a lamp that scatters by s, the range has the mean square 2 s^2, and the mean s^2 / 2
            lamp = math.sqrt(float(np.mean([one.lamp_spread**2 for one in measurement.flat]))) / 2
            chance_dn = math.hypot(chance_dn, lamp * signal_dn)
            pattern = sum(estimates[name].value for name in ("prnu", "prnu_row", "prnu_column"))
            line = estimates["linearity_error"].high + sure * pattern / math.sqrt(SIDE_PX)
            line_dn = line * signal_dn
        interval = _SMALL_DN + sure * chance_dn + line_dn
        title = "the mean" if lit else "the mean in the dark"
        found.append(Miss(title, " (DN)", str(level), level.mean_dn, simulated.mean_dn, interval))
    errors = [level.variance_error_dn2, simulated.variance_error_dn2, fit.error(signal_dn, 1)]
    if fit.rounding and not lit:  # where the black level wanders, the variance follows it
        errors.append(float(np.std([one.variance_dn2 for one in measurement.dark])))
    # whole rows and columns make the variance of small frames less certain
    variance, shares = simulated.variance_dn2, abs(simulated.row_share) + abs(simulated.column_share)
    errors.append(variance * shares * math.sqrt(2 / SIDE_PX))
    title = f"the variance of {level.taken.kind} frames"
    interval = _SMALL * variance + sure * math.hypot(*errors)
    return [*found, Miss(title, " (DN²)", str(level), level.variance_dn2, variance, interval)]
