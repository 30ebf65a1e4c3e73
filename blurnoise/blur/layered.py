"""Layered exposures: objects, each in a motion of its own, before a background that moves otherwise or not at all.

Domain: linear light, white is 1; px, x right, y down; at mid-exposure everything is where the picture at rest has it,
unless the camera shakes or reads row by row. Layers come back to front: the last is in front.

One object of light F and matte alpha before a background B makes, the exposure being T,

    I = h_F * (alpha F) + 1/T integral of (1 - alpha(p - d_F(t))) B(p - d_B(t)) dt.

The matte formula h_F * (alpha F) + (1 - h_F * alpha) (h_B * B) is that wherever matte or background does not vary in
time, as where either of them is still (Giusti & Caglioti 2007, inria-00264748). Where both move, and where objects
overlap that move differently, it is a mean of sub-exposures (:mod:`.sub_exposures`) in a window around what
the objects pass; the rest of the picture knows the background alone, and what of that is uncovered there is as
exact as in the rest. Never blend a blurred picture by a blurred matte: that leaves the object sharp in its own place.

Where a matte meets the picture's border it goes on beyond it as the border does; elsewhere nothing is beyond it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import Numbers, image_batch, in_range, one_of
from blurnoise._core.limits import limited_motion, limited_per_image
from blurnoise._core.threads import differentiable
from blurnoise._core.windows import Window, continued_in, cut
from blurnoise.blur import convolution, fourier, row_paths, rows, sub_exposures
from blurnoise.blur.displacement import Displacement, Readout
from blurnoise.blur.layers import Layer, Layers, of_each, plane_of, trimmed, window_at_rest
from blurnoise.blur.sub_exposures import Sheet

STEP_PX = sub_exposures.SPACING_PX
"""What the fastest moves from one sub-exposure to the next, at most."""
_LONGEST_PX = 4096.0  # of a motion that is cut into sub-exposures


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
    moved_px = convolution.motions("velocity_px_s", velocity_px_s, background) * exposure[:, None]
    limited_motion("displacement_px: velocity times exposure", moved_px)
    height = background.shape[-2]
    seen = []
    for picture, own, lasting, by in zip(
        torch.split(background, 1), per_picture, exposure, moved_px, strict=True
    ):
        moves = Displacement(by, lasting, Readout(height, 0.0, float(lasting)))
        seen.append(exposed(picture, own, moves, border, step_px))
    return seen[0] if len(seen) == 1 else torch.cat(seen)


def at_rest(background: Tensor, layers: Sequence[Layer]) -> Tensor:
    """A picture (1, C, H, W) with its layers before it, nothing moving."""
    still = Displacement(
        background.new_zeros(2), background.new_zeros(()), Readout(background.shape[-2], 0.0, 0.0)
    )
    return exposed(background, layers, still)


def moved(picture: Tensor, moves: Displacement, border: Border) -> Tensor:
    """A picture (1, C, H, W) as an exposure sees it; no brighter where rows are exposed longer."""
    if moves.still:
        return picture
    if moves.way == "sub-exposures":
        return sub_exposures.moved_picture(picture[0], moves, border)[None]
    if moves.way == "rows" and moves.each_row_differs:
        return row_paths.exposed(picture, moves, border)
    if moves.way == "rows":
        return rows.rolled(picture, moves.even_px, moves.exposure_s, moves.readout.row_s, border)
    if (path := moves.polyline) is not None:
        return convolution.path_blur(picture, path, border=border)
    return convolution.motion_blur(picture, moves.even_px[None], border=border)


def exposed(
    background: Tensor,
    layers: Sequence[Layer],
    moves: Displacement,
    border: Border = "reflect",
    step_px: float = STEP_PX,
) -> Tensor:
    """:func:`expose_layers` of one picture (1, C, H, W); moves: the background's, before any camera."""
    size = (background.shape[-2], background.shape[-1])
    everything = Window(0, 0, *size)
    laid = []
    for layer in map(trimmed, layers):
        displacement = layer.displacement_px(moves.exposure_s).to(background)
        limited_motion("displacement_px: a layer's velocity times exposure", displacement)
        own = replace(moves, even_px=displacement)
        window = everything if border == "circular" else own.passed(window_at_rest(layer)).clipped(size)
        if window.height > 0 and window.width > 0:
            laid.append(_Laid((layer,), own, window))
    ground = background
    while laid and laid[0].moves.moves_like(moves):  # what moves with the background is part of it
        first = laid.pop(0)
        rest = first.window if border == "circular" else window_at_rest(first.layers[0]).clipped(size)
        if rest.height <= 0 or rest.width <= 0:
            continue
        ground = background.clone() if ground is background else ground
        plane = first.plane(rest, size, border, background)
        ground[..., *rest.within] = plane[:, :-1] + (1 - plane[:, -1:]) * ground[..., *rest.within].clone()
    blurred = moved(ground, moves, border)
    if not laid:
        return blurred
    follows = differentiable(blurred, moves.exposure_s) or any(layer.requires_grad for layer in layers)
    out = blurred.clone() if blurred is background or (torch.is_grad_enabled() and follows) else blurred
    for window, members in _groups(laid):
        group = _joined(members)
        if len(group) > 1 or not (moves.still or group[0].moves.still):
            seen = _sub_exposed(group, window, ground, blurred, moves, border, step_px)
        else:
            colour, share = _blurred(group[0], window, size, border, background)
            seen = colour + (1 - share) * blurred[..., *window.within]
        out[..., *window.within] = seen
    return out


class _Laid(NamedTuple):
    """Layers that move alike, back to front, how they move, and the pixels of the picture that they may cover."""

    layers: tuple[Layer, ...]
    moves: Displacement
    window: Window

    def plane(self, work: Window, size: tuple[int, int], border: Border, like: Tensor) -> Tensor:
        """Light times matte, and the matte, (1, C + 1, h, w) in ``work``, of all as one."""
        plane = plane_of(self.layers[0], work, size, border, like)
        for layer in self.layers[1:]:
            before = plane_of(layer, work, size, border, like)
            plane = before + (1 - before[:, -1:]) * plane
        return plane


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


def _joined(group: Sequence[_Laid]) -> list[_Laid]:
    """Layers back to front, neighbours that move alike as one."""
    found: list[_Laid] = []
    for each in group:
        if found and found[-1].moves.moves_like(each.moves):
            last = found.pop()
            each = _Laid((*last.layers, *each.layers), last.moves, last.window.joined(each.window))
        found.append(each)
    return found


def _blurred(
    laid: _Laid, window: Window, size: tuple[int, int], border: Border, like: Tensor
) -> tuple[Tensor, Tensor]:
    """Its light times its matte, (1, C, h, w), and its share of the exposure, (1, 1, h, w), in the window."""
    moves = laid.moves
    work = _work(window, [moves])
    plane = laid.plane(work, size, border, like)
    if moves.each_row_differs and not moves.still:
        sheet = Sheet(plane[0], moves, work.top, work.left)
        seen = sub_exposures.moved_sheet(sheet, window)[None]
    elif moves.way == "rows":  # of a window, of which row ``middle`` is read at time 0
        seen = convolution.motion_blur(plane, moves.even_px[None], border="circular")
        middle, velocity = (size[0] - 1) / 2 - work.top, moves.even_px / moves.exposure_s.to(moves.even_px)
        seen = cut(rows.warped(seen, velocity, moves.readout.row_s, "circular", middle=middle), work, window)
    else:
        seen = cut(moved(plane, moves, "circular"), work, window)
    return seen[:, :-1], seen[:, -1:].clamp(0, 1)


def _sub_exposed(
    group: Sequence[_Laid],
    window: Window,
    ground: Tensor,
    blurred: Tensor,
    moves: Displacement,
    border: Border,
    step_px: float,
) -> Tensor:
    """The window (1, C, h, w) as a mean of sub-exposures, what of the background is uncovered as it is elsewhere."""
    every = [moves, *(each.moves for each in group)]
    longest = max(float(each.length_px(window).max()) for each in every)
    if longest > _LONGEST_PX:
        raise ValueError(
            f"displacement_px: {longest:.4g} px; a layer before others in motion takes at most {_LONGEST_PX:g}"
        )
    work = _work(window, every)
    behind = continued_in(ground, work, border)[0]
    sheets = [Sheet(behind, moves, work.top, work.left, "replicate")]
    for each in group:
        plane = each.plane(work, (ground.shape[-2], ground.shape[-1]), border, ground)[0]
        sheets.append(Sheet(plane[:-1], each.moves, work.top, work.left, matte=plane[-1:]))
    seen = sub_exposures.layers_over(sheets, window, step_px)
    # a mean of sub-exposures is for what varies together; what does not is as exact as elsewhere
    light, uncovered = seen.light - seen.uncovered * seen.hindmost, seen.uncovered
    if not group[-1].moves.each_row_differs:
        colour, share = _blurred(group[-1], window, (ground.shape[-2], ground.shape[-1]), border, ground)
        light = light - seen.foremost + colour[0]
        uncovered = 1 - share[0] if len(group) == 1 else uncovered
    return (light + uncovered * blurred[0, :, *window.within])[None]


def _work(window: Window, moves: Sequence[Displacement]) -> Window:
    """The window with all that moves through it, and what is left over to make lengths that transforms like."""
    down, across = (max(reach) for reach in zip(*(each.reach_px(window) for each in moves), strict=True))
    grown = window.grown(down, across)
    height = fourier.fast_length(grown.height) if down else grown.height
    width = fourier.fast_length(grown.width) if across else grown.width
    if height * width > fourier.LARGEST_PLANE:
        raise ValueError(
            f"displacement_px: {max(across, down)} px to either side; a layer needs a plane of {height}x{width} "
            f"pixels, at most {fourier.LARGEST_PLANE} are allowed"
        )
    return grown._replace(height=height, width=width)
