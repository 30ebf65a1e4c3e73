"""An exposure in the units of the picture: electrons of white, motion in px, one window of time for each frame.

:class:`blurnoise.Exposure` says what a user asks for. ``Resolved`` is what that means for one capture of a camera:
what light effects and sensor stages read, and what the error budget is computed from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar, cast

import torch
from torch import Tensor

from blurnoise._core.checks import limited_motion
from blurnoise.blur import convolution
from blurnoise.blur.layer import Layer, ObjectMotion, object_motion
from blurnoise.blur.sub_exposures import flows
from blurnoise.camera import Camera
from blurnoise.camera.colour import PLANES
from blurnoise.camera.radiometry import dark_electrons, electrons_per_lux_s
from blurnoise.camera.spectra import Curve
from blurnoise.light.lamp import Pwm
from blurnoise.motion.trajectory import Trajectory

Number = TypeVar("Number", float, Tensor)


class Shift(NamedTuple):
    """How far the scene of each picture has moved on since the first capture.

    later_s: (B,), between the middles of the two exposures. path_px: (B, 2), by the trajectory. scene_px: (B, 2), or
    (B, 2, H, W) of each pixel, by velocity and trajectory together. Of one frame a number and pairs (x, y).

    >>> Shift(later_s=0.01, path_px=(0.0, 0.0), scene_px=(8.0, 0.0)).scene_px  # 800 px/s for 10 ms
    (8.0, 0.0)
    """

    later_s: Tensor | float
    path_px: Tensor | tuple[float, float]
    scene_px: Tensor | tuple[float, float]


class BeamLight(NamedTuple):
    """Light of headlamps on pictures: the beam, the least, the most and the RMS of each picture, and planes, lux.

    lux: (B, 1, H, W), what the beam adds to the illuminance of each pixel; of one frame None.

    >>> BeamLight("low", ranges_lux=((0.0, 20.0, 3.5),)).beam
    'low'
    """

    beam: str
    ranges_lux: tuple[tuple[float, float, float], ...]
    lux: Any = None  # Tensor


@dataclass(frozen=True)
class Resolved(Generic[Number]):
    """Conditions of frames: floats for one frame, which are hashable, or tensors (B,) for a batch.

    white_e: mean photo-electrons of light 1. displacement_px: uniform motion (x, y) during the exposure, for a batch
    (B, 2). size: (H, W) of the picture, None for the sensor's. trajectories: of each frame, in addition to that
    motion; () without. objects: for one frame the motion of each layer, for a batch the layers of every frame; ()
    without. flow_px: (B, 2, H, W), the displacement of each pixel; displacement_px is then the midrange of the flow,
    variation_px the largest distance from it. lamps: the pulsed lamp of each frame, () without; lamp_mask: (B, H, W),
    the share of each pixel's light that comes from it, None for all of it. windows_s: start and duration of each
    frame's exposure, in double precision, from the start of the first capture. shift: of the scene since the first
    capture; None in that capture. illuminance_lux: on the scene, to which ``headlamp`` adds the light of a beam; None
    without.

    >>> from blurnoise import Camera
    >>> warm = Camera.preset("imx250").with_figures(dark_current_e_s=100.0)
    >>> Resolved(warm, exposure_s=0.01, temperature_c=20.0, white_e=5000.0).dark_e
    1.0
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
    lamps: tuple[Pwm | None, ...] = ()
    lamp_mask: Tensor | None = None
    windows_s: tuple[tuple[float, float], ...] = ()
    shift: Shift | None = None
    illuminance_lux: Number | float = 0.0
    headlamp: BeamLight | None = None

    @staticmethod
    def of(
        image: Tensor,
        camera: Camera,
        exposure_s: Tensor,
        illuminance_lux: Tensor,
        temperature_c: Tensor,
        velocity_px_s: Tensor,
        paths: tuple[Trajectory | None, ...],
        illuminant: str | Curve,
        sensitivity: float = 1.0,
        **scene: Any,
    ) -> Resolved[Tensor]:
        """Conditions of one exposure of ``image``'s pictures (B, C, H, W), in its dtype and on its device.

        Numbers (B,) and :func:`velocities` are within their limits; paths: of each picture, or (). sensitivity: a
        factor on the capture's electrons. scene: the fields objects, lamps, lamp_mask, windows_s, shift and headlamp.
        Raises ``ValueError`` for motion beyond its limit, and for a path that ends within the exposure.
        """
        size = image.shape[-2], image.shape[-1]
        if camera.sensor.cfa not in PLANES and min(size) < 2:
            must = f"behind cfa = {camera.sensor.cfa!r} must be at least 2 x 2"
            raise ValueError(f"image: {size[1]} x {size[0]} px; {must}")
        exposure, lux, temperature = (
            numbers.to(image) for numbers in (exposure_s, illuminance_lux * sensitivity, temperature_c)
        )
        white_e = lux * exposure * electrons_per_lux_s(camera, illuminant)
        by_flow = velocity_px_s.ndim > 2
        moved = velocity_px_s * exposure.view(-1, *[1] * (velocity_px_s.ndim - 1))
        limited_motion("displacement_px: velocity times exposure", moved)
        middle, variation = middle_of(moved) if by_flow else (moved, 0.0)
        for path, lasting_s in zip(paths, exposure.tolist(), strict=False):
            if path is not None:
                path.origin_px(lasting_s)  # raises unless it holds the exposure
        return Resolved(
            camera,
            exposure,
            temperature,
            white_e,
            middle,
            illuminant,
            size,
            paths,
            flow_px=moved if by_flow else None,
            variation_px=variation,
            illuminance_lux=illuminance_lux.to(image),
            **scene,
        )

    @property
    def dark_e(self) -> Number:
        """Mean electrons of the dark current."""
        return dark_electrons(self.camera, self.exposure_s, self.temperature_c)

    @property
    def trajectory(self) -> Trajectory | None:
        """The trajectory of the one frame."""
        return self.trajectories[0] if self.trajectories else None

    @property
    def layers(self) -> tuple[tuple[Layer, ...], ...]:
        """The layers of every frame of a batch; () without."""
        return cast(tuple[tuple[Layer, ...], ...], self.objects)

    @property
    def lamp(self) -> Pwm | None:
        """The pulsed lamp of the one frame."""
        return self.lamps[0] if self.lamps else None

    def each(self: Resolved[Tensor]) -> Iterator[Resolved[float]]:
        """The conditions of every frame, in the precision of the batch."""
        displacement = torch.as_tensor(self.displacement_px)
        varies = torch.as_tensor(self.variation_px).expand(len(displacement))
        lux = torch.as_tensor(self.illuminance_lux).expand(len(displacement))
        tensors = self.exposure_s, self.temperature_c, self.white_e, displacement, varies, lux
        rows = zip(*(tensor.tolist() for tensor in tensors), strict=True)
        size = self.size or self.camera.field.size
        for item, (exposure_s, temperature_c, white_e, (x, y), varies_px, of_scene) in enumerate(rows):
            layers = self.layers[item] if self.objects else ()
            one = slice(item, item + 1)
            yield Resolved(
                self.camera,
                exposure_s,
                temperature_c,
                white_e,
                (x, y),
                self.illuminant,
                self.size,
                self.trajectories[one],
                tuple(object_motion(layer, exposure_s, size) for layer in layers) if layers else (),
                variation_px=varies_px,
                lamps=self.lamps[one],
                windows_s=self.windows_s[one],
                shift=None if self.shift is None else _farthest(self.shift, item),
                illuminance_lux=of_scene,
                headlamp=self.headlamp and BeamLight(self.headlamp.beam, self.headlamp.ranges_lux[one]),
            )

    def part(self: Resolved[Tensor], indices: list[int]) -> Resolved[Tensor]:
        """The conditions of some frames."""
        some: dict[str, Any] = {
            name: value[indices] for name, value in vars(self).items() if isinstance(value, Tensor)
        }
        for name in ("trajectories", "objects", "lamps", "windows_s"):
            values = tuple(vars(self)[name][item] for item in indices if vars(self)[name])
            some[name] = values if any(values) else ()
        if self.shift is not None:
            some["shift"] = Shift(*(torch.as_tensor(tensor)[indices] for tensor in self.shift))
        if (lit := self.headlamp) is not None:
            ranges = tuple(lit.ranges_lux[item] for item in indices)
            some["headlamp"] = BeamLight(lit.beam, ranges, lit.lux[indices])
        return replace(self, **some)

    def readout(self: Resolved[Tensor], indices: slice | list[int]) -> Resolved[Tensor]:
        """What the sensor needs of some frames: light, time and temperature."""
        numbers = self.exposure_s[indices], self.temperature_c[indices], self.white_e[indices]
        return Resolved(self.camera, *numbers, illuminant=self.illuminant)


def velocities(velocity_px_s: object, image: Tensor) -> Tensor:
    """Velocities of pictures (B, C, H, W), px/s: (B, 2), or of each pixel (B, 2, H, W), in their dtype.

    Raises ``TypeError`` or ``ValueError`` naming the argument.

    >>> pictures = torch.zeros(2, 1, 4, 6)
    >>> velocities((800.0, 0.0), pictures).shape, velocities(torch.zeros(2, 4, 6), pictures).shape
    (torch.Size([2, 2]), torch.Size([2, 2, 4, 6]))
    """
    by_flow = getattr(velocity_px_s, "ndim", 0) > 2
    return (flows if by_flow else convolution.motions)("velocity_px_s", velocity_px_s, image)


def middle_of(flow_px: Tensor) -> tuple[Tensor, Tensor]:
    """Midrange of flows (B, 2, H, W), (B, 2), and the largest distance from it, (B,).

    >>> middle_of(torch.tensor([[[[1.0, 3.0]], [[0.0, 0.0]]]]))
    (tensor([[2., 0.]]), tensor([1.]))
    """
    flow = flow_px.detach()
    middle = (flow.amax((2, 3)) + flow.amin((2, 3))) / 2
    return middle, (flow - middle[:, :, None, None]).square().sum(1).amax((1, 2)).sqrt()


def _farthest(shift: Shift, item: int) -> Shift:
    """The shift of one frame, of its pixels the largest along x and along y."""
    later_s, path_px, scene_px = (torch.as_tensor(tensor)[item].detach() for tensor in shift)
    x, y = scene_px.flatten(1).abs().amax(1).tolist() if scene_px.ndim > 1 else scene_px.tolist()
    return Shift(float(later_s), (float(path_px[0]), float(path_px[1])), (x, y))
