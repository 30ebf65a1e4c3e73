"""Causes of paths: camera shake, and logs of places or of an inertial sensor."""

from __future__ import annotations

import csv
import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise._core import rng
from blurnoise._core.checks import in_range, integer, limited, shown
from blurnoise.motion.trajectory import Floats, Trajectory, sums
from blurnoise.optics.camera import Camera

_STEPS = 2000  # of a shake during its exposure
_ANXIETY = 0.005  # of Boracchi and Foi's shakes, as their demonstration has it
_LENGTH_PX = 64.0  # of a path during an exposure, the unit of their terms
LONGEST_SHAKE = 500
"""Duration of a whole shake over the exposure that its extent is of, at most."""
_FINE = 8  # places between two readings of a rate


def path_duration_s(camera: Camera, exposure_s: float) -> float:
    """Duration of a path about mid-exposure that covers every row, s: exposure plus read-out."""
    return exposure_s + 2 * camera.row_time_s * camera.height_px


@lru_cache(maxsize=256)
def shake(seed: int, extent_px: float, exposure_s: float, *, duration_s: float | None = None) -> Trajectory:
    """A camera held by hand, after Boracchi and Foi, IEEE TIP 21(8), 2012, 10.1109/TIP.2012.2192126.

    The velocity gets Gaussian steps, a pull towards the middle and, rarely, a jerk, strengths drawn once, and keeps
    its speed. extent_px: the longer side of the box about what ``exposure_s`` around mid-exposure sees. duration_s >=
    exposure_s: of the whole, of which exposures see parts. The same seed and duration over exposure give the same
    shape.
    """
    integer("seed", seed, 0, rng.LAST_SEED)
    extent = in_range("extent_px", extent_px, 0.0, 1e4)
    exposure = in_range("exposure_s", exposure_s, 0.0, above=True)
    duration = in_range("duration_s", exposure if duration_s is None else duration_s, exposure, 3600.0)
    if duration > LONGEST_SHAKE * exposure:
        raise ValueError(f"duration_s = {duration:g}: must be at most {LONGEST_SHAKE} times exposure_s")
    count = math.ceil(_STEPS * duration / exposure)
    drawn = np.random.default_rng(rng.derived(seed, "shake"))
    pull, noise, jerks = drawn.uniform(size=3) * (0.7, 10.0, 0.2)
    speed = _LENGTH_PX / _STEPS
    velocity = speed * np.exp(2j * math.pi * drawn.uniform())
    steps = (drawn.standard_normal((count, 2)) @ (1, 1j)) * noise
    jerked = drawn.uniform(size=count) < jerks * _ANXIETY
    turns = np.exp(1j * (math.pi + drawn.uniform(size=count) - 0.5))
    path, place = [0j], 0j
    for random, jerk, turn in zip(steps.tolist(), jerked.tolist(), turns.tolist(), strict=True):
        velocity += _ANXIETY * (random - pull * place) * speed + (2 * velocity * turn if jerk else 0)
        velocity *= speed / abs(velocity)
        place += velocity
        path.append(place)
    places = np.stack([np.real(path), np.imag(path)])
    time = np.linspace(-duration / 2, duration / 2, count + 1)
    knots, _ = Trajectory.of(time, places).window(-exposure / 2, exposure / 2)
    return Trajectory.of(time, extent / float(np.ptp(knots, axis=1).max()) * places)


def from_text(content: str, name: str, *, focal_px: float | None = None) -> Trajectory:
    """A trajectory of the text of a CSV file: time_s with x_px, y_px, or with wx, wy (and wz) in rad_s or deg_s.

    Mid-exposure is the middle of its times. name: of the file. focal_px: of the camera, for rates, see
    :func:`from_rates`. Raises ``ValueError`` naming the file and what is wrong in it.
    """
    try:
        columns = _columns(content)
        names = shown(list(columns))
        if "time_s" not in columns:
            raise ValueError(f"columns {names}: must hold time_s")
        time = columns.pop("time_s")
        if len(time) < 2 or not bool((np.diff(time) > 0).all()):
            raise ValueError("time_s: must be at least two times that increase")
        time = time - (time[0] + time[-1]) / 2
        if {"x_px", "y_px"} <= set(columns):
            if any(name.startswith("w") for name in columns):
                raise ValueError(f"columns {names}: must be places or rates, not both")
            return Trajectory.of(time, np.stack([columns["x_px"], columns["y_px"]]))
        for unit, scale in (("rad_s", 1.0), ("deg_s", math.pi / 180)):
            if {f"wx_{unit}", f"wy_{unit}"} <= set(columns):
                rates = [columns.get(f"w{axis}_{unit}", np.zeros_like(time)) * scale for axis in "xyz"]
                return from_rates(time, np.stack(rates), focal_px=focal_px)
        raise ValueError(f"columns {names}: must be time_s and x_px, y_px or wx_rad_s, wy_rad_s or in deg_s")
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{name}: {error}") from None


def from_rates(time_s: NDArray[Any], rates_rad_s: NDArray[Any], *, focal_px: float | None) -> Trajectory:
    """A trajectory of a camera's rates of rotation (3, K) about its axes, rad/s, at times (K,), linear between.

    d = f (-int wy, int wx). Raises ``ValueError`` naming the argument.
    """
    if focal_px is None:
        raise ValueError("focal_px: must be the camera's, px, for rates of rotation")
    time, rates = np.asarray(time_s, float), np.asarray(rates_rad_s, float)
    if time.ndim != 1 or len(time) < 2 or rates.shape != (3, len(time)):
        raise ValueError(
            f"time_s, rates_rad_s: shapes are {time.shape}, {rates.shape}; must be (K,), (3, K), K >= 2"
        )
    fine = np.interp(np.arange((len(time) - 1) * _FINE + 1) / _FINE, np.arange(len(time)), time)
    between = np.stack([np.interp(fine, time, rate) for rate in (-rates[1], rates[0])])
    angles = sums((between[:, 1:] + between[:, :-1]) / 2 * np.diff(fine))
    return Trajectory.of(fine, limited("focal_px", focal_px) * angles)


def _columns(content: str) -> dict[str, Floats]:
    rows = [row for row in csv.reader(content.splitlines()) if row and not row[0].lstrip().startswith("#")]
    if not rows:
        raise ValueError("is empty")
    names = [name.strip() for name in rows[0]]
    if len({*names}) != len(names) or any(len(row) != len(names) for row in rows):
        raise ValueError("must have one header of different names, and as many values in every row")
    try:
        values = np.array([[float(value) for value in row] for row in rows[1:]]).reshape(-1, len(names))
    except ValueError:
        raise ValueError("must hold numbers below its header") from None
    return dict(zip(names, values.T, strict=True))
