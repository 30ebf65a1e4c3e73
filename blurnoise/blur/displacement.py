"""The description of motion: how far something is displaced at any time, and when each row of a picture is exposed.

Convention: px, x right, y down; (0, 0) is where the picture at rest has it. Time 0 is mid-exposure of the middle row.
Rows are read every ``row_s``, downwards > 0, upwards < 0, 0 together. Row i is exposed for T about
(i - (H - 1) / 2) row_s; with global reset all begin together, and each ends ``row_s`` after the one before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import Window
from blurnoise._core.threads import differentiable
from blurnoise.motion.trajectory import Polyline, Trajectory, sums

Floats = NDArray[np.float64]
Way = Literal["transfer", "rows", "sub-exposures"]
_AT_ONCE_PX2 = 0.15  # of a path in a part of a row's window
_TIMES = 2049  # at which the rows that are exposed are looked at
_MOST_PARTS = 6  # of a row's window: beyond that sub-exposures are as fast, and as good
STILL_PX = 1e-4
"""Less than this is no motion, and motions that differ by less are one: 3e-4 of the finest detail."""
_TAIL_PX = 8  # of a band-limited line beyond its ends, as in blur.fourier; more than interpolation reaches


@dataclass(frozen=True)
class Readout:
    """When the rows of a picture are exposed, s: ``row_s`` as the module says, ``reset``: all begin together.

    >>> readout = Readout(rows=3, row_s=1e-3, exposure_s=5e-3)
    >>> starts, stops = readout.windows_s
    >>> (1e3 * starts).round(3).tolist(), (1e3 * stops).round(3).tolist()  # ms; the middle row about 0
    ([-3.5, -2.5, -1.5], [1.5, 2.5, 3.5])
    """

    rows: int
    row_s: float
    exposure_s: float
    reset: bool = False

    @property
    def windows_s(self) -> tuple[Floats, Floats]:
        """Start and end of each row's exposure, s."""
        return self.windows_of(np.arange(self.rows))

    def windows_of(self, rows: NDArray[Any]) -> tuple[Floats, Floats]:
        """Start and end for rows, or places between them; those beyond the picture take the nearest row's."""
        last = self.rows - 1
        tau = (rows.clip(0, last) - last / 2) * self.row_s
        if not self.reset:
            return tau - self.exposure_s / 2, tau + self.exposure_s / 2
        readout_s = last * abs(self.row_s)
        later = tau + readout_s / 2
        start = np.full_like(later, -(self.exposure_s + readout_s / 2) / 2)
        # Centred, so that time 0 stays mid-exposure of the middle row.
        return start, start + self.exposure_s + later

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first exposure begins and the last ends."""
        starts, stops = self.windows_s
        return float(starts.min()), float(stops.max())

    @property
    def light(self) -> Floats:
        """Exposure of each row relative to the nominal exposure."""
        starts, stops = self.windows_s
        return (stops - starts) / self.exposure_s if self.exposure_s else np.ones(self.rows)


@dataclass(frozen=True, eq=False)
class Displacement:
    """Displacement at time t: ``even_px`` t / T plus the position on the path, during the exposure of each row.

    even_px: (2,), or (2, H, W) of each pixel of the picture, during an exposure; its gradients pass. exposure_s: ().

    >>> still_rows = Readout(rows=4, row_s=0.0, exposure_s=0.01)
    >>> moves = Displacement(torch.tensor([3.0, 0.0]), torch.tensor(0.01), still_rows)
    >>> moves.way, moves.velocity_px_s  # 3 px in 10 ms
    ('transfer', (300.0, 0.0))
    """

    even_px: Tensor
    exposure_s: Tensor
    readout: Readout
    path: Trajectory | None = None

    @property
    def flows(self) -> bool:
        """Whether displacement differs from pixel to pixel."""
        return self.even_px.ndim == 3

    @property
    def way(self) -> Way:
        """How the motion is computed; the only place that decides it.

        One displacement for all pixels in one window of time is a transfer function. Rows exposed in turn see one
        blur of a uniform motion, each displaced; of a path that in no window goes far along rows and down them at
        once, each has its own. Everything else is a mean of sub-exposures.
        """
        by_rows = self.readout.row_s != 0
        if self.flows:
            return "sub-exposures"
        if by_rows and self.each_row_differs:
            return "sub-exposures" if differentiable(self.even_px) or self.parts > _MOST_PARTS else "rows"
        return "rows" if by_rows and self.readout.exposure_s and not self.still else "transfer"

    @property
    def each_row_differs(self) -> bool:
        """Whether each row sees another part of the motion."""
        return self.readout.row_s != 0 and (self.path is not None or self.readout.reset)

    @property
    def still(self) -> bool:
        """Whether nothing moves."""
        if differentiable(self.even_px) or float(self.even_px.detach().abs().max()) >= STILL_PX:
            return False
        return float(np.abs(self.path_track[1]).max()) < STILL_PX

    def moves_like(self, other: Displacement) -> bool:
        """Whether both have the same motion."""
        if self.flows or other.flows or differentiable(self.even_px, other.even_px):
            return False
        return float((self.even_px - other.even_px).abs().amax()) < STILL_PX

    @property
    def velocity_px_s(self) -> tuple[float, float]:
        """Velocity of the uniform part of the motion; 0 for an exposure of no length."""
        lasting_s = self.readout.exposure_s or math.inf
        x, y = self.even_px.detach().tolist()
        return x / lasting_s, y / lasting_s

    @property
    def polyline(self) -> Polyline | None:
        """The path and the uniform motion within an exposure of all rows together; None where there is none."""
        if self.path is None or self.each_row_differs or self.flows:
            return None
        line = self.path.seen(self.readout.exposure_s, self.velocity_px_s)
        if not line.shares or not differentiable(self.even_px, self.exposure_s):
            return line
        shares = np.array(line.shares)
        time = sums(shares) - 0.5
        rates = time * self.path.rates_px_s(time * self.readout.exposure_s)
        rates -= ((rates[:, 1:] + rates[:, :-1]) / 2 * shares).sum(1)[:, None]
        knots = torch.from_numpy(line.knots) + torch.from_numpy(rates) * _follow(self.exposure_s)
        return replace(line, knots_px=knots + torch.outer(_follow(self.even_px), torch.from_numpy(time)))

    @cached_property
    def track(self) -> tuple[Floats, Floats]:
        """Times (K,) and places (2, K) of the path and the uniform motion together."""
        times, knots = self.path_track
        return times, knots + np.outer(self.velocity_px_s, times)

    @cached_property
    def path_track(self) -> tuple[Floats, Floats]:
        """Times (K,) and places (2, K) of the path. Raises ``ValueError`` unless it holds all rows' windows."""
        begin, end = self.readout.span_s
        if self.path is None:
            return np.array([begin, end + 1e-12]), np.zeros((2, 2))
        knots, durations = self.path.window(begin, end)
        # The picture at rest shows where things are on average, so that no path moves its centroid.
        origin = np.array(self.path.origin_px(self.readout.exposure_s))[:, None]
        return begin + sums(durations), knots - origin

    def even(self, window: Window) -> tuple[Tensor, Tensor]:
        """Displacement (2, h, 1 or w) of a window's pixels without the path: at the middle of each row's exposure,
        and during it."""
        if self.flows:
            base, along = self._flow
            return base[:, *window.within], along[:, *window.within]
        by = self.even_px[:, None, None].expand(2, window.height, 1)
        if not self.readout.row_s:
            return torch.zeros_like(by), by
        rate, middle, lasting = self._rate(by, window)
        return rate * middle, rate * lasting

    @cached_property
    def _flow(self) -> tuple[Tensor, Tensor]:
        """:meth:`even` of a steady flow: what is at p at time t was at p - t u, u the flow half-way."""
        by = self.even_px
        if not self.readout.row_s:
            return torch.zeros_like(by), by
        # A flow carries itself along: what passes p at the middle of its row's exposure has come from further back.
        rate, middle, lasting = self._rate(by, Window(0, 0, *by.shape[1:]))
        base = _carried(rate, rate * (middle / 2)) * middle
        return base, _carried(rate, base) * lasting

    def _rate(self, by: Tensor, window: Window) -> tuple[Tensor, Tensor, Tensor]:
        """Velocity, px/s, and middles and lengths (h, 1) of the rows' exposures, s."""
        starts, stops = self.readout.windows_of(window.top + np.arange(window.height))
        middle, lasting = ((starts + stops) / 2, stops - starts)
        rate = by / self.exposure_s.to(by) if self.readout.exposure_s else torch.zeros_like(by)
        longer = torch.from_numpy(lasting) + _follow(self.exposure_s)  # about the same middles
        return rate, torch.from_numpy(middle).to(by)[:, None], longer.to(by)[:, None]

    def along_path(self, window: Window, times: Floats) -> Tensor | None:
        """Positions (n, 2, h) on the path for a window's rows, at times (n,) in each row's exposure, -1/2 to 1/2."""
        if self.path is None:
            return None
        starts, stops = self.readout.windows_of(window.top + np.arange(window.height))
        at = (starts + stops) / 2 + np.multiply.outer(times, stops - starts)
        known, knots = self.path_track
        places = torch.from_numpy(np.stack([np.interp(at, known, along) for along in knots], 1))
        lasting_s = self.readout.exposure_s
        # The gradient by the exposure: its window's ends move, and with them the points of the path that are seen.
        if not lasting_s or not differentiable(self.exposure_s):
            return places
        during, _ = self.path.window(-lasting_s / 2, lasting_s / 2)
        rates = np.moveaxis(self.path.rates_px_s(at) * times[:, None], 0, 1)
        mean_px = np.array(self.path.origin_px(lasting_s))  # the places are about it
        rates -= (during[:, [0, -1]].mean(1) - mean_px)[:, None] / lasting_s
        return places + torch.from_numpy(rates) * _follow(self.exposure_s)

    def length_px(self, window: Window) -> Floats:
        """The longest path length (h,) within the exposure of each row of a window."""
        times, knots = self.path_track if self.flows else self.track
        gone = sums(np.hypot(*np.diff(knots)))
        starts, stops = self.readout.windows_of(window.top + np.arange(window.height))
        length = np.interp(stops, times, gone) - np.interp(starts, times, gone)
        if self.flows:
            length += self.even(window)[1].detach().square().sum(0).amax(-1).sqrt().double().cpu().numpy()
        return np.asarray(length)

    def extremes_px(self, window: Window) -> tuple[Floats, Floats]:
        """Least and largest displacement (2, h) in each row of a window; of a path over all rows."""
        base, along = (each.detach() for each in self.even(window))
        half = along.abs() / 2
        if differentiable(self.even_px):  # the slope along an axis on which nothing moves
            half = half.clamp_min(STILL_PX)
        starts, stops = self.readout.windows_of(window.top + np.arange(window.height))
        (times, knots), ends = self.path_track, (starts.min(), stops.max())
        within = knots[:, (times >= ends[0]) & (times <= ends[1])]
        places = np.concatenate([within, [np.interp(ends, times, along) for along in knots]], 1)
        least = (base - half).amin(-1).double().cpu().numpy() + places.min(1)[:, None]
        return least, (base + half).amax(-1).double().cpu().numpy() + places.max(1)[:, None]

    def range_px(self, window: Window) -> tuple[Floats, Floats]:
        """Least and largest displacement (x, y) in a window."""
        least, largest = self.extremes_px(window)
        return least.min(1), largest.max(1)

    def passed(self, rest: Window) -> Window:
        """The pixels that an object may cover during the exposure; ``rest``: those that it covers at mid-exposure."""
        if self.way == "rows":
            stretch(self.velocity_px_s[1], self.readout.row_s)
        covered, before = Window(0, 0, self.readout.rows, 1), None
        while covered != before:  # of all rows first, then of those that it comes to
            before, (low, high) = covered, self.range_px(covered._replace(left=0, width=1))
            left, top = (-spread_px(-along) for along in low.tolist())
            right, bottom = (spread_px(along) for along in high.tolist())
            height, width = max(1, rest.height + bottom - top), rest.width + right - left
            covered = Window(rest.top + top, rest.left + left, height, width)
        return covered

    @cached_property
    def parts(self) -> int:
        """Parts of each row's window, so many that in none anything goes far along rows and down them at once."""
        gone = sums(np.abs(np.diff(self.track[1])))
        starts, stops = self.readout.windows_s
        ends = (np.stack([np.interp(at, self.track[0], each) for each in gone]) for at in (stops, starts))
        # In n parts each axis moves by 1/n, so their product falls with n squared.
        return max(1, math.ceil(math.sqrt(float(np.subtract(*ends).prod(0).max()) / _AT_ONCE_PX2)))

    def mean_px(self, rows: Floats) -> Floats:
        """Mean displacement (2, n) in the windows of rows (n,), or of places between them."""
        (times, knots), (starts, stops) = self.track, self.readout.windows_of(rows)
        passed = sums((knots[:, 1:] + knots[:, :-1]) / 2 * np.diff(times))

        def until(at: Floats) -> Floats:
            knot = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
            return passed[:, knot] + (at - times[knot]) * (knots[:, knot] + self._places(at)) / 2

        lasting = stops - starts
        # Exposures of no length have no mean: there the place at that time counts.
        mean = (until(stops) - until(starts)) / np.maximum(lasting, 1e-9)
        return np.where(lasting > 1e-9, mean, self._places(starts))

    def _places(self, at: Floats) -> Floats:
        times, knots = self.track
        return np.stack([np.interp(at, times, along) for along in knots])

    def seen_rows(self, rows: Floats) -> Floats:
        """The rows r that show rows of the scene, on average over their exposure: r - y(r) = row."""
        low, high = self.range_px(Window(0, 0, self.readout.rows, 1))
        reach = math.ceil(max(high[1], -low[1])) + 1
        far = rows - rows.clip(
            -2 * reach, self.readout.rows + 2 * reach
        )  # all rows beyond move as the nearest one
        # Only rows near the picture are searched: boxes may lie anywhere.
        rows = rows - far
        grid = np.arange(math.floor(rows.min()) - reach, math.ceil(rows.max()) + reach + 1, 0.25)
        shown: Floats = far + np.interp(rows, np.maximum.accumulate(grid - self.mean_px(grid)[1]), grid)
        return shown

    def covered(self, boxes: Floats) -> Floats:
        """The boxes that boxes (N, 4), px between pixels' centres, sweep while their rows are exposed.

        At each time, the rows that are exposed show the part of a box that is there; rows beyond the picture are
        exposed as its last ones.
        """
        (begin, end), knots = self.readout.span_s, self.track[0]
        times = np.union1d(np.linspace(begin, end, _TIMES), knots[(knots > begin) & (knots < end)])
        # Rows in the order in which they are read, so that both times increase, as interpolation needs.
        down = 1 if self.readout.row_s > 0 else -1
        starts, stops = (each[::down] for each in self.readout.windows_s)
        rows, outside = np.arange(self.readout.rows)[::down], math.inf * down
        # At each time the rows from the first whose exposure is not over, to the last one that has begun.
        over = np.where(times <= stops[0], -outside, np.interp(times, stops, rows))
        begun = np.where(times >= starts[-1], outside, np.interp(times, starts, rows))
        first, last = np.minimum(over, begun), np.maximum(over, begun)
        x, y = self._places(times)
        swept = boxes.copy()
        for box in swept:
            left, top, right, bottom = box
            upper, lower = np.maximum(first, top + y), np.minimum(last, bottom + y)
            if (exposed := upper <= lower).any():
                across = x[exposed]
                box[:] = left + across.min(), upper[exposed].min(), right + across.max(), lower[exposed].max()
        return swept


def stretch(velocity_y_px_s: float, row_s: float) -> float:
    """Factor by which moving objects are stretched down the picture, and their blur too, 1 / (1 - v_y row_s).

    Raises ``ValueError`` where what is seen overtakes the readout.

    >>> stretch(velocity_y_px_s=2000.0, row_s=100e-6)  # falls 0.2 rows while a row is read
    1.25
    """
    if velocity_y_px_s * row_s >= 1:
        raise ValueError(
            f"velocity_px_s = {velocity_y_px_s:g} down: must be below {1 / row_s:g}, at which rows are read; "
            "else the picture is overtaken"
        )
    return 1 / (1 - velocity_y_px_s * row_s)


def _follow(value: Tensor) -> Tensor:
    """0, with the gradient of ``value``, in double precision on the CPU."""
    return (value - value.detach()).double().cpu()


def _carried(flow: Tensor, by_px: Tensor) -> Tensor:
    """A flow (2, H, W) at p as it is at p - by_px."""
    _, height, width = flow.shape
    x = torch.arange(width).to(flow) - by_px[0]
    y = torch.arange(height).to(flow)[:, None] - by_px[1]
    grid = torch.stack([2 * x / max(1, width - 1) - 1, 2 * y / max(1, height - 1) - 1], -1)
    carried: Tensor = functional.grid_sample(flow[None], grid[None], "bilinear", "border", align_corners=True)
    return carried[0]


def spread_px(along_px: float) -> int:
    """How far a blur reaches that displaces by so much, the tail of the band-limited line included.

    >>> spread_px(2.5), spread_px(0.0)  # the motion, and 8 px of tail
    (11, 0)
    """
    return math.ceil(along_px) + _TAIL_PX if abs(along_px) >= STILL_PX else 0
