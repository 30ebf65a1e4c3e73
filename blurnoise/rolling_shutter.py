"""Rolling shutter: rows that are exposed one after another, in pictures (B, C, H, W) of linear light.

Convention: x right, y down, px; time 0 is mid-exposure of the middle row, (H - 1) / 2, so that the picture's centre
stays. Rows are read every ``row_s``, downwards > 0, upwards < 0. Row i is exposed from tau_i - T/2 to tau_i + T/2,
tau_i = (i - (H - 1) / 2) row_s; with global reset all begin together, and each ends ``row_s`` after the one before.

A picture in uniform motion v is first blurred, as if all rows were exposed together, and then :func:`warped`. (Warped
first, it would have to be blurred by v T / (1 - v_y row_s).) Else each row sees the path in its own window:
:func:`of_rows`. A picture that is blurred already, continued as its border says, is not quite what is seen there:
where rows are displaced by a pixel and more, it is continued before, :func:`blurred_and_warped`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import blur, fourier
from blurnoise._core.borders import Border, continued, extended, index_of
from blurnoise._core.checks import finite
from blurnoise._core.scratch import borrowed
from blurnoise._core.threads import WORTH_IT, side_by_side
from blurnoise.trajectory import Trajectory
from blurnoise.transfer import SHARP

Floats = NDArray[np.float64]
_LOBES = 6  # of Lanczos's window: 12 taps, which keep 0.99 of 0.4 cycles/px
_MARGIN_PX = 64  # of a displaced row's tail, which falls as one over the distance
_CLOSING_PX = 32  # of the margin, at its end
_STILL_PX = 1e-3  # motion across that is not worth its transform
_STRIP = 1 << 16  # values of a strip of rows
_BEYOND_PX = 8  # of a continued picture's blur, whose ends fall off
_SPACING_PX = 1.0  # of sub-exposures, which err by transfer.motion_error of it at most
# of a row's exposure, however little moves: its window ends within a cell
_LEAST_CELLS, _LEAST_SAMPLES = 8, 16
_FINEST, _MOMENT = 8.0, 1e-9  # cells of 1/64 px are small enough; of the whole time, an instant
_SAMPLES_PER_PX, _LONGEST_PX = 4, 4096.0  # of the way up and down; beyond that they thin out
_PHASES = 256  # places within a pixel at which taps are computed, linear between them: to 1e-5
_ROOM_PX = 32  # of a row's band-limited ends
_BLOCK = 32  # rows whose phases are a product
_TOGETHER = 16  # rows mixed at once: a product of matrices, of which half are zeros


@dataclass(frozen=True)
class Readout:
    """When the rows of a picture are exposed, s: ``row_s`` as the module says, ``reset``: all begin together."""

    rows: int
    row_s: float
    exposure_s: float
    reset: bool = False

    @property
    def windows_s(self) -> tuple[Floats, Floats]:
        """Where each row's exposure begins and ends."""
        tau = self.middle_s(np.arange(self.rows, dtype=np.float64))
        if not self.reset:
            return tau - self.exposure_s / 2, tau + self.exposure_s / 2
        later = tau - tau.min()
        start = np.full_like(later, -(self.exposure_s + later.max() / 2) / 2)
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
        light = _resampled(light, -velocity[1] * tau, border)
    if follows or abs(float(velocity[0].detach())) * readout_s > _STILL_PX:
        light = shifted_rows(light, velocity[0] * tau, border)  # of rows as they are read, hence afterwards
    return light


def along_rows(velocity_px_s: tuple[float, float], lasting_s: float) -> bool:
    """Whether motion is along rows alone, for as long as it matters, so that :func:`blurred_rows` serves."""
    return velocity_px_s[0] != 0 and abs(velocity_px_s[1]) * lasting_s <= _STILL_PX


def blurred_rows(
    light: Tensor, displacement_px: Tensor, exposure_s: Tensor, row_s: float, border: Border
) -> Tensor:
    """Pictures (B, C, H, W) blurred and :func:`warped` by motion along rows, (2,) px in an exposure (): at once."""
    velocity = displacement_px / exposure_s
    asked = (light, displacement_px, exposure_s)
    if light.device.type != "cpu" or (torch.is_grad_enabled() and any(each.requires_grad for each in asked)):
        blurred = blur.motion_blur(light, displacement_px[None].expand(len(light), 2), border=border)
        return warped(blurred, velocity, row_s, border)
    tau = (torch.arange(light.shape[-2], dtype=torch.float64) - (light.shape[-2] - 1) / 2) * row_s
    return shifted_rows(light, velocity[0] * tau, border, float(displacement_px[0]))


def blurred_and_warped(
    light: Tensor, displacement_px: Tensor, exposure_s: Tensor, row_s: float, border: Border
) -> Tensor:
    """Pictures (B, C, H, W) blurred and :func:`warped` by uniform motion, (2,) px in an exposure (): continued first.

    What the rows bring in from beyond the border is then what was blurred there.
    """
    velocity = displacement_px / exposure_s
    height, width = light.shape[-2:]
    skewed, along = ((velocity * row_s).detach().abs() * (height - 1) / 2).tolist(), displacement_px.tolist()
    across, down = (
        math.ceil(skew + abs(by) / 2) + _BEYOND_PX for skew, by in zip(skewed, along, strict=True)
    )
    own = border == "circular" or (border == "reflect" and skewed[0] <= _STILL_PX)
    spans = (height, width) if own else (height + 2 * down, width + 2 * across)
    if spans[0] * spans[1] > fourier.LARGEST_PLANE:
        raise ValueError(
            f"displacement_px = {along}: rows that are read one after another need a plane of "
            f"{spans[0]}x{spans[1]} pixels; at most {fourier.LARGEST_PLANE} are allowed"
        )
    beyond: Border = border if own else "replicate"
    plane = light if own else extended(light, (down, across), spans, border)
    moved = displacement_px[None].expand(len(light), 2)
    seen = blur.exposure_blur(plane, moved, SHARP, border=beyond)
    if own:
        return warped(seen, velocity, row_s, border)
    seen = warped(seen, torch.stack([velocity[0] * 0, velocity[1]]), row_s, beyond)[
        ..., down : down + height, :
    ]
    tau = (torch.arange(height, dtype=torch.float64, device=light.device) - (height - 1) / 2) * row_s
    seen = shifted_rows(seen, velocity[0] * tau, beyond, known_px=across)
    return seen[..., across : across + width].contiguous()


def shifted_rows(
    light: Tensor, shift_px: Tensor, border: Border, along_px: float = 0.0, *, known_px: int = 0
) -> Tensor:
    """Row i displaced to the right by shift_px (H,), by a phase: exact for what the samples hold.

    along_px: of an exposure in which all move, blurred by it in the same transform; of light on the CPU, without
    gradients. known_px: of either end that is not asked for.
    """
    far = math.ceil(float(shift_px.detach().abs().max()) + abs(along_px) / 2)
    margin = max(_CLOSING_PX, _MARGIN_PX - known_px) + far
    length = fourier.fast_length(light.shape[-1] + 2 * margin)
    if light.device.type != "cpu" or (
        torch.is_grad_enabled() and (light.requires_grad or shift_px.requires_grad)
    ):
        phase = (
            -2
            * math.pi
            * shift_px[:, None]
            * torch.fft.rfftfreq(length, dtype=torch.float64).to(shift_px.device)
        )
        factors = torch.polar(torch.ones_like(phase), phase)
        return _times(light, factors, margin, length, border)
    packed = _phases(tuple(shift_px.tolist()), length, light.detach().numpy().dtype, along_px)
    return _times_packed(light, packed, margin, border)


def of_rows(
    light: Tensor, path: Trajectory, origin_px: tuple[float, float], readout: Readout, border: Border
) -> Tensor:
    """Each row exposed in its own window of a path, px from ``origin_px``; differentiable in the light.

    Along rows exactly, by their own transfer functions; across them by Lanczos's taps, integrated over the window;
    both at once by sub-exposures every pixel of the path, each for the rows whose windows hold it. Brightness
    follows the windows' lengths. Raises ``ValueError`` unless the path holds all windows.
    """
    knots, durations = path.window(*readout.span_s)
    time = readout.span_s[0] + np.concatenate([[0.0], np.cumsum(durations)])
    knots = knots - np.array(origin_px)[:, None]
    across, down = np.abs(knots).max(1)
    if across > _STILL_PX and down > _STILL_PX:
        light = _sub_exposed(light, time, knots, readout, border)
    elif across > _STILL_PX:
        light = _rows_blurred(light, time, knots[0], readout, border)
    elif down > _STILL_PX:
        light = _rows_mixed(light, *_integrated_taps(time, knots[1], readout), border)
    brighter = readout.light
    return light * torch.from_numpy(brighter).to(light)[:, None] if (brighter != 1).any() else light


def lanczos(x: Any) -> Any:
    """Lanczos's window of six lobes, of an array or a tensor."""
    if isinstance(x, Tensor):
        return torch.where(x.abs() < _LOBES, torch.sinc(x) * torch.sinc(x / _LOBES), torch.zeros_like(x))
    return np.where(np.abs(x) < _LOBES, np.sinc(x) * np.sinc(x / _LOBES), 0.0)


def _times(light: Tensor, factors: Tensor, margin: int, length: int, border: Border) -> Tensor:
    """Rows (H) times factors (H, L / 2 + 1) of a row of ``length``."""
    height, width = light.shape[-2:]
    kind = torch.complex64 if light.dtype == torch.float32 else torch.complex128
    plane = extended(light, (0, margin), (height, length), border)
    plane = torch.cat([plane[..., :-_CLOSING_PX], _closing(plane)], -1)
    rows: Tensor = torch.fft.irfft(torch.fft.rfft(plane) * factors.to(kind), n=length)
    return rows[..., margin : margin + width].contiguous()


def _closing(plane: Any) -> Any:
    """The last px of rows, led to the first: a step where a row wraps round would ring into the picture."""
    share = (1 - np.cos(np.pi * (np.arange(_CLOSING_PX) + 0.5) / _CLOSING_PX)) / 2
    last, first = plane[..., -_CLOSING_PX:], plane[..., :1]
    if isinstance(plane, Tensor):
        return last + (first - last) * torch.from_numpy(share).to(plane)
    return last + (first - last) * share.astype(plane.dtype)


def _times_packed(light: Tensor, factors: NDArray[Any], margin: int, border: Border) -> Tensor:
    """The same by OpenCV's transform, strip by strip; factors (H, L), packed and divided by L."""
    out = torch.empty_like(light, memory_format=torch.contiguous_format)
    sources, targets = light.detach().flatten(0, 1).numpy(), out.flatten(0, 1).numpy()
    (height, width), length = light.shape[-2:], factors.shape[1]
    strip = max(1, _STRIP // length)

    def move(at: tuple[int, int]) -> None:
        place, top = at
        source, target = sources[place, top : top + strip], targets[place, top : top + strip]
        with borrowed([(len(source), length)] * 2, factors.dtype) as (plane, spectrum):
            continued(source, plane, (0, margin), border)
            plane[:, -_CLOSING_PX:] = _closing(plane)
            cv2.dft(plane, spectrum, cv2.DFT_ROWS)
            cv2.mulSpectrums(spectrum, factors[top : top + strip], cv2.DFT_ROWS, spectrum)
            cv2.dft(spectrum, plane, cv2.DFT_ROWS | cv2.DFT_INVERSE)
            target[:] = plane[:, margin : margin + width]

    threads = torch.get_num_threads() if light.numel() >= WORTH_IT else 1
    side_by_side(
        move, [(place, top) for place in range(len(sources)) for top in range(0, height, strip)], threads
    )
    return out


@lru_cache(maxsize=4)
def _phases(shift_px: tuple[float, ...], length: int, kind: np.dtype[Any], along_px: float) -> NDArray[Any]:
    """Packed phases of rows' displacements, times a blur along them: products of a few, where these grow evenly; not
    to be written to."""
    shifts = np.array(shift_px)
    turn = -2j * np.pi * np.arange(length // 2 + 1) / length
    step = (shifts[-1] - shifts[0]) / max(1, len(shifts) - 1)
    if np.abs(shifts - shifts[0] - step * np.arange(len(shifts))).max() > 1e-9:
        return _spread(_packed(np.exp(np.outer(shifts, turn)), length, kind), along_px)
    within = np.exp(np.outer(np.arange(min(_BLOCK, len(shifts))) * step, turn))
    blocks = np.exp(np.outer(shifts[::_BLOCK], turn))
    phases = (blocks[:, None] * within).reshape(-1, len(turn))[: len(shifts)]
    return _spread(_packed(phases, length, kind), along_px)


def _spread(packed: NDArray[Any], along_px: float) -> NDArray[Any]:
    """Packed factors (H, L) times the transfer function of motion along rows, in their place."""
    if along_px:
        packed *= fourier.row_factors(along_px, packed.shape[1], packed.dtype) * packed.shape[1]
    return packed


def _packed(factors: NDArray[np.complex128], length: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Rows of factors at the frequencies of ``rfft``, as OpenCV packs them; length even."""
    packed = np.empty((len(factors), length), kind)
    packed[:, 0], packed[:, -1] = factors[:, 0].real, factors[:, -1].real
    packed[:, 1:-1:2], packed[:, 2:-1:2] = factors[:, 1:-1].real, factors[:, 1:-1].imag
    packed /= length
    return packed


def _resampled(light: Tensor, shift_px: Tensor, border: Border) -> Tensor:
    """Row i as seen at i + shift_px (H,), between rows by Lanczos's taps."""
    whole = torch.floor(shift_px.detach())
    taps = torch.arange(1 - _LOBES, _LOBES + 1, dtype=torch.float64, device=light.device)
    weights = lanczos((shift_px - whole)[:, None] - taps)
    weights = weights / weights.sum(1, keepdim=True)
    first = whole.long() + 1 - _LOBES
    follows = torch.is_grad_enabled() and (light.requires_grad or weights.requires_grad)
    if follows or light.device.type != "cpu":
        return _gathered(light, first, weights, border)
    return _rows_mixed(light, first.numpy(), weights.numpy(), border)


def _gathered(light: Tensor, first: Tensor, weights: Tensor, border: Border) -> Tensor:
    """Row i: the sum over k of weights[i, k] times row i + first[i] + k."""
    height, width = light.shape[-2:]
    before, after = _ends(
        first.numpy() if first.device.type == "cpu" else first.cpu().numpy(), weights.shape[1]
    )
    plane = extended(light, (before, 0), (before + height + after, width), border)
    rows = torch.arange(height, device=light.device) + first + before
    total = torch.zeros_like(light)
    for tap, weight in enumerate(weights.to(light).unbind(1)):
        total = total + plane.index_select(-2, rows + tap) * weight[:, None]
    return total


def _rows_mixed(light: Tensor, first: NDArray[Any], weights: NDArray[Any], border: Border) -> Tensor:
    """As :func:`_gathered`, a few rows at a time as the product of a band of weights and the rows it needs."""
    if light.device.type != "cpu" or (torch.is_grad_enabled() and light.requires_grad):
        return _gathered(light, torch.from_numpy(first).to(light.device), torch.from_numpy(weights), border)
    height, taps = light.shape[-2], weights.shape[1]
    sources = light.detach().contiguous().flatten(0, 1).numpy()
    out = torch.empty_like(light, memory_format=torch.contiguous_format)
    targets = out.flatten(0, 1).numpy()
    before, after = _ends(first, taps)
    inside = index_of(height, before, before + height + after, border).numpy()
    bands = []
    for top in range(0, height, _TOGETHER):
        rows = slice(top, top + _TOGETHER)
        places = before + first[rows] + np.arange(height)[rows]
        begin, end = int(places.min()), int(places.max()) + taps
        band = np.zeros((len(places), end - begin))
        np.put_along_axis(band, places[:, None] - begin + np.arange(taps), weights[rows], 1)
        shown = inside[begin:end]  # rows that the border shows count where they are
        if border == "constant":
            band[:, (np.arange(begin, end) < before) | (np.arange(begin, end) >= before + height)] = 0
        needed = slice(int(shown.min()), int(shown.max()) + 1)
        folded = np.zeros((needed.stop - needed.start, len(places)), sources.dtype)
        np.add.at(folded, shown - needed.start, band.T)
        bands.append((rows, needed, np.ascontiguousarray(folded.T)))

    def mix(at: tuple[int, tuple[slice, slice, NDArray[Any]]]) -> None:
        place, (rows, needed, band) = at
        np.matmul(band, sources[place, needed], out=targets[place, rows])

    threads = torch.get_num_threads() if light.numel() >= WORTH_IT else 1
    side_by_side(mix, [(place, band) for place in range(len(targets)) for band in bands], threads)
    return out


def _ends(first: NDArray[Any], taps: int) -> tuple[int, int]:
    """Rows needed above and below a picture."""
    return max(0, -int(first.min())), max(0, int(first.max()) + taps - 1)


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
    taps = lanczos(np.arange(_PHASES)[:, None] / _PHASES - np.arange(1 - _LOBES, _LOBES + 1))
    taps /= taps.sum(1, keepdims=True) * count
    spread = spent.reshape(rows, span, _PHASES) @ taps
    weights = np.zeros((rows, span + 2 * _LOBES - 1))
    for tap in range(2 * _LOBES):
        weights[:, tap : tap + span] += spread[..., tap]
    return low + 1 - _LOBES, weights


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
        return _times(light, torch.from_numpy(factors).to(light.device), margin, length, border)
    return _times_packed(light, _packed(factors, length, light.detach().numpy().dtype), margin, border)


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
    first = np.floor(-y).astype(np.int64) + 1 - _LOBES  # of the taps, from a row
    taps = lanczos(-y[:, None] - first[:, None] - np.arange(2 * _LOBES))
    taps /= taps.sum(1, keepdims=True)
    before, after = _ends(first, 2 * _LOBES)
    margin = _MARGIN_PX + math.ceil(float(np.abs(x).max()))
    length = fourier.fast_length(width + 2 * margin)
    if (before + height + after) * length > fourier.LARGEST_PLANE:
        raise ValueError(
            f"trajectory: goes {np.abs(x).max():.4g}, {np.abs(y).max():.4g} px from where it is shown; needs "
            f"a plane of {before + height + after}x{length} pixels, at most {fourier.LARGEST_PLANE} are allowed"
        )
    plane = extended(light, (before, margin), (before + height + after, length), border)
    spectra = torch.fft.rfft(torch.cat([plane[..., :-_CLOSING_PX], _closing(plane)], -1))
    phases = torch.from_numpy(np.exp(-2j * np.pi * np.outer(x, np.fft.rfftfreq(length)))).to(spectra)
    weights = torch.from_numpy(held).to(device=light.device, dtype=kind)
    strips, strip = [], max(1, _STRIP // (4 * length))
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
