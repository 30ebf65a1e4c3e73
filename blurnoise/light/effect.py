"""The light effect: what one cause does to the light before it reaches the sensor.

Domain: linear light (B, C, H, W), white is 1; boxes (left, top, right, bottom) px, x right, y down.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from typing import NamedTuple

from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.light.conditions import Conditions
from blurnoise.motion.trajectory import Polyline
from blurnoise.optics.camera import Camera
from blurnoise.optics.transfer import SHARP, Optics


class Blur(NamedTuple):
    """A blur that is the same everywhere: by the lens, and by motion (B, 2) px or none.

    paths: (B,) of the pictures that move otherwise, in place of their motion; () where all move straight.
    """

    optics: Optics = SHARP
    displacement_px: Tensor | None = None
    paths: tuple[Polyline | None, ...] = ()


class LightEffect(ABC):
    """One entry of :data:`blurnoise.light.effects.EFFECTS`; it must compare equal to itself and be hashable.

    name: in plans and explanations. figures: the camera's fields that it depends on; setting them to 0 leaves it
    out. essential: never left out, however small, as without it the scene is another. Of a camera for which it is
    :meth:`idle` none of the other methods but :meth:`key` is called.
    """

    name: str
    figures: tuple[str, ...] = ()
    essential: bool = False

    def idle(self, camera: Camera) -> bool:
        """Whether the camera does not have the effect; by default, whether it has figures and all of them are 0."""
        return bool(self.figures) and not any(getattr(camera, name) for name in self.figures)

    @abstractmethod
    def bound(self, at: Conditions[float]) -> float:
        """RMS, in units of white, that leaving it out changes any picture within [0, 1] by, at most."""

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        """Return the light after an effect that is no blur, of the same shape; ``light`` is not modified."""
        raise NotImplementedError(f"{self.name}: an effect has to define apply, or blur")

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        """The effect as a blur that shares a transform with its neighbours; None, the default: see :meth:`apply`."""
        return None

    def how(self, at: Conditions[float]) -> str:
        """Short description of the model."""
        return "light in, light out"

    def key(self, at: Conditions[float]) -> Hashable:
        """The conditions that the effect depends on: equal keys give equal light."""
        return None if self.idle(at.camera) else at

    def move_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Boxes (N, 4) of the scene at mid-exposure in the picture; unchanged by default.

        The picture's size is ``at.size``, or where that is None the sensor's.
        """
        return boxes_xyxy

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Boxes (N, 4) that targets cover during the exposure; by default :meth:`move_boxes`."""
        return self.move_boxes(boxes_xyxy, at)
