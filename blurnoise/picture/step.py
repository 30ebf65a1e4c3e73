"""The picture step: one of those that make a picture of digital numbers, after the converter.

Domain: digital numbers until the black level is taken off, then linear light (1: full scale), then values in [0, 1].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor

from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Encoding
from blurnoise.optics.spectra import Curve


@dataclass(frozen=True)
class Development:
    """How a frame becomes a picture: digital gain, the picture's encoding, the light on the scene."""

    camera: Camera
    gain_db: float = 0.0
    encoding: Encoding = "srgb"
    illuminant: str | Curve = "D55"


class PictureStep(ABC):
    """One entry of :data:`blurnoise.picture.steps.STEPS`.

    pointwise: each value depends on its own digital number alone, so tables serve.
    """

    name: str
    pointwise: bool = True

    def active(self, camera: Camera) -> bool:
        """Whether it does anything to this camera's frames."""
        return True

    @abstractmethod
    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """The picture after it: differentiable, on any device."""
