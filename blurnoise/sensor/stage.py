"""The sensor's stage: one step of the way from light on the pixels to digital numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from torch import Tensor

from blurnoise.camera import Camera
from blurnoise.light.resolved import Resolved

MERGE_READ_NOISE_E = 1.0
"""From this read noise (e- rms) up, shot and read noise share one draw; see :func:`.stages.noisy_electrons`."""
Law = Literal["none", "merged", "apart", "counts", "exact"]
"""How shot and read noise are drawn: not; in one normal draw; in one each, for own stages between them; as counts
made of one normal draw; as Poisson counts."""


@dataclass(frozen=True)
class ReadoutFields:
    """Frames (B, C, H, W) being read out: means per frame (B, 1, 1, 1), and the fields (B, C, H, W) drawn for them.

    white_e, dark_e: mean electrons of light 1 and of the dark. seeds: of the noise, one for each frame. normal, read:
    N(0, 1), of shot noise and of read noise apart from it. gain, offset_e: the fixed pattern. A field is None
    where the law or the camera does not ask for it. shared: N(0, 1) by stage, of size 1 along what shares a value.

    >>> import torch
    >>> light = torch.ones(2, 1, 1, 1)
    >>> at = ReadoutFields(Camera.preset("imx250"), "none", white_e=1000 * light, dark_e=0 * light, seeds=[1, 2])
    >>> at.part(1, slice(0, 1)).seeds
    [2]
    """

    camera: Camera
    law: Law
    white_e: Tensor
    dark_e: Tensor
    seeds: Sequence[int]
    quantised: bool = True
    normal: Tensor | None = None
    read: Tensor | None = None
    gain: Tensor | None = None
    offset_e: Tensor | None = None
    shared: Mapping[str, Tensor] = field(default_factory=dict)

    def part(self, item: int, rows: slice) -> ReadoutFields:
        """Some rows of one frame."""
        of, fields = slice(item, item + 1), ("normal", "read", "gain", "offset_e")
        own: dict[str, Any] = {
            name: None if (each := getattr(self, name)) is None else each[of, :, rows] for name in fields
        }
        own["shared"] = {
            name: each[of, :, rows] if each.shape[2] > 1 else each[of] for name, each in self.shared.items()
        }
        own |= {"white_e": self.white_e[of], "dark_e": self.dark_e[of], "seeds": self.seeds[of]}
        return replace(self, **own)


class SensorStage(ABC):
    """One entry of :data:`blurnoise.sensor.stages.STAGES`.

    name: in plans and explanations. figures: the camera's fields that it depends on; 0 for all of them disables the
    stage. essential: the stage is never omitted, since it changes the signal's unit or range. draws: the stage is
    temporal noise from its own random stream (``rng.standard_normal(at.seeds, signal, "its name")``) and is omitted
    with noise=False. spreads: the stage makes pixels or frames of a uniform scene differ, as noise does. modelled:
    short description of the model.

    >>> import torch
    >>> class Half(SensorStage):
    ...     name = "half"
    ...     def apply(self, signal, at):
    ...         return signal / 2
    >>> Half().apply(torch.tensor(100.0), at=None), Half().how(Camera.preset("imx250"), noisy=True)
    (tensor(50.), 'element by element')
    """

    name: str
    figures: tuple[str, ...] = ()
    essential: bool = False
    draws: bool = False
    spreads: bool = False
    modelled: str = "element by element"

    @abstractmethod
    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        """Return the signal after the stage; differentiable, on any device."""

    def bound_dn(self, at: Resolved[float]) -> float | None:
        """Largest contribution in a white picture, DN RMS; None if undefined."""
        return None

    def dither_dn(self, at: Resolved[float]) -> float:
        """Smallest normal noise, DN RMS, that the stage adds to every pixel at any light; it dithers rounding."""
        return 0.0

    def how(self, camera: Camera, noisy: bool) -> str:
        """Short description of the model. noisy: whether shot or read noise is modelled."""
        return self.modelled


def signal_bound_e(at: Resolved[float]) -> float:
    """Electrons of white, but not beyond twice saturation: noise past the clip does not show.

    >>> camera = Camera.preset("imx250")
    >>> glare = Resolved(camera, exposure_s=1.0, temperature_c=25.0, white_e=1e9)
    >>> signal_bound_e(glare) == 2 * camera.sensor.saturation_e
    True
    """
    return min(at.white_e, 2 * at.camera.sensor.saturation_e)


def within_range_dn(camera: Camera, electrons: float) -> float:
    """An error of so many electrons in DN, which cannot exceed the range.

    >>> within_range_dn(Camera.preset("imx250"), 1e9)
    4095
    """
    return min(camera.sensor.system_gain_dn_per_e * electrons, camera.sensor.full_scale_dn)
