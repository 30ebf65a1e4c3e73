"""Vignetting as a light effect: less light towards the corners, by the field angle or by a measured curve."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.light.conditions import OperatingPoint
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.optics.camera import Camera
from blurnoise.optics.distortion import Floats
from blurnoise.optics.lens import Field, Size


@dataclass(frozen=True)
class Vignetting(LightEffect):
    """The light of every pixel times its relative illumination."""

    name = "vignetting"

    def bound(self, at: OperatingPoint[float]) -> float:
        """What the darkest pixel of white loses."""
        return 1 - at.camera.field.least_light() if _darkens(at.camera) else 0.0

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """None that is shared, unless there is no vignetting."""
        return None if _darkens(at.camera) else Blur()

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """Pixel by pixel."""
        share = _light(at.camera.field, (light.shape[-2], light.shape[-1]))
        return light * torch.from_numpy(share).to(light)

    def how(self, at: OperatingPoint[float]) -> str:
        """By which law, and what is left in the darkest corner."""
        if not _darkens(at.camera):
            return "pixel by pixel"
        by = f"cos^{at.camera.lens.falloff_power:g}" if at.camera.lens.falloff_power else "measured curve"
        return f"{by}, {at.camera.field.least_light():.3g} of the light in the darkest corner"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The field, where it darkens."""
        return at.camera.field if _darkens(at.camera) else None


def _darkens(camera: Camera) -> bool:
    return camera.lens.falloff_power > 0 or camera.lens.relative_illumination is not None


@lru_cache(maxsize=4)
def _light(field: Field, size: Size) -> Floats:
    return field.light(size)


VIGNETTING = Vignetting()
