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

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from blurnoise._core.beams import BeamPlanes, checked_planes
from blurnoise._core.borders import BORDERS, Border, Window, continued_in, cut, placed
from blurnoise._core.checks import (
    LIMITS,
    Numbers,
    an_instance,
    image_batch,
    in_range,
    integer,
    limited_motion,
    limited_per_image,
    one_of,
    real_tensor,
    shown,
)
from blurnoise._core.threads import differentiable, same_bits
from blurnoise.blur import convolution, fourier, rows, sub_exposures
from blurnoise.blur.displacement import Displacement, Readout, spread_px
from blurnoise.blur.sub_exposures import MovingPlane
from blurnoise.camera.transfer import SHARP

# As the largest side of a picture, see _core.checks: beyond it a layer can only be a mistake.
_PLACE_PX = 1 << 20
_LONGEST_PX = 4096.0  # of a motion that is cut into sub-exposures
_FAINT = 1e-3  # share of a pixel below which an object has no colour


@dataclass(frozen=True, eq=False)
class Layer:
    """An object in front of a picture: its light and its matte, with a velocity of its own.

    light: (C, h, w), linear, not multiplied by alpha. alpha: (h, w) within [0, 1], the share of each pixel that the
    object covers. velocity_px_s: (2,), (x, y). place_px: (left, top) of the object's first pixel in the picture,
    whole px; it may lie outside the picture. speed: of a target, a multiple of the exposure's velocity in place of
    velocity_px_s (:meth:`blurnoise.Exposure.of_targets`); None: no target. headlamp_lux: for each beam, "low" or
    "high", what headlamps add to the light on the object, lux, (1, h, w). Gradients pass through light, alpha,
    velocity and headlamp_lux. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed.

    >>> import torch
    >>> from blurnoise import Layer
    >>> post = Layer(torch.full((1, 4, 2), 0.8), torch.ones(4, 2), velocity_px_s=(500.0, 0.0), place_px=(6, 1))
    >>> post.displacement_px(torch.tensor(0.01)).tolist()  # 500 px/s for 10 ms
    [5.0, 0.0]
    """

    light: Tensor
    alpha: Tensor
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0)
    place_px: tuple[int, int] = (0, 0)
    speed: float | None = None
    headlamp_lux: BeamPlanes = field(default_factory=dict)

    def __post_init__(self) -> None:
        image_batch("layer: light", self.light, "(C, h, w)")
        image_batch("layer: alpha", self.alpha, "(h, w)")
        size, light_size = tuple(self.alpha.shape), tuple(self.light.shape[1:])
        if light_size != size:
            raise ValueError(f"layer: alpha is {size}, light {light_size}; must be equal")
        checked_planes("layer: headlamp_lux", self.headlamp_lux, (1, *size))
        low, high = (float(edge) for edge in self.alpha.detach().aminmax())
        if low < 0 or high > 1:
            raise ValueError(f"layer: alpha: values span [{low:g}, {high:g}]; must lie within [0, 1]")
        velocity = real_tensor("layer: velocity_px_s", self.velocity_px_s)
        if velocity.shape != (2,):
            raise ValueError(f"layer: velocity_px_s = {shown(velocity)}: must be two numbers (x, y)")
        for along in velocity.detach().tolist():
            in_range("layer: velocity_px_s", along, *LIMITS["velocity_px_s"][:2])
        object.__setattr__(self, "velocity_px_s", velocity)
        corner = self.place_px
        if not isinstance(corner, (tuple, list)) or len(corner) != 2:
            raise ValueError(f"layer: place_px = {shown(corner)}: must be two whole numbers (left, top)")
        for along in corner:
            integer("layer: place_px", along, -_PLACE_PX, _PLACE_PX)

    def displacement_px(self, exposure_s: Tensor) -> Tensor:
        """Displacement (2,) during an exposure (), in the exposure's precision."""
        velocity = torch.as_tensor(self.velocity_px_s)
        return velocity.to(device=exposure_s.device, dtype=exposure_s.dtype) * exposure_s

    @property
    def window(self) -> Window:
        """The pixels of the picture that the matte covers at rest, those beyond its border included."""
        left, top = self.place_px
        return Window(top, left, *self.alpha.shape)

    @property
    def requires_grad(self) -> bool:
        """Whether any part of it needs gradients."""
        velocity = torch.as_tensor(self.velocity_px_s)
        return differentiable(self.light, self.alpha, velocity)


Layers = Sequence[Layer] | Sequence[Sequence[Layer]]
"""Layers of every picture of a batch, or a sequence of them for each."""


def layers_per_picture(layers: Layers, background: Tensor) -> tuple[tuple[Layer, ...], ...]:
    """The layers of each picture (B, C, H, W), checked against it. Raises ``TypeError`` or ``ValueError``.

    >>> post = Layer(torch.ones(1, 4, 2), torch.ones(4, 2))
    >>> [len(own) for own in layers_per_picture([post], torch.zeros(3, 1, 8, 8))]  # before each of 3 pictures
    [1, 1, 1]
    """
    must = f"layers: must be layers, or a sequence of them for each of {len(background)} pictures"
    if not isinstance(layers, (tuple, list)):
        raise TypeError(must)
    per_picture: Any = layers
    if all(isinstance(each, Layer) for each in layers):
        per_picture = (layers,) * len(background)
    if len(per_picture) != len(background) or not all(
        isinstance(each, (tuple, list)) for each in per_picture
    ):
        raise ValueError(must)
    for layer in (layer for some in per_picture for layer in some):
        an_instance("layers", layer, Layer)
        if len(layer.light) not in (1, background.shape[1]):
            raise ValueError(
                f"layers: one has {len(layer.light)} channels; must be 1 or the background's {background.shape[1]}"
            )
    return tuple(map(tuple, per_picture))


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
    height = fourier.fast_length(grown.height) if down else grown.height
    width = fourier.fast_length(grown.width) if across else grown.width
    # Refused by name here: as a failure of memory it would name nothing.
    fourier.limited_plane(
        f"displacement_px: {max(across, down)} px to either side; a layer needs", height, width
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


def flattened(layers: Sequence[Layer]) -> Layer:
    """Layers that move as the first does, back to front, as one layer.

    >>> back = Layer(torch.full((1, 2, 2), 0.2), torch.ones(2, 2))
    >>> front = Layer(torch.ones(1, 2, 2), torch.full((2, 2), 0.5))
    >>> round(float(flattened([back, front]).light[0, 0, 0]), 6)  # half of 1 over half of 0.2
    0.6
    """
    if len(layers) == 1:
        return layers[0]
    window = reduce(Window.joined, (layer.window for layer in layers))
    beams = [beam for beam in layers[0].headlamp_lux if all(beam in layer.headlamp_lux for layer in layers)]
    stacked = [  # the light of each beam as a colour more
        replace(
            layer,
            light=torch.cat([layer.light, *(layer.headlamp_lux[beam] for beam in beams)]),
            headlamp_lux={},
        )
        for layer in layers
    ]
    plane = plane_of(stacked, window, stacked[0].light[None], "constant")[0]
    alpha = plane[-1]
    light = torch.where(alpha > 0, plane[:-1] / alpha.clamp_min(torch.finfo(alpha.dtype).tiny), 0.0)
    light, *lamps = torch.split(light, [len(layers[0].light), *[1] * len(beams)])
    place = window.left, window.top
    by_beam = dict(zip(beams, lamps, strict=True))
    return Layer(light, alpha.clamp(0, 1), layers[0].velocity_px_s, place, headlamp_lux=by_beam)


def coloured(plane: Tensor) -> tuple[Tensor, Tensor]:
    """Light (C, h, w) and matte (h, w) of a plane (C + 1, h, w) of light times matte, and the matte.

    >>> light, alpha = coloured(torch.tensor([[[0.25, 0.0]], [[0.5, 0.0]]]))
    >>> light.tolist(), alpha.tolist()
    ([[[0.5, 0.0]]], [[0.5, 0.0]])
    """
    alpha = plane[-1].clamp(0, 1)
    covers = alpha > _FAINT  # fainter values are the ringing of resampling, and have no colour
    return torch.where(covers, plane[:-1] / alpha.clamp_min(_FAINT), 0.0), torch.where(covers, alpha, 0.0)


def trimmed(layer: Layer) -> Layer:
    """The layer without margins in which its matte is 0, so that only objects at the border continue beyond it.

    A layer whose matte needs gradients, or is empty, is returned unchanged.

    >>> alpha = torch.zeros(5, 5)
    >>> alpha[2, 3] = 1.0
    >>> small = trimmed(Layer(torch.ones(1, 5, 5), alpha))
    >>> small.place_px, tuple(small.alpha.shape)
    ((3, 2), (1, 1))
    """
    x, y, width, height = cv2.boundingRect((layer.alpha.detach() > 0).byte().cpu().numpy())
    if differentiable(layer.alpha) or width == 0 or (height, width) == tuple(layer.alpha.shape):
        return layer
    box, (left, top) = (slice(y, y + height), slice(x, x + width)), layer.place_px
    planes = {beam: plane[:, *box] for beam, plane in layer.headlamp_lux.items()}
    corner = left + x, top + y
    return replace(
        layer, light=layer.light[:, *box], alpha=layer.alpha[box], place_px=corner, headlamp_lux=planes
    )


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


class ObjectMotion(NamedTuple):
    """An object's displacement, and the share of the picture that its window covers."""

    displacement_px: tuple[float, float]
    share: float


def object_motion(layer: Layer, exposure_s: float, size: tuple[int, int]) -> ObjectMotion:
    """Motion of a layer, and the share of a picture (H, W) that it may cover.

    >>> post = Layer(torch.ones(1, 4, 2), torch.ones(4, 2), velocity_px_s=(500.0, 0.0), place_px=(50, 50))
    >>> object_motion(post, 0.01, (100, 100)).displacement_px
    (5.0, 0.0)
    """
    x, y = layer.displacement_px(torch.tensor(exposure_s, dtype=torch.float64)).tolist()
    window = layer.window.grown(spread_px(abs(y) / 2), spread_px(abs(x) / 2)).clipped(size)
    return ObjectMotion((x, y), max(0, window.height) * max(0, window.width) / math.prod(size))


def plane_of(layers: Sequence[Layer], work: Window, like: Tensor, border: Border) -> Tensor:
    """Light times matte, and the matte, (1, C + 1, h, w) in ``work`` of a picture such as ``like``; of several as
    one.

    >>> half = Layer(torch.full((1, 1, 1), 0.5), torch.full((1, 1), 0.5))
    >>> plane_of([half], Window(0, 0, 1, 2), torch.zeros(1, 1, 1, 2), "constant").tolist()  # light x matte, matte
    [[[[0.25, 0.0]], [[0.5, 0.0]]]]
    """
    planes = []
    for layer in layers:
        alpha = layer.alpha.to(like)[None]
        light = layer.light.to(like).expand(like.shape[1], -1, -1)
        size = (like.shape[-2], like.shape[-1])
        planes.append(placed(torch.cat([light * alpha, alpha])[None], layer.place_px, work, size, border))
    return reduce(lambda behind, before: before + (1 - before[:, -1:]) * behind, planes)
