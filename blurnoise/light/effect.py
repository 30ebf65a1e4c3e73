"""Interface of light effects: changes of the light before it reaches the sensor.

Domain: linear light (B, C, H, W), white is 1; boxes (left, top, right, bottom) px, x right, y down; points (2, ...)
of x and y, px, (0, 0) the centre of the first pixel.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from typing import NamedTuple

from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur.layer import Layer
from blurnoise.camera import Camera
from blurnoise.camera.spectra import Floats
from blurnoise.camera.transfer import SHARP, Optics
from blurnoise.light.resolved import Number, Resolved
from blurnoise.motion.trajectory import Polyline


class Blur(NamedTuple):
    """A blur that is the same everywhere: by the lens, and by motion (B, 2), px, or None.

    paths: (B,), paths of pictures that do not move straight, in place of their motion; () if all move straight.

    >>> import torch
    >>> Blur(displacement_px=torch.tensor([[3.0, 0.0]])).optics == SHARP  # motion alone
    True
    """

    optics: Optics = SHARP
    displacement_px: Tensor | None = None
    paths: tuple[Polyline | None, ...] = ()


class LightEffect(ABC):
    """One entry of :data:`blurnoise.light.effects.EFFECTS`; it must compare equal to itself and be hashable.

    name: in plans and explanations. figures: the camera's fields that it depends on; 0 for all of them disables the
    effect. essential: the effect is never omitted, however small, since it is part of the scene. of_scene: the effect
    changes the scene before the lens, so that it decides how bright the brightest surface is. For a camera for which
    it is :meth:`idle`, only :meth:`key` is called.

    >>> class Fog(LightEffect):
    ...     name = "fog"
    ...     def bound(self, at):
    ...         return 0.1  # of white, in a black picture
    ...     def apply(self, light, at, border):
    ...         return 0.9 * light + 0.1
    >>> Fog().how(at=None), Fog().idle(Camera.preset("imx250"))
    ('light in, light out', False)
    """

    name: str
    figures: tuple[str, ...] = ()
    essential: bool = False
    of_scene: bool = False

    def idle(self, camera: Camera) -> bool:
        """Whether the camera lacks the effect; by default, whether the effect has figures and all of them are 0."""
        return bool(self.figures) and not any(camera.figure(name) for name in self.figures)

    def acts(self, at: Resolved[Number]) -> bool:
        """Whether the effect changes the light under these conditions; by default, whether it is not idle."""
        return not self.idle(at.camera)

    @abstractmethod
    def bound(self, at: Resolved[float]) -> float:
        """Largest RMS change, in units of white, of any picture within [0, 1] if the effect is omitted."""

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        """Return the light after the effect, of the same shape; ``light`` is not modified. Not called for a blur."""
        raise NotImplementedError(f"{self.name}: an effect has to define apply, or blur")

    def apply_to_layer(self, layer: Layer, like: Tensor, at: Resolved[Tensor], border: Border) -> Layer:
        """Return an object in front of a picture ``like`` (1, C, H, W) after the effect; unchanged by default.

        Called for effects that precede the motion of objects. at: the conditions of that picture alone.
        """
        return layer

    def blur(self, at: Resolved[Tensor]) -> Blur | None:
        """The effect as a blur that shares a transform with its neighbours; None, the default: see :meth:`apply`."""
        return None

    def how(self, at: Resolved[float]) -> str:
        """Short description of the model."""
        return "light in, light out"

    def key(self, at: Resolved[float]) -> Hashable:
        """The conditions that the effect depends on: equal keys give equal light."""
        return None if self.idle(at.camera) else at

    def move_boxes(self, boxes_xyxy: Tensor, at: Resolved[float]) -> Tensor:
        """Boxes (N, 4) of the scene at mid-exposure in the picture; unchanged by default.

        The picture's size is ``at.size``, or where that is None the sensor's.
        """
        return boxes_xyxy

    def sweep_boxes(self, boxes_xyxy: Tensor, at: Resolved[float]) -> Tensor:
        """Boxes (N, 4) that targets cover during the exposure; by default :meth:`move_boxes`."""
        return self.move_boxes(boxes_xyxy, at)

    def origins(self, points: Floats, at: Resolved[float]) -> Floats:
        """Points of the scene that points (2, ...) within the picture show at mid-exposure; unchanged by default.

        The inverse of :meth:`move_boxes`, for every pixel of a mask.
        """
        return points
