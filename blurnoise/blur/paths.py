"""Blur of pictures (B, C, H, W) by paths of any shape, in linear light.

Convention: x right, y down, px; the border is continued as in :mod:`.convolution`. The transfer function of a path
of many segments is not evaluated at every frequency of the picture: a grid as large as the path and its band-limited
ends need gives the point spread, which is laid into a tile of the picture and transformed there. Half the RMS of what
that changes of the transfer function, the RMS error of a white picture of full contrast, is 1e-4.
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

from blurnoise._core import packed_fft as packed
from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import image_batch, one_of, real_tensor
from blurnoise._core.limits import limited_motion
from blurnoise._core.threads import WORTH_IT, plain
from blurnoise._core.uncompiled import uncompiled
from blurnoise.blur import convolution, fourier
from blurnoise.blur.convolution import NEGLIGIBLE
from blurnoise.blur.transfer_of_paths import polyline, polyline_on
from blurnoise.motion.trajectory import Polyline
from blurnoise.optics.transfer import SHARP, Optics

_LEAST_PX = 64  # side of the small grid
_ROOM_PX = 32  # of the band-limited ends, both together
_LARGE = 1 << 20  # values of a small grid
_MOST_VALUES = 1 << 26  # of segments times frequencies, of which gradients keep several


def path_blur(image: Tensor, path: Polyline, optics: Optics = SHARP, *, border: Border = "reflect") -> Tensor:
    """Every picture blurred by one path, and one lens; ``image`` itself where that is too small to be seen.

    Differentiable in the pictures. Raises ``TypeError`` or ``ValueError``.
    """
    image_batch("image", image)
    one_of("border", border, BORDERS)
    if path.error + optics.error <= NEGLIGIBLE:
        return image
    plan = _plan(image, path.reach_px, optics, border)
    fourier.check_span(plan, border, f"path over {path.box} px")
    if plan.packs and len(plan.dims) == 2 and plain(image):
        out = torch.empty_like(image, memory_format=torch.contiguous_format)
        lengths = (plan.y.length, plan.x.length)
        spectrum = _packed_spectrum(path, optics, lengths, image.detach().numpy().dtype)
        threads = torch.get_num_threads() if image.numel() >= WORTH_IT else 1
        for picture, target in zip(image.detach(), out, strict=True):
            fourier.multiply_planes(picture, spectrum, packed.multiply_complex, plan, border, target, threads)
        return out
    tile = torch.from_numpy(_tile(path.knots, np.array(path.shares), (plan.y.length, plan.x.length)))
    response = _with_lens(torch.fft.rfftn(tile, dim=plan.dims), optics, plan, image)
    return fourier.filtered(image, response, plan, border)


def exposure_blur(
    image: Tensor,
    displacement_px: Tensor | Iterable[float],
    paths: Sequence[Polyline | None],
    optics: Optics,
    *,
    border: Border = "reflect",
) -> Tensor:
    """:func:`.convolution.exposure_blur`, but by their own paths for those pictures that have one; (): none has."""
    if not any(paths):
        return convolution.exposure_blur(image, displacement_px, optics, border=border)
    moved = convolution.displacements(displacement_px, image)
    return torch.cat(
        [
            convolution.exposure_blur(picture, by, optics, border=border)
            if path is None
            else path_blur(picture, path, optics, border=border)
            for picture, by, path in zip(torch.split(image, 1), torch.split(moved, 1), paths, strict=True)
        ]
    )


@uncompiled
def polyline_blur(
    image: Tensor,
    knots_px: Tensor,
    durations: Tensor | None = None,
    optics: Optics = SHARP,
    *,
    border: Border = "reflect",
) -> Tensor:
    """Blur each picture by a path that may be optimised: straight between knots, as long in each segment as it says.

    image: (B, C, H, W). knots_px: (K, 2) or (B, K, 2), K >= 2, px, (0, 0) where the picture shows the place.
    durations: (K - 1,), > 0 in any unit; None: equal. Differentiable in all three. Raises ``TypeError`` or
    ``ValueError``.
    """
    image_batch("image", image)
    one_of("border", border, BORDERS)
    knots = real_tensor("knots_px", knots_px)
    if knots.ndim not in (2, 3) or knots.shape[-1] != 2 or knots.shape[-2] < 2:
        raise ValueError(f"knots_px: shape must be (K, 2) or (B, K, 2) of K >= 2, got {tuple(knots.shape)}")
    if knots.ndim == 3 and len(knots) != len(image):
        raise ValueError(
            f"knots_px: got {len(knots)} paths for a batch of {len(image)}; must be one per picture"
        )
    limited_motion("knots_px", knots)
    segments = knots.shape[-2] - 1
    spent = torch.ones(segments) if durations is None else real_tensor("durations", durations)
    if spent.shape != (segments,) or not bool((spent.detach() > 0).all()):
        raise ValueError(f"durations: must be {segments} numbers > 0, one per segment")
    shares = (spent / spent.sum()).to(image.device)
    parts = []
    for picture, path in zip(torch.split(image, 1), knots.expand(len(image), segments + 1, 2), strict=True):
        reach = path.detach().abs().amax(0).tolist()
        plan = _plan(picture, (reach[0], reach[1]), optics, border)
        fourier.check_span(plan, border, f"knots_px up to {max(reach):g} px")
        response = _response(path.to(image.device).T, shares, optics, plan, picture)
        parts.append(fourier.filtered(picture, response, plan, border))
    return torch.cat(parts)


def point_spread(knots_px: NDArray[Any], shares: NDArray[Any]) -> NDArray[np.float64]:
    """The band-limited point spread of a path (2, K), on a grid whose middle, at half its sides, is (0, 0)."""
    return np.fft.fftshift(_spread_on(_sides(np.abs(knots_px).max(1).tolist()), knots_px, shares))


def _spread_on(lengths: tuple[int, int], knots_px: NDArray[Any], shares: NDArray[Any]) -> NDArray[np.float64]:
    """The same on a grid of ``lengths``, which it wraps round, from (0, 0)."""
    fy, fx = fourier.frequencies(lengths)
    spectrum = fourier.joined(polyline_on(lengths, knots_px, shares), fx, fy, lengths)
    return np.fft.irfftn(spectrum, s=lengths, axes=(-2, -1) if lengths[1] > 1 else (-1, -2))


def _tile(knots_px: NDArray[Any], shares: NDArray[Any], lengths: tuple[int, int]) -> NDArray[np.float64]:
    """The same on a tile, by way of the small grid unless that is large, and the larger of the two."""
    sides = _sides(np.abs(knots_px).max(1).tolist())
    if math.prod(sides) > max(_LARGE, math.prod(lengths)):
        return _spread_on(lengths, knots_px, shares)
    spread = point_spread(knots_px, shares)
    tile = np.zeros(lengths)
    rows, columns = (
        (np.arange(side) - side // 2) % length for side, length in zip(spread.shape, lengths, strict=True)
    )
    np.add.at(tile, np.ix_(rows, columns), spread)  # wraps where the tile is smaller
    return tile


def _plan(
    image: Tensor, reach_px: tuple[float, float], optics: Optics, border: Border
) -> fourier.TransformPlan:
    across, down = (2 * reach for reach in reach_px)
    reach = fourier.reach((across, down), optics, every_axis=True)
    size = (image.shape[-2], image.shape[-1])
    plans = [fourier.plan(size, reach, border, tiled=tiled) for tiled in (False, True)]
    return min(plans, key=lambda each: each.cost_ns)


def _sides(reach_px: tuple[float, float]) -> tuple[int, int]:
    """Of the small grid, (h, w), even."""
    width, height = (max(_LEAST_PX, math.ceil(2 * reach) + _ROOM_PX) for reach in reach_px)
    return fourier.fast_length(height), fourier.fast_length(width)


@lru_cache(maxsize=16)
def _packed_spectrum(path: Polyline, optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]) -> Any:
    """A path's transfer function on a tile, packed and divided by its size; not to be written to."""
    tile = _tile(path.knots, np.array(path.shares), lengths)
    spectrum = cv2.dft((tile / tile.size).astype(kind))
    if optics != SHARP:
        factors = np.empty(lengths, kind)
        fy, fx = (torch.from_numpy(f.astype(kind)) for f in fourier.frequencies(lengths))
        packed.pack(optics.response(fx, fy[:, None]).numpy(), factors)
        spectrum *= factors * factors.size
    return spectrum


def _response(
    knots_px: Tensor, shares: Tensor, optics: Optics, plan: fourier.TransformPlan, image: Tensor
) -> Tensor:
    """The same as a response (1, 1, h, w) of ``image``'s precision over the plan's axes, with gradients."""
    reach = knots_px.detach().abs().amax(1).tolist()
    large = {-2: plan.y.length, -1: plan.x.length}
    sides = dict(zip((-2, -1), _sides((reach[0], reach[1])), strict=True))
    small = (sides[-2] if -2 in plan.dims else 1, sides[-1] if -1 in plan.dims else 1)
    if len(shares) * math.prod(small) > 2 * _MOST_VALUES:
        raise ValueError(
            f"knots_px: {len(shares)} segments over {2 * reach[0]:.4g}x{2 * reach[1]:.4g} px; at most "
            f"{2 * _MOST_VALUES // math.prod(small)} are allowed over as many"
        )
    fy, fx = (torch.from_numpy(f).to(knots_px) for f in fourier.frequencies(small))

    def motion(fx: Tensor, fy: Tensor) -> Tensor:
        return polyline(fx, fy[:, None], knots_px, shares)

    response = fourier.joined(motion, fx, fy, small)
    spread = torch.fft.irfftn(response, s=[sides[dim] for dim in plan.dims], dim=plan.dims)
    for (
        dim
    ) in plan.dims:  # from 0 to the end, then what lies before 0: laid into the tile, which it may wrap round
        side, length = sides[dim], large[dim]
        places = torch.arange(side, device=spread.device)
        places = torch.where(places < side - side // 2, places, places - side) % length
        shape = [*spread.shape]
        shape[dim] = length
        spread = spread.new_zeros(shape).index_add(spread.ndim + dim, places, spread)
    return _with_lens(torch.fft.rfftn(spread, dim=plan.dims), optics, plan, image)


def _with_lens(whole: Tensor, optics: Optics, plan: fourier.TransformPlan, image: Tensor) -> Tensor:
    """A transfer function over the plan's axes times the lens's, (1, 1, h, w), as ``image`` needs it."""
    if optics != SHARP:
        lengths = tuple(axis.length if dim in plan.dims else 1 for dim, axis in ((-2, plan.y), (-1, plan.x)))
        fy, fx = (torch.from_numpy(f).to(whole.device) for f in fourier.frequencies((lengths[0], lengths[1])))
        whole = whole * optics.response(fx, fy[:, None])
    kind = torch.complex64 if image.dtype == torch.float32 else torch.complex128
    return whole.to(device=image.device, dtype=kind)[None, None]
