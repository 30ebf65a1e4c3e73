"""Layered exposures: objects, each in a motion of its own, before a background that moves otherwise or not at all.

Domain: linear light, white is 1; px, x right, y down; motion straight and centred, so that at mid-exposure everything
is where the picture at rest has it. Layers come back to front: the last is in front.

One object of light F and matte alpha before a background B makes, the exposure being T,

    I = h_F * (alpha F) + 1/T integral of (1 - alpha(p - d_F(t))) B(p - d_B(t)) dt.

The matte formula h_F * (alpha F) + (1 - h_F * alpha) (h_B * B) is that wherever matte or background does not vary in
time, as where either of them is still (Giusti & Caglioti 2007, inria-00264748). Where both move, and where objects
overlap, the exposure is cut into ``K`` parts, by default one for each ``STEP_PX`` that the fastest moves, within each
of which it is taken for exact. The error of the formula is then that of the covariance within a part. Never blend a
blurred picture by a blurred matte: that leaves the object sharp in its own place.

All of it happens in a window around what the object passes; the rest of the picture knows the background alone. Where
a layer ends at the picture's border it goes on beyond it as the border does; elsewhere nothing is beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from blurnoise import blur, fourier
from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import (
    Numbers,
    image_batch,
    in_range,
    one_of,
)
from blurnoise._core.limits import limited_motion, limited_per_image
from blurnoise._core.windows import Window, continued_in, cut
from blurnoise.layers import ALIKE_PX, Layer, Layers, of_each, plane_of, reach_px, window_of

STEP_PX = 2.0
"""What the fastest moves within one part of an exposure, at most."""
_LONGEST_PX = 4096.0  # of a motion that is cut into parts: each of them costs a transform of the whole window


def expose_layers(
    background: Tensor,
    layers: Layers,
    *,
    exposure_s: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    border: Border = "reflect",
    step_px: float = STEP_PX,
) -> Tensor:
    """The mean light (B, C, H, W) of an exposure of backgrounds (B, C, H, W), float32 or float64, and their layers.

    exposure_s: a number or (B,). velocity_px_s: of the background, (2,) or (B, 2). Differentiable in every light,
    matte, velocity and exposure. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    image_batch("background", background)
    one_of("border", border, BORDERS)
    in_range("step_px", step_px, 0.05, 1e5)
    per_picture = of_each(layers, background)
    exposure = limited_per_image("exposure_s", exposure_s, len(background), background)
    moved = blur.motions("velocity_px_s", velocity_px_s, background) * exposure[:, None]
    limited_motion("displacement_px: velocity times exposure", moved)
    pictures = zip(torch.split(background, 1), per_picture, exposure, moved, strict=True)
    seen = [exposed(*each, border=border, step_px=step_px) for each in pictures]
    return seen[0] if len(seen) == 1 else torch.cat(seen)


def at_rest(background: Tensor, layers: Sequence[Layer]) -> Tensor:
    """A picture (1, C, H, W) with its layers before it, nothing moving."""
    return exposed(background, layers, background.new_zeros(()), background.new_zeros(2))


def exposed(
    background: Tensor,
    layers: Sequence[Layer],
    exposure_s: Tensor,
    moved_px: Tensor,
    border: Border = "reflect",
    step_px: float = STEP_PX,
) -> Tensor:
    """:func:`expose_layers` of one picture (1, C, H, W), exposure () and displacement (2,) of the background."""
    size = (background.shape[-2], background.shape[-1])
    laid = []
    for layer in layers:
        displacement = layer.displacement_px(exposure_s).to(background)
        limited_motion("displacement_px: a layer's velocity times exposure", displacement)
        window = window_of(layer, displacement, size, border)
        if window.height > 0 and window.width > 0:
            laid.append(_Laid(layer, displacement, window))
    ground = background
    while laid and _as_one(laid[0].displacement_px, moved_px):  # what moves with the background is part of it
        layer, _, window = laid.pop(0)
        ground = background.clone() if ground is background else ground
        plane = plane_of(layer, window, size, border, background)
        ground[..., *window.within] = (
            plane[:, :-1] + (1 - plane[:, -1:]) * ground[..., *window.within].clone()
        )
    blurred = blur.motion_blur(ground, moved_px[None], border=border)
    if not laid:
        return blurred
    asked = blurred.requires_grad or exposure_s.requires_grad or any(one.layer.requires_grad for one in laid)
    out = blurred.clone() if blurred is background or (torch.is_grad_enabled() and asked) else blurred
    for window, group in _groups(laid):
        apart = len(group) > 1 or not any(_still(each) for each in (moved_px, group[0].displacement_px))
        if apart:
            seen = _in_parts(group, window, ground, blurred, moved_px, border, step_px)
        else:
            colour, share = _blurred(group[0], window, size, border, background)
            seen = colour + (1 - share) * blurred[..., *window.within]
        out[..., *window.within] = seen
    return out


class _Laid(NamedTuple):
    """A layer, what it moves, and the pixels of the picture that it may cover."""

    layer: Layer
    displacement_px: Tensor
    window: Window


def _as_one(one: Tensor, other: Tensor) -> bool:
    """Whether two motions are the same, as far as anybody asks."""
    if torch.is_grad_enabled() and (one.requires_grad or other.requires_grad):
        return False
    return float((one - other).abs().amax()) < ALIKE_PX


def _still(displacement_px: Tensor) -> bool:
    return _as_one(displacement_px, torch.zeros_like(displacement_px))


def _groups(laid: Sequence[_Laid]) -> list[tuple[Window, list[_Laid]]]:
    """Layers whose windows meet, each group with the window of all, back to front."""
    groups: list[tuple[Window, list[int]]] = []
    for place, each in enumerate(laid):
        window, members = each.window, [place]
        while met := [group for group in groups if group[0].meets(window)]:
            groups = [group for group in groups if group not in met]
            for other, places in met:
                window, members = window.joined(other), [*members, *places]
        groups.append((window, members))
    return [(window, [laid[place] for place in sorted(members)]) for window, members in groups]


def _blurred(
    laid: _Laid, window: Window, size: tuple[int, int], border: Border, like: Tensor
) -> tuple[Tensor, Tensor]:
    """A layer's light times its matte, (1, C, h, w), and its share of the exposure, (1, 1, h, w), in the window."""
    work = _work(window, [laid.displacement_px])
    plane = plane_of(laid.layer, work, size, border, like)
    moved = blur.motion_blur(plane, laid.displacement_px[None], border="circular")
    seen = cut(moved, work, window)
    return seen[:, :-1], seen[:, -1:].clamp(0, 1)


def _in_parts(
    group: Sequence[_Laid],
    window: Window,
    ground: Tensor,
    blurred: Tensor,
    moved_px: Tensor,
    border: Border,
    step_px: float,
) -> Tensor:
    """The window (1, C, h, w) as the mean of parts of the exposure, in each of which every matte covers what is
    behind it as the part's mean does."""
    size = (ground.shape[-2], ground.shape[-1])
    displacements = [moved_px, *(each.displacement_px for each in group)]
    longest = max(float(each.detach().norm()) for each in displacements)
    if longest > _LONGEST_PX:
        raise ValueError(
            f"displacement_px: {longest:.4g} px; a layer before others in motion takes at most {_LONGEST_PX:g}"
        )
    count = max(1, math.ceil(longest / step_px - 1e-6))
    work = _work(window, displacements)
    colour, share = _blurred(group[-1], window, size, border, ground)
    scene = _Moving(continued_in(ground, work, border), moved_px, count, work, window)
    planes = [plane_of(each.layer, work, size, border, ground) for each in group]
    moving = [
        _Moving(plane, each.displacement_px, count, work, window)
        for plane, each in zip([*planes[:-1], planes[-1][:, -1:]], group, strict=True)
    ]
    total, bare, clear = torch.zeros_like(colour), torch.zeros_like(colour), torch.zeros_like(colour[:, :1])
    for part in range(count):
        seen = own = scene.at(part)
        through = (1 - moving[-1].at(part)).clamp(0, 1)
        uncovered = through
        for each in moving[:-1]:
            before = each.at(part)
            left = (1 - before[:, -1:]).clamp(0, 1)
            seen, uncovered = before[:, :-1] + left * seen, uncovered * left
        total, bare, clear = total.addcmul_(through, seen), bare.add_(own), clear.add_(uncovered)
    # parts are for what varies together; what does not is exact, and the background that outside the window
    bare, clear = bare / count, clear / count
    uncovered = 1 - share if len(group) == 1 else clear
    return colour + total / count - clear * bare + uncovered * blurred[..., *window.within]


class _Moving:
    """A plane (1, C, h, w) over ``work`` as each of the parts of an exposure sees it on average, in ``window``.

    Between pixels linearly, which loses what is finest; it counts only where it varies with what is before it.
    """

    def __init__(
        self, plane: Tensor, displacement_px: Tensor, count: int, work: Window, window: Window
    ) -> None:
        self._plane = blur.motion_blur(plane, displacement_px[None] / count, border="circular")
        asked = torch.is_grad_enabled() and displacement_px.requires_grad
        self._along: list[Any] = list(displacement_px) if asked else displacement_px.tolist()
        self._count = count
        self._place = (window.left - work.left, window.top - work.top)
        self._lengths = (window.width, window.height)

    def at(self, part: int) -> Tensor:
        """In part number ``part``."""
        later = (part + 0.5) / self._count - 0.5
        seen = self._plane
        for dim, along, first, length in zip((-1, -2), self._along, self._place, self._lengths, strict=True):
            seen = _between(seen, along * later, dim, first, length)
        return seen


def _between(plane: Tensor, shift_px: float | Tensor, dim: int, first: int, count: int) -> Tensor:
    """``count`` pixels along one axis from ``first`` on, of a plane that is moved by ``shift_px``."""
    whole = math.ceil(float(shift_px.detach() if isinstance(shift_px, Tensor) else shift_px))
    rest = whole - shift_px  # from the pixel before, in [0, 1)
    near = plane.narrow(dim, first - whole, count)
    if isinstance(rest, float) and rest == 0:
        return near
    return torch.lerp(near, plane.narrow(dim, first - whole + 1, count), rest)


def _work(window: Window, displacements: Sequence[Tensor]) -> Window:
    """The window with all that moves through it, and what is left over to make lengths that transforms like."""
    across, down = (max(reach_px(float(each.detach()[axis])) for each in displacements) for axis in (0, 1))
    grown = window.grown(down, across)
    height = fourier.fast_length(grown.height) if down else grown.height
    width = fourier.fast_length(grown.width) if across else grown.width
    if height * width > fourier.LARGEST_PLANE:
        farthest = max(float(each.detach().abs().max()) for each in displacements)
        raise ValueError(
            f"displacement_px: {farthest:.4g} px along x or y; a layer needs a plane of {height}x{width} pixels, "
            f"at most {fourier.LARGEST_PLANE} are allowed"
        )
    return grown._replace(height=height, width=width)
