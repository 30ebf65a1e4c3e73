"""The light effects, one table in causal order, and the way of light through them.

``EFFECTS`` is read wherever light is changed, planned or explained: a new entry is all that a new effect needs.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import convolution
from blurnoise.camera import Camera
from blurnoise.camera.spectra import Floats
from blurnoise.camera.transfer import SHARP, Optics
from blurnoise.light import capture, headlamps, lens, motion, veil
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.light.resolved import Resolved

EFFECTS: tuple[LightEffect, ...] = (
    headlamps.HEADLAMPS, capture.LAMP, capture.LATER_CAPTURE, lens.DISTORTION, motion.OBJECTS, lens.LATERAL_COLOUR,
    lens.DEFOCUS, lens.DIFFRACTION, lens.MEASURED_MTF, motion.MOTION, motion.MOTION_VARIATION, motion.ROLLING_SHUTTER,
    veil.VEIL, lens.VIGNETTING,
)  # fmt: skip
"""All light effects, in causal order. Blur and motion are in px of the distorted picture, hence after distortion."""


def scene_at(
    light: Tensor, at: Resolved[Tensor], *, border: Border = "reflect"
) -> tuple[Tensor, Resolved[Tensor]]:
    """The scene during one capture: its light (B, C, H, W), and the conditions with its layers.

    Returns ``light`` itself if no effect changes it.

    >>> scene = torch.full((1, 1, 4, 6), 0.5)
    >>> one = torch.ones(1)
    >>> at = Resolved(Camera.preset("imx250"), 0.01 * one, 25 * one, 1000 * one, torch.zeros(1, 2))
    >>> scene_at(scene, at)[0] is scene  # no pulsed lamp, and no earlier capture
    True
    """
    return _applied(light, at, border, [effect for effect in EFFECTS if effect.of_scene])


def through(
    light: Tensor,
    at: Resolved[Tensor],
    *,
    border: Border = "reflect",
    without: frozenset[str] = frozenset(),
) -> Tensor:
    """Light (B, C, H, W) of the scene after lens and motion, without the effects named in ``without``.

    Adjacent blurs share a transform. Returns ``light`` itself if no effect changes it.

    >>> edge, one = (torch.arange(64.0) >= 32).expand(1, 1, 8, 64).float(), torch.ones(1)
    >>> moving = Resolved(Camera.preset("imx250"), 0.01 * one, 25 * one, 1000 * one, torch.tensor([[8.0, 0.0]]))
    >>> [round(float(through(edge, moving, without=frozenset(some))[0, 0, 4, 30]), 1) for some in ((), ("motion",))]
    [0.3, 0.0]
    """
    some = [effect for effect in EFFECTS if not effect.of_scene and effect.name not in without]
    light, _ = _applied(light, at, border, some)
    return light


def _applied(
    light: Tensor, at: Resolved[Tensor], border: Border, some: Sequence[LightEffect]
) -> tuple[Tensor, Resolved[Tensor]]:
    waiting = Blur()  # of the transfer functions since the last effect that is none
    for effect in some:
        if not effect.acts(at):
            continue
        blur = effect.blur(at)
        joined = None if blur is None else _joined(waiting, blur)
        if joined is None:  # the effect cannot share the transform: what waited comes before it
            light = _blurred(light, waiting, border)
        if blur is None:
            before, light = light, effect.apply(light, at, border)
            at = _with_layers_after(effect, before, at, border)
        waiting = joined or blur or Blur()
    return _blurred(light, waiting, border), at


def _with_layers_after(
    effect: LightEffect, like: Tensor, at: Resolved[Tensor], border: Border
) -> Resolved[Tensor]:
    """The conditions with the layers after an effect that changes them as it does the picture behind them."""
    if not at.objects or type(effect).apply_to_layer is LightEffect.apply_to_layer:
        return at
    every = []
    for item, layers in enumerate(at.layers):
        one, picture = at.part([item]), like[item : item + 1]
        every.append(tuple(effect.apply_to_layer(layer, picture, one, border) for layer in layers))
    return replace(at, objects=tuple(every))


def key(at: Resolved[float], without: frozenset[str] = frozenset()) -> Hashable:
    """Equal for exposures of one picture whose light is equal after all effects.

    >>> slow = Resolved(Camera.preset("imx250"), 0.01, 25.0, white_e=1000.0)
    >>> key(slow) == key(replace(slow, white_e=500.0))  # light on the pixels, whatever its level
    True
    """
    return tuple(effect.key(at) for effect in EFFECTS if effect.name not in without)


def displace(camera: Camera) -> bool:
    """Whether any effect moves boxes in pictures of this camera.

    >>> displace(Camera.preset("imx250")), displace(Camera.preset("ar0237"))  # global, rolling shutter
    (False, True)
    """
    moves = LightEffect.move_boxes
    return any(type(effect).move_boxes is not moves and not effect.idle(camera) for effect in EFFECTS)


def moved_boxes(boxes_xyxy: Tensor, at: Resolved[float], *, swept: bool = False) -> Tensor:
    """Boxes (N, 4) of the scene in the picture, after all effects: at mid-exposure, or what they cover during it.

    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, displacement_px=(8.0, 0.0))
    >>> moved_boxes(torch.tensor([[100.0, 50.0, 120.0, 70.0]]), at, swept=True).tolist()
    [[96.0, 50.0, 124.0, 70.0]]
    """
    for effect in EFFECTS:
        if not effect.idle(at.camera):
            boxes_xyxy = (effect.sweep_boxes if swept else effect.move_boxes)(boxes_xyxy, at)
    return boxes_xyxy


def origins(points: Floats, at: Resolved[float]) -> Floats:
    """Points (2, ...) of the scene that points of the picture show at mid-exposure, through all effects.

    >>> import numpy as np
    >>> at = Resolved(Camera.preset("imx250"), 0.01, 25.0, 1000.0, size=(4, 6))
    >>> origins(np.array([[2.0], [1.0]]), at).tolist()  # no distortion, no rolling shutter
    [[2.0], [1.0]]
    """
    for effect in reversed(EFFECTS):  # from the picture back to the scene
        if not effect.idle(at.camera):
            points = effect.origins(points, at)
    return points


def _joined(first: Blur, second: Blur) -> Blur | None:
    """Both blurs as one; None for two motions, whose displacements do not add."""
    if first.displacement_px is not None and second.displacement_px is not None:
        return None
    moved = first.displacement_px if second.displacement_px is None else second.displacement_px
    optics, paths = first.optics, first.paths or second.paths
    if second.optics != SHARP:
        a, b = vars(optics), vars(second.optics)
        if optics != SHARP and any(a[cause] and b[cause] for cause in a):  # two discs are no larger disc
            return None
        optics = Optics(**{cause: a[cause] or b[cause] for cause in a}) if optics != SHARP else second.optics
    return Blur(optics, moved, paths)


def _blurred(light: Tensor, by: Blur, border: Border) -> Tensor:
    if by.optics == SHARP and by.displacement_px is None:
        return light
    moved = torch.zeros(2) if by.displacement_px is None else by.displacement_px
    return convolution.exposure_blur(light, moved, by.optics, by.paths, border=border)
