"""Layers: objects with a matte that move for themselves before a picture, and what is known of each without it.

Domain: linear light, white is 1; px, x right, y down; motion straight and centred, so that at mid-exposure an object
is where its ``place_px`` says. What they make of a picture is in :mod:`blurnoise.blur.layered`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, cast

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise._core.checks import an_instance, finite, integer, one_of, real_tensor, shown
from blurnoise._core.limits import LIMITS
from blurnoise._core.windows import Window, cut, placed
from blurnoise.blur import convolution
from blurnoise.blur.displacement import ALIKE_PX, TAIL_PX

BoxKind = Literal["object", "half", "swept"]
BOX_KINDS = ("object", "half", "swept")
_PLACE_PX = 1 << 20


@dataclass(frozen=True, eq=False)
class Layer:
    """An object: light (C, h, w), its own everywhere in the matte; alpha (h, w) within [0, 1], the share it covers.

    velocity_px_s: (2,), (x, y). place_px: (left, top) of its first pixel in the picture, whole px, outside it too.
    Gradients pass through all three. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed.
    """

    light: Tensor
    alpha: Tensor
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0)
    place_px: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for name, dims in (("light", 3), ("alpha", 2)):
            value = getattr(self, name)
            an_instance(f"layer: {name}", value, Tensor)
            if value.dtype not in (torch.float32, torch.float64):
                raise TypeError(f"layer: {name}: must be float32 or float64, got {value.dtype}")
            if value.ndim != dims or 0 in value.shape:
                must = "(C, h, w)" if dims == 3 else "(h, w)"
                raise ValueError(
                    f"layer: {name}: shape must be {must}, none of them 0, got {tuple(value.shape)}"
                )
            finite(f"layer: {name}", value)
        if self.light.shape[1:] != self.alpha.shape:
            raise ValueError(
                f"layer: alpha is {tuple(self.alpha.shape)}, light {tuple(self.light.shape[1:])}; must be equal"
            )
        low, high = (float(edge) for edge in self.alpha.detach().aminmax())
        if low < 0 or high > 1:
            raise ValueError(f"layer: alpha: values span [{low:g}, {high:g}]; must lie within [0, 1]")
        velocity = real_tensor("layer: velocity_px_s", self.velocity_px_s)
        most = LIMITS["velocity_px_s"].high
        if velocity.shape != (2,) or not bool((velocity.detach().abs() <= most).all()):
            raise ValueError(
                f"layer: velocity_px_s = {shown(velocity)}: must be two numbers (x, y) of at most {most:g}"
            )
        object.__setattr__(self, "velocity_px_s", velocity)
        if not isinstance(self.place_px, (tuple, list)) or len(self.place_px) != 2:
            raise ValueError(
                f"layer: place_px = {shown(self.place_px)}: must be two whole numbers (left, top)"
            )
        for along in self.place_px:
            integer("layer: place_px", along, -_PLACE_PX, _PLACE_PX)

    def displacement_px(self, exposure_s: Tensor) -> Tensor:
        """What it moves during an exposure (), (2,), in the exposure's precision."""
        velocity = torch.as_tensor(self.velocity_px_s)
        return velocity.to(device=exposure_s.device, dtype=exposure_s.dtype) * exposure_s

    @property
    def requires_grad(self) -> bool:
        """Whether gradients are asked of any part of it."""
        return any(
            torch.as_tensor(each).requires_grad for each in (self.light, self.alpha, self.velocity_px_s)
        )


Layers = Sequence[Layer] | Sequence[Sequence[Layer]]
"""Layers of every picture of a batch, or a sequence of them for each."""


def of_each(layers: Layers, background: Tensor) -> tuple[tuple[Layer, ...], ...]:
    """The layers of each picture (B, C, H, W), checked against it. Raises ``TypeError`` or ``ValueError``."""
    must = f"layers: must be layers, or a sequence of them for each of {len(background)} pictures"
    if not isinstance(layers, (tuple, list)):
        raise TypeError(must)
    given = list(layers)
    if any(not isinstance(each, Layer) for each in given):
        if len(given) != len(background) or not all(isinstance(each, (tuple, list)) for each in given):
            raise ValueError(must)
        found = tuple(tuple(cast(Sequence[Layer], each)) for each in given)
    else:
        found = (tuple(cast(list[Layer], given)),) * len(background)
    for layer in (layer for some in found for layer in some):
        an_instance("layers", layer, Layer)
        if len(layer.light) not in (1, background.shape[1]):
            raise ValueError(
                f"layers: one has {len(layer.light)} channels; must be 1 or the background's {background.shape[1]}"
            )
    return found


def as_one(layers: Sequence[Layer]) -> Layer:
    """Layers that move as the first does, back to front, as one layer."""
    windows = [window_at_rest(layer) for layer in layers]
    window = windows[0]
    for each in windows[1:]:
        window = window.joined(each)
    like = layers[0].light[None]
    whole = like.new_zeros(1, like.shape[1] + 1, window.height, window.width)
    for layer, own in zip(layers, windows, strict=True):
        part = whole[..., own.top - window.top :, own.left - window.left :][..., : own.height, : own.width]
        plane = torch.cat([layer.light * layer.alpha, layer.alpha[None]])
        part[:] = plane + (1 - layer.alpha) * part
    alpha = whole[0, -1]
    light = torch.where(alpha > 0, whole[0, :-1] / alpha.clamp_min(torch.finfo(alpha.dtype).tiny), 0.0)
    return Layer(light, alpha.clamp(0, 1), layers[0].velocity_px_s, (window.left, window.top))


def trimmed(layer: Layer) -> Layer:
    """The layer without margins in which its matte is 0: an object that meets no border goes on beyond none.

    One of whose matte gradients are asked keeps them, as does one that is nowhere.
    """
    alpha = layer.alpha.detach()
    if layer.alpha.requires_grad or not bool(alpha.any()):
        return layer
    (top, bottom), (left, right) = (
        torch.nonzero(alpha.any(dim)).flatten()[[0, -1]].tolist() for dim in (1, 0)
    )
    if (bottom - top + 1, right - left + 1) == tuple(alpha.shape):
        return layer
    own = (slice(top, bottom + 1), slice(left, right + 1))
    x, y = layer.place_px
    return replace(layer, light=layer.light[:, *own], alpha=layer.alpha[own], place_px=(x + left, y + top))


def window_at_rest(layer: Layer) -> Window:
    """The pixels of its matte, those beyond a picture's border too."""
    left, top = layer.place_px
    return Window(top, left, *layer.alpha.shape)


def seen_behind(
    layer: Layer,
    displacement_px: Iterable[float],
    *,
    size: tuple[int, int] | None = None,
    movers: Sequence[tuple[Layer, Iterable[float]]] | None = None,
) -> float:
    """Of what is behind the object, at mid-exposure, the share that is seen: sum of alpha (1 - a) / sum of alpha.

    displacement_px: of the object against what is behind it. a is the share of the exposure for which it covers a
    pixel. For a w px wide object that moves L along its width L / 4w up to L = 2w, then 1 - w / L.

    size: of the picture (H, W) whose border an object that ends there goes on beyond, as its reflection does; None:
    it ends. movers: everything before the background, the object too, each with its displacement; those of different
    motions as if they came in each other's way at random. None: the object alone.
    """
    movers = [(trimmed(each), by) for each, by in ([(layer, displacement_px)] if movers is None else movers)]
    layer = trimmed(layer)
    rest = window_at_rest(layer)
    if size is not None:
        rest = rest.clipped(size)
    if rest.height <= 0 or rest.width <= 0:
        return 0.0
    alpha = _matte_in(layer, rest, size)
    total = float(alpha.sum())
    if total == 0:
        return 0.0
    clear = torch.ones_like(alpha)
    for each, moved in movers:
        motion = real_tensor("displacement_px", moved).detach().double()
        down, across = (reach_px(along) for along in motion.tolist()[::-1])
        work = rest.grown(down, across)
        if window_at_rest(each).meets(work):
            covered = convolution.motion_blur(_matte_in(each, work, size), motion, border="constant")
            clear = clear * (1 - cut(covered, work, rest).clamp(0, 1))
    return float((alpha * clear).sum()) / total


def _matte_in(layer: Layer, window: Window, size: tuple[int, int] | None) -> Tensor:
    """The matte in a window, (1, 1, h, w) float64, going on beyond the border of a picture of that size."""
    alpha = layer.alpha.detach().double()[None, None]
    if size is not None:
        return placed(alpha, layer.place_px, window, size, "reflect")
    left, top = (
        along - start for along, start in zip(layer.place_px, (window.left, window.top), strict=True)
    )
    size = (window.height, window.width)
    return placed(alpha, (left, top), Window(0, 0, *size), size, "constant")


def boxes_in_motion(
    boxes_xyxy: Tensor, displacement_px: Tensor | Iterable[float], kind: BoxKind = "object"
) -> Tensor:
    """Boxes (N, 4) of objects that move by (2,) or (N, 2) px: three answers to where they are, as truth.

    "object": where they are at mid-exposure. "swept": all that they pass, half the motion more to either side, whose
    IoU with the object's is w / (w + L). "half": where they are for half of the exposure or more, which is the
    object's own box up to a motion of twice its size along either axis, and nowhere beyond: NaN. Raises
    ``ValueError``.
    """
    one_of("kind", kind, BOX_KINDS)
    if boxes_xyxy.ndim != 2 or boxes_xyxy.shape[1] != 4:
        raise ValueError(f"boxes_xyxy: shape must be (N, 4), got {tuple(boxes_xyxy.shape)}")
    moved = real_tensor("displacement_px", displacement_px).to(boxes_xyxy)
    if moved.shape not in {(2,), tuple(boxes_xyxy[:, :2].shape)}:
        raise ValueError(
            f"displacement_px: shape must be (2,) or ({len(boxes_xyxy)}, 2), got {tuple(moved.shape)}"
        )
    if kind == "object":
        return boxes_xyxy
    passed = moved.abs().expand(len(boxes_xyxy), 2)
    if kind == "swept":
        return boxes_xyxy + torch.cat([-passed / 2, passed / 2], 1)
    there = (passed <= 2 * (boxes_xyxy[:, 2:] - boxes_xyxy[:, :2])).all(1, keepdim=True)
    return torch.where(there, boxes_xyxy, torch.nan)


class Passing(NamedTuple):
    """What an object does to a frame: how far it moves, and the share of the picture that its window takes."""

    displacement_px: tuple[float, float]
    share: float


def passing(layer: Layer, exposure_s: float, size: tuple[int, int]) -> Passing:
    """What a layer does to a picture (H, W)."""
    moved = layer.displacement_px(torch.tensor(exposure_s, dtype=torch.float64)).detach()
    x, y = moved.tolist()
    window = window_of(layer, moved, size, "reflect")
    return Passing((x, y), max(0, window.height) * max(0, window.width) / math.prod(size))


def window_of(layer: Layer, displacement_px: Tensor, size: tuple[int, int], border: Border) -> Window:
    """Of a picture (H, W) the pixels that a layer may cover in the course of its displacement (2,)."""
    if border == "circular":  # it comes back in at the other side
        return Window(0, 0, *size)
    across, down = (reach_px(along) for along in displacement_px.detach().tolist())
    return window_at_rest(layer).grown(down, across).clipped(size)


def reach_px(along_px: float) -> int:
    """How far a motion spreads what moves, the tail of the band-limited line included."""
    return math.ceil(abs(along_px) / 2) + TAIL_PX if abs(along_px) >= ALIKE_PX else 0


def on_canvas(layer: Layer, size: tuple[int, int], like: Tensor) -> Tensor:
    """Light times matte, and the matte, (1, C + 1, H, W) in a picture of that size and of ``like``'s channels."""
    return plane_of(layer, Window(0, 0, *size), size, "constant", like)


def plane_of(layer: Layer, work: Window, size: tuple[int, int], border: Border, like: Tensor) -> Tensor:
    """Light times matte, and the matte, (1, C + 1, h, w) in ``work``."""
    alpha = layer.alpha.to(like)[None]
    light = layer.light.to(like).expand(like.shape[1], -1, -1)
    return placed(torch.cat([light * alpha, alpha])[None], layer.place_px, work, size, border)
