"""What the scene looks like in one capture: the light of a pulsed lamp, and how far everything has moved on.

A camera of several captures takes them one after the other. A lamp of pulses runs on in the meantime, and what moves
is elsewhere in each capture: that makes ghosts.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from typing import cast

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise._core.checks import real_tensor
from blurnoise.blur.layer import Layer, coloured
from blurnoise.blur.rows import translated
from blurnoise.blur.sub_exposures import flow_warp
from blurnoise.light.effect import LightEffect
from blurnoise.light.headlamps import ambient_share
from blurnoise.light.motion import readout_of
from blurnoise.light.resolved import Number, Resolved, Shift

_MARGIN_PX = 8  # around a layer that is moved by a fraction of a pixel, for the ringing of its edge


class Lamp(LightEffect):
    """A lamp of pulses that lights the scene, or is part of it within a mask (:class:`blurnoise.Pwm`).

    Each row sees the lamp while it is exposed; ``at.windows_s`` says when, so that the lamp runs on from row to row
    and from capture to capture. The phase refers to the start of the first row of the first capture. The light of
    headlamps is not the lamp's: it goes on between the pulses.

    >>> from blurnoise import Camera, Pwm
    >>> when = {"lamps": (Pwm(90.0, 0.1),), "windows_s": ((0.0, 0.001),)}
    >>> at = Resolved(Camera.preset("imx250"), 0.001, 25.0, white_e=1000.0, **when)
    >>> round(LAMP.bound(at), 3)  # an exposure within a pulse has ten times the mean light, nine times too much
    9.0
    """

    name = "pulsed lamp"
    essential = True
    of_scene = True

    def acts(self, at: Resolved[Number]) -> bool:
        return any(lamp is not None and lamp.duty < 1 for lamp in at.lamps)

    def bound(self, at: Resolved[float]) -> float:
        """The largest change of a white picture from steady light, over all phases."""
        if at.lamp is None:
            return 0.0
        _, duration_s = at.windows_s[0]
        least, most = at.lamp.extremes(duration_s)
        return max(1 - least, most - 1)

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        # Picture by picture: lamps differ in phase, and rows of a rolling shutter in their windows of time.
        factors = [_factors(light, at, item) for item in range(len(light))]
        if at.headlamp is not None:
            shares = torch.as_tensor(ambient_share(at)).to(light)
            factors = [1 + share * (factor - 1) for share, factor in zip(shares, factors, strict=True)]
        lit = [light[item : item + 1] * factor for item, factor in enumerate(factors)]
        return lit[0] if len(lit) == 1 else torch.cat(lit)

    def apply_to_layer(self, layer: Layer, like: Tensor, at: Resolved[Tensor], border: Border) -> Layer:
        """The layer in the light of its place; beyond the picture in that of the nearest pixel."""
        factors = _factors(like, at, 0)
        if isinstance(factors, float):
            return layer
        starts = zip(layer.place_px[::-1], layer.alpha.shape, factors.shape, strict=True)
        rows, columns = (
            (start + torch.arange(count)).clamp(0, most - 1).to(factors.device)
            for start, count, most in starts
        )
        here = factors[rows][:, columns]
        if at.headlamp is not None:
            here = 1 + ambient_share(at, layer) * (here - 1)
        return replace(layer, light=layer.light * here.to(layer.light))

    def how(self, at: Resolved[float]) -> str:
        if at.lamp is None:
            return "none here"
        least, most = at.lamp.extremes(at.windows_s[0][1])
        lamp = f"{at.lamp.frequency_hz:g} Hz, lit {at.lamp.duty:.3g} of the time"
        return f"{lamp}: {least:.3g} to {most:.3g} of its mean light, by its phase in each row"

    def key(self, at: Resolved[float]) -> Hashable:
        return (at.lamp, at.windows_s) if at.lamp else None


class LaterCapture(LightEffect):
    """The motion of the scene between the middle of the first capture and the middle of this one.

    >>> from blurnoise import Camera
    >>> moved_on = Shift(later_s=0.01, path_px=(0.0, 0.0), scene_px=(3.0, 0.0))
    >>> LATER_CAPTURE.how(Resolved(Camera.preset("imx250"), 0.001, 25.0, 1000.0, shift=moved_on))
    'displaced by +3, +0 px since the first capture'
    """

    name = "motion between captures"
    essential = True
    of_scene = True

    def acts(self, at: Resolved[Number]) -> bool:
        return at.shift is not None

    def bound(self, at: Resolved[float]) -> float:
        """Bound of a displacement d: pi d / sqrt(2), of a checkerboard, at most 1."""
        if at.shift is None:
            return 0.0
        return min(1.0, math.pi * math.hypot(*at.shift.scene_px) / math.sqrt(2))

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        shift_px = torch.as_tensor(cast(Shift, at.shift).scene_px)
        return (flow_warp if shift_px.ndim > 2 else translated)(light, shift_px, border=border)

    def apply_to_layer(self, layer: Layer, like: Tensor, at: Resolved[Tensor], border: Border) -> Layer:
        # A layer has a velocity of its own, and shares the trajectory of the whole picture.
        shift = cast(Shift, at.shift)
        later_s, path_px = torch.as_tensor(shift.later_s)[0], torch.as_tensor(shift.path_px)[0]
        return displaced(layer, layer.displacement_px(later_s) + path_px)

    def how(self, at: Resolved[float]) -> str:
        if at.shift is None:
            return "none here"
        x, y = at.shift.scene_px
        return f"displaced by {x:+.3g}, {y:+.3g} px since the first capture"

    def key(self, at: Resolved[float]) -> Hashable:
        return at.shift


def _factors(light: Tensor, at: Resolved[Tensor], item: int) -> Tensor | float:
    """Factors (H, W) or (H, 1) on the light of one picture; 1 without a lamp."""
    size = light.shape[-2], light.shape[-1]
    lamp = at.lamps[item] if at.lamps else None  # () of the part of a batch that no lamp lights
    if lamp is None:
        return 1.0
    start_s, duration_s = at.windows_s[item]
    # Rows count from the first one that is exposed, as the phase does, whichever way the sensor scans.
    begin, end = map(torch.from_numpy, readout_of(at.camera, duration_s, size).windows_s)
    rows = lamp.factor(end - begin, begin - begin.min() + start_s)[:, None]
    if at.lamp_mask is None:
        return rows.to(light)
    mask = at.lamp_mask[item]
    return (1 + mask * (rows.to(mask) - 1)).to(light)


def checked_mask(mask: Tensor, batch: int, size: tuple[int, int]) -> Tensor:
    """A lamp's mask (H, W) or (B, H, W) within [0, 1] as (B, H, W). Raises ``TypeError`` or ``ValueError``.

    >>> checked_mask(torch.ones(4, 6), batch=2, size=(4, 6)).shape
    torch.Size([2, 4, 6])
    """
    mask = real_tensor("lamp_mask", mask)
    if mask.shape not in (size, (batch, *size)):
        raise ValueError(f"lamp_mask: shape is {tuple(mask.shape)}; must be the picture's, {size}")
    if not bool(((mask >= 0) & (mask <= 1)).all()):
        raise ValueError("lamp_mask: must lie within [0, 1]")
    return mask.expand(batch, *size)


def displaced(layer: Layer, shift_px: Tensor) -> Layer:
    """The layer displaced by (x, y) px, whole or not; nothing is beyond its sides.

    >>> post = Layer(torch.ones(1, 4, 2), torch.ones(4, 2), place_px=(10, 5))
    >>> displaced(post, torch.tensor([3.0, 0.0])).place_px  # 3 px to the right, with a margin of 8 px
    (5, -3)
    """
    shift = shift_px.detach()
    if not bool((shift != 0).any()):
        return layer
    # Whole pixels move the layer's place and lose nothing; only the remaining fraction is interpolated.
    whole = shift.round()
    plane = torch.cat([layer.light * layer.alpha, layer.alpha[None]])
    plane = torch.nn.functional.pad(plane, (_MARGIN_PX,) * 4)[None]
    light, alpha = coloured(translated(plane, shift - whole, "constant")[0])
    left, top = (start + int(steps) - _MARGIN_PX for start, steps in zip(layer.place_px, whole, strict=True))
    return replace(layer, light=light, alpha=alpha, place_px=(left, top), headlamp_lux={})


LAMP, LATER_CAPTURE = Lamp(), LaterCapture()
