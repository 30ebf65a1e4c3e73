"""Courses: how one thing moves while a picture of several is exposed, as :mod:`blurnoise.layered` asks for it.

Convention: px, x right, y down; (0, 0) is where the picture at rest has it. A course blurs planes (1, C, h, w) over a
window, and shows them as they are in the middle of parts of the exposure, whose times go from -1/2 to 1/2: between
pixels linearly, which loses what is finest and counts only where it varies with what is before it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from blurnoise import blur, path_blur, rolling_shutter
from blurnoise._core.borders import Border
from blurnoise._core.windows import Window
from blurnoise.flow_blur import flow_blur
from blurnoise.layers import ALIKE_PX, reach_px
from blurnoise.rolling_shutter import Readout
from blurnoise.trajectory import Floats, Polyline, Trajectory

Shown = Callable[[float], Tensor]
"""What a plane shows in a window in the part of the exposure whose middle is at that time."""


class Course(ABC):
    """A motion; ``displacement_px`` (2,) is what of it is straight and even."""

    displacement_px: Tensor

    def passed(self, rest: Window) -> Window:
        """The pixels that something may cover which at rest is in ``rest``: grown by the reach."""
        return rest.grown(*self.reach(rest))

    @abstractmethod
    def reach(self, window: Window) -> tuple[int, int]:
        """How far down and across from a window that may be which it shows."""

    @abstractmethod
    def blurred(self, plane: Tensor, window: Window, border: Border) -> Tensor:
        """A plane over ``window`` as the whole exposure sees it."""

    @abstractmethod
    def shown(self, plane: Tensor, parts: int, work: Window, window: Window) -> Shown:
        """A plane over ``work`` in ``window``, in the middle of parts of the exposure."""

    def edges(self, window: Window, step_px: float) -> Floats:
        """Times that cut the exposure into parts in which nothing in the window moves more than ``step_px``."""
        return np.linspace(-0.5, 0.5, max(1, math.ceil(self.length_px(window) / step_px - 1e-6)) + 1)

    def length_px(self, window: Window) -> float:
        """How far anything in the window moves, at most."""
        return float(self.displacement_px.detach().norm())

    @property
    def still(self) -> bool:
        """Whether what moves so does not, for anybody who asks."""
        return as_one(self.displacement_px, torch.zeros_like(self.displacement_px))

    def as_one_with(self, other: Course) -> bool:
        """Whether both move alike."""
        return as_one(self.displacement_px, other.displacement_px)


def as_one(one: Tensor, other: Tensor) -> bool:
    """Whether two displacements are the same, as far as anybody asks."""
    if torch.is_grad_enabled() and (one.requires_grad or other.requires_grad):
        return False
    return float((one - other).abs().amax()) < ALIKE_PX


@dataclass(frozen=True, eq=False)
class Straight(Course):
    """Uniform motion."""

    displacement_px: Tensor

    def reach(self, window: Window) -> tuple[int, int]:
        """Half of the way, and the tail of the band-limited line; of none, too, where its slope is asked for."""
        least = ALIKE_PX if torch.is_grad_enabled() and self.displacement_px.requires_grad else 0.0
        across, down = (reach_px(max(abs(along), least)) for along in self.displacement_px.detach().tolist())
        return down, across

    def blurred(self, plane: Tensor, window: Window, border: Border) -> Tensor:
        """By its transfer function."""
        return blur.motion_blur(plane, self.displacement_px[None], border=border)

    def shown(self, plane: Tensor, parts: int, work: Window, window: Window) -> Shown:
        """As a part sees it on average."""
        seen = blur.motion_blur(plane, self.displacement_px[None] / parts, border="circular")
        asked = torch.is_grad_enabled() and self.displacement_px.requires_grad
        along = list(self.displacement_px) if asked else self.displacement_px.tolist()
        return lambda time: _shifted(seen, along[0] * time, along[1] * time, work, window)


@dataclass(frozen=True, eq=False)
class RowByRow(Straight):
    """Uniform motion before a rolling shutter, which reads a row every ``row_s``, ``middle`` at mid-exposure."""

    exposure_s: Tensor
    row_s: float
    middle: float

    def passed(self, rest: Window) -> Window:
        """Where rows have it when they are read, and the line's spread. Raises where it overtakes the readout."""
        x, y = self._velocity.detach().tolist()
        taller = rolling_shutter.stretch(y, self.row_s)
        top, bottom = (
            self.middle + taller * (row - self.middle)
            for row in (rest.top - 0.5, rest.top + rest.height - 0.5)
        )
        shifts = [x * (row - self.middle) * self.row_s for row in (top, bottom)]
        first, left = math.floor(top), rest.left + math.floor(min(shifts))
        width = rest.width + math.ceil(max(shifts)) - math.floor(min(shifts))
        seen = Window(first, left, math.ceil(bottom) - first + 1, width)
        spread = (reach_px(taller * along) for along in self.displacement_px.detach().tolist())
        across, down = spread
        return seen.grown(down, across)

    def reach(self, window: Window) -> tuple[int, int]:
        """With what it moves between the middle row and those of the window."""
        late = abs(self._tau(window)).max()
        down, across = super().reach(window)
        x, y = (math.ceil(abs(along) * late) for along in self._velocity.detach().tolist())
        room = 8 if x or y else 0  # of the taps between rows
        return down + y + room, across + x + room

    def blurred(self, plane: Tensor, window: Window, border: Border) -> Tensor:
        """Blurred, then warped."""
        seen = super().blurred(plane, window, border)
        return rolling_shutter.warped(
            seen, self._velocity, self.row_s, border, middle=self.middle - window.top
        )

    def shown(self, plane: Tensor, parts: int, work: Window, window: Window) -> Shown:
        """Each row at its own time."""
        seen = blur.motion_blur(plane, self.displacement_px[None] / parts, border="circular")
        tau = torch.from_numpy(self._tau(window)).to(plane)[:, None]

        def at(time: float) -> Tensor:
            later = time * self.exposure_s.to(plane) + tau
            return _sampled(seen, self._velocity[0] * later, self._velocity[1] * later, work, window)

        return at

    @property
    def _velocity(self) -> Tensor:
        if not float(self.exposure_s):
            return torch.zeros_like(self.displacement_px)
        return self.displacement_px / self.exposure_s

    def _tau(self, window: Window) -> Floats:
        return np.asarray((window.top + np.arange(window.height) - self.middle) * self.row_s)


@dataclass(frozen=True, eq=False)
class Along(Course):
    """A trajectory that all share, and uniform motion beside it; the gradients of that stop."""

    displacement_px: Tensor
    trajectory: Trajectory
    exposure_s: float

    def reach(self, window: Window) -> tuple[int, int]:
        """As far as the path goes, and its band-limited ends."""
        across, down = (reach_px(2 * along) for along in self._path.reach_px)
        return down, across

    def blurred(self, plane: Tensor, window: Window, border: Border) -> Tensor:
        """By the path's transfer function."""
        return path_blur.path_blur(plane, self._path, border=border)

    def shown(self, plane: Tensor, parts: int, work: Window, window: Window) -> Shown:
        """Displaced by where the path is."""
        x, y = self._velocity
        knots, _ = self.trajectory.window(-self.exposure_s / 2, self.exposure_s / 2)
        times, origin = self._times, self.trajectory.origin_px(self.exposure_s)

        def at(time: float) -> Tensor:
            place = [float(np.interp(time, times, along)) for along in knots]
            later = time * self.exposure_s
            return _shifted(
                plane, place[0] - origin[0] + x * later, place[1] - origin[1] + y * later, work, window
            )

        return at

    def edges(self, window: Window, step_px: float) -> Floats:
        """As many where it is fast; what moves within a part is not blurred by it."""
        if not self.exposure_s:
            return np.array([-0.5, 0.5])
        knots, _ = self.trajectory.window(-self.exposure_s / 2, self.exposure_s / 2)
        steps = np.diff(knots + np.outer(self._velocity, self._times * self.exposure_s))
        gone = np.concatenate([[0.0], np.cumsum(np.hypot(*steps) / step_px + 1e-9)])
        return np.interp(np.linspace(0, gone[-1], math.ceil(gone[-1]) + 1), gone, self._times)

    def length_px(self, window: Window) -> float:
        """Of the path."""
        return float(np.hypot(*np.diff(self._path.knots)).sum())

    @property
    def still(self) -> bool:
        """Where the path stays in its place."""
        return max(map(abs, self._path.box)) < ALIKE_PX

    @property
    def _velocity(self) -> tuple[float, float]:
        x, y = self.displacement_px.detach().tolist()
        return (x / self.exposure_s, y / self.exposure_s) if self.exposure_s else (0.0, 0.0)

    @property
    def _times(self) -> Floats:
        _, durations = self.trajectory.window(-self.exposure_s / 2, self.exposure_s / 2)
        return np.concatenate([[0.0], np.cumsum(durations)]) / self.exposure_s - 0.5

    @property
    def _path(self) -> Polyline:
        return self.trajectory.seen(self.exposure_s, self._velocity)


@dataclass(frozen=True, eq=False)
class PathByRow(Course):
    """A path of which each row sees the part that its own window holds; its gradients stop. path: with the motion."""

    displacement_px: Tensor
    path: Trajectory
    readout: Readout

    def reach(self, window: Window) -> tuple[int, int]:
        """As far as the path goes, and its ends."""
        across, down = (reach_px(2 * far) for far in np.abs(self._places[1]).max(1).tolist())
        return down, across

    def blurred(self, plane: Tensor, window: Window, border: Border) -> Tensor:
        """Row by row; no brighter where windows are longer."""
        return rolling_shutter.mean_of_rows(plane, self.path, self._origin, self._rows(window), border)

    def shown(self, plane: Tensor, parts: int, work: Window, window: Window) -> Shown:
        """Each row at its own time."""
        starts, stops = self._rows(window).windows_s
        times, places = self._places

        def at(time: float) -> Tensor:
            later = starts + (time + 0.5) * (stops - starts)
            x, y = (torch.from_numpy(np.interp(later, times, along))[:, None] for along in places)
            return _sampled(plane, x, y, work, window)

        return at

    def length_px(self, window: Window) -> float:
        """What the longest exposure takes at the path's greatest speed, at most all of it."""
        times, places = self._places
        starts, stops = self._rows(window).windows_s
        steps = np.hypot(*np.diff(places))
        fastest = float((steps / np.diff(times)).max()) if len(steps) else 0.0
        return fastest * float((stops - starts).max())

    @property
    def still(self) -> bool:
        """Where the path stays in its place."""
        return float(np.abs(self._places[1]).max()) < ALIKE_PX

    @property
    def _places(self) -> tuple[Floats, Floats]:
        """Times, and where it is then, (2, K), from where the picture at rest has it."""
        begin, end = self.readout.span_s
        knots, durations = self.path.window(begin, end)
        return begin + np.concatenate([[0.0], np.cumsum(durations)]), knots - np.array(self._origin)[:, None]

    @property
    def _origin(self) -> tuple[float, float]:
        return self.path.origin_px(self.readout.exposure_s)

    def _rows(self, window: Window) -> Readout:
        return replace(self.readout, rows=window.height, first=window.top, of=self.readout.rows)


@dataclass(frozen=True, eq=False)
class Flow(Course):
    """Motion (2, H, W) of its own for each pixel of a picture: of a background."""

    flow_px: Tensor
    displacement_px: Tensor

    def passed(self, rest: Window) -> Window:
        """All of it; layers have none."""
        return rest

    def reach(self, window: Window) -> tuple[int, int]:
        """As far as the farthest in the window."""
        farthest = self._in(window).detach().abs().amax((1, 2)).tolist()
        across, down = (reach_px(along) for along in farthest)
        return down, across

    def blurred(self, plane: Tensor, window: Window, border: Border) -> Tensor:
        """By sub-exposures along each pixel's path."""
        return flow_blur(plane, self._in(window), border=border)

    def shown(self, plane: Tensor, parts: int, work: Window, window: Window) -> Shown:
        """Each pixel along its own path."""
        x, y = self._in(window)
        return lambda time: _sampled(plane, x * time, y * time, work, window)

    def length_px(self, window: Window) -> float:
        """Of the farthest in the window."""
        return float(self._in(window).detach().square().sum(0).max().sqrt())

    @property
    def still(self) -> bool:
        """Where nothing moves."""
        return as_one(self.flow_px, torch.zeros_like(self.flow_px))

    def as_one_with(self, other: Course) -> bool:
        """Never: what is in a layer moves otherwise."""
        return False

    def _in(self, window: Window) -> Tensor:
        return self.flow_px[:, *window.within]


def finest(courses: Sequence[Course], window: Window, step_px: float) -> Floats:
    """Times that cut the exposure finely enough for all of them."""
    return max((course.edges(window, step_px) for course in courses), key=len)


def _shifted(plane: Tensor, x: float | Tensor, y: float | Tensor, work: Window, window: Window) -> Tensor:
    """Of a plane over ``work`` what is in ``window`` once it has moved."""
    first = (window.left - work.left, window.top - work.top)
    for dim, along, start, length in zip((-1, -2), (x, y), first, (window.width, window.height), strict=True):
        plane = _between(plane, along, dim, start, length)
    return plane


def _between(plane: Tensor, shift_px: float | Tensor, dim: int, first: int, count: int) -> Tensor:
    """``count`` pixels along one axis from ``first`` on, of a plane that is moved by ``shift_px``.

    Less than ``ALIKE_PX`` is no motion: the plane may have nothing beside these pixels.
    """
    if not isinstance(shift_px, Tensor) and abs(shift_px) < ALIKE_PX:
        shift_px = 0.0
    whole = math.ceil(float(shift_px.detach() if isinstance(shift_px, Tensor) else shift_px))
    rest = whole - shift_px  # from the pixel before, in [0, 1)
    near = plane.narrow(dim, first - whole, count)
    if isinstance(rest, float) and rest == 0:
        return near
    return torch.lerp(near, plane.narrow(dim, first - whole + 1, count), rest)


def _sampled(plane: Tensor, x_px: Tensor, y_px: Tensor, work: Window, window: Window) -> Tensor:
    """The same where each row, (h, 1), or pixel, (h, w), has moved by its own x_px and y_px."""
    columns = torch.arange(window.width).to(plane) + (window.left - work.left)
    rows = torch.arange(window.height).to(plane)[:, None] + (window.top - work.top)
    size = (window.height, window.width)
    x, y = (columns - x_px.to(plane)).expand(size), (rows - y_px.to(plane)).expand(size)
    spans = (max(1, work.width - 1), max(1, work.height - 1))
    grid = torch.stack([2 * x / spans[0] - 1, 2 * y / spans[1] - 1], -1)[None]
    return functional.grid_sample(plane, grid, "bilinear", "border", align_corners=True)
