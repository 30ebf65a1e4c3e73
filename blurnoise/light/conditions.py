"""The operating point of a frame: what every part of the chain needs to know of how it is taken.

Convention: for one frame numbers are floats, for a batch of B frames of one camera tensors (B,), the
displacement (B, 2); the same formulas serve both. A flow is a motion that differs from pixel to pixel.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar, cast

import torch
from torch import Tensor

from blurnoise._core.checks import Numbers, an_instance
from blurnoise._core.limits import limited_motion, limited_per_image
from blurnoise.blur import convolution
from blurnoise.blur.layers import Layer, Passing, passing
from blurnoise.blur.sub_exposures import flows
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import dark_electrons, electrons_per_lux_s
from blurnoise.optics.spectra import Curve

Number = TypeVar("Number", float, Tensor)


@dataclass(frozen=True)
class OperatingPoint(Generic[Number]):
    """A camera and what its frame meets; hashable where the numbers are floats.

    white_e: mean photo-electrons of light 1. displacement_px: motion (x, y) during the exposure, which adds to the
    trajectory of each frame, none where there are none. size: (H, W) of the picture whose boxes are moved, None for
    the sensor's. objects: for one frame what each does, for a batch the layers of every frame; empty where there are
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
    objects: tuple[Passing, ...] | tuple[tuple[Layer, ...], ...] = ()
    flow_px: Tensor | None = None
    variation_px: Tensor | float = 0.0

    @property
    def dark_e(self) -> Number:
        """Mean electrons of the dark current."""
        return dark_electrons(self.camera, self.exposure_s, self.temperature_c)

    @property
    def trajectory(self) -> Trajectory | None:
        """That of the one frame."""
        return self.trajectories[0] if self.trajectories else None


def operating_points(
    image: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] | Iterable[tuple[float, float]],
    temperature_c: Numbers,
    illuminant: str | Curve,
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    objects: tuple[tuple[Layer, ...], ...] = (),
) -> OperatingPoint[Tensor]:
    """The operating points of frames of ``image``'s pictures (B, C, H, W), in its dtype and on its device.

    Every number is one for all or (B,); velocity_px_s (2,) or (B, 2), or of each pixel (2, H, W) or (B, 2, H, W);
    trajectory: one for all or one, or None, for each. Raises ``ValueError`` naming the argument.
    """
    of_one_exposure(camera)
    batch = len(image)
    exposure = limited_per_image("exposure_s", exposure_s, batch, image)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, image)
    temperature = limited_per_image("temperature_c", temperature_c, batch, image)
    white_e = lux * exposure * electrons_per_lux_s(camera, illuminant)
    displacement, flow = _motion(velocity_px_s, exposure, image)
    points = OperatingPoint(camera, exposure, temperature, white_e, displacement, illuminant, objects=objects)
    if flow is not None:
        points = replace(points, flow_px=flow, variation_px=middle_of(flow)[1])
    paths = per_picture(trajectory, batch)
    for at in each_of(replace(points, trajectories=paths)) if paths else ():
        if at.trajectory is not None:  # which holds the exposure, or raises
            at.trajectory.origin_px(at.exposure_s)
    return replace(points, trajectories=paths) if paths else points


def _motion(velocity_px_s: Any, exposure_s: Tensor, image: Tensor) -> tuple[Tensor, Tensor | None]:
    """Displacements (B, 2) of pictures (B, C, H, W); of a flow the middle, and the flow (B, 2, H, W) itself."""
    moved = "displacement_px: velocity times exposure"
    if getattr(velocity_px_s, "ndim", 0) < 3:
        displacement = convolution.motions("velocity_px_s", velocity_px_s, image) * exposure_s[:, None]
        limited_motion(moved, displacement)
        return displacement, None
    flow = flows("velocity_px_s", velocity_px_s, image) * exposure_s[:, None, None, None]
    limited_motion(moved, flow)
    return middle_of(flow)[0], flow


def middle_of(flow_px: Tensor) -> tuple[Tensor, Tensor]:
    """Of flows (B, 2, H, W) the displacements in the middle, (B, 2), and how far the farthest are from them, (B,)."""
    seen = flow_px.detach()
    middle = (seen.amax((2, 3)) + seen.amin((2, 3))) / 2
    return middle, (seen - middle[:, :, None, None]).square().sum(1).amax((1, 2)).sqrt()


def each_of(
    points: OperatingPoint[Tensor], size: tuple[int, int] | None = None
) -> Iterator[OperatingPoint[float]]:
    """The operating point of every frame, in the precision of the batch; of one (H, W) with what objects do to it."""
    displacement = torch.as_tensor(points.displacement_px)
    varies = torch.as_tensor(points.variation_px).expand(len(displacement))
    numbers = (points.exposure_s, points.temperature_c, points.white_e, displacement, varies)
    rows = zip(*(each.tolist() for each in numbers), strict=True)
    for item, (exposure_s, temperature_c, white_e, (x, y), variation_px) in enumerate(rows):
        layers = cast(tuple[tuple[Layer, ...], ...], points.objects[item : item + 1]) if size else ()
        yield OperatingPoint(
            points.camera,
            exposure_s,
            temperature_c,
            white_e,
            (x, y),
            points.illuminant,
            trajectories=points.trajectories[item : item + 1],
            variation_px=variation_px,
            objects=tuple(passing(layer, exposure_s, size) for some in layers for layer in some if size),
        )


def of_one_exposure(camera: Camera) -> None:
    """Raise ``TypeError`` for no camera, ``ValueError`` for one of several captures."""
    an_instance("camera", camera, Camera)
    if camera.captures:
        raise ValueError(
            f"camera: {camera.name!r} makes a picture of {len(camera.captures)} captures; blurnoise.scene.hdr takes "
            "them, here there is one exposure (captures=())"
        )


def items(points: OperatingPoint[Tensor], of: list[int] | slice) -> OperatingPoint[Tensor]:
    """The operating points of some frames of a batch."""
    return replace(
        points,
        exposure_s=points.exposure_s[of],
        temperature_c=points.temperature_c[of],
        white_e=points.white_e[of],
        displacement_px=torch.as_tensor(points.displacement_px)[of],
        trajectories=_some(points.trajectories, of),
        objects=_some(points.objects, of),
        flow_px=None if points.flow_px is None else points.flow_px[of],
        variation_px=points.variation_px[of] if isinstance(points.variation_px, Tensor) else 0.0,
    )


def _some(of_each: tuple[Any, ...], of: list[int] | slice) -> tuple[Any, ...]:
    some = of_each[of] if isinstance(of, slice) else tuple(of_each[item] for item in of if of_each)
    return some if any(some) else ()
