"""Inputs of metrics, tensors of real numbers and regions of pictures, and their results: estimates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.luminance import LUMINANCE

Roi = tuple[int, int, int, int]
"""Left, top, width and height of a region, px."""

# A side of a region: fewer leave no flat sides beside an edge, and no noise to measure.
SMALLEST_PX = 8
CLIPPED_SHARE = 0.005
"""Share of pixels at black or full scale above which a region counts as clipped."""
ROUNDING = 1e-12
"""Share of the largest value below which a deviation is a rounding error of double precision."""
_FULL_SCALE = {torch.uint8: 255.0, torch.uint16: 65535.0, torch.float32: 1.0, torch.float64: 1.0}


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, ``low`` to ``high``, NaN if missing. flags: why it is NaN or doubtful.

    >>> Estimate(2.0, 1.0, 3.0) * 10.0
    Estimate(value=20.0, low=10.0, high=30.0, flags=frozenset())
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    flags: frozenset[str] = frozenset()

    @property
    def available(self) -> bool:
        """Whether the value is finite."""
        return math.isfinite(self.value)

    def __mul__(self, factor: float) -> Estimate:
        """The estimate times an exactly known number >= 0."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high, self.flags)


@dataclass(frozen=True)
class BatchEstimate:
    """A number per item of a batch, its interval and its flags by name, as tensors of one shape.

    >>> from blurnoise.metrics.patches import patch_snr
    >>> estimate = patch_snr(torch.full((2, 8, 8), 200.0))
    >>> estimate.value.tolist(), estimate.flags["noiseless"].tolist()
    ([inf, inf], [True, True])
    """

    value: Tensor
    low: Tensor
    high: Tensor
    flags: Mapping[str, Tensor]


def real(name: str, value: Tensor, *, dims: int = 0) -> Tensor:
    """``value`` as float64; integers keep their numbers, gradients pass, NaN is allowed.

    Raises ``TypeError`` unless it is a tensor of real numbers, ``ValueError`` if it is empty or has fewer than
    ``dims`` dimensions.

    >>> real("patch", torch.tensor([[1, 2]], dtype=torch.uint8)).dtype
    torch.float64
    """
    if not isinstance(value, Tensor):
        raise TypeError(f"{name}: must be a torch.Tensor, got {type(value).__name__}")
    value = checks.real_tensor(name, value)
    if value.ndim < dims or 0 in value.shape:
        raise ValueError(
            f"{name}: must have at least {dims} dimensions, none empty, got shape {tuple(value.shape)}"
        )
    return value.double()


def beside(name: str, value: float | Tensor, like: Tensor, *, low: float = -math.inf) -> Tensor:
    """``value`` as float64 on ``like``'s device. Raises ``ValueError`` below ``low`` and for shapes that clash.

    >>> beside("noise_variance", 4, like=torch.zeros(3), low=0)
    tensor(4., dtype=torch.float64)
    """
    tensor = checks.real_tensor(name, value).to(like.device, torch.float64)
    try:
        torch.broadcast_shapes(tensor.shape, like.shape)  # type: ignore[no-untyped-call]
    except RuntimeError:
        raise ValueError(f"{name}: shape {tuple(tensor.shape)} does not fit {tuple(like.shape)}") from None
    if bool((tensor.detach() < low).any()):
        raise ValueError(f"{name}: must be >= {low:g}, got {checks.shown(tensor)}")
    return tensor


def cut(image: Tensor, roi: Roi) -> Tensor:
    """The region of ``image`` (..., H, W). Raises ``TypeError`` unless four integers, ``ValueError`` outside it.

    >>> cut(torch.zeros(5, 7), (1, 2, 3, 2)).shape
    torch.Size([2, 3])
    """
    sides = roi if isinstance(roi, (tuple, list)) else ()
    if len(sides) != 4 or not all(type(side) is int for side in sides):
        raise TypeError(f"roi = {checks.shown(roi)}: must be four integers (x, y, width, height)")
    (left, top, wide, high), (height, width) = sides, image.shape[-2:]
    if min(left, top) < 0 or min(wide, high) < 1 or left + wide > width or top + high > height:
        raise ValueError(f"roi = {checks.shown(roi)}: must lie inside the picture, {width} x {height} px")
    return image[..., top : top + high, left : left + wide]


class Regions(NamedTuple):
    """values: (B, H, W) luminance above black. colours: (B, C, H, W), as read. clipped, finite: (B,) bool.

    >>> read_regions(torch.rand(8, 8), full_scale=None, black_level=0.0, roi=None).finite
    tensor([True])
    """

    values: Tensor
    colours: Tensor
    clipped: Tensor
    finite: Tensor


def read_regions(image: Tensor, *, full_scale: float | None, black_level: float, roi: Roi | None) -> Regions:
    """A region of each picture of ``image``, as :func:`blurnoise.metrics.slanted_edge` takes them.

    A pixel counts as clipped at ``full_scale``, at 0, or at the minimum of a picture with values below 0.

    >>> grey = torch.full((3, 8, 8), 130, dtype=torch.uint8)
    >>> regions = read_regions(grey, full_scale=None, black_level=10.0, roi=None)
    >>> float(regions.values[0, 0, 0]), bool(regions.clipped)  # luminance above black
    (120.0, False)
    """
    if not isinstance(image, Tensor) or image.dtype not in _FULL_SCALE:
        got = image.dtype if isinstance(image, Tensor) else type(image).__name__
        raise TypeError(f"image: must be a tensor of uint8, uint16, float32 or float64, got {got}")
    checks.dense("image", image)
    if image.ndim not in (2, 3, 4) or 0 in image.shape or (image.ndim > 2 and image.shape[-3] not in (1, 3)):
        raise ValueError(
            "image: shape must be (H, W), (C, H, W) or (B, C, H, W) with 1 or 3 channels, none empty, "
            f"got {tuple(image.shape)}"
        )
    pixels = image.detach().reshape(-1, 1 if image.ndim == 2 else image.shape[-3], *image.shape[-2:])
    pixels = pixels if roi is None else cut(pixels, roi)
    height, width = pixels.shape[-2:]
    if min(height, width) < SMALLEST_PX:
        raise ValueError(f"image: the region is {width} x {height} px; must be at least 8 x 8")
    top = _FULL_SCALE[image.dtype] if full_scale is None else full_scale
    top = checks.in_range("full_scale", top, 0.0, above=True)
    black = checks.in_range("black_level", black_level, 0.0, top)
    if black == top:
        raise ValueError(f"black_level = {black:g}: must be below full_scale = {top:g}")
    raw = pixels.to("cpu", torch.float64)
    finite = torch.isfinite(raw.sum((1, 2, 3)))
    lowest, highest = raw.amin((1, 2, 3)), raw.amax((1, 2, 3))
    if bool((highest[finite] > top).any()):
        largest = float(highest[finite].max())
        raise ValueError(f"image: holds {largest:g}, above full_scale = {top:g}; specify its full_scale")
    # Pictures with values below 0 have their black level removed: they clip at their minimum, not at 0.
    floor = lowest.clamp(max=0.0)[:, None, None, None]
    at_limit = ((raw >= top) | (raw <= floor)).any(1)  # a single channel can clip, which luminance would hide
    clipped = at_limit.double().mean((1, 2)) > CLIPPED_SHARE
    weights = raw.new_tensor(LUMINANCE if raw.shape[1] == 3 else [1.0])
    return Regions(torch.einsum("bchw,c->bhw", raw, weights) - black, raw, clipped, finite)
