"""Layered exposures: objects with a matte, each in a motion of its own, before a background that moves otherwise.

Domain: linear light, white is 1; px, x right, y down. Layers come back to front. At mid-exposure everything is where
the picture at rest has it. One object of light F and matte alpha before a background B makes, the exposure being T,

    I = h_F * (alpha F) + 1/T integral of (1 - alpha(p - d_F(t))) B(p - d_B(t)) dt.

The matte formula h_F * (alpha F) + (1 - h_F * alpha) (h_B * B) is that wherever either of the two is still (Giusti &
Caglioti 2007, inria-00264748). Where both move, and where objects overlap that move differently, it is a mean of
sub-exposures in a window around the paths of the objects. Where a matte meets the picture's border it continues
beyond it as the border does; elsewhere nothing is beyond it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import BORDERS, Border, Window, continued_in, cut, placed
from blurnoise._core.checks import (
    Numbers,
    image_batch,
    limited_motion,
    limited_per_image,
    one_of,
    real_tensor,
)
from blurnoise._core.threads import differentiable, same_bits
from blurnoise.blur import convolution, rows, sub_exposures, tiles
from blurnoise.blur.displacement import Displacement, Readout, spread_px
from blurnoise.blur.layer import Layer, Layers, layers_per_picture, plane_of, trimmed
from blurnoise.blur.sub_exposures import MovingPlane
from blurnoise.camera.transfer import SHARP

_LONGEST_PX = 4096.0  # of a motion that is cut into sub-exposures


@same_bits
def expose_layers(
    background: Tensor,
    layers: Layers,
    *,
    exposure_s: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    border: Border = "reflect",
) -> Tensor:
    """Expose layers in front of backgrounds (B, C, H, W), float32 or float64; returns the mean light (B, C, H, W).

    exposure_s: a number or (B,). velocity_px_s: of the background, (2,) or (B, 2). Differentiable in every light,
    matte, velocity and exposure. Raises ``TypeError`` or ``ValueError`` naming the argument.

    >>> sign = Layer(torch.ones(1, 3, 4), torch.ones(3, 4), velocity_px_s=(300.0, 0.0), place_px=(5, 2))
    >>> light = expose_layers(torch.zeros(1, 1, 8, 14), [sign], exposure_s=0.01)
    >>> round(float(light.sum()), 1)  # 3 px of motion spread the light of 12 px and keep it
    12.0
    """
    image_batch("background", background)
    one_of("border", border, BORDERS)
    per_picture = layers_per_picture(layers, background)
    exposure = limited_per_image("exposure_s", exposure_s, len(background), background)
    moved_px = convolution.motions("velocity_px_s", velocity_px_s, background) * exposure[:, None]
    limited_motion("displacement_px: velocity times exposure", moved_px)
    moves = [
        Displacement(by, lasting, Readout(background.shape[-2], 0.0, float(lasting)))
        for by, lasting in zip(moved_px, exposure, strict=True)
    ]
    pictures = zip(torch.split(background, 1), per_picture, moves, strict=True)
    mean_light = [exposed(picture, some, by, border) for picture, some, by in pictures]
    return mean_light[0] if len(mean_light) == 1 else torch.cat(mean_light)


def moved(picture: Tensor, moves: Displacement, border: Border) -> Tensor:
    """Mean of a picture (1, C, H, W) over an exposure, normalised for rows that are exposed longer.

    >>> edge = (torch.arange(64.0) >= 32).expand(1, 1, 8, 64).float()
    >>> by = Displacement(torch.tensor([8.0, 0.0]), torch.tensor(0.01), Readout(8, 0.0, 0.01))
    >>> [round(float(moved(edge, by, "reflect")[0, 0, 0, x]), 1) for x in (24, 32, 40)]
    [0.0, 0.6, 1.0]
    """
    if moves.still:
        return picture
    if moves.way == "sub-exposures":
        return sub_exposures.exposed(MovingPlane(picture[0], moves, border=border))[None]
    if moves.way == "rows" and moves.each_row_differs:
        return rows.exposed(picture, moves, border)
    if moves.way == "rows":
        return rows.rolled(picture, moves, border)
    if (path := moves.polyline) is not None:
        return convolution.exposure_blur(picture, moves.even_px, SHARP, (path,), border=border)
    return convolution.motion_blur(picture, moves.even_px[None], border=border)


def exposed(
    background: Tensor, layers: Sequence[Layer], moves: Displacement, border: Border = "reflect"
) -> Tensor:
    """:func:`expose_layers` of one picture (1, C, H, W); moves: the background's, before any camera.

    >>> sign = Layer(torch.ones(1, 3, 4), torch.ones(3, 4), velocity_px_s=(300.0, 0.0), place_px=(5, 2))
    >>> still = Displacement(torch.zeros(2), torch.tensor(0.01), Readout(8, 0.0, 0.01))
    >>> round(float(exposed(torch.zeros(1, 1, 8, 14), [sign], still).sum()), 1)  # light of 12 px, spread by 3 px
    12.0
    """
    size = (background.shape[-2], background.shape[-1])
    groups: list[_Alike] = []
    for layer in map(trimmed, layers):
        displacement = layer.displacement_px(moves.exposure_s).to(background)
        limited_motion("displacement_px: a layer's velocity times exposure", displacement)
        motion = replace(moves, even_px=displacement)
        window = Window(0, 0, *size) if border == "circular" else motion.passed(layer.window).clipped(size)
        if window.height > 0 and window.width > 0:
            groups.append(_Alike((layer,), motion, window))
    ground = background
    # An object that moves with the background hides the same part of it throughout: the two are one picture.
    while groups and groups[0].moves.moves_like(moves):  # it is part of the background
        (layer,), _, window = groups.pop(0)
        rest = window if border == "circular" else layer.window.clipped(size)
        if rest.height > 0 and rest.width > 0:
            ground = background.clone() if ground is background else ground
            plane = plane_of([layer], rest, background, border)
            behind = ground[..., *rest.within].clone()
            ground[..., *rest.within] = plane[:, :-1] + (1 - plane[:, -1:]) * behind
    blurred = moved(ground, moves, border)
    if not groups:
        return blurred
    follows = differentiable(blurred, moves.exposure_s) or any(layer.requires_grad for layer in layers)
    out = blurred.clone() if blurred is background or follows else blurred
    for window, members in meeting([each.window for each in groups]):
        near: list[_Alike] = []
        for each in (groups[index] for index in members):
            if near and near[-1].moves.moves_like(each.moves):
                last = near.pop()
                each = _Alike((*last.layers, *each.layers), last.moves, window)
            near.append(each)
        # The matte formula is exact where the object or the background is still; else the part of the background
        # that is hidden changes during the exposure.
        if len(near) > 1 or not (moves.still or near[0].moves.still):
            composite = _sub_exposed(near, window, ground, blurred, moves, border)
        else:
            colour, share = _blurred(near[0], window, background, border)
            composite = colour + (1 - share) * blurred[..., *window.within]
        out[..., *window.within] = composite
    return out


class _Alike(NamedTuple):
    """Layers that move alike, back to front, how they move, and the pixels of the picture that they may cover."""

    layers: tuple[Layer, ...]
    moves: Displacement
    window: Window


def _blurred(group: _Alike, window: Window, like: Tensor, border: Border) -> tuple[Tensor, Tensor]:
    """The blurred light times matte, (1, C, h, w), and the blurred matte, (1, 1, h, w), in the window."""
    moves = group.moves
    work = _work(window, [moves])
    plane = plane_of(group.layers, work, like, border)
    if moves.readout.row_s and not moves.still:
        mean = sub_exposures.exposed(MovingPlane(plane[0], moves, work.top, work.left), window)[None]
    else:
        # The window holds all that the motion reaches, so that what wraps round is 0.
        mean = cut(moved(plane, moves, "circular"), work, window)
    return mean[:, :-1], mean[:, -1:].clamp(0, 1)


def _sub_exposed(
    group: Sequence[_Alike],
    window: Window,
    ground: Tensor,
    blurred: Tensor,
    moves: Displacement,
    border: Border,
) -> Tensor:
    """Sub-expose a window (1, C, h, w) only where layer and background motion interact.

    The front layer's light and the visible background are blurred exactly, and added.
    """
    every = [moves, *(each.moves for each in group)]
    longest = max(float(each.length_px(window).max()) for each in every)
    if longest > _LONGEST_PX:
        raise ValueError(
            f"displacement_px: {longest:.4g} px; a layer before others in motion takes at most {_LONGEST_PX:g}"
        )
    work = _work(window, every)
    planes = [MovingPlane(continued_in(ground, work, border)[0], moves, work.top, work.left, "replicate")]
    front = group[-1]
    for each in group:
        plane = plane_of(each.layers, work, ground, border)[0]
        # Only the background's visible share needs sub-exposures; the front layer's own blur is exact without them.
        if each is front and not front.moves.each_row_differs:  # its light is added below
            plane = plane[-1:]
        planes.append(MovingPlane(plane, each.moves, work.top, work.left))
    light, uncovered = sub_exposures.exposed_together(planes, window)
    if not front.moves.each_row_differs:
        colour, share = _blurred(front, window, ground, border)
        light = light + colour[0]
        uncovered = 1 - share[0] if len(group) == 1 else uncovered
    return (light + uncovered * blurred[0, :, *window.within])[None]


def _work(window: Window, moves: Sequence[Displacement]) -> Window:
    """The window enlarged by the motion that enters it, then to lengths with fast transforms."""
    farthest = np.max([np.abs(each.range_px(window)).max(0) for each in moves], 0)
    across, down = map(spread_px, farthest.tolist())
    grown = window.grown(down, across)
    height = tiles.fast_length(grown.height) if down else grown.height
    width = tiles.fast_length(grown.width) if across else grown.width
    # Refused by name here: as a failure of memory it would name nothing.
    tiles.limited_plane(
        lambda: f"displacement_px: {max(across, down)} px to either side; a layer needs", height, width
    )
    return grown._replace(height=height, width=width)


def meeting(windows: Sequence[Window]) -> list[tuple[Window, list[int]]]:
    """Groups of windows that overlap, directly or through others: the joint window, and their indices in order.

    >>> left, right, far = Window(0, 0, 4, 4), Window(0, 3, 4, 4), Window(20, 20, 4, 4)
    >>> [members for _, members in meeting([left, far, right])]
    [[1], [0, 2]]
    """
    groups: list[tuple[Window, list[int]]] = []
    for index, window in enumerate(windows):
        members = [index]
        while met := [group for group in groups if group[0].meets(window)]:
            groups = [group for group in groups if group not in met]
            for other, indices in met:
                window, members = window.joined(other), [*members, *indices]
        groups.append((window, sorted(members)))
    return groups


def seen_behind(
    layer: Layer, movers: Sequence[tuple[Layer, Iterable[float]]], size: tuple[int, int]
) -> float:
    """Share of the background hidden at mid-exposure that becomes visible: sum of alpha (1 - a) / sum of alpha.

    a is the share of the exposure for which a pixel is covered. For an object w px wide that moves L along its width
    it is L / 4w up to L = 2w, then 1 - w / L. movers: all objects, this one included, each with its displacement
    relative to the background; objects of different motions count as independent. size: of the picture (H, W); an
    object at its border continues beyond it by reflection.

    >>> post = Layer(torch.ones(1, 20, 10), torch.ones(20, 10), place_px=(40, 20))
    >>> share = seen_behind(post, [(post, (10.0, 0.0))], (60, 100))
    >>> round(share, 2)  # L / 4w of 10 px wide and 10 px moved
    0.25
    """

    def matte(of: Layer, window: Window) -> Tensor:
        return placed(of.alpha.detach().double()[None, None], of.place_px, window, size, "reflect")

    layer = trimmed(layer)
    rest = layer.window.clipped(size)
    if rest.height <= 0 or rest.width <= 0:
        return 0.0
    alpha = matte(layer, rest)
    clear = torch.ones_like(alpha)
    for each, moved in ((trimmed(each), moved) for each, moved in movers):
        motion = real_tensor("displacement_px", moved).detach().double()
        across, down = map(spread_px, (motion.abs() / 2).tolist())
        work = rest.grown(down, across)
        if each.window.meets(work):
            covered = convolution.motion_blur(matte(each, work), motion, border="constant")
            clear = clear * (1 - cut(covered, work, rest).clamp(0, 1))
    total = float(alpha.sum())
    return float((alpha * clear).sum()) / total if total else 0.0
