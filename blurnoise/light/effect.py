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

    name: in plans and explanations. figures: the camera's fields without which it does nothing; setting them
    to 0 leaves it out. essential: it stays whatever it contributes, as without it the scene is another.
    """

    name: str
    figures: tuple[str, ...] = ()
    essential: bool = False

    @abstractmethod
    def bound(self, at: Conditions[float]) -> float:
        """RMS, in units of white, that leaving it out changes any picture within [0, 1] by, at most."""

    @abstractmethod
    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        """The light after it, of the same shape; ``light`` itself stays as it is."""

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        """The effect as a blur that shares a transform with its neighbours; None: :meth:`apply` does it.

        By default no blur where its figures are 0, and else None.
        """
        return Blur() if self.idle(at.camera) else None

    def idle(self, camera: Camera) -> bool:
        """Whether it has figures and all of them are 0."""
        return bool(self.figures) and not any(getattr(camera, name) for name in self.figures)

    def how(self, at: Conditions[float]) -> str:
        """How it is modelled, in a few words."""
        return "light in, light out"

    def key(self, at: Conditions[float]) -> Hashable:
        """What of the conditions it depends on: equal keys, equal light."""
        return None if self.idle(at.camera) else at

    def displaces(self, camera: Camera) -> bool:
        """Whether :meth:`move_boxes` moves any in pictures of this camera; by default, whether it is defined."""
        return type(self).move_boxes is not LightEffect.move_boxes

    def move_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """Where targets at ``boxes_xyxy`` (N, 4) are in the picture at mid-exposure; by default where they were.

        The picture's size is ``at.size``, or where that is None the sensor's.
        """
        return boxes_xyxy

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        """What targets at ``boxes_xyxy`` (N, 4) cover during the exposure; by default :meth:`move_boxes`."""
        return self.move_boxes(boxes_xyxy, at)
