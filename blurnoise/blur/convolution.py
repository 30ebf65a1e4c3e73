"""Applies blur to batches of pictures (B, C, H, W) in linear light.

Convention: x right, y down, px. A blur keeps the mean of what it sees and its centroid; the border is
continued by ``border`` ("reflect", "replicate", "circular" or "constant" for black), by default "reflect".
A transfer function is exact for what the samples can hold, so beside a step that the samples do not resolve
it may ring, some per cent below black or above white; :func:`blurnoise.sensor.readout.read_out` takes light below 0
as none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal, get_args

import numpy as np
import torch
from kornia import filters
from torch import Tensor

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise._core.checks import an_instance, image_batch, limited_motion, one_of, real_tensor
from blurnoise._core.threads import differentiable, same_bits, side_by_side, threads_for
from blurnoise.blur import fourier
from blurnoise.blur.path_otf import Path
from blurnoise.camera import transfer
from blurnoise.camera.transfer import SHARP, Optics
from blurnoise.motion.trajectory import Polyline

Method = Literal["auto", "none", "transfer", "tiles", "kornia"]
METHODS = get_args(Method)
_LONGEST_KERNEL_PX = 2000  # whose cost in time and memory grows as its square
NEGLIGIBLE = 1e-5
"""RMS error, in units of white, below which ``auto`` leaves a blur out: a twenty-fifth of a 12-bit step."""


@same_bits
def motion_blur(
    image: Tensor,
    displacement_px: Tensor | Iterable[float],
    *,
    method: Method = "auto",
    border: Border = "reflect",
) -> Tensor:
    """Blur each picture by uniform straight motion during its exposure.

    image: (B, C, H, W), float32 or float64. displacement_px: (2,) or (B, 2), motion (x, y) during the
    exposure, of any length and angle, one for all pictures or one for each. Returns the shape of ``image``;
    differentiable in both. Without motion, ``image`` itself is returned.

    method:
        "transfer": the analytic transfer function by one Fourier transform, over the axes that move.
        "tiles": the same over overlapping tiles that fit the processor's cache (overlap-save), if that is faster.
        "kornia": ``kornia.filters.motion_blur`` with the nearest odd length, as a baseline for comparisons.
        "none": no blur.
        "auto": "tiles", without blurs whose omission causes an error below ``NEGLIGIBLE``.

    Raises ``TypeError`` or ``ValueError`` for anything but finite values of these shapes.

    >>> import torch
    >>> from blurnoise import motion_blur
    >>> edge = (torch.arange(64.0) >= 32).expand(1, 1, 8, 64).float()
    >>> ramp = motion_blur(edge, (8.0, 0.0))[0, 0, 0]  # 8 px to the right: the step becomes a ramp 8 px wide
    >>> [round(float(ramp[x]), 1) for x in (24, 30, 32, 34, 40)]
    [0.0, 0.3, 0.6, 0.8, 1.0]
    """
    return exposure_blur(image, displacement_px, SHARP, method=method, border=border)


@same_bits
def path_blur(
    image: Tensor, path: Polyline | Tensor, optics: Optics = SHARP, *, border: Border = "reflect"
) -> Tensor:
    """Blur every picture by one path and one lens; returns ``image`` itself if both are negligible.

    path: as an exposure sees it, or knots (K, 2), px, at equal times, (0, 0) where the picture shows the place.
    Differentiable in the pictures and the knots. Raises ``TypeError`` or ``ValueError``.

    >>> dot = torch.zeros(1, 1, 32, 32)
    >>> dot[..., 16, 16] = 1.0
    >>> path = torch.tensor([[-4.0, 0.0], [4.0, 0.0], [-4.0, 0.0]])  # 8 px to the right and back again
    >>> once = motion_blur(dot, (8.0, 0.0))
    >>> bool((path_blur(dot, path) - once).abs().max() < 1e-4)  # the same places for the same times
    True
    """
    if isinstance(path, Polyline):
        return exposure_blur(image, (0.0, 0.0), optics, (path,) * len(image), border=border)
    image_batch("image", image)
    one_of("border", border, BORDERS)
    knots = real_tensor("path", path)
    if knots.ndim != 2 or knots.shape[1] != 2 or len(knots) < 2:
        raise ValueError(f"path: shape must be (K, 2) of K >= 2, got {tuple(knots.shape)}")
    limited_motion("path", knots)
    shares = torch.full((len(knots) - 1,), 1 / (len(knots) - 1), dtype=torch.float64)
    knots = knots if differentiable(knots) else knots.detach()
    return _applied(image, [Path(knots.double().cpu().T, shares, optics)] * len(image), border)


def exposure_blur(
    image: Tensor,
    displacement_px: Tensor | Iterable[float],
    optics: Optics,
    paths: Sequence[Polyline | None] = (),
    *,
    method: Method = "auto",
    border: Border = "reflect",
) -> Tensor:
    """Blur by lens and motion in one pass: their transfer functions are multiplied; see :func:`motion_blur`.

    paths: a path or None for each picture; a path includes the displacement. ``method`` "kornia" supports only
    straight motion and raises ``ValueError`` for a lens with blur.

    >>> bar = torch.zeros(1, 1, 8, 64)
    >>> bar[..., 32] = 1.0
    >>> lens = Optics(gaussian_sigma_px=1.0)
    >>> seen = exposure_blur(bar, (6.0, 0.0), lens)[0, 0, 0]  # a line of 1 px, spread over 6 px
    >>> round(float(seen.sum()), 3), round(1 / float(seen[32]), 1)
    (1.0, 6.0)
    """
    image_batch("image", image)
    an_instance("optics", optics, Optics)
    one_of("border", border, BORDERS)
    one_of("method", method, METHODS)
    moved = motions("displacement_px", displacement_px, image)
    if method == "kornia":
        return _kornia(image, moved, optics, border)
    moved = moved if differentiable(moved) else moved.detach()
    # A GPU is fastest with one transform for the whole batch, a core's cache with one for each picture.
    together = image.device.type != "cpu" and not any(paths)
    responses: list[fourier.Response | None] = []
    groups = torch.split(moved, len(image) if together else 1)
    for group, path in zip(groups, paths or (None,) * len(groups), strict=True):
        if path is not None and path.shares:
            # Errors of causes that act one after another add up at most, so their sum is a bound for both.
            left_out = path.error + optics.error
            knots = torch.from_numpy(path.knots) if path.knots_px is None else path.knots_px
            shares = torch.from_numpy(np.array(path.shares))
            response: fourier.Response = Path(knots, shares, optics)
        else:
            response = straight = fourier.Straight(group, optics)
            left_out = transfer.motion_error(*straight.most_px) + optics.error
        seen = left_out > NEGLIGIBLE or method != "auto" or differentiable(response.variable)
        responses.append(response if seen and method != "none" and any(response.reach_px) else None)
    return _applied(image, responses, border, tiled=method != "transfer")


def _applied(
    image: Tensor, responses: Sequence[fourier.Response | None], border: Border, *, tiled: bool = True
) -> Tensor:
    """Filter pictures by their responses, one per picture or one for all; None leaves a picture unchanged."""
    if not any(responses):
        return image
    threads, each = threads_for(image), len(image) // len(responses)

    def blurred(picture: Tensor, response: fourier.Response | None, out: Tensor | None = None) -> Tensor:
        if response is None:
            return picture if out is None else out.copy_(picture)
        return fourier.apply(picture, response, border, tiled=tiled, out=out, threads=threads)

    if differentiable(image, *(response.variable for response in responses if response)):
        pairs = zip(torch.split(image, each), responses, strict=True)
        # Written to one by one, a plane cannot be differentiated: with gradients the parts are joined.
        return torch.cat([blurred(picture, response) for picture, response in pairs])
    out = torch.empty_like(image, memory_format=torch.contiguous_format)
    jobs = zip(torch.split(image.detach(), each), responses, torch.split(out, each), strict=True)
    side_by_side(lambda job: blurred(*job), jobs, threads if threads <= len(responses) else 1)
    return out


def motions(name: str, value: object, image: Tensor) -> Tensor:
    """Check vectors and broadcast them to (B, 2), in ``image``'s dtype. Raises ``TypeError`` or ``ValueError``.

    >>> motions("displacement_px", (3.0, 4.0), torch.zeros(2, 1, 8, 8)).tolist()
    [[3.0, 4.0], [3.0, 4.0]]
    """
    vectors = real_tensor(name, value)
    if vectors.shape not in {(2,), (1, 2), (len(image), 2)}:
        raise ValueError(f"{name}: shape must be (2,) or ({len(image)}, 2), got {tuple(vectors.shape)}")
    limited_motion(name, vectors)
    return vectors.to(device=image.device, dtype=image.dtype).expand(len(image), 2)


def _kornia(image: Tensor, moved: Tensor, optics: Optics, border: Border) -> Tensor:
    """Kornia's kernels of the nearest odd lengths; its angle runs counter-clockwise as displayed."""
    if optics != SHARP:
        raise ValueError(f"method = 'kornia': supports only motion; use 'transfer' or 'auto' with {optics}")
    parts = []
    for picture, (dx, dy) in zip(torch.split(image, 1), moved.tolist(), strict=True):
        length = math.hypot(dx, dy)
        if length > _LONGEST_KERNEL_PX:
            raise ValueError(
                f"displacement_px = {(dx, dy)}: method 'kornia' takes at most {_LONGEST_KERNEL_PX} px"
            )
        pad = max(0, round((length - 1) / 2))
        if pad:
            # Kornia counts angles counter-clockwise, and here y points down.
            angle_deg = -math.degrees(math.atan2(dy, dx))
            size = picture.shape[-2] + 2 * pad, picture.shape[-1] + 2 * pad
            plane = extended(picture, (pad, pad), size, border)
            plane = filters.motion_blur(
                plane, 2 * pad + 1, angle_deg, 0.0, border_type="constant", mode="bilinear"
            )
            picture = plane[..., pad:-pad, pad:-pad]
        parts.append(picture)
    return torch.cat(parts)
