"""Rows moved by numbers of pixels of their own, along and across, in pictures (B, C, H, W) of linear light.

Convention: x right, y down, px. Along rows by their transforms, of whatever is real; across by Lanczos's window of
twelve taps. Uniform motion v is blurred as if all rows were exposed together, and then warped: warped first, the blur
would have to be that of v T / (1 - v_y row_s). Rows that see parts of a path are blurred along and across by
these: exact but for what a path does along both at once, hence in as many parts of windows as leave little of that.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import Border, continued, extended
from blurnoise._core.threads import plain, side_by_side, threads_for
from blurnoise.blur import convolution, fourier, tiles
from blurnoise.blur.displacement import STILL_PX, Displacement, Floats, stretch
from blurnoise.camera.transfer import SHARP
from blurnoise.motion.trajectory import sums

Band = tuple[slice, slice, NDArray[Any]]
Taps = tuple[Tensor, Tensor]
Sides = tuple[int, int]
LOBES = 6  # of Lanczos's window: 12 taps, which keep 0.99 of 0.4 cycles/px
_MARGIN_PX = 64  # of a displaced row's tail, which falls as one over the distance
_CLOSING_PX = 32  # of the margin, at its end
_BEYOND_PX = 16  # rows of a continued picture: of the blur's ends, and of the taps
_STRIP = 1 << 16  # values of a strip of rows
_BLOCK = 32  # rows whose phases are a product
_TOGETHER = 16  # rows mixed at once: a product of matrices, of which half are zeros
_LONGEST_TAPS_PX = 256  # beyond that a transform is faster
_LEAST_SAMPLES = 16  # of a row's exposure, however little moves
_SAMPLES_PER_PX, _LONGEST_PX = 4, 4096.0  # of the way up and down; beyond that they thin out
_PHASES = 4096  # places within a pixel at which taps are known
_ROOM_PX = 64  # of a row's band-limited ends


def exposed(light: Tensor, moves: Displacement, border: Border) -> Tensor:
    """Pictures (B, C, H, W) of which each row is the mean of its own window; differentiable in the light.

    >>> from blurnoise.blur.displacement import Readout
    >>> step = torch.zeros(1, 1, 65, 4)
    >>> step[..., 32:, :] = 1.0
    >>> by = Displacement(torch.tensor([0.0, 8.0]), torch.tensor(1e-3), Readout(65, 0.0, 1e-3))
    >>> [round(float(exposed(step, by, "replicate")[0, 0, row, 0]), 1) for row in (24, 30, 40)]  # a ramp of 8 px
    [0.0, 0.3, 1.0]
    """
    (starts, stops), (time, (x_px, y_px)) = moves.readout.windows_s, moves.track
    across, down = np.abs(x_px).max() > STILL_PX, np.abs(y_px).max() > STILL_PX
    mean, parts = light, moves.parts
    for part in range(parts):
        lasting = (stops - starts) / parts
        part_light, windows_s = light, (starts + part * lasting, starts + (part + 1) * lasting)
        if down:
            part_light = mixed(part_light, *_window_taps(time, y_px, windows_s), border)
        if across:
            part_light = _rows_blurred(part_light, time, x_px, windows_s, border)
        mean = mean + part_light if part else part_light
    return mean / parts if parts > 1 else mean


def rolled(light: Tensor, moves: Displacement, border: Border) -> Tensor:
    """Pictures in uniform motion whose rows are read one after another; differentiable.

    Motion along rows is one transform of rows, motion down them a mean of rows. Otherwise the picture is continued
    before its blur. Raises as :func:`.displacement.stretch` does, and where the continued picture would be too large.

    >>> from blurnoise.blur.displacement import Readout
    >>> bar = torch.zeros(1, 1, 65, 32)
    >>> bar[..., 16] = 1.0
    >>> by = Displacement(torch.tensor([2.0, 0.0]), torch.tensor(1e-3), Readout(65, 62.5e-6, 1e-3))
    >>> seen = rolled(bar, by, "replicate")[0, 0]
    >>> [int(seen[row].argmax()) for row in (0, 32, 64)]  # 2000 px/s lean by 4 px each way in 2 ms
    [12, 16, 20]
    """
    from scipy.fft import next_fast_len

    (height, width), row_s, moved = light.shape[-2:], moves.readout.row_s, moves.even_px
    velocity = moved / moves.exposure_s
    stretch(float(velocity[1].detach()), row_s)
    tau = (torch.arange(height, dtype=torch.float64, device=light.device) - (height - 1) / 2) * row_s
    across, down = ((velocity.detach() * row_s).abs() * (height - 1) / 2 + moved.detach().abs() / 2).tolist()
    places, shift_px = -velocity[1] * tau, velocity[0] * tau
    on_numpy = plain(light, moved, moves.exposure_s)
    # Motion along rows keeps each row to itself: blur and displacement are one product in one transform of rows.
    if on_numpy and down <= STILL_PX:
        return shifted_rows(light, shift_px, border, float(moved[0]))
    if on_numpy and across <= STILL_PX and float(moved[1].abs()) <= _LONGEST_TAPS_PX:
        return exposed(light, moves, border)
    before = math.ceil(down) + _BEYOND_PX, math.ceil(across) + _MARGIN_PX
    spans = next_fast_len(height + 2 * before[0]), tiles.fast_length(width + 2 * before[1])
    tiles.limited_plane(
        lambda: f"displacement_px = {moved.tolist()}: rows read one after another need", *spans
    )
    taps = _lanczos_taps(before[0] + places)
    if on_numpy:
        return _at_once(light, moved, taps, shift_px, before, spans, border)
    plane = _closed(extended(light, before, spans, border))
    by = moved[None].expand(len(light), 2)
    plane = convolution.motion_blur(plane, by, method="transfer", border="circular")
    plane = shifted_rows(mixed(plane, *taps, "replicate"), shift_px, "circular", wraps=True)
    return plane[..., before[1] : before[1] + width].contiguous()


def _at_once(
    light: Tensor, moved: Tensor, taps: Taps, shift_px: Tensor, before: Sides, spans: Sides, border: Border
) -> Tensor:
    """The same between two transforms of rows: blurred there, and resampled and displaced while they are spectra.

    OpenCV packs the spectrum of a row as real 0, real 1, imaginary 1, ...: with a value before and one behind these
    are complex numbers, once the imaginary parts of the first and the last are 0.
    """
    from scipy.fft import fft, ifft

    (height, width), (high, wide) = light.shape[-2:], spans
    out = torch.empty_like(light, memory_format=torch.contiguous_format)
    sources, targets = light.detach().flatten(0, 1).numpy(), out.flatten(0, 1).numpy()
    kind, (x, y) = sources.dtype, moved.tolist()
    response = fourier.motion_response((x, y), spans, kind)
    wave = np.complex64 if kind == np.float32 else np.complex128
    phases = _row_phases(shift_px.numpy(), wide, wave) / wave(wide)
    bands = _bands(taps[0].numpy(), taps[1].numpy(), kind)

    def see(index: int) -> None:
        plane, waves = np.empty((high, wide), kind), np.empty((high, wide + 2), kind)
        resampled = np.empty((height, wide + 2), kind)
        continued(sources[index], plane, before, border)
        cv2.dft(_closed(plane), waves[:, 1:-1], cv2.DFT_ROWS)
        # From OpenCV's packing to complex numbers in place, with no copy of the plane.
        waves[:, 0] = waves[:, 1]
        waves[:, [1, -1]] = 0
        # Down the columns of the rows' spectra: a transform over both axes, stopped half-way.
        spectra = fft(waves.view(wave), axis=0, overwrite_x=True)
        spectra *= response
        spectra = ifft(spectra, axis=0, overwrite_x=True).view(kind)
        for rows, needed, band in bands:
            # A row of the picture is a mean of twelve rows of the blurred one, and so are their spectra.
            np.matmul(band, spectra[needed], out=resampled[rows])
        moved = resampled.view(wave)
        np.multiply(moved, phases, out=moved)
        resampled[:, 1] = resampled[:, 0]
        cv2.dft(resampled[:, 1:-1], plane[:height], cv2.DFT_ROWS | cv2.DFT_INVERSE)
        targets[index] = plane[:height, before[1] : before[1] + width]

    side_by_side(see, range(len(targets)), threads_for(light))
    return out


def shifted_rows(
    light: Tensor, shift_px: Tensor, border: Border, along_px: float = 0.0, *, wraps: bool = False
) -> Tensor:
    """Row i displaced to the right by shift_px (H,), by a phase: exact for what the samples hold.

    along_px: of an exposure in which all move, blurred by it in the same transform; of light on the CPU, without
    gradients. wraps: rows are continued and closed already, of a length that transforms like.

    >>> bars = torch.zeros(1, 1, 2, 8)
    >>> bars[..., 2] = 1.0
    >>> shifted_rows(bars, torch.tensor([0.0, 3.0], dtype=torch.float64), "constant")[0, 0].argmax(-1).tolist()
    [2, 5]
    """
    far = math.ceil(float(shift_px.detach().abs().max()) + abs(along_px) / 2)
    margin = 0 if wraps else _MARGIN_PX + far
    length = light.shape[-1] if wraps else tiles.fast_length(light.shape[-1] + 2 * margin)
    if not plain(light, shift_px):
        turn = torch.fft.rfftfreq(length, dtype=torch.float64).to(shift_px.device)
        phase = -2 * math.pi * shift_px[:, None] * turn
        factors = torch.polar(torch.ones_like(phase), phase)
        return times(light, factors, margin, length, border)
    packed = _phases(tuple(shift_px.tolist()), length, light.detach().numpy().dtype, along_px)
    return times(light, packed, margin, length, border)


def times(light: Tensor, factors: Tensor | NDArray[Any], margin: int, length: int, border: Border) -> Tensor:
    """Rows (H) times factors of a row of ``length`` L, ``margin`` before the picture: complex (H, L / 2 + 1), or
    (H, L) as OpenCV packs them, divided by L.

    >>> rows = torch.rand(1, 1, 2, 8, generator=torch.Generator().manual_seed(0))
    >>> twice = torch.full((2, 65), 2.0)  # a factor of 2 at every frequency of rows of 128 px
    >>> bool((times(rows, twice, 24, 128, "reflect") - 2 * rows).abs().max() < 1e-5)
    True
    """
    height, width = light.shape[-2:]
    if isinstance(factors, Tensor):
        kind = torch.complex64 if light.dtype == torch.float32 else torch.complex128
        plane = _closed(extended(light, (0, margin), (height, length), border))
        rows: Tensor = torch.fft.irfft(torch.fft.rfft(plane) * factors.to(kind), n=length)
        return rows[..., margin : margin + width].contiguous()
    out = torch.empty_like(light, memory_format=torch.contiguous_format)
    sources, targets = light.detach().flatten(0, 1).numpy(), out.flatten(0, 1).numpy()
    strip = max(1, _STRIP // length)

    def move(at: tuple[int, int]) -> None:
        index, top = at
        source, target = sources[index, top : top + strip], targets[index, top : top + strip]
        plane, spectrum = np.empty((2, len(source), length), factors.dtype)
        continued(source, plane, (0, margin), border)
        cv2.dft(_closed(plane), spectrum, cv2.DFT_ROWS)
        cv2.mulSpectrums(spectrum, factors[top : top + strip], cv2.DFT_ROWS, spectrum)
        cv2.dft(spectrum, plane, cv2.DFT_ROWS | cv2.DFT_INVERSE)
        target[:] = plane[:, margin : margin + width]

    jobs = [(index, top) for index in range(len(sources)) for top in range(0, height, strip)]
    side_by_side(move, jobs, threads_for(light))
    return out


def _closed(plane: Any) -> Any:
    """Cross-fade the end of each row into its start, which avoids ringing at the FFT's wrap-around.

    Modifies arrays, and copies tensors.
    """
    share = (1 - np.cos(np.pi * (np.arange(_CLOSING_PX) + 0.5) / _CLOSING_PX)) / 2
    last, first = plane[..., -_CLOSING_PX:], plane[..., :1]
    if isinstance(plane, Tensor):
        faded = last + (first - last) * torch.from_numpy(share).to(plane)
        return torch.cat([plane[..., :-_CLOSING_PX], faded], -1)
    last += (first - last) * share.astype(plane.dtype)
    return plane


@lru_cache(maxsize=4)
def _phases(shift_px: tuple[float, ...], length: int, kind: np.dtype[Any], along_px: float) -> NDArray[Any]:
    """Phases of rows' displacements, times a blur along them, packed, over the length; not to be written to."""
    phases = _row_phases(np.array(shift_px), length, np.complex64 if kind == np.float32 else np.complex128)
    packed = packed_factors(phases, length, kind)
    if along_px:
        packed *= fourier.row_factors((along_px, 0.0), SHARP, (1, length), kind) * length
    return packed


def packed_factors(factors: NDArray[Any], length: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Rows of factors at the frequencies of ``rfft``, as OpenCV packs them, divided by the length; that is even.

    >>> packed_factors(np.array([[1 + 0j, 2 + 3j, 4 + 0j]]), 4, np.dtype(np.float64)).tolist()
    [[0.25, 0.5, 0.75, 1.0]]
    """
    parts = np.ascontiguousarray(factors).view(factors.real.dtype)  # real, imaginary, real, ...
    packed = np.empty((len(factors), length), kind)
    packed[:, 0] = parts[:, 0]
    packed[:, 1:] = parts[:, 2:-1]
    packed /= length
    return packed


def _row_phases(shift_px: Floats, length: int, kind: type[np.complexfloating]) -> NDArray[Any]:
    """Phases (H, L / 2 + 1) of rows' displacements (H,): products of a few, where these grow evenly."""
    turn = -2j * np.pi * np.arange(length // 2 + 1) / length
    step = (shift_px[-1] - shift_px[0]) / max(1, len(shift_px) - 1)
    if np.abs(shift_px - shift_px[0] - step * np.arange(len(shift_px))).max() > 1e-9:
        return np.asarray(np.exp(np.outer(shift_px, turn)), kind)
    within = np.exp(np.outer(np.arange(min(_BLOCK, len(shift_px))) * step, turn)).astype(kind)
    blocks = np.exp(np.outer(shift_px[::_BLOCK], turn)).astype(kind)
    return np.asarray((blocks[:, None] * within).reshape(-1, len(turn))[: len(shift_px)])


def _lanczos_taps(shift_px: Tensor) -> tuple[Tensor, Tensor]:
    """First tap of each row, relative to the row, and tap weights to sample at i + shift_px (H,)."""
    whole = torch.floor(shift_px.detach())
    taps = torch.arange(1 - LOBES, LOBES + 1, dtype=torch.float64, device=shift_px.device)
    off = (shift_px - whole)[:, None] - taps
    weights = torch.where(off.abs() < LOBES, torch.sinc(off) * torch.sinc(off / LOBES), 0.0)
    return whole.long() + 1 - LOBES, weights / weights.sum(1, keepdim=True)


def _window_taps(time: Floats, y_px: Floats, windows_s: tuple[Floats, Floats]) -> tuple[Tensor, Tensor]:
    """First tap of each row, relative to the row, and tap weights averaged over its part of a path y_px (K,)."""
    starts, stops = windows_s
    gone = sums(np.abs(np.diff(y_px)))  # a vibration goes there and back
    longest = float((np.interp(stops, time, gone) - np.interp(starts, time, gone)).max())
    count = max(_LEAST_SAMPLES, math.ceil(_SAMPLES_PER_PX * min(longest, _LONGEST_PX)))
    at = starts[:, None] + (stops - starts)[:, None] * (np.arange(count) + 0.5) / count
    # In whole steps of 1/4096 px, whose taps are in a table: rounding moves a row by 1e-4 px at most.
    # Row i shows what was at i + position / _PHASES.
    position = np.rint(-_PHASES * np.interp(at, time, y_px)).astype(np.int64)
    whole, phase = np.divmod(position, _PHASES)
    first = whole.min(1)
    height, width = len(first), int((whole.max(1) - first).max()) + 2 * LOBES
    begins = whole - first[:, None] + width * np.arange(height)[:, None]
    places = begins[..., None] + np.arange(2 * LOBES)
    weights = np.bincount(places.ravel(), _tap_table()[phase].ravel(), height * width) / count
    return torch.from_numpy(first + 1 - LOBES), torch.from_numpy(weights.reshape(height, width))


@lru_cache(maxsize=1)
def _tap_table() -> Floats:
    """Lanczos's taps (n, 12) at places within a pixel."""
    _, weights = _lanczos_taps(torch.arange(_PHASES, dtype=torch.float64) / _PHASES)
    return np.asarray(weights.numpy())


def mixed(light: Tensor, first: Tensor, weights: Tensor, border: Border) -> Tensor:
    """Row i, as many as first: the sum over k of weights[i, k] times row i + first[i] + k.

    >>> rows = torch.tensor([[[[0.0], [10.0], [20.0]]]])
    >>> first, weights = torch.tensor([0, 0]), torch.tensor([[0.5, 0.5], [0.5, 0.5]], dtype=torch.float64)
    >>> mixed(rows, first, weights, "replicate").flatten().tolist()  # the means of rows 0 and 1, 1 and 2
    [5.0, 15.0]
    """
    (height, width), (count, taps) = light.shape[-2:], weights.shape
    begins = torch.arange(count, device=first.device) + first
    before, after = max(0, -int(begins.min())), max(0, int(begins.max()) + taps - height)
    plane = extended(light, (before, 0), (before + height + after, width), border)
    if not plain(light, weights):
        total = light.new_zeros(())
        rows = (begins + before).to(light.device)
        for tap, weight in enumerate(weights.to(light).unbind(1)):
            total = total + plane.index_select(-2, rows + tap) * weight[:, None]
        return total
    sources = plane.detach().contiguous().flatten(0, 1).numpy()
    out = light.new_empty(*light.shape[:2], count, width)
    targets = out.flatten(0, 1).numpy()

    def mix(at: tuple[int, Band]) -> None:  # a few rows at a time: a band of weights and the rows it needs
        index, (rows, needed, band) = at
        np.matmul(band, sources[index][needed], out=targets[index][rows])

    bands = _bands(first.numpy() + before, weights.numpy(), sources.dtype)
    side_by_side(mix, [(index, band) for index in range(len(targets)) for band in bands], threads_for(light))
    return out


def _bands(first: NDArray[Any], weights: Floats, kind: np.dtype[Any]) -> Sequence[Band]:
    """Taps (N, n) in bands of rows: the rows of a band, the rows that they need, and the weights."""
    count, taps = weights.shape
    begins = first + np.arange(count)
    bands = []
    for top in range(0, count, _TOGETHER):
        rows = slice(top, min(count, top + _TOGETHER))
        begin = int(begins[rows].min())
        needed = slice(begin, int(begins[rows].max()) + taps)
        band = np.zeros((rows.stop - top, needed.stop - begin), kind)
        band[np.arange(len(band))[:, None], begins[rows, None] - begin + np.arange(taps)] = weights[rows]
        bands.append((rows, needed, band))
    return bands


def _rows_blurred(
    light: Tensor, time: Floats, x_px: Floats, windows_s: tuple[Floats, Floats], border: Border
) -> Tensor:
    """Rows times the transfer functions of their own windows of a path x_px (K,), exact."""
    reach = math.ceil(float(np.abs(x_px).max()))
    side = tiles.fast_length(2 * reach + _ROOM_PX)
    margin = side // 2
    length = tiles.fast_length(light.shape[-1] + 2 * margin)
    _, f = fourier.frequencies((1, side))
    responses = fourier.joined(
        lambda fx, _: row_responses(fx, time, x_px, windows_s)[:, None], f, np.zeros(1), (1, side)
    )
    spread = np.fft.irfft(responses[:, 0], n=side)
    kernels = np.zeros((len(spread), length))
    kernels[:, (np.arange(side) + side // 2) % side - side // 2] = spread
    factors: NDArray[Any] = np.fft.rfft(kernels)
    if not plain(light):
        return times(light, torch.from_numpy(factors).to(light.device), margin, length, border)
    packed = packed_factors(factors, length, light.detach().numpy().dtype)
    return times(light, packed, margin, length, border)


def row_responses(
    f: Floats, time: Floats, x_px: Floats, windows_s: tuple[Floats, Floats]
) -> NDArray[np.complex128]:
    """(H, n): at frequencies f (n,), cycles/px, of the path x_px (K,) seen in each row's window; exact.

    The integral of exp(-2 pi i f x) up to any time, by segments, at a window's end less that at its start.

    >>> time, x_px, window = np.array([0.0, 1.0]), np.array([-2.0, 2.0]), (np.array([0.0]), np.array([1.0]))
    >>> abs(row_responses(np.array([0.0, 0.25]), time, x_px, window)).round(6).tolist()  # of 4 px
    [[1.0, 0.0]]
    """
    starts, stops = windows_s
    if not (stops > starts).any():
        return np.asarray(np.exp(-2j * np.pi * np.outer(np.interp(starts, time, x_px), f)))

    def segment(first: Floats, last: Floats, spent: Floats) -> NDArray[np.complex128]:
        wave = np.exp(-1j * np.pi * np.outer(first + last, f))
        return np.asarray(wave * np.sinc(np.outer(last - first, f)) * spent[:, None])

    whole = np.cumsum(segment(x_px[:-1], x_px[1:], np.diff(time)), axis=0)
    whole = np.concatenate([np.zeros((1, len(f))), whole])

    def until(at: Floats) -> NDArray[np.complex128]:
        knot = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
        return np.asarray(whole[knot] + segment(x_px[knot], np.interp(at, time, x_px), at - time[knot]))

    # Rows whose exposure has no length are seen at once; the tiny number only avoids 0 / 0.
    lasting = np.maximum(stops - starts, 1e-300)
    return (until(stops) - until(starts)) / lasting[:, None]


def translated(light: Tensor, shift_px: Tensor | Iterable[float], border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) displaced by (x, y) px, (2,) or (B, 2); ``light`` itself where that is nothing.

    Whole pixels are copied; the rest is a phase, exact for what the samples hold: beside a step that they do not
    resolve it rings. Differentiable in the light.

    >>> dot = torch.zeros(1, 1, 4, 6)
    >>> dot[..., 1, 2] = 1.0
    >>> translated(dot, (2.0, 1.0), "constant").nonzero().tolist()  # row 2, column 4
    [[0, 0, 2, 4]]
    """
    shifts = convolution.motions("displacement_px", shift_px, light).detach().tolist()
    if all(abs(along) < STILL_PX for shift in shifts for along in shift):
        return light
    pictures = zip(torch.split(light, 1), shifts, strict=True)
    return torch.cat(
        [_along_rows(_along_rows(each.mT, y, border).mT, x, border) for each, (x, y) in pictures]
    )


def _along_rows(light: Tensor, shift_px: float, border: Border) -> Tensor:
    (height, width), whole = light.shape[-2:], round(shift_px)
    rest = shift_px - whole
    before = max(0, whole) + (_MARGIN_PX if abs(rest) >= STILL_PX else 0)
    length = width + abs(whole) + 2 * (before - max(0, whole))
    plane = extended(light, (0, before), (height, length), border)
    if abs(rest) >= STILL_PX:
        turns = rest * torch.fft.rfftfreq(length, dtype=light.dtype, device=light.device)
        phases = torch.polar(torch.ones_like(turns), -2 * torch.pi * turns)
        plane = torch.fft.irfft(torch.fft.rfft(plane) * phases, n=length)
    return plane[..., before - whole : before - whole + width]
