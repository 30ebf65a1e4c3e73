"""The light effects, one table in causal order, and the way of light through them.

``EFFECTS`` is read wherever light is changed, planned or explained: a new entry is all that a new effect needs.
"""

from __future__ import annotations

from collections.abc import Hashable

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import convolution
from blurnoise.light import lens, motion
from blurnoise.light.conditions import Conditions
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.optics.camera import Camera
from blurnoise.optics.transfer import SHARP, Optics

EFFECTS: tuple[LightEffect, ...] = (
    lens.DISTORTION, motion.OBJECTS, lens.LATERAL_COLOUR, lens.DEFOCUS, lens.DIFFRACTION, lens.MEASURED_MTF,
    motion.MOTION, motion.MOTION_VARIATION, motion.ROLLING_SHUTTER, lens.VIGNETTING,
)  # fmt: skip
"""Blur and motion are in px of the picture that the lens makes, hence after its distortion."""
NOTHING: frozenset[str] = frozenset()


def through(
    light: Tensor,
    at: Conditions[Tensor],
    *,
    border: Border = "reflect",
    without: frozenset[str] = NOTHING,
) -> Tensor:
    """Light (B, C, H, W) after all effects except those named in ``without``; adjacent blurs share a transform.

    Returns ``light`` itself if no effect changes it.
    """
    waiting = Blur()
    for effect in EFFECTS:
        if effect.name in without:
            continue
        own = effect.blur(at)
        if own is not None and (joined := _joined(waiting, own)) is not None:
            waiting = joined
            continue
        light, waiting = _blurred(light, waiting, border), own or Blur()
        if own is None:
            light = effect.apply(light, at, border)
    return _blurred(light, waiting, border)


def key(at: Conditions[float], without: frozenset[str] = NOTHING) -> Hashable:
    """Equal for exposures of one picture whose light is equal after all effects."""
    return tuple(effect.key(at) for effect in EFFECTS if effect.name not in without)


def displace(camera: Camera) -> bool:
    """Whether any effect moves boxes in pictures of this camera."""
    return any(effect.displaces(camera) for effect in EFFECTS)


def moved_boxes(boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
    """Boxes (N, 4) of the scene in the picture at mid-exposure, after all effects."""
    for effect in EFFECTS:
        boxes_xyxy = effect.move_boxes(boxes_xyxy, at)
    return boxes_xyxy


def swept_boxes(boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
    """Boxes (N, 4) that boxes of the scene cover in the picture during the exposure, after all effects."""
    for effect in EFFECTS:
        boxes_xyxy = effect.sweep_boxes(boxes_xyxy, at)
    return boxes_xyxy


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
