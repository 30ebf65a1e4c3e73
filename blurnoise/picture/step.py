"""The picture step: one step from digital numbers to a picture, after the converter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor

from blurnoise._core.checks import an_instance, limited, one_of
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Encoding
from blurnoise.optics.spectra import Curve, check_illuminant


@dataclass(frozen=True)
class Development:
    """Options of development: digital gain, the picture's encoding, the light on the scene.

    Raises ``TypeError`` or ``ValueError`` naming the field.
    """

    camera: Camera
    gain_db: float = 0.0
    encoding: Encoding = "srgb"
    illuminant: str | Curve = "D55"

    def __post_init__(self) -> None:
        an_instance("camera", self.camera, Camera)
        limited("gain_db", self.gain_db)
        one_of("encoding", self.encoding, ("srgb", "linear"))
        check_illuminant(self.illuminant)


class PictureStep(ABC):
    """One entry of :data:`blurnoise.picture.steps.STEPS`.

    pointwise: each value depends on its own digital number alone, so tables serve.
    """

    name: str
    pointwise: bool = True

    def active(self, camera: Camera) -> bool:
        """Whether the step changes this camera's frames."""
        return True

    @abstractmethod
    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """Return the picture after the step; differentiable, on any device."""
