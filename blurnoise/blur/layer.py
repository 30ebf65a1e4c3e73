"""A layer: an object with a matte, in front of a picture, in a motion of its own.

Domain: linear light, white is 1; px, x right, y down. Layers come back to front.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any, NamedTuple

import cv2
import torch
from torch import Tensor

from blurnoise._core.beams import BeamPlanes, checked_planes
from blurnoise._core.borders import Border, Window, placed
from blurnoise._core.checks import (
    LIMITS,
    an_instance,
    image_batch,
    in_range,
    integer,
    real_tensor,
    shown,
)
from blurnoise._core.threads import differentiable
from blurnoise.blur.displacement import spread_px

# As the largest side of a picture, see _core.checks: beyond it a layer can only be a mistake.
_PLACE_PX = 1 << 20
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
