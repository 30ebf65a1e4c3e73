"""Rows moved by numbers of pixels of their own, along and across, in pictures (B, C, H, W) of linear light.

Convention: x right, y down, px. Along rows by their transforms, of whatever is real; across by Lanczos's window of
twelve taps, by its mean over what a row passes (:func:`swept_taps`), or by taps that are given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import fourier
from blurnoise._core.borders import Border, continued, extended, index_of
from blurnoise._core.scratch import borrowed
from blurnoise._core.threads import WORTH_IT, side_by_side

Floats = NDArray[np.float64]
Band = tuple[slice, slice, NDArray[Any]]
LOBES = 6  # of Lanczos's window: 12 taps, which keep 0.99 of 0.4 cycles/px
MARGIN_PX = 64  # of a displaced row's tail, which falls as one over the distance
CLOSING_PX = 32  # of the margin, at its end
STRIP = 1 << 16  # values of a strip of rows
_BLOCK = 32  # rows whose phases are a product
_TOGETHER = 16  # rows mixed at once: a product of matrices, of which half are zeros
_STILL_PX = 1e-3  # passed by a row that is as good as in its place
_FINE = 4096  # places within a pixel at which the window's integral is known


def shifted_rows(
    light: Tensor, shift_px: Tensor, border: Border, along_px: float = 0.0, *, wraps: bool = False
) -> Tensor:
    """Row i displaced to the right by shift_px (H,), by a phase: exact for what the samples hold.

    along_px: of an exposure in which all move, blurred by it in the same transform; of light on the CPU, without
    gradients. wraps: rows are continued and closed already, of a length that transforms like.
    """
    far = math.ceil(float(shift_px.detach().abs().max()) + abs(along_px) / 2)
    margin = 0 if wraps else MARGIN_PX + far
    length = light.shape[-1] if wraps else fourier.fast_length(light.shape[-1] + 2 * margin)
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
        return times(light, factors, margin, length, border)
    packed = _phases(tuple(shift_px.tolist()), length, light.detach().numpy().dtype, along_px)
    return times_packed(light, packed, margin, border)


def lanczos(x: Any) -> Any:
    """Lanczos's window of six lobes, of an array or a tensor."""
    if isinstance(x, Tensor):
        return torch.where(x.abs() < LOBES, torch.sinc(x) * torch.sinc(x / LOBES), torch.zeros_like(x))
    return np.where(np.abs(x) < LOBES, np.sinc(x) * np.sinc(x / LOBES), 0.0)


def times(light: Tensor, factors: Tensor, margin: int, length: int, border: Border) -> Tensor:
    """Rows (H) times factors (H, L / 2 + 1) of a row of ``length``."""
    height, width = light.shape[-2:]
    kind = torch.complex64 if light.dtype == torch.float32 else torch.complex128
    plane = extended(light, (0, margin), (height, length), border)
    plane = torch.cat([plane[..., :-CLOSING_PX], closing(plane)], -1)
    rows: Tensor = torch.fft.irfft(torch.fft.rfft(plane) * factors.to(kind), n=length)
    return rows[..., margin : margin + width].contiguous()


def closing(plane: Any) -> Any:
    """The last px of rows, led to the first: a step where a row wraps round would ring into the picture."""
    share = (1 - np.cos(np.pi * (np.arange(CLOSING_PX) + 0.5) / CLOSING_PX)) / 2
    last, first = plane[..., -CLOSING_PX:], plane[..., :1]
    if isinstance(plane, Tensor):
        return last + (first - last) * torch.from_numpy(share).to(plane)
    return last + (first - last) * share.astype(plane.dtype)


def times_packed(light: Tensor, factors: NDArray[Any], margin: int, border: Border) -> Tensor:
    """The same by OpenCV's transform, strip by strip; factors (H, L), packed and divided by L."""
    out = torch.empty_like(light, memory_format=torch.contiguous_format)
    sources, targets = light.detach().flatten(0, 1).numpy(), out.flatten(0, 1).numpy()
    (height, width), length = light.shape[-2:], factors.shape[1]
    strip = max(1, STRIP // length)

    def move(at: tuple[int, int]) -> None:
        place, top = at
        source, target = sources[place, top : top + strip], targets[place, top : top + strip]
        with borrowed([(len(source), length)] * 2, factors.dtype) as (plane, spectrum):
            continued(source, plane, (0, margin), border)
            plane[:, -CLOSING_PX:] = closing(plane)
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
    """Packed phases of rows' displacements, times a blur along them; not to be written to."""
    phases = row_phases(np.array(shift_px), length, np.complex64 if kind == np.float32 else np.complex128)
    return _spread(packed_factors(phases, length, kind), along_px)


def row_phases(shift_px: Floats, length: int, kind: type[np.complexfloating] = np.complex128) -> NDArray[Any]:
    """Phases (H, L / 2 + 1) of rows' displacements (H,): products of a few, where these grow evenly."""
    turn = -2j * np.pi * np.arange(length // 2 + 1) / length
    step = (shift_px[-1] - shift_px[0]) / max(1, len(shift_px) - 1)
    if np.abs(shift_px - shift_px[0] - step * np.arange(len(shift_px))).max() > 1e-9:
        return np.asarray(np.exp(np.outer(shift_px, turn)), kind)
    within = np.exp(np.outer(np.arange(min(_BLOCK, len(shift_px))) * step, turn)).astype(kind)
    blocks = np.exp(np.outer(shift_px[::_BLOCK], turn)).astype(kind)
    return np.asarray((blocks[:, None] * within).reshape(-1, len(turn))[: len(shift_px)])


def _spread(packed: NDArray[Any], along_px: float) -> NDArray[Any]:
    """Packed factors (H, L) times the transfer function of motion along rows, in their place."""
    if along_px:
        packed *= fourier.row_factors(along_px, packed.shape[1], packed.dtype) * packed.shape[1]
    return packed


def packed_factors(factors: NDArray[Any], length: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Rows of factors at the frequencies of ``rfft``, as OpenCV packs them; length even."""
    parts = np.ascontiguousarray(factors).view(factors.real.dtype)  # real, imaginary, real, ...
    packed = np.empty((len(factors), length), kind)
    packed[:, 0] = parts[:, 0]
    packed[:, 1:] = parts[:, 2:-1]
    packed /= length
    return packed


def resampled(light: Tensor, shift_px: Tensor, border: Border) -> Tensor:
    """Row i as seen at i + shift_px, for every i of those, between rows by Lanczos's taps."""
    first, weights = lanczos_taps(shift_px)
    follows = torch.is_grad_enabled() and (light.requires_grad or weights.requires_grad)
    if follows or light.device.type != "cpu":
        return _gathered(light, first, weights, border)
    return rows_mixed(light, first.numpy(), weights.numpy(), border)


def lanczos_taps(shift_px: Tensor) -> tuple[Tensor, Tensor]:
    """Where each row's taps begin, from itself, to see it at i + shift_px (H,), and their weights."""
    whole = torch.floor(shift_px.detach())
    taps = torch.arange(1 - LOBES, LOBES + 1, dtype=torch.float64, device=shift_px.device)
    weights = lanczos((shift_px - whole)[:, None] - taps)
    weights = weights / weights.sum(1, keepdim=True)
    return whole.long() + 1 - LOBES, weights


def swept_taps(middle_px: Floats, along_px: float) -> tuple[NDArray[np.int64], Floats]:
    """Where each row's taps begin, from itself: means of Lanczos's window over along_px >= 0 about middle_px (H,).

    By the window's integral, a table linear to 1e-8 between its places: exact for any motion that is worth a blur.
    """
    first = np.floor(middle_px - along_px / 2).astype(np.int64) + 1 - LOBES
    off = first[:, None] - middle_px[:, None] + np.arange(math.ceil(along_px) + 2 * LOBES)
    if along_px < _STILL_PX:
        weights = lanczos(off)
    else:
        places, integral = _integral()
        far, near = (np.interp(off + by, places, integral) for by in (along_px / 2, -along_px / 2))
        weights = far - near
    return first, weights / weights.sum(1, keepdims=True)


@lru_cache(maxsize=1)
def _integral() -> tuple[Floats, Floats]:
    """Places over Lanczos's window, and its integral up to them."""
    places = np.linspace(-LOBES, LOBES, 2 * LOBES * _FINE + 1)
    values = lanczos(places)
    return places, np.concatenate([[0.0], np.cumsum(values[1:] + values[:-1])]) / (2 * _FINE)


def _gathered(light: Tensor, first: Tensor, weights: Tensor, border: Border) -> Tensor:
    """Row i, as many as first: the sum over k of weights[i, k] times row i + first[i] + k."""
    height, width = light.shape[-2:]
    before, after = ends(
        first.numpy() if first.device.type == "cpu" else first.cpu().numpy(), weights.shape[1]
    )
    plane = extended(light, (before, 0), (before + height + after, width), border)
    rows = torch.arange(len(first), device=light.device) + first + before
    total = light.new_zeros(())
    for tap, weight in enumerate(weights.to(light).unbind(1)):
        total = total + plane.index_select(-2, rows + tap) * weight[:, None]
    return total


def rows_mixed(light: Tensor, first: NDArray[Any], weights: NDArray[Any], border: Border) -> Tensor:
    """As :func:`_gathered`, a few rows at a time as the product of a band of weights and the rows it needs."""
    if light.device.type != "cpu" or (torch.is_grad_enabled() and light.requires_grad):
        return _gathered(light, torch.from_numpy(first).to(light.device), torch.from_numpy(weights), border)
    (height, width), count = light.shape[-2:], len(first)
    sources = light.detach().contiguous().flatten(0, 1).numpy()
    out = light.new_empty(*light.shape[:2], count, width)
    targets = out.flatten(0, 1).numpy()
    bands = bands_of(first, weights, height, border, sources.dtype)
    threads = torch.get_num_threads() if light.numel() >= WORTH_IT else 1
    side_by_side(
        lambda at: mixed(sources[at[0]], [at[1]], targets[at[0]]),
        [(place, band) for place in range(len(targets)) for band in bands],
        threads,
    )
    return out


def bands_of(
    first: NDArray[Any], weights: Floats, height: int, border: Border, kind: np.dtype[Any]
) -> list[Band]:
    """Taps (N, n) of rows of a picture, a few at a time: these rows, those that they need, and by how much."""
    count, taps = weights.shape
    begins = first + np.arange(count)
    bands = []
    for top in range(0, count, _TOGETHER):
        rows = slice(top, min(count, top + _TOGETHER))
        begin = int(begins[rows].min())
        needed = slice(begin, int(begins[rows].max()) + taps)
        band = np.zeros((rows.stop - top, needed.stop - begin), kind)
        band[np.arange(len(band))[:, None], begins[rows, None] - begin + np.arange(taps)] = weights[rows]
        if begin < 0 or needed.stop > height:
            band, needed = _folded(band, begin, height, border)
        bands.append((rows, needed, band))
    return bands


def mixed(plane: NDArray[Any], bands: Sequence[Band], out: NDArray[Any]) -> None:
    """Rows of a plane (H, W) by their taps."""
    for rows, needed, band in bands:
        np.matmul(band, plane[needed], out=out[rows])


def _folded(band: NDArray[Any], begin: int, height: int, border: Border) -> tuple[NDArray[Any], slice]:
    """A band of weights of rows from ``begin`` on, those that the border shows counted where they are."""
    count = band.shape[1]
    shown = index_of(height, -begin, count, border).numpy()
    if border == "constant":
        outside = np.arange(begin, begin + count)
        band[:, (outside < 0) | (outside >= height)] = 0
        shown = shown.clip(0, height - 1)
    needed = slice(int(shown.min()), int(shown.max()) + 1)
    folded = np.zeros((needed.stop - needed.start, len(band)), band.dtype)
    np.add.at(folded, shown - needed.start, band.T)
    return np.ascontiguousarray(folded.T), needed


def ends(first: NDArray[Any], taps: int) -> tuple[int, int]:
    """Rows needed above and below a picture."""
    return max(0, -int(first.min())), max(0, int(first.max()) + taps - 1)
