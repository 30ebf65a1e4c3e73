"""Applies blur to batches of pictures (B, C, H, W) in linear light: the methods, and the choice between them.

Convention: x right, y down, px. A blur keeps the mean of what it sees and its centroid; the border is
continued by ``border`` ("reflect", "replicate", "circular" or "constant" for black), by default "reflect".
A transfer function is exact for what the samples can hold, so beside a step that the samples do not resolve
it may ring, some per cent below black or above white; :func:`blurnoise.sensor.readout.read_out` takes light below 0
as none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, cast

import torch
from kornia import filters
from torch import Tensor

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise._core.checks import an_instance, image_batch, one_of, real_tensor, shown
from blurnoise._core.limits import LIMITS, limited, limited_motion
from blurnoise._core.threads import WORTH_IT, differentiable, side_by_side
from blurnoise._core.uncompiled import uncompiled
from blurnoise.blur import fourier, psf
from blurnoise.optics import transfer
from blurnoise.optics.transfer import SHARP, Optics

Method = Literal["auto", "none", "transfer", "tiles", "kornia"]
METHODS = ("auto", "none", "transfer", "tiles", "kornia")
_FOURIER: tuple[Method, ...] = ("transfer", "tiles")
_LONGEST_KERNEL_PX = 2000  # whose cost in time and memory grows as its square
NEGLIGIBLE = 1e-5
"""RMS error, in units of white, below which ``auto`` leaves a blur out: a twenty-fifth of a 12-bit step."""


@dataclass(frozen=True)
class Choice:
    """What is done to one picture, and why.

    error: predicted RMS error in units of white, above what the sampling of the picture itself causes, and
    cost_ns: predicted time per value of the picture on one core; None where neither is predicted.
    plan: of the Fourier transforms, where there are any.
    """

    method: Method
    reason: str
    error: float | None = None
    cost_ns: float | None = None
    plan: fourier.TransformPlan | None = None


@uncompiled
def motion_blur(
    image: Tensor,
    displacement_px: Tensor | Iterable[float],
    *,
    method: Method = "auto",
    border: Border = "reflect",
) -> Tensor:
    """Blur each picture by uniform straight motion during its exposure.

    image: (B, C, H, W), float32 or float64. displacement_px: (2,) or (B, 2), motion (x, y) during the
    exposure, any length and angle, another for each picture if wished. Returns the shape of ``image``;
    differentiable in both. Where nothing moves, ``image`` itself is returned.

    method:
        "transfer": the analytic transfer function by one Fourier transform, over the axes that move.
        "tiles": the same over overlapping tiles that fit the processor's cache (overlap-save).
        "kornia": ``kornia.filters.motion_blur`` of the nearest odd length, as a baseline to compare with.
        "none": leaves the pictures as they are.
        "auto": the cheapest that is exact; :func:`choose` says which and why.

    Raises ``TypeError`` or ``ValueError`` for anything but finite values of these shapes.
    """
    return exposure_blur(image, displacement_px, SHARP, method=method, border=border)


def optical_blur(image: Tensor, optics: Optics, *, border: Border = "reflect") -> Tensor:
    """Blur by the lens through its transfer function; a lens below ``NEGLIGIBLE`` returns ``image`` itself."""
    return exposure_blur(image, (0.0, 0.0), optics, border=border)


def exposure_blur(
    image: Tensor,
    displacement_px: Tensor | Iterable[float],
    optics: Optics,
    *,
    method: Method = "auto",
    border: Border = "reflect",
) -> Tensor:
    """Blur by lens and motion in one pass, as their transfer functions multiply; see :func:`motion_blur`.

    ``method`` "kornia" knows motion only and raises ``ValueError`` for a lens that blurs.
    """
    image_batch("image", image)
    an_instance("optics", optics, Optics)
    moved = displacements(displacement_px, image)
    at_once = 1 if image.device.type == "cpu" or method == "kornia" else len(image)
    groups = list(zip(torch.split(image, at_once), torch.split(moved, at_once), strict=True))
    size = (image.shape[-2], image.shape[-1])
    moving = differentiable(moved)  # then a blur too short to be seen still has its gradient
    choices = []
    for _, group in groups:
        dx, dy = group.detach().abs().amax(0).tolist()
        choices.append(_choose(dx, dy, size, optics, method, border, moving=moving))
    if all(choice.method == "none" for choice in choices):
        return image
    if differentiable(image, moved):
        parts = zip(groups, choices, strict=True)
        return torch.cat([_blurred(*group, choice, optics, border) for group, choice in parts])
    out = torch.empty_like(image, memory_format=torch.contiguous_format)
    detached = [(pictures.detach(), by.detach()) for pictures, by in groups]
    jobs = list(zip(detached, choices, torch.split(out, at_once), strict=True))
    threads = torch.get_num_threads() if image.numel() >= WORTH_IT else 1
    shared = threads <= len(jobs) and all(choice.plan is not None for choice in choices)

    def blur(job: tuple[tuple[Tensor, Tensor], Choice, Tensor]) -> None:
        (pictures, by), choice, target = job
        _blurred(pictures, by, choice, optics, border, target, 1 if shared else threads)

    side_by_side(blur, jobs, threads if shared else 1)
    return out


@uncompiled
def defocus(image: Tensor, radius_px: float, *, border: Border = "reflect") -> Tensor:
    """Blur by a disc's exact areas in the pixels, radius_px >= 0; up to half a pixel it is the identity.

    Equals MATLAB's ``fspecial('disk', r)``, which counts the pixel's own aperture a second time;
    :func:`optical_blur` does not.
    """
    image_batch("image", image)
    one_of("border", border, BORDERS)
    kernel = psf.disc(limited("radius_px", radius_px))
    if kernel.size == 1:
        return image
    return _correlate(image, torch.from_numpy(kernel).to(image)[None], border)


def choose(
    displacement_px: Tensor | Iterable[Iterable[float]],
    size: tuple[int, int],
    *,
    optics: Optics = SHARP,
    method: Method = "auto",
    border: Border = "reflect",
) -> list[Choice]:
    """What ``method`` does to pictures (H, W) = ``size`` under motions (B, 2): for "auto", its choices.

    "auto" leaves out a blur whose error stays below ``NEGLIGIBLE``, else takes the transfer function, which
    has no error of its own, whole or in tiles, whichever is predicted to be faster.
    """
    moved = real_tensor("displacement_px", displacement_px).detach()
    if moved.ndim != 2 or moved.shape[1] != 2:
        raise ValueError(f"displacement_px: shape must be (B, 2), got {tuple(moved.shape)}")
    limited_motion("displacement_px", moved)
    return [_choose(x, y, size, optics, method, border) for x, y in moved.tolist()]


def _choose(
    dx: float,
    dy: float,
    size: tuple[int, int],
    optics: Optics,
    method: Method,
    border: Border,
    *,
    moving: bool = False,
) -> Choice:
    one_of("border", border, BORDERS)
    one_of("method", method, METHODS)
    if method == "kornia":
        if optics != SHARP:
            raise ValueError(
                f"method = {method!r}: knows motion only; use 'transfer' or 'auto' with {optics}"
            )
        if math.hypot(dx, dy) > _LONGEST_KERNEL_PX:
            raise ValueError(
                f"displacement_px = {(dx, dy)}: method {method!r} takes at most {_LONGEST_KERNEL_PX} px"
            )
        return Choice(method, "asked for")
    left_out = transfer.motion_error(dx, dy) + optics.error
    reach = fourier.reach((dx, dy), optics, every_axis=moving)
    nothing = not any(reach) or (method == "auto" and left_out <= NEGLIGIBLE and not moving)
    if method == "none" or nothing:
        return Choice("none", f"leaving it out changes less than {left_out:.1g} of white", left_out, 0.0)
    plans = {each: fourier.plan(size, reach, border, tiled=each == "tiles") for each in _FOURIER}
    chosen = method if method != "auto" else min(_FOURIER, key=lambda each: plans[each].cost_ns)
    costs = ", ".join(f"{each} {plans[each].cost_ns:.1f} ns" for each in _FOURIER)
    return Choice(chosen, f"exact; predicted per value: {costs}", 0.0, plans[chosen].cost_ns, plans[chosen])


def displacements(value: Tensor | Iterable[float], image: Tensor) -> Tensor:
    """Motions (B, 2), px, for the pictures of ``image``; raises as :func:`motions` does."""
    return motions("displacement_px", value, image)


def motions(name: str, value: object, image: Tensor) -> Tensor:
    """Vectors (B, 2) for the pictures of ``image``, as it is. Raises ``TypeError`` or ``ValueError``."""
    vectors = real_tensor(name, value)
    if vectors.shape not in {(2,), (1, 2), (len(image), 2)}:
        raise ValueError(f"{name}: shape must be (2,) or ({len(image)}, 2), got {tuple(vectors.shape)}")
    low, high, _ = LIMITS[name]
    seen = vectors.detach()
    if not bool(torch.isfinite(seen).all()) or bool((seen.abs() > high * (1 + 1e-6)).any()):
        raise ValueError(f"{name} = {shown(vectors)}: must be finite and >= {low:g} and <= {high:g}")
    return vectors.to(device=image.device, dtype=image.dtype).expand(len(image), 2)


def _blurred(
    image: Tensor,
    motion: Tensor,
    choice: Choice,
    optics: Optics,
    border: Border,
    out: Tensor | None = None,
    threads: int = 1,
) -> Tensor:
    """A group of pictures, blurred as ``choice`` says, into ``out`` where it is given."""
    if choice.plan is not None:
        return fourier.multiply(image, motion, optics, choice.plan, border, out, threads)
    blurred = image if choice.method == "none" else _kornia(image, motion, border)
    return blurred if out is None else out.copy_(blurred)


def _correlate(image: Tensor, kernel: Tensor, border: Border) -> Tensor:
    pad_y, pad_x = kernel.shape[-2] // 2, kernel.shape[-1] // 2
    spans = (image.shape[-2] + 2 * pad_y, image.shape[-1] + 2 * pad_x)
    return cast(
        Tensor, filters.filter2d(extended(image, (pad_y, pad_x), spans, border), kernel, padding="valid")
    )


def _kornia(image: Tensor, motion: Tensor, border: Border) -> Tensor:
    """Kornia's kernel of the nearest odd length; its angle runs counter-clockwise as displayed."""
    dx, dy = motion[0].tolist()
    taps = 2 * round((math.hypot(dx, dy) - 1) / 2) + 1
    if taps < 3:
        return image
    pad = taps // 2
    plane = extended(image, (pad, pad), (image.shape[-2] + 2 * pad, image.shape[-1] + 2 * pad), border)
    angle_deg = -math.degrees(math.atan2(dy, dx))
    blurred = filters.motion_blur(plane, taps, angle_deg, 0.0, border_type="constant", mode="bilinear")
    return cast(Tensor, blurred)[..., pad:-pad, pad:-pad]
