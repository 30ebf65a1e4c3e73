"""The conditions of a frame: camera, light, exposure, motion and temperature in one record."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar, cast

import torch
from torch import Tensor

from blurnoise._core.checks import Numbers, an_instance, limited_motion, limited_per_image
from blurnoise.blur import convolution
from blurnoise.blur.layers import Layer, ObjectMotion, object_motion
from blurnoise.blur.sub_exposures import flows
from blurnoise.camera import Camera
from blurnoise.camera.colour import PLANES
from blurnoise.camera.radiometry import dark_electrons, electrons_per_lux_s
from blurnoise.camera.spectra import Curve
from blurnoise.motion.trajectory import Trajectory, per_picture

Number = TypeVar("Number", float, Tensor)


@dataclass(frozen=True)
class Conditions(Generic[Number]):
    """A camera and its conditions: floats for one frame, which are hashable, or tensors (B,) for a batch.

    white_e: mean photo-electrons of light 1. displacement_px: motion (x, y) during the exposure, for a batch (B, 2),
    which adds to the trajectory of each frame, none where there are none. size: (H, W) of the picture, None for the
    sensor's. objects: for one frame what each does, for a batch the layers of every frame; empty where there are
    none. flow_px: (B, 2, H, W), each pixel's displacement, whose middle displacement_px is then; variation_px: the
    farthest from that.
    """

    camera: Camera
    exposure_s: Number
    temperature_c: Number
    white_e: Number
    displacement_px: Tensor | tuple[float, float] = (0.0, 0.0)
    illuminant: str | Curve = "D55"
    size: tuple[int, int] | None = None
    trajectories: tuple[Trajectory | None, ...] = ()
    objects: tuple[ObjectMotion, ...] | tuple[tuple[Layer, ...], ...] = ()
    flow_px: Tensor | None = None
    variation_px: Tensor | float = 0.0

    @staticmethod
    def of(
        image: Tensor,
        camera: Camera,
        *,
        exposure_s: Numbers,
        illuminance_lux: Numbers,
        velocity_px_s: Tensor | Iterable[float] | Iterable[tuple[float, float]] = (0.0, 0.0),
        temperature_c: Numbers = 25.0,
        illuminant: str | Curve = "D55",
        trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
        objects: tuple[tuple[Layer, ...], ...] = (),
    ) -> Conditions[Tensor]:
        """Conditions of frames of ``image``'s pictures (B, C, H, W), in its dtype and on its device.

        Every number is one for all or (B,); velocity_px_s (2,) or (B, 2), or of each pixel (2, H, W) or
        (B, 2, H, W); trajectory: one for all or one, or None, for each. Raises ``ValueError`` naming the argument.
        """
        of_one_exposure(camera)
        batch, size = len(image), (image.shape[-2], image.shape[-1])
        if camera.sensor.cfa not in PLANES and min(size) < 2:
            must = f"behind cfa = {camera.sensor.cfa!r} must be at least 2 x 2"
            raise ValueError(f"image: {size[1]} x {size[0]} px; {must}")
        exposure = limited_per_image("exposure_s", exposure_s, batch, image)
        lux = limited_per_image("illuminance_lux", illuminance_lux, batch, image)
        temperature = limited_per_image("temperature_c", temperature_c, batch, image)
        white_e = lux * exposure * electrons_per_lux_s(camera, illuminant)
        by_flow = getattr(velocity_px_s, "ndim", 0) > 2
        velocity = (flows if by_flow else convolution.motions)("velocity_px_s", velocity_px_s, image)
        moved = velocity * exposure.view(-1, *[1] * (velocity.ndim - 1))
        limited_motion("displacement_px: velocity times exposure", moved)
        middle, variation = middle_of(moved) if by_flow else (moved, 0.0)
        paths = per_picture(trajectory, batch)
        for path, lasting_s in zip(paths, exposure.tolist(), strict=False):
            if path is not None:
                path.origin_px(lasting_s)  # raises unless it holds the exposure
        flow = moved if by_flow else None
        numbers = exposure, temperature, white_e, middle
        return Conditions(camera, *numbers, illuminant, size, paths, objects, flow, variation)

    @property
    def dark_e(self) -> Number:
        """Mean electrons of the dark current."""
        return dark_electrons(self.camera, self.exposure_s, self.temperature_c)

    @property
    def trajectory(self) -> Trajectory | None:
        """The trajectory of the one frame."""
        return self.trajectories[0] if self.trajectories else None

    def each(self: Conditions[Tensor]) -> Iterator[Conditions[float]]:
        """The conditions of every frame, in the precision of the batch."""
        displacement = torch.as_tensor(self.displacement_px)
        varies = torch.as_tensor(self.variation_px).expand(len(displacement))
        tensors = self.exposure_s, self.temperature_c, self.white_e, displacement, varies
        rows = zip(*(tensor.tolist() for tensor in tensors), strict=True)
        size = self.size or self.camera.field.size
        for item, (exposure_s, temperature_c, white_e, (x, y), varies_px) in enumerate(rows):
            layers = cast(tuple[Layer, ...], self.objects[item] if self.objects else ())
            objects = tuple(object_motion(layer, exposure_s, size) for layer in layers)
            numbers = exposure_s, temperature_c, white_e, (x, y)
            yield Conditions(
                self.camera, *numbers, self.illuminant, self.size, self.trajectories[item : item + 1], objects,
                variation_px=varies_px,
            )  # fmt: skip

    def part(self: Conditions[Tensor], of: list[int]) -> Conditions[Tensor]:
        """The conditions of some frames."""
        own: dict[str, Any] = {
            name: value[of] for name, value in vars(self).items() if isinstance(value, Tensor)
        }
        for name in ("trajectories", "objects"):
            each = tuple(vars(self)[name][item] for item in of if vars(self)[name])
            own[name] = each if any(each) else ()
        return replace(self, **own)


def middle_of(flow_px: Tensor) -> tuple[Tensor, Tensor]:
    """Centre of the range of flows (B, 2, H, W), (B, 2), and the largest distance from it, (B,)."""
    seen = flow_px.detach()
    middle = (seen.amax((2, 3)) + seen.amin((2, 3))) / 2
    return middle, (seen - middle[:, :, None, None]).square().sum(1).amax((1, 2)).sqrt()


def of_one_exposure(camera: Camera) -> None:
    """Raise ``TypeError`` for no camera, ``ValueError`` for one of several captures."""
    an_instance("camera", camera, Camera)
    if camera.sensor.captures:
        raise ValueError(
            f"camera: {camera.name!r} makes a picture of {len(camera.sensor.captures)} captures; take it with "
            "blurnoise.scene.hdr.pictures or frames, here there is one exposure (captures=())"
        )
