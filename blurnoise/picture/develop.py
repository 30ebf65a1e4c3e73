"""Development: digital numbers to a picture for viewing and for detectors, through all picture steps.

Beside the formulas, two faster ways for whole numbers: a table of what they make of every digital number; and of
mosaics on the CPU integers of 16 bits, with black at ``steps.OFFSET`` and ``steps.SCALE`` steps to full scale.
Those are fine beside the steps of a converter of up to 12 bits, and keep noise below black until the tone curve;
means of neighbours and matrices whose rows sum to 1 leave the offset. Both give the formulas' picture, to a few such.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import an_instance, dense, finite
from blurnoise._core.lookup import look_up, look_up_codes, look_up_mosaic
from blurnoise._core.luminance import LUMINANCE
from blurnoise._core.threads import differentiable, same_bits, side_by_side
from blurnoise.camera import Camera, colour
from blurnoise.camera.colour import Encoding
from blurnoise.camera.spectra import Curve
from blurnoise.picture import steps
from blurnoise.picture.steps import OFFSET, SCALE, Development, PictureStep, by_opencv, padded


@same_bits
def develop(
    dn: Tensor,
    camera: Camera,
    *,
    encoding: Encoding = "srgb",
    gain_db: float = 0.0,
    illuminant: str | Curve = "D55",
    white_e: Tensor | float | None = None,
) -> Tensor:
    """Digital numbers to a picture in [0, 1]; no automatic gain.

    (dn - black) / (full scale - black) times 10^(gain_db / 20), clamped, then coded by the camera's tone curve (sRGB
    by default) unless ``encoding`` is "linear". For a mosaic, white balance for the light ``illuminant``,
    demosaicking and colour matrix come before the gain: see ``STEPS``. dn: integers of any size, float32 or float64,
    of any shape; a mosaic (B, 1, H, W) becomes (B, 3, H, W). Values outside the converter's range are clamped.
    The captures of an HDR camera, (captures, B, C, H, W), are fused first (:mod:`.fusion`); white_e electrons of the
    first one, (B,) or one number, become white. Noise reduction, local tone, sharpening and JPEG round to 8 bits.
    Returns dn's floating dtype, float32 for integers.
    Tables speed up whole numbers; gradients and fractions use the formulas. Raises ``TypeError`` or ``ValueError``
    naming dn (NaN and Inf are invalid), camera, encoding, gain_db, illuminant or white_e.

    >>> import torch
    >>> from blurnoise import Camera
    >>> camera = Camera.preset("imx250")
    >>> develop(torch.tensor([[[[240.0, 1000.0, 4095.0]]]]), camera).round(decimals=3)
    tensor([[[[0.0000, 0.4810, 1.0000]]]])
    """
    at = Development(camera, gain_db, encoding, illuminant, white_e)
    kind, active = _checked(dn, camera)
    if steps.FUSION in active or not _tabled(dn):  # no table holds a frame of several captures
        return _developed(dn.to(kind), at, active)
    # Whole numbers are few: what the leading steps make of each is computed once and looked up.
    first = _first_steps(dn, at, active)
    later = active[len(first) :]
    if later and _coded(at, later):
        return _developed(_looked_up(dn, at, first, torch.uint8), at, later).to(kind) / 255
    return _developed(_looked_up(dn, at, first, kind), at, later)


def develop_8bit(
    dn: Tensor,
    camera: Camera,
    gain_db: float = 0.0,
    illuminant: str | Curve = "D55",
    white_e: Tensor | float | None = None,
) -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, of its shape.

    >>> camera = Camera.preset("imx250").with_figures(black_level_dn=95.0)
    >>> develop_8bit(torch.tensor([[[[95, 1095, 4095]]]]), camera)  # no light, a quarter, all of the range
    tensor([[[[  0, 137, 255]]]], dtype=torch.uint8)
    """
    at = Development(camera, gain_db, "srgb", illuminant, white_e)
    _, active = _checked(dn, camera)
    first = _first_steps(dn, at, active)
    later = active[len(first) :]
    if not later or (_coded(at, later) and _tabled(dn)):
        return _developed(_looked_up(dn, at, first, torch.uint8), at, later)
    picture: Tensor = develop(dn, camera, gain_db=gain_db, illuminant=illuminant, white_e=white_e)
    return picture.mul(255.0).round().to(torch.uint8)


def tones_8bit(camera: Camera, gain_db: float = 0.0, illuminant: str | Curve = "D55") -> Tensor:
    """The 8-bit sRGB value of every digital number, uint8 on the CPU, by the pointwise steps.

    >>> tones = tones_8bit(Camera.preset("imx250").with_figures(black_level_dn=95.0))
    >>> len(tones), tones[[95, 1095, 4095]].tolist()
    (4096, [0, 137, 255])
    """
    return _table(Development(camera, gain_db, "srgb", illuminant), _pointwise(camera), torch.uint8)


def tones_of(camera: Camera, gain_db: float, illuminant: str | Curve, encoding: Encoding) -> Tensor:
    """What :func:`develop` makes of every digital number by the pointwise steps, float32 on the CPU.

    >>> tones = tones_of(Camera.preset("imx250").with_figures(black_level_dn=95.0), 0.0, "D55", "linear")
    >>> tones[[95, 1095, 4095]].tolist()
    [0.0, 0.25, 1.0]
    """
    return _table(Development(camera, gain_db, encoding, illuminant), _pointwise(camera), torch.float32)


def _pointwise(camera: Camera) -> tuple[PictureStep, ...]:
    return tuple(step for step in steps.active(camera) if step.pointwise)


def tabulated(camera: Camera) -> bool:
    """Whether :func:`tones_8bit` is all of :func:`develop_8bit`, and :func:`tones_of` of :func:`develop`.

    >>> tabulated(Camera.preset("imx250")), tabulated(Camera.preset("imx250c"))  # a mosaic needs its neighbours
    (True, False)
    """
    return all(step.pointwise for step in steps.active(camera))


def in_channels(picture: Tensor, channels: int) -> Tensor:
    """A picture (B, 1 or 3, H, W) with the given number of channels: grey repeated, or colours to luma.

    >>> in_channels(torch.full((1, 1, 2, 2), 0.5), 3).shape
    torch.Size([1, 3, 2, 2])
    """
    own_channels = picture.shape[1]
    if own_channels == channels:
        return picture
    if own_channels == 1:
        return picture.expand(-1, channels, -1, -1)
    # The weighted sum of the values as they are, coded or linear, as pictures are turned grey everywhere.
    weights = torch.tensor(LUMINANCE, device=picture.device)
    luma = torch.einsum("c,bchw->bhw", weights, picture.float())[:, None]
    return luma.round().to(picture.dtype) if picture.dtype == torch.uint8 else luma.to(picture.dtype)


def _checked(dn: Tensor, camera: Camera) -> tuple[torch.dtype, tuple[PictureStep, ...]]:
    """The dtype of a picture made of ``dn``, and its steps."""
    an_instance("dn", dn, Tensor)
    dense("dn", dn)
    kind = torch.float32
    if dn.dtype in (torch.float32, torch.float64):
        kind = finite("dn", dn).dtype
    elif dn.is_floating_point() or dn.is_complex() or dn.dtype == torch.bool:
        raise TypeError(f"dn: must be integers, float32 or float64, got {dn.dtype}")
    active, shape = steps.active(camera), tuple(dn.shape)
    if steps.FUSION in active:
        if len(shape) != 5 or shape[0] != len(camera.sensor.captures):
            raise ValueError(
                f"dn: shape is {shape}; must be ({len(camera.sensor.captures)}, B, C, H, W), one for each capture"
            )
        shape = shape[1:]
    if camera.sensor.cfa not in colour.PLANES and (len(shape) != 4 or shape[1] != 1 or min(shape[-2:]) < 2):
        needs = "needs (B, 1, H, W), H and W at least 2"
        raise ValueError(f"dn: shape is {tuple(dn.shape)}; cfa = {camera.sensor.cfa!r} {needs}")
    return kind, active


def _coded(at: Development, some: tuple[PictureStep, ...]) -> bool:
    """Whether all steps take a picture of 8 bits, which linear ones never are."""
    return at.encoding == "srgb" and all(step.coded for step in some)


def _tabled(dn: Tensor) -> bool:
    """Whether tables serve: for whole numbers without gradients; on the CPU in pieces that stay in its cache."""
    if differentiable(dn):
        return False
    if not dn.is_floating_point():
        return True
    if dn.device.type != "cpu":
        return torch.equal(dn, dn.trunc())
    pieces = torch.split(dn.detach().flatten(), 1 << 16)
    return all(np.array_equal(each, np.trunc(each)) for each in map(Tensor.numpy, pieces))


def _first_steps(dn: Tensor, at: Development, active: tuple[PictureStep, ...]) -> tuple[PictureStep, ...]:
    """The leading steps of a table: a mosaic's where 16 bits serve, and the pointwise ones that follow."""
    count = 0
    if steps.FUSION in active:  # of which no table exists: it mixes frames
        return ()
    # Where 16 bits serve: for pictures that a tone curve codes, in single precision at most.
    in_16_bits = at.encoding == "srgb" and dn.device.type == "cpu" and dn.dtype != torch.float64
    if in_16_bits and active[:3] == (steps.BLACK_LEVEL, steps.WHITE_BALANCE, steps.DEMOSAIC):
        count = 3 + (active[3:4] == (steps.COLOUR_MATRIX,))
    while count < len(active) and active[count].pointwise:
        count += 1
    return active[:count]


def _looked_up(dn: Tensor, at: Development, first: tuple[PictureStep, ...], kind: torch.dtype) -> Tensor:
    """Look up whole numbers in a table of the leading steps."""
    if steps.DEMOSAIC not in first:
        return look_up(_table(at, first, kind).to(dn.device), dn)
    after_colour = first[3 + (steps.COLOUR_MATRIX in first) :]
    return _in_16_bits(dn, at, first, _table(at, after_colour, kind, of_light=True).numpy())


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _table(
    at: Development, pointwise: tuple[PictureStep, ...], kind: torch.dtype, of_light: bool = False
) -> Tensor:
    """Table of the steps' result for every digital number, or for each linear value of 16 bits, on the CPU."""
    count = 1 << 16 if of_light else at.camera.sensor.full_scale_dn + 1
    values = torch.arange(count, dtype=torch.float64)
    tones = _developed((values - OFFSET) / SCALE if of_light else values, at, pointwise)
    return tones.mul(255.0).round().to(kind) if kind == torch.uint8 else tones.to(kind)


def _developed(picture: Tensor, at: Development, some: tuple[PictureStep, ...]) -> Tensor:
    for step in some:
        picture = step.apply(picture, at)
    return picture


def _in_16_bits(dn: Tensor, at: Development, first: tuple[PictureStep, ...], table: NDArray[Any]) -> Tensor:
    """The colours of planes (B, 1, H, W) after a mosaic's steps, by ``table``: (B, 3, H, W), channels last."""
    batch, _, height, width = dn.shape
    camera = at.camera
    rows = np.array(steps.matrix(camera, at.illuminant), np.float32)
    coloured, balanced = steps.COLOUR_MATRIX in first, _balanced_codes(camera, at.illuminant)
    frames = dn.detach().reshape(batch, height, width).numpy()
    out = torch.empty((batch, height, width, 3), dtype=getattr(torch, table.dtype.name))

    def frame(index: int) -> None:
        codes = frames[index]
        if codes.dtype != np.uint16:
            codes = np.clip(codes, 0, camera.sensor.full_scale_dn).astype(np.uint16)
        light = padded(codes)
        look_up_mosaic(balanced, light)
        colours = by_opencv(light, camera.sensor.cfa, camera.isp.demosaic)
        if coloured:
            colours = cv2.transform(colours, rows)
        look_up_codes(table, colours, out[index].numpy())

    side_by_side(frame, range(batch), torch.get_num_threads())
    return out.permute(0, 3, 1, 2)


@lru_cache(maxsize=32)
def _balanced_codes(camera: Camera, illuminant: str | Curve) -> NDArray[np.uint16]:
    """Balanced light in steps of 16 bits of every code of 16 bits, at the pattern's four places, (2, 65536, 2)."""
    black_dn = camera.sensor.black_level_dn
    white_dn = camera.sensor.full_scale_dn - black_dn
    gains = np.array(steps.site_gains(camera, illuminant)).reshape(2, 1, 2) / white_dn
    numbers = np.subtract(np.arange(1 << 16), black_dn, dtype=np.float32).clip(-black_dn, white_dn)
    light = numbers[:, None] * gains.astype(np.float32)
    light = np.minimum(light, np.float32(steps.highest(camera))).reshape(2, -1)
    # One call that scales, shifts, rounds and limits: what NumPy does in four passes.
    codes: Any = cv2.addWeighted(light, SCALE, light, 0.0, OFFSET, dtype=cv2.CV_16U)
    return np.asarray(codes).reshape(2, -1, 2)
