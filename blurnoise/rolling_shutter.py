"""Rolling shutter: rows that are exposed one after another, in pictures (B, C, H, W) of linear light.

Convention: x right, y down, px; time 0 is mid-exposure of the middle row, (H - 1) / 2, so that the picture's centre
stays. Rows are read every ``row_s``, downwards > 0, upwards < 0. Row i is exposed from tau_i - T/2 to tau_i + T/2,
tau_i = (i - (H - 1) / 2) row_s; with global reset all begin together, and each ends ``row_s`` after the one before.

A picture in uniform motion v is first blurred, as if all rows were exposed together, and then :func:`warped`. (Warped
first, it would have to be blurred by v T / (1 - v_y row_s).) A picture that is blurred already, continued as its
border says, is not quite what is seen there: where rows are displaced by 1/64 px and more,
:mod:`blurnoise.rolled_motion` continues it before. In any other motion each row sees the path in its own window:
:func:`of_rows`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import fourier
from blurnoise._core.borders import Border, extended
from blurnoise._core.checks import finite
from blurnoise.moved_rows import (
    CLOSING_PX,
    LOBES,
    MARGIN_PX,
    STRIP,
    closing,
    ends,
    lanczos,
    packed_factors,
    resampled,
    rows_mixed,
    shifted_rows,
    times,
    times_packed,
)
from blurnoise.trajectory import Trajectory

Floats = NDArray[np.float64]
_STILL_PX = 1e-3  # motion across that is not worth its transform
_SPACING_PX = 1.0  # of sub-exposures, which err by transfer.motion_error of it at most
# of a row's exposure, however little moves: its window ends within a cell
_LEAST_CELLS, _LEAST_SAMPLES = 8, 16
_FINEST, _MOMENT = 8.0, 1e-9  # cells of 1/64 px are small enough; of the whole time, an instant
_SAMPLES_PER_PX, _LONGEST_PX = 4, 4096.0  # of the way up and down; beyond that they thin out
_PHASES = 256  # places within a pixel at which taps are computed, linear between them: to 1e-5
_ROOM_PX = 32  # of a row's band-limited ends


@dataclass(frozen=True)
class Readout:
    """When the rows of a picture are exposed, s: ``row_s`` as the module says, ``reset``: all begin together.

    first, of: those from that row on of a picture of so many rows; None: all of it.
    """

    rows: int
    row_s: float
    exposure_s: float
    reset: bool = False
    first: int = 0
    of: int | None = None

    @property
    def windows_s(self) -> tuple[Floats, Floats]:
        """Where each row's exposure begins and ends; of one beyond the picture that of the nearest."""
        last = (self.of or self.rows) - 1
        tau = ((self.first + np.arange(self.rows)).clip(0, last) - last / 2) * self.row_s
        if not self.reset:
            return tau - self.exposure_s / 2, tau + self.exposure_s / 2
        readout_s = last * abs(self.row_s)
        later = tau + readout_s / 2
        start = np.full_like(later, -(self.exposure_s + readout_s / 2) / 2)
        return start, start + self.exposure_s + later

    def middle_s(self, row: Floats) -> Floats:
        """When a row, or a place between rows, is read, less half an exposure."""
        return np.asarray((row - (self.rows - 1) / 2) * self.row_s)

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first exposure begins and the last ends."""
        starts, stops = self.windows_s
        return float(starts.min()), float(stops.max())

    @property
    def light(self) -> Floats:
        """The light of each row, in that of an exposure."""
        starts, stops = self.windows_s
        return (stops - starts) / self.exposure_s if self.exposure_s else np.ones(self.rows)


def stretch(velocity_y_px_s: float, row_s: float) -> float:
    """By how much what moves is taller in the picture, 1 / (1 - v_y row_s); its streak is longer by it, too.

    Raises ``ValueError`` where what is seen overtakes the readout.
    """
    if velocity_y_px_s * row_s >= 1:
        raise ValueError(
            f"velocity_px_s = {velocity_y_px_s:g} down: must be below {1 / row_s:g}, at which rows are read; "
            "else the picture is overtaken"
        )
    return 1 / (1 - velocity_y_px_s * row_s)


def warped(
    light: Tensor,
    velocity_px_s: Tensor | tuple[float, float],
    row_s: float,
    border: Border,
    *,
    middle: float | None = None,
) -> Tensor:
    """Pictures of which row i shows what was at (x - v_x tau_i, i - v_y tau_i); differentiable, in the velocity too.

    middle: the row that is read at time 0, by default the pictures' middle one. Light is not kept: what moves along
    with the readout is read longer. Raises as :func:`stretch` does.
    """
    velocity = torch.as_tensor(velocity_px_s, dtype=light.dtype, device=light.device)
    finite("velocity_px_s", velocity)
    stretch(float(velocity[1].detach()), row_s)
    height = light.shape[-2]
    still = (height - 1) / 2 if middle is None else middle
    tau = (torch.arange(height, dtype=torch.float64, device=light.device) - still) * row_s
    follows = torch.is_grad_enabled() and velocity.requires_grad
    readout_s = float(tau.abs().max())
    if follows or abs(float(velocity[1].detach())) * readout_s > _STILL_PX:
        light = resampled(light, -velocity[1] * tau, border)
    if follows or abs(float(velocity[0].detach())) * readout_s > _STILL_PX:
        light = shifted_rows(light, velocity[0] * tau, border)  # of rows as they are read, hence afterwards
    return light


def of_rows(
    light: Tensor, path: Trajectory, origin_px: tuple[float, float], readout: Readout, border: Border
) -> Tensor:
    """Each row exposed in its own window of a path, px from ``origin_px``; differentiable in the light.

    Along rows exactly, by their own transfer functions; across them by Lanczos's taps, integrated over the window;
    both at once by sub-exposures every pixel of the path, each for the rows whose windows hold it. Brightness
    follows the windows' lengths. Raises ``ValueError`` unless the path holds all windows.
    """
    brighter = readout.light
    light = mean_of_rows(light, path, origin_px, readout, border)
    return light * torch.from_numpy(brighter).to(light)[:, None] if (brighter != 1).any() else light


def mean_of_rows(
    light: Tensor, path: Trajectory, origin_px: tuple[float, float], readout: Readout, border: Border
) -> Tensor:
    """The same, each row's mean over its window."""
    knots, durations = path.window(*readout.span_s)
    time = readout.span_s[0] + np.concatenate([[0.0], np.cumsum(durations)])
    knots = knots - np.array(origin_px)[:, None]
    across, down = np.abs(knots).max(1)
    if across > _STILL_PX and down > _STILL_PX:
        light = _sub_exposed(light, time, knots, readout, border)
    elif across > _STILL_PX:
        light = _rows_blurred(light, time, knots[0], readout, border)
    elif down > _STILL_PX:
        light = rows_mixed(light, *_integrated_taps(time, knots[1], readout), border)
    return light


def whole_path(
    trajectory: Trajectory | None, velocity_px_s: tuple[float, float], readout: Readout
) -> Trajectory:
    """A trajectory over all of a readout, uniform motion added. Raises ``ValueError`` unless it holds all windows."""
    begin, end = readout.span_s
    half = max(-begin, end, readout.exposure_s / 2) + 1e-9
    straight = Trajectory.straight(velocity_px_s, 4 * half)  # boxes may lie beyond the picture
    if trajectory is None:
        return straight
    knots, durations = trajectory.window(begin, end)
    time = begin + np.concatenate([[0.0], np.cumsum(durations)])
    return Trajectory.of(time, knots + np.outer(velocity_px_s, time), trajectory.reference)


def _integrated_taps(time: Floats, y_px: Floats, readout: Readout) -> tuple[NDArray[np.int64], Floats]:
    """Where each row's taps begin, from itself, and their means over the row's window of a path y_px (K,)."""
    starts, stops = readout.windows_s
    gone = np.concatenate(
        [[0.0], np.cumsum(np.abs(np.diff(y_px)))]
    )  # there and back: a vibration goes further
    longest = float((np.interp(stops, time, gone) - np.interp(starts, time, gone)).max())
    count = max(_LEAST_SAMPLES, math.ceil(_SAMPLES_PER_PX * min(longest, _LONGEST_PX)))
    shares = (np.arange(count) + 0.5) / count
    at = starts[:, None] + (stops - starts)[:, None] * shares
    seen = -np.interp(at, time, y_px)  # what was at row i + seen is at row i
    low = np.floor(seen.min(1)).astype(np.int64)
    rows, span = readout.rows, int((np.floor(seen.max(1)) - low).max()) + 2
    fine = (seen - low[:, None]) * _PHASES
    place = fine.astype(np.int64)
    part = (fine - place).ravel()
    place = (place + span * _PHASES * np.arange(rows)[:, None]).ravel()
    spent = np.bincount(place, 1 - part, rows * span * _PHASES)
    spent += np.bincount(place + 1, part, rows * span * _PHASES)
    taps = lanczos(np.arange(_PHASES)[:, None] / _PHASES - np.arange(1 - LOBES, LOBES + 1))
    taps /= taps.sum(1, keepdims=True) * count
    spread = spent.reshape(rows, span, _PHASES) @ taps
    weights = np.zeros((rows, span + 2 * LOBES - 1))
    for tap in range(2 * LOBES):
        weights[:, tap : tap + span] += spread[..., tap]
    return low + 1 - LOBES, weights


def _rows_blurred(light: Tensor, time: Floats, x_px: Floats, readout: Readout, border: Border) -> Tensor:
    """Rows times the transfer functions of their own windows of a path x_px (K,), exact."""
    reach = math.ceil(float(np.abs(x_px).max()))
    side = fourier.fast_length(2 * reach + _ROOM_PX + 32)
    margin = side // 2
    length = fourier.fast_length(light.shape[-1] + 2 * margin)
    _, f = fourier.frequencies((1, side))

    def motion(fx: Floats, fy: Floats) -> NDArray[np.complex128]:
        return row_responses(fx, time, x_px, readout)[:, None]

    spread = np.fft.irfft(fourier.joined(motion, f, np.zeros(1), (1, side))[:, 0], n=side)
    rows = np.zeros((readout.rows, length))
    rows[:, (np.arange(side) + side // 2) % side - side // 2] = spread
    factors = np.fft.rfft(rows)
    if light.device.type != "cpu" or (torch.is_grad_enabled() and light.requires_grad):
        return times(light, torch.from_numpy(factors).to(light.device), margin, length, border)
    return times_packed(light, packed_factors(factors, length, light.detach().numpy().dtype), margin, border)


def row_responses(f: Floats, time: Floats, x_px: Floats, readout: Readout) -> NDArray[np.complex128]:
    """(H, n): at frequencies f (n,), cycles/px, of the path x_px (K,) seen in each row's window; exact.

    The integral of exp(-2 pi i f x) up to any time, by segments, at a window's end less that at its start.
    """
    starts, stops = readout.windows_s
    if readout.exposure_s == 0 and not readout.reset:
        return np.asarray(np.exp(-2j * np.pi * np.outer(np.interp(starts, time, x_px), f)))

    def segment(first: Floats, last: Floats, spent: Floats) -> NDArray[np.complex128]:
        wave = np.exp(-1j * np.pi * np.outer(first + last, f))
        return np.asarray(wave * np.sinc(np.outer(last - first, f)) * spent[:, None])

    whole = np.cumsum(segment(x_px[:-1], x_px[1:], np.diff(time)), axis=0)
    whole = np.concatenate([np.zeros((1, len(f))), whole])

    def until(at: Floats) -> NDArray[np.complex128]:
        knot = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
        return np.asarray(whole[knot] + segment(x_px[knot], np.interp(at, time, x_px), at - time[knot]))

    lasting = np.maximum(stops - starts, 1e-300)
    return (until(stops) - until(starts)) / lasting[:, None]


def _sub_exposed(light: Tensor, time: Floats, knots: Floats, readout: Readout, border: Border) -> Tensor:
    """Cells of time at whose middle the picture is displaced, weighted by what of them each row's window holds.

    Along rows by a phase, so that rows are transformed once and back once; across them by Lanczos's taps.
    """
    starts, stops = readout.windows_s
    moment = _MOMENT * (time[-1] - time[0])  # an exposure of no length sees what there is then
    starts, stops = starts - moment, stops + moment
    steps = np.hypot(*np.diff(knots)) / _SPACING_PX
    least = np.minimum(np.diff(time) / (stops - starts).min(), _FINEST * steps) * _LEAST_CELLS
    gone = np.concatenate([[0.0], np.cumsum(np.maximum(steps, least))])
    edges = np.interp(np.linspace(0, gone[-1], math.ceil(gone[-1]) + 1), gone, time)
    held = np.minimum(edges[1:], stops[:, None]) - np.maximum(edges[:-1], starts[:, None])
    held = held.clip(0.0)
    held /= held.sum(1, keepdims=True)  # (rows, cells)
    x, y = (np.interp((edges[1:] + edges[:-1]) / 2, time, along) for along in knots)

    (height, width), kind = light.shape[-2:], light.dtype
    first = np.floor(-y).astype(np.int64) + 1 - LOBES  # of the taps, from a row
    taps = lanczos(-y[:, None] - first[:, None] - np.arange(2 * LOBES))
    taps /= taps.sum(1, keepdims=True)
    before, after = ends(first, 2 * LOBES)
    margin = MARGIN_PX + math.ceil(float(np.abs(x).max()))
    length = fourier.fast_length(width + 2 * margin)
    if (before + height + after) * length > fourier.LARGEST_PLANE:
        raise ValueError(
            f"trajectory: goes {np.abs(x).max():.4g}, {np.abs(y).max():.4g} px from where it is shown; needs "
            f"a plane of {before + height + after}x{length} pixels, at most {fourier.LARGEST_PLANE} are allowed"
        )
    plane = extended(light, (before, margin), (before + height + after, length), border)
    spectra = torch.fft.rfft(torch.cat([plane[..., :-CLOSING_PX], closing(plane)], -1))
    phases = torch.from_numpy(np.exp(-2j * np.pi * np.outer(x, np.fft.rfftfreq(length)))).to(spectra)
    weights = torch.from_numpy(held).to(device=light.device, dtype=kind)
    strips, strip = [], max(1, STRIP // (4 * length))
    for top in range(0, height, strip):
        bottom = min(height, top + strip)
        (cells,) = np.nonzero(held[top:bottom].any(0))
        total = torch.zeros_like(spectra[..., top:bottom, :])
        for cell in cells.tolist():
            begin = before + top + int(first[cell])
            seen = torch.zeros_like(total)
            for tap, weight in enumerate(taps[cell].tolist()):
                seen = seen.add(spectra[..., begin + tap : begin + tap + bottom - top, :], alpha=weight)
            total = total + seen * phases[cell] * weights[top:bottom, cell, None]
        strips.append(torch.fft.irfft(total, n=length)[..., margin : margin + width])
    return torch.cat(strips, -2)
