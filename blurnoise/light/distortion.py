"""Displacements by the lens as light effects: distortion, and colours of different magnification.

Convention: the scene is what a pinhole camera of the same focal length and axis sees; what it does not see follows
the picture's border. Both are by :mod:`.resampling`, with its loss of what is near half a cycle per pixel.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import resampling
from blurnoise.light.conditions import OperatingPoint
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.optics.camera import Camera
from blurnoise.optics.distortion import Floats
from blurnoise.optics.lens import Field, Size


@dataclass(frozen=True)
class Distortion(LightEffect):
    """Distortion by OpenCV's models; boxes follow."""

    name = "distortion"

    def bound(self, at: OperatingPoint[float]) -> float:
        """Of the largest displacement in a picture of the sensor's size; see ``_displaced``."""
        return _displaced(at.camera.field.farthest_px()) if at.camera.lens.displaces else 0.0

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """None that is shared, unless there is no distortion."""
        return None if at.camera.lens.displaces else Blur()

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """The picture seen at the pixels' directions."""
        return resampling.sampled(light, *_sources(at.camera.field, _size(light)), border)

    def how(self, at: OperatingPoint[float]) -> str:
        """The model, and how far it moves."""
        shape = at.camera.lens.distortion
        if shape is None:
            return "resampled"
        return f"{shape.model}, up to {at.camera.field.farthest_px():.3g} px: resampled by splines"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The field, where it is distorted."""
        return at.camera.field if at.camera.lens.displaces else None

    def displaces(self, camera: Camera) -> bool:
        """Where the camera's lens distorts."""
        return camera.lens.displaces

    def move_boxes(self, boxes_xyxy: Tensor, at: OperatingPoint[float]) -> Tensor:
        """As :meth:`blurnoise.optics.lens.Field.moved_boxes` does."""
        if not at.camera.lens.displaces:
            return boxes_xyxy
        field = at.camera.field
        moved = field.moved_boxes(boxes_xyxy.detach().cpu().double().numpy(), at.size or field.size)
        return torch.from_numpy(moved).to(boxes_xyxy)


@dataclass(frozen=True)
class LateralColour(LightEffect):
    """Red and blue larger or smaller than green, in pictures of three channels, R, G and B; others have no colour."""

    name = "lateral colour"

    def bound(self, at: OperatingPoint[float]) -> float:
        """Of the larger displacement in the corner of a picture of the sensor's size; see ``_displaced``."""
        return _displaced(max(map(abs, _shares(at.camera))) * at.camera.field.corner_px)

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """None that is shared, unless there is no lateral colour."""
        return None if any(_shares(at.camera)) else Blur()

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """Red and blue seen in their own magnification."""
        if light.shape[1] != 3:
            return light
        planes = [light[:, place : place + 1] for place in range(3)]
        for place, share in zip((0, 2), _shares(at.camera), strict=True):
            if share:
                positions = _larger(at.camera.field, share, _size(light))
                planes[place] = resampling.sampled(planes[place], *positions, border)
        return torch.cat(planes, 1)

    def how(self, at: OperatingPoint[float]) -> str:
        """How far the colours lie apart in the corner."""
        red, blue = (share * at.camera.field.corner_px for share in _shares(at.camera))
        return f"in the corner red {red:+.3g} px, blue {blue:+.3g} px from green: resampled by splines"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The field, where colours differ in it."""
        return at.camera.field if any(_shares(at.camera)) else None


def _displaced(by_px: float) -> float:
    """RMS that a displacement changes a picture by, at most, units of white.

    A wave changes by at most 2 pi f d of its amplitude; the worst picture is a checkerboard, whose contrast, 1/2 RMS,
    lies at f = 1 / sqrt(2).
    """
    return min(1.0, math.pi * by_px / math.sqrt(2))


def _shares(camera: Camera) -> tuple[float, float]:
    return camera.lens.lateral_red, camera.lens.lateral_blue


def _size(light: Tensor) -> Size:
    return light.shape[-2], light.shape[-1]


@lru_cache(maxsize=2)
def _sources(field: Field, size: Size) -> tuple[Floats, Floats]:
    return field.sources(size)


@lru_cache(maxsize=4)
def _larger(field: Field, share: float, size: Size) -> tuple[Floats, Floats]:
    return field.larger(share, size)


DISTORTION, LATERAL_COLOUR = Distortion(), LateralColour()
