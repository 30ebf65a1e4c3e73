"""Objects as a light effect: layers before the picture, each in a motion of its own.

With objects, the motion of everything happens here, the background's included: what covers what changes during the
exposure. So it stands before the lens, which sees what all of them make together, but behind the distortion, in whose
px motion is. So do shake and readout, which hence come before the lens instead of behind it: that differs by how far
rows are displaced against each other within the lens's blur.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from typing import cast

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import layered
from blurnoise.blur.layers import Layer, Passing, on_canvas
from blurnoise.light.conditions import Conditions
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.light.lens import DISTORTION
from blurnoise.light.motion import exposed
from blurnoise.light.translation import translated


class Objects(LightEffect):
    """Layers by :mod:`blurnoise.blur.layered`. Where there are some it stays, as they are part of the picture."""

    name = "objects"
    essential = True

    def bound(self, at: Conditions[float]) -> float:
        """What one motion for all, the background's, would change.

        The mean over the exposure of a product of waves f (of the matte or its light) and g (of what is behind)
        is sinc(f . d_F + g . d_B), so that a difference D of the motions changes it by at most 1.3703 |f . D|; f is
        at most 1 / sqrt(2), a checkerboard's, and black and white differ by 1. All in the object's window.
        """
        squares = 0.0
        for each in cast(tuple[Passing, ...], at.objects):
            apart = math.dist(each.displacement_px, cast(tuple[float, float], at.displacement_px))
            squares += min(1.0, 1.3703 / math.sqrt(2) * apart) ** 2 * each.share
        return min(1.0, math.sqrt(squares))

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        """Nothing to share, unless there are objects."""
        return None if at.objects else Blur()

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        """Every picture with its own layers."""
        every = cast(tuple[tuple[Layer, ...], ...], at.objects)
        if at.camera.lens.displaces:
            every = tuple(
                tuple(_distorted(layer, light, at.part([place]), border) for layer in own)
                for place, own in enumerate(every)
            )
        return exposed(light, at, every, border)

    def how(self, at: Conditions[float]) -> str:
        """How many, and the longest motion."""
        found = cast(tuple[Passing, ...], at.objects)
        if not found:
            return "none here"
        longest = max(math.hypot(*each.displacement_px) for each in found)
        apart = any(any(each.displacement_px) for each in found) and any(at.displacement_px)
        way = f"parts of {layered.STEP_PX:g} px" if apart or len(found) > 1 else "matte formula"
        return f"{len(found)} in layers, up to {longest:.3g} px: {way}, in their windows"

    def key(self, at: Conditions[float]) -> Hashable:
        """Their displacements."""
        return at.objects


def displaced(layer: Layer, shift_px: Tensor) -> Layer:
    """The layer (x, y) px further on, of any real numbers; nothing is beyond it then."""
    shift = shift_px.detach()
    if not bool((shift != 0).any()):
        return layer
    whole = shift.round()
    plane = torch.cat([layer.light * layer.alpha, layer.alpha[None]])
    plane = torch.nn.functional.pad(plane, (_MARGIN_PX,) * 4)[None]
    light, alpha = _coloured(translated(plane, shift - whole, "constant")[0])
    left, top = (start + int(steps) - _MARGIN_PX for start, steps in zip(layer.place_px, whole, strict=True))
    return replace(layer, light=light, alpha=alpha, place_px=(left, top))


_MARGIN_PX = 8  # of what a fraction of a pixel makes of an edge
_FAINT = 1e-3  # share of a pixel below which there is no colour


def _distorted(layer: Layer, like: Tensor, at: Conditions[Tensor], border: Border) -> Layer:
    """The layer as the lens shows it, in a window as large as the picture."""
    height, width = like.shape[-2:]
    plane = on_canvas(layer, (height, width), like)
    seen = DISTORTION.apply(plane, at, border)[0]
    light, alpha = _coloured(seen)
    return replace(layer, light=light, alpha=alpha, place_px=(0, 0))


def _coloured(plane: Tensor) -> tuple[Tensor, Tensor]:
    """Light and matte of light times matte, and the matte, (C + 1, h, w)."""
    alpha = plane[-1].clamp(0, 1)
    seen = alpha > _FAINT  # what rings about it is not of the object
    return torch.where(seen, plane[:-1] / alpha.clamp_min(_FAINT), 0.0), torch.where(seen, alpha, 0.0)


OBJECTS = Objects()
