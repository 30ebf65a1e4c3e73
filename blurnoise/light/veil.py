"""Veiling glare: light that lens, dirt and windscreen scatter over the picture, as an even veil and as halos.

    out = (1 - v - g) light + v mean(light) + g K(light)

The camera's veil_share v is spread evenly, its halo_share g by the point spread function

    K(r) = (exp(-r^2 / b^2) - exp(-r^2 / a^2)) / (2 pi ln(b / a) r^2)

that is 1 / r^2, the same light in every octave of radius, between a = 4 and b = 256 px of the sensor, with soft ends.
It is a sum of Gaussians, as many in every octave of width. Its transfer function is therefore

    H(f) = (E1((pi a f)^2) - E1((pi b f)^2)) / (2 ln(b / a))

with the exponential integral E1: 1 at f = 0, and within [0, 1]. The power of -2 is assumed: functions fitted to
pictures of six cameras and lenses fall with r^-0.7 (nearly a veil) to r^-2.1 from 4 to 1000 px (camera_gsf.m in
github.com/ZeshanAlam/Saturation-Aware-Space-Variant-Blind-Image-Deblurring). ISO 9358 and ISO 18844 read, in the
middle of a black patch of a white field, v and the part of g that comes from beyond: half of it if the patch has a
radius of 24 px.

The scene beyond the picture is its mirror image, whatever the border of the blurs: as much light comes in as goes
out, so that the sum is kept. The discrete cosine transform has the waves of such a scene, each of which K multiplies
by its H.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise._core.threads import side_by_side, threads_for
from blurnoise.camera.spectra import Floats
from blurnoise.light.effect import LightEffect
from blurnoise.light.resolved import Resolved

INNER_PX, OUTER_PX = 4.0, 256.0
"""Radii between which halos fall off with 1 / r^2, px of the sensor."""
_FINEST_PX = 2.0  # of the picture: a halo that begins within it would ring, as pixels cannot show its core


class VeilingGlare(LightEffect):
    """Veiling glare of the camera's veil_share and halo_share.

    It follows the blurs, with which it commutes: between them it would part the transform that they share.

    >>> from blurnoise import Camera
    >>> hazy = Camera.preset("imx250").with_figures(veil_share=0.01, halo_share=0.02)
    >>> VEIL.bound(Resolved(hazy, 0.01, 25.0, white_e=1000.0))
    0.015
    """

    name = "veiling glare"
    figures = ("veil_share", "halo_share")

    def bound(self, at: Resolved[float]) -> float:
        """Half of the light that is scattered: it moves a picture towards its mean, from which none is farther."""
        return (at.camera.lens.veil_share + at.camera.lens.halo_share) / 2

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        own, size = at.camera.lens, (light.shape[-2], light.shape[-1])
        return scattered(light, own.veil_share, own.halo_share, at.camera.field.per_sensor_px(size))

    def how(self, at: Resolved[float]) -> str:
        own = at.camera.lens
        halos = f"{own.halo_share:.3g} in halos of {INNER_PX:g} to {OUTER_PX:g} px"
        return f"{own.veil_share:.3g} of the light everywhere, {halos}"

    def key(self, at: Resolved[float]) -> Hashable:
        own = at.camera.lens
        return None if self.idle(at.camera) else (own.veil_share, own.halo_share, at.camera.field.size)


def scattered(light: Tensor, veil_share: float, halo_share: float, per_sensor_px: float = 1.0) -> Tensor:
    """Light (B, C, H, W) with shares of it scattered over its picture, whose sum is kept; differentiable.

    veil_share: everywhere alike. halo_share: in halos (see the module), at most 1 with the veil. per_sensor_px:
    pixels of the picture per pixel of the sensor, in whose px the halos are. What of a halo lies within 2 px of the
    picture stays where it is.

    >>> light = torch.full((1, 1, 30, 40), 0.05)
    >>> light[0, 0, 10, 20] = 1000.0  # a lamp
    >>> seen = scattered(light, veil_share=0.01, halo_share=0.02)[0, 0, 10]
    >>> [round(float(seen[x]), 2) for x in (22, 25, 30, 39)]
    [0.11, 0.09, 0.08, 0.07]
    """
    inner, outer = INNER_PX * per_sensor_px, OUTER_PX * per_sensor_px
    finest = max(inner, _FINEST_PX)
    halo_share *= max(0.0, math.log(outer / finest)) / math.log(outer / inner)
    scatter: Tensor = _Scatter.apply(light, veil_share, halo_share, (finest, outer))  # type: ignore[no-untyped-call]
    return scatter


class _Scatter(torch.autograd.Function):
    """The light of every plane by itself, so that its bits depend neither on the batch nor on threads."""

    @staticmethod
    def forward(ctx: Any, light: Tensor, veil: float, halo: float, radii_px: tuple[float, float]) -> Tensor:
        from scipy.fft import dctn, idctn

        ctx.how = veil, halo, radii_px
        kind = torch.promote_types(light.dtype, torch.float32)
        source = light.detach().to("cpu", kind).flatten(0, 1).numpy()
        out = np.empty(source.shape, source.dtype)
        passed = _transfer(source.shape[1:], radii_px, source.dtype.char) if halo else None

        def spread(index: int) -> None:
            plane, to = source[index], out[index]
            np.multiply(plane, 1 - veil - halo, out=to)
            if passed is not None:
                waves = dctn(plane, norm="ortho")
                waves *= passed
                to += halo * idctn(waves, norm="ortho", overwrite_x=True)
            to += veil * plane.mean(dtype=np.float64)

        side_by_side(spread, range(len(source)), threads_for(light))
        return torch.from_numpy(out).view(light.shape).to(light)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        # What a pixel gets from another it gives to it: the gradient is scattered as light is.
        scatter: Tensor = _Scatter.apply(gradients[0], *ctx.how)  # type: ignore[no-untyped-call]
        return scatter, None, None, None


@lru_cache(maxsize=8)
def _transfer(size: tuple[int, int], radii_px: tuple[float, float], kind: str) -> Floats:
    """The transfer function at the waves (H, W) of the cosine transform: half cycles along the sides."""
    y, x = (np.arange(side) / (2 * side) for side in size)
    return transfer(np.hypot(y[:, None], x), *radii_px).astype(kind)


def transfer(f: Floats, inner_px: float = INNER_PX, outer_px: float = OUTER_PX) -> Floats:
    """Transfer function of halos between two radii, at frequencies f, cycles/px.

    >>> transfer(np.array([0.0, 0.001, 0.01, 0.1])).round(3)
    array([1.   , 0.933, 0.431, 0.011])
    """
    from scipy.special import exp1

    # E1(x) is -ln x - 0.577... near 0: the difference of the two has a limit, 1, which they cannot give themselves.
    at = np.square(np.pi * np.maximum(f, 1e-9))
    between = exp1(at * inner_px**2) - exp1(at * outer_px**2)
    return np.asarray(between / (2 * math.log(outer_px / inner_px)))


VEIL = VeilingGlare()
