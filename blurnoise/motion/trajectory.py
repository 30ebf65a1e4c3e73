"""Trajectories: where the scene goes in the picture over time, and the part of it that an exposure sees.

By camera shake, vibration, and logs of places or of an inertial sensor.

Convention: s and px, x right, y down; between its knots a trajectory is straight. Time 0 is mid-exposure (of the
middle row, where rows are read one after another). A picture shows each place where it is on average: labels stay.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import LIMITS, in_range, integer, limited, shown
from blurnoise._core.fields import check_fields
from blurnoise.camera import Camera
from blurnoise.camera.captures import windows
from blurnoise.camera.spectra import Floats

SIMPLIFIED_PX = 0.02  # from a path to its simplified one; at most 2 pi f times it in the transfer function
_SAG_PX = 1e-3  # of curves between their knots
# As many as two minutes of a vibration of 1 px at 100 Hz have.
_MOST_KNOTS = 1 << 20
_SPAN = 4096  # knots simplified together
_STEPS = 2000  # of a shake during its exposure
_ANXIETY = 0.005  # of Boracchi and Foi's shakes, as their demonstration has it
_LENGTH_PX = 64.0  # of a path during an exposure, the unit of their terms
LONGEST_SHAKE = 500  # duration of a whole shake over the exposure that its extent is of, at most
_FINE = 8  # places between two readings of a rate


@dataclass(frozen=True)
class Polyline:
    """The part of a trajectory within an exposure: knots, px from the reference position, and shares of time.

    knots_px: the knots (2, K) with their gradients, where they have some.

    >>> there_and_back = Polyline(x_px=(-2.0, 2.0, -2.0), y_px=(0.0, 0.0, 0.0), shares=(0.5, 0.5))
    >>> there_and_back.box
    (-2.0, 0.0, 2.0, 0.0)
    """

    x_px: tuple[float, ...]
    y_px: tuple[float, ...]
    shares: tuple[float, ...]
    knots_px: Tensor | None = field(default=None, compare=False)

    @cached_property
    def knots(self) -> Floats:
        """(2, K), px."""
        return np.array((self.x_px, self.y_px))

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Smallest x and y, largest x and y, px."""
        return min(self.x_px), min(self.y_px), max(self.x_px), max(self.y_px)

    @cached_property
    def error(self) -> float:
        """RMS error, in units of white, of leaving it out: a bound for any picture within [0, 1].

        |1 - H(f)| is at most 2, and 2 pi f . c + 2 pi^2 f . S f of the centroid c and the second moments S about
        it; the worst picture is a checkerboard, f = (1/2, 1/2) or (1/2, -1/2).
        """
        shares = np.array(self.shares)
        starts, ends = self.knots[:, :-1], self.knots[:, 1:]
        second = ((starts[:, None] * starts + ends[:, None] * ends) / 3 * shares).sum(-1)
        second += ((starts[:, None] * ends + ends[:, None] * starts) / 6 * shares).sum(-1)
        centroid = np.array(_mean(self.knots, shares))
        (a, c), (_, b) = second - np.outer(centroid, centroid)
        spread = 2 * math.pi**2 * max(0.0, float(a + b + 2 * abs(c))) / 4
        shifted = math.pi * float(np.abs(centroid).sum())
        return min(2.0, spread + shifted) / 2


@dataclass(frozen=True)
class Trajectory:
    """A path of the picture: increasing times, s, and places, px. Raises ``TypeError`` or ``ValueError``.

    The path must span the whole exposure: functions that use it raise ``ValueError`` otherwise.

    >>> path = Trajectory.sinusoid(2.0, 50.0, duration_s=0.02)
    >>> [round(edge, 2) for edge in path.seen(exposure_s=0.01).box]  # half a period: x from -2 to 2 px
    [-2.0, 0.0, 2.0, 0.0]
    """

    time_s: tuple[float, ...]
    x_px: tuple[float, ...]
    y_px: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self)
        counts = len(self.time_s), len(self.x_px), len(self.y_px)
        if len({*counts}) > 1 or counts[0] < 2:
            raise ValueError(f"time_s, x_px, y_px: got {counts} numbers; must be as many of each, at least 2")
        for before, after in pairwise(self.time_s):
            if not before < after:
                raise ValueError(f"time_s: {after!r} follows {before!r}; must increase")
        most = LIMITS["displacement_px"].high
        for name, values in (("x_px", self.x_px), ("y_px", self.y_px)):
            if max(values) - min(values) > most:
                raise ValueError(f"{name}: spans {max(values) - min(values):g} px; must be at most {most:g}")

    @classmethod
    def of(cls, time_s: Any, places_px: NDArray[Any]) -> Trajectory:
        """Trajectory from times (K,), s, and positions (2, K), px."""
        shapes = np.shape(time_s), np.shape(places_px)
        if np.ndim(time_s) != 1 or shapes[1] != (2, len(time_s)):
            raise ValueError(f"time_s, places_px: shapes are {shapes[0]}, {shapes[1]}; must be (K,), (2, K)")
        return cls(time_s, *places_px)

    @classmethod
    def sinusoid(
        cls,
        amplitude_px: float,
        frequency_hz: float,
        duration_s: float,
        *,
        phase_rad: float = 0.0,
        direction_deg: float = 0.0,
    ) -> Trajectory:
        """Vibration a sin(2 pi f t + phase) along a direction, counter-clockwise as displayed, to 1e-3 px."""
        amplitude = in_range("amplitude_px", amplitude_px, 0.0, 1e4)
        omega = 2 * math.pi * limited("frequency_hz", frequency_hz)
        half = in_range("duration_s", duration_s, 0.0, above=True) / 2
        # A chord of length s leaves a curve of curvature c by c s^2 / 8; here c is at most amplitude omega^2.
        step = math.sqrt(8 * _SAG_PX / max(amplitude, _SAG_PX)) / omega
        count = math.ceil(2 * half / step) + 1
        if count > _MOST_KNOTS:
            must = f"at most {_MOST_KNOTS} are allowed"
            raise ValueError(f"duration_s = {2 * half:g}: needs {count} knots; {must}")
        time = np.linspace(-half, half, max(2, count))
        angle, phase = math.radians(limited("direction_deg", direction_deg)), limited("phase_rad", phase_rad)
        along = amplitude * np.sin(omega * time + phase)
        return cls.of(time, np.outer((math.cos(angle), -math.sin(angle)), along))

    def window(self, start_s: float, stop_s: float) -> tuple[Floats, Floats]:
        """Knots (2, K), px, and durations (K - 1,), s, between two times; one knot if these are equal.

        Raises ``ValueError`` unless the trajectory holds both.
        """
        first, last = self.time_s[0], self.time_s[-1]
        # A path made for an exposure in double precision is often asked for its rounded duration.
        slack = 1e-6 * (last - first)  # of times that were rounded to single precision
        if not first - slack <= start_s <= stop_s <= last + slack:
            must = f"must hold the exposure, {start_s:.6g} to {stop_s:.6g} s about mid-exposure"
            raise ValueError(f"trajectory: goes from {first:.6g} to {last:.6g} s; {must}")
        time, x, y = self._arrays
        within = time[(time > start_s) & (time < stop_s)]
        at = np.concatenate([[start_s], within, [stop_s] if stop_s > start_s else []])
        return np.stack([np.interp(at, time, x), np.interp(at, time, y)]), np.diff(at)

    def seen(self, exposure_s: float, velocity_px_s: tuple[float, float] = (0.0, 0.0)) -> Polyline:
        """The part within an exposure, plus uniform motion, simplified to 0.02 px. Raises as :meth:`window` does."""
        return _seen(self, limited("exposure_s", exposure_s), velocity_px_s)

    def origin_px(self, exposure_s: float) -> tuple[float, float]:
        """The mean position over an exposure."""
        return _mean(*self.window(-exposure_s / 2, exposure_s / 2))

    def later(self, by_s: float) -> Trajectory:
        """The trajectory about a time ``by_s`` after mid-exposure."""
        return replace(self, time_s=tuple(time_s - by_s for time_s in self.time_s)) if by_s else self

    def rates_px_s(self, at_s: Floats) -> Floats:
        """Velocity (2, ...), px/s, at times; at a knot the mean of both sides, at an end that of its one side."""
        time, *places = self._arrays
        step = 1e-8 * (time[-1] - time[0])
        before, after = (np.clip(at_s + by, time[0], time[-1]) for by in (-step, step))
        passed = [np.interp(after, time, along) - np.interp(before, time, along) for along in places]
        return np.asarray(np.stack(passed) / (after - before))

    @cached_property
    def _arrays(self) -> tuple[Floats, Floats, Floats]:
        return np.array(self.time_s), np.array(self.x_px), np.array(self.y_px)


@lru_cache(maxsize=256)
def _seen(trajectory: Trajectory, exposure_s: float, velocity_px_s: tuple[float, float]) -> Polyline:
    knots, durations = trajectory.window(-exposure_s / 2, exposure_s / 2)
    if not len(durations):
        return Polyline((0.0,), (0.0,), ())
    time = sums(durations) - exposure_s / 2
    knots = knots + np.outer(velocity_px_s, time) - np.array(trajectory.origin_px(exposure_s))[:, None]
    # Every segment costs a transform: knots that move the path by less than it shows are dropped.
    kept = simplified(time, knots, SIMPLIFIED_PX)
    knots, shares = knots[:, kept], np.diff(time[kept]) / (time[-1] - time[0])
    x, y = knots - np.array(_mean(knots, shares))[:, None]  # the path's mean, to rounding and 0.02 px
    return Polyline(tuple(x.tolist()), tuple(y.tolist()), tuple(shares.tolist()))


def simplified(time: Floats, knots: Floats, tolerance_px: float) -> list[int]:
    """Indices of the knots (2, K) at times (K,) to keep, for an error of at most ``tolerance_px`` at any time.

    >>> time, knots = np.array([0.0, 1.0, 2.0, 3.0]), np.array([[0.0, 1.0, 2.0, 2.0], [0.0, 0.0, 0.0, 0.0]])
    >>> simplified(time, knots, 0.02)  # the second knot lies on the way; at the third the motion ends
    [0, 2, 3]
    """
    # After Douglas and Peucker, but with places at equal times compared: speed counts, not shape alone.
    kept = {*range(0, len(time), _SPAN), len(time) - 1}
    spans = list(pairwise(sorted(kept)))
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        share = (time[inside] - time[first]) / (time[last] - time[first])
        line = knots[:, first, None] + share * (knots[:, last] - knots[:, first])[:, None]
        off = np.hypot(*(knots[:, inside] - line))
        middle = first + 1 + int(off.argmax())
        if off.max() > tolerance_px:
            kept.add(middle)
            spans += [(first, middle), (middle, last)]
    return sorted(kept)


def sums(steps: Floats) -> Floats:
    """0, and the sum of the first step, the first two, ..., along the last axis.

    >>> sums(np.array([1.0, 2.0, 3.0])).tolist()
    [0.0, 1.0, 3.0, 6.0]
    """
    return np.concatenate([np.zeros((*steps.shape[:-1], 1)), np.cumsum(steps, -1)], -1)


def _mean(knots: Floats, durations: Floats) -> tuple[float, float]:
    """The mean place over time of knots (2, K)."""
    if not len(durations):
        return float(knots[0, 0]), float(knots[1, 0])
    x, y = ((knots[:, :-1] + knots[:, 1:]) / 2 * durations).sum(-1) / durations.sum()
    return float(x), float(y)


def per_picture(
    trajectory: Trajectory | Sequence[Trajectory | None] | None, batch: int
) -> tuple[Trajectory | None, ...]:
    """A trajectory or None for each picture of a batch; () if all are None. Raises ``TypeError``.

    >>> still = Trajectory((-1.0, 1.0), (0.0, 0.0), (0.0, 0.0))
    >>> len(per_picture(still, 3)), per_picture([None, None], 2)
    (3, ())
    """
    if trajectory is None:
        return ()
    each = (trajectory,) * batch if isinstance(trajectory, Trajectory) else trajectory
    known = isinstance(each, Sequence) and all(isinstance(one, Trajectory | None) for one in each)
    if not known:
        must = "must be a blurnoise.Trajectory, or a sequence of one or None for each picture"
        raise TypeError(f"trajectory = {shown(trajectory)}: {must}")
    if len(each) != batch:
        raise ValueError(f"trajectory: got {len(each)} for a batch of {batch}; must be one per picture")
    return tuple(each) if any(each) else ()


def path_duration_s(camera: Camera, exposure_s: float) -> float:
    """Duration of a path about mid-exposure that covers every row and capture, s: exposure plus read-out.

    >>> from blurnoise import Camera
    >>> rolling = Camera.preset("imx250").with_figures(shutter="rolling", row_time_s=10e-6, height_px=1000)
    >>> path_duration_s(rolling, 0.005)  # the exposure, and the read-out of 10 ms on either side
    0.025
    """
    ends = (
        [sum(window) for window in windows(camera.sensor.captures, exposure_s)]
        if camera.sensor.captures
        else [exposure_s]
    )
    return (
        max(exposure_s, *(2 * end_s - exposure_s for end_s in ends))
        + 2 * camera.sensor.row_time_s * camera.sensor.height_px
    )


@lru_cache(maxsize=256)
def shake(seed: int, extent_px: float, exposure_s: float, *, duration_s: float | None = None) -> Trajectory:
    """Shake of a handheld camera, after Boracchi and Foi, IEEE TIP 21(8), 2012, 10.1109/TIP.2012.2192126.

    The velocity changes by Gaussian steps, a pull towards the middle and, rarely, a jerk, of random strengths; the
    speed is constant. extent_px: longer side of the box around the path during ``exposure_s``. duration_s: of the
    whole path, at least exposure_s. The same seed and ratio of duration to exposure give the same shape.

    >>> from blurnoise.motion.trajectory import shake
    >>> path = shake(seed=1, extent_px=8.0, exposure_s=0.01).seen(0.01)
    >>> left, top, right, bottom = path.box
    >>> round(max(right - left, bottom - top), 1)  # px
    8.0
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
    path, position = [0j], 0j
    for random, jerk, turn in zip(steps.tolist(), jerked.tolist(), turns.tolist(), strict=True):
        velocity += _ANXIETY * (random - pull * position) * speed + (2 * velocity * turn if jerk else 0)
        # The speed stays the same, only its direction changes: so the exposure is spread evenly over the path.
        velocity *= speed / abs(velocity)
        position += velocity
        path.append(position)
    places = np.stack([np.real(path), np.imag(path)])
    time = np.linspace(-duration / 2, duration / 2, count + 1)
    knots, _ = Trajectory.of(time, places).window(-exposure / 2, exposure / 2)
    return Trajectory.of(time, extent / float(np.ptp(knots, axis=1).max()) * places)


def from_text(content: str, name: str, *, focal_px: float | None = None) -> Trajectory:
    """Read a trajectory from CSV text: time_s with x_px, y_px, or with wx, wy (and wz) in rad_s or deg_s.

    Mid-exposure is the middle of the times. name: of the file, for messages. focal_px: of the camera, for rates, see
    :func:`from_rates`. Raises ``ValueError`` naming the file and the fault.

    >>> from blurnoise.motion.trajectory import from_text
    >>> log = from_text("time_s,x_px,y_px\\n0.00,0,0\\n0.01,5,0", "log.csv")
    >>> log.time_s, log.x_px  # mid-exposure is the middle
    ((-0.005, 0.005), (0.0, 5.0))
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

    >>> import numpy as np
    >>> from blurnoise.motion.trajectory import from_rates
    >>> pan = from_rates(np.array([0.0, 0.01]), np.array([[0.0, 0.0], [-1.0, -1.0], [0.0, 0.0]]), focal_px=1000.0)
    >>> round(pan.x_px[-1] - pan.x_px[0], 3)  # 1 rad/s for 10 ms, 1000 px per radian
    10.0
    """
    if focal_px is None:
        raise ValueError("focal_px: must be the camera's, px, for rates of rotation")
    time, rates = np.asarray(time_s, float), np.asarray(rates_rad_s, float)
    if time.ndim != 1 or len(time) < 2 or rates.shape != (3, len(time)):
        shapes = f"{time.shape}, {rates.shape}"
        raise ValueError(f"time_s, rates_rad_s: shapes are {shapes}; must be (K,), (3, K), K >= 2")
    # Rates are linear between readings, so angles are parabolas: finer knots hold them.
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
