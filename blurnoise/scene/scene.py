"""Scenes: pictures in linear light to be exposed, with what stands in front of them and the light on them."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import lru_cache, partial
from typing import Any, Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.beams import BeamPlanes, checked_planes
from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import batch_shaped, image_batch, one_of
from blurnoise.blur.layer import Layer, Layers, layers_per_picture
from blurnoise.camera.colour import PictureTone, picture_tone, untoned
from blurnoise.light.capture import checked_mask
from blurnoise.light.resolved import BeamLight
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import anchored, mean_luma
from blurnoise.sensor.readout import most

_FIELDS = 2  # noise fields that a scene keeps: those of shot and read noise


@dataclass(eq=False, repr=False)
class Scene:
    """Pictures as linear light (B, C, H, W) for cameras to take; 1 is white. Any number of threads may use it.

    layers: objects in front of the pictures, the same for all, or a sequence for each (:mod:`blurnoise.blur.layers`).
    border: how pictures go on beyond their sides. lamp_mask: (H, W) or (B, H, W), the share of each pixel's light
    that comes from a pulsed lamp; None: all of it. headlamp_lux: for each beam, "low" or "high", what headlamps add
    to the illuminance of each pixel, lux, (B, 1, H, W), or (1, 1, H, W) for all pictures; layers have their own. The
    light's spectrum and the beam are the exposure's. Raises ``TypeError`` or ``ValueError`` naming the argument.

    >>> scene = Scene.of_picture(np.full((2, 3, 3), 118, np.uint8))
    >>> round(float(scene.light.mean()), 3)  # the reflectance of middle grey
    0.181
    """

    light: Tensor
    _: KW_ONLY
    layers: Layers = ()
    border: Border = "reflect"
    lamp_mask: Tensor | None = None
    headlamp_lux: BeamPlanes = field(default_factory=dict)

    def __post_init__(self) -> None:
        light = image_batch("light", self.light)
        per_picture = layers_per_picture(self.layers, light)
        self.per_picture: tuple[tuple[Layer, ...], ...] = per_picture if any(per_picture) else ()
        one_of("border", self.border, BORDERS)
        self.brightest = brightest(light, per_picture)
        if self.lamp_mask is not None:
            self.lamp_mask = checked_mask(self.lamp_mask, len(light), self.size)
        one, every = (1, 1, *self.size), (len(light), 1, *self.size)
        self.headlamp_lux = checked_planes("headlamp_lux", self.headlamp_lux, every, one)
        self._beams: dict[str, BeamLight] = {}
        self._means: dict[Hashable, float] = {}  # threads may compute one twice, which is harmless
        self._field = lru_cache(_FIELDS)(partial(_noise_field, self.light[:1, :1]))  # no cycle: freed at once

    @classmethod
    def of_picture(
        cls,
        picture: NDArray[Any],
        grey_anchor: str | None = None,
        encoding: PictureTone = "srgb",
        **options: Any,
    ) -> Self:
        """The scene of a picture (H, W, C) of 8 or 16 bits, or of floats, which are linear light of which 1 is white;
        the other options are those of the constructor.

        grey_anchor: the part that reflects 18 %, see :class:`.metering.GreyAnchor`; None: brightness is reflectance.
        encoding: the tone curve of 8 or 16 bits.
        """
        return cls(anchored(_decoded(picture, encoding), grey_anchor), **options)

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the pictures."""
        return self.light.shape[-2], self.light.shape[-1]

    def beam_light(self, beam: str) -> BeamLight:
        """The light of a beam on the pictures. Raises ``ValueError`` where the scene, or a layer of it, has none.

        >>> scene = Scene(torch.full((1, 1, 4, 6), 0.2), headlamp_lux={"low": torch.full((1, 1, 4, 6), 9.0)})
        >>> scene.beam_light("low").ranges_lux
        ((9.0, 9.0, 9.0),)
        """
        if beam not in self._beams:
            known = {"the scene": [self.headlamp_lux]}
            known["a layer of the scene"] = [one.headlamp_lux for some in self.per_picture for one in some]
            for what, every in known.items():
                if not all(beam in planes for planes in every):
                    raise ValueError(f"headlamp = {beam!r}: {what} has no headlamp_lux of this beam")
            plane = self.headlamp_lux[beam].to(self.light)
            behind = plane.expand(len(self.light), -1, -1, -1)
            layers = self.per_picture or ((),) * len(behind)
            ranges = tuple(_range_lux(beam, *each) for each in zip(behind, layers, strict=True))
            self._beams[beam] = BeamLight(beam, ranges, plane)
        return self._beams[beam]

    def mean_light(self, exposure: Exposure[Any]) -> float:
        """Mean light of the first picture as the exposure's camera meters it (:func:`.metering.mean_luma`).

        With headlamps mean(light) + mean(light X) / E, both of them computed once for any number of exposures.

        >>> from blurnoise import Camera
        >>> scene = Scene(torch.full((1, 1, 4, 6), 0.2), headlamp_lux={"low": torch.full((1, 1, 4, 6), 9.0)})
        >>> round(scene.mean_light(Exposure(Camera.preset("imx250"), 0.01, 3.0, headlamp="low")), 3)
        0.8
        """

        def mean(beam: str) -> float:
            key = exposure.camera, exposure.illuminant, beam
            if key not in self._means:
                plane = 1.0 if beam == "off" else self.beam_light(beam).lux[:1]
                light = self.light[:1] * plane
                self._means[key] = float(mean_luma(light, exposure.camera, exposure.illuminant)[0])
            return self._means[key]

        if exposure.headlamp == "off":
            return mean("off")
        return mean("off") + mean(exposure.headlamp) / float(exposure.illuminance_lux)

    def normal(self, seeds: Sequence[int], like: Tensor, stream: str) -> Tensor:
        """``rng.standard_normal`` of one seed for all frames of a picture; the last two fields are kept."""
        return self._field(seeds[0], stream, like.shape[1]).expand(like.shape)


def _noise_field(plane: Tensor, seed: int, stream: str, planes: int) -> Tensor:
    return rng.standard_normal([seed], plane.expand(-1, planes, -1, -1), stream)


def _range_lux(beam: str, behind: Tensor, layers: Sequence[Layer]) -> tuple[float, float, float]:
    """The least, the most and the RMS of headlamps' light on a picture, that on its layers included, lux."""
    least, highest = extremes(behind)
    squares = float(behind.detach().double().square().sum())
    for layer in layers:
        low, high = extremes(layer.headlamp_lux[beam])
        least, highest = min(least, low), max(highest, high)
        squares += float((layer.headlamp_lux[beam] * layer.alpha).detach().double().square().sum())
    return least, highest, min(highest, math.sqrt(squares / behind.numel()))


def brightest(light: Tensor, layers: Sequence[Sequence[Layer]]) -> list[float]:
    """Light of the brightest surface of each picture (B, C, H, W), that of its layers included, at least white.

    >>> brightest(torch.full((1, 1, 4, 6), 0.5), []), brightest(torch.full((1, 1, 4, 6), 3.0), [])
    ([1.0], [3.0])
    """
    every = layers or ((),) * len(light)
    return [
        max(1.0, most(picture), *(float(layer.light.detach().amax()) for layer in some))
        for picture, some in zip(light, every, strict=True)
    ]


def scene_reflectance(image: Tensor, encoding: PictureTone) -> Tensor:
    """Reflectance, linear light in [0, 1], of a picture (B, C, H, W) coded by the tone curve ``encoding``.

    "linear": light as it is; more than 1 is brighter than white and stays.

    >>> scene_reflectance(torch.tensor([[[[0.0, 0.5, 1.0]]]]), "srgb").round(decimals=3)
    tensor([[[[0.0000, 0.2140, 1.0000]]]])
    """
    batch_shaped("image", image)
    curve = picture_tone(encoding)
    low, high = extremes(image)
    if not math.isfinite(low + high):  # extremes hand NaN on
        raise ValueError("image: contains NaN or Inf")
    if low < 0.0 or (high > 1.0 and curve != "linear"):
        must = "be >= 0" if curve == "linear" else "lie within [0, 1], or be light (encoding = 'linear')"
        raise ValueError(f"image: values span [{low:g}, {high:g}]; must {must}")
    return image if curve == "linear" else untoned(image, curve)


def extremes(values: Tensor) -> tuple[float, float]:
    """Smallest and largest value; NumPy's wake no threads, which would spin during the work that follows.

    >>> extremes(torch.tensor([0.25, 0.5, 0.75]))
    (0.25, 0.75)
    """
    plain = values.detach()
    if plain.device.type == "cpu":
        return float(plain.numpy().min()), float(plain.numpy().max())
    low, high = torch.stack(plain.aminmax()).tolist()  # one wait for the device
    return low, high


def _decoded(picture: NDArray[Any], encoding: PictureTone) -> Tensor:
    """``scene_reflectance`` of a picture (H, W, C), (1, C, H, W). Integers are looked up, floats are light."""
    if picture.dtype.kind == "f":
        light = torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32))[None]
        return scene_reflectance(light, "linear")
    most = np.iinfo(picture.dtype).max
    codes = torch.arange(most + 1, dtype=torch.float32) / float(most)
    table = scene_reflectance(codes[None, None, None], encoding).flatten().numpy()
    return torch.from_numpy(np.stack([table[plane] for plane in cv2.split(picture)]))[None]
