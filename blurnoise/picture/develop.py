"""Development: digital numbers to a picture for viewing and for detectors, through all picture steps."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from blurnoise import colour
from blurnoise._core.checks import an_instance, finite, one_of
from blurnoise._core.limits import limited
from blurnoise._core.lookup import look_up
from blurnoise._core.uncompiled import uncompiled
from blurnoise.camera import Camera
from blurnoise.encoding import Encoding
from blurnoise.picture import sixteen_bits, steps
from blurnoise.picture.step import Development, PictureStep
from blurnoise.spectra import Curve, check_illuminant

_INTEGERS = (
    *(torch.int8, torch.int16, torch.int32, torch.int64),
    *(torch.uint8, torch.uint16, torch.uint32, torch.uint64),
)
_LUMA = (0.2126, 0.7152, 0.0722)


@uncompiled
def develop(
    dn: Tensor,
    camera: Camera,
    *,
    encoding: Encoding = "srgb",
    gain_db: float = 0.0,
    illuminant: str | Curve = "D55",
    whole: bool | None = None,
) -> Tensor:
    """Digital numbers to a picture in [0, 1]; no automatic gain.

    (dn - black) / (full scale - black) times 10^(gain_db / 20), clamped, then coded by the camera's tone curve (sRGB
    by default) unless ``encoding`` is "linear"; of a mosaic white balance for the light ``illuminant``, demosaic and
    colour matrix come before the gain: ``STEPS`` in their order. dn: any shape, of a mosaic (B, 1, H, W), which
    becomes (B, 3, H, W); values within the converter's range, beyond which they count as its ends; integers of any
    size, float32 or float64. Returns dn's floating dtype, for integers float32. whole: whether dn is known to hold
    whole numbers; None: that is looked at.
    By a table of the formulas, where each value depends on its own number; coded float32 mosaics on the CPU in
    integers of 16 bits (:mod:`blurnoise.picture.sixteen_bits`); by the formulas where gradients are asked for, and of
    frames that were not rounded.
    Raises ``TypeError`` or ``ValueError`` naming dn (NaN and Inf are none), camera, encoding, gain_db or illuminant.
    """
    dn, kind = _digital_numbers(dn)
    at = _development(camera, encoding, gain_db, illuminant)
    active = _active(dn, camera)
    if (dn.requires_grad and torch.is_grad_enabled()) or not (_whole(dn) if whole is None else whole):
        return _developed(dn.to(kind), at, active)
    if fast := _fast(dn, at, active):
        found = _by_16_bits(dn, at, active[:fast], kind)
        return _developed(found, at, active[fast:])
    tabulated = _leading(active)
    found = look_up(_tones(at, active[:tabulated]).to(dn.device, kind), dn)
    return _developed(found, at, active[tabulated:])


def _whole(dn: Tensor) -> bool:
    return not dn.is_floating_point() or torch.equal(dn, dn.trunc())


def develop_8bit(dn: Tensor, camera: Camera, gain_db: float = 0.0, illuminant: str | Curve = "D55") -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, of its shape."""
    active = steps.active(camera)
    if _leading(active) == len(active):
        table = tones_8bit(camera, gain_db, illuminant).to(dn.device)
        return look_up(table, _digital_numbers(dn)[0])
    at = _development(camera, "srgb", gain_db, illuminant)
    if _fast(dn, at, active) == len(active):
        return _by_16_bits(_digital_numbers(dn)[0], at, _active(dn, camera), torch.uint8)
    picture = develop(dn, camera, gain_db=gain_db, illuminant=illuminant)
    return picture.mul(255.0).round().to(torch.uint8)


def tones_8bit(camera: Camera, gain_db: float = 0.0, illuminant: str | Curve = "D55") -> Tensor:
    """The 8-bit sRGB value of every digital number, uint8 on the CPU, by the steps that look at one number only."""
    pointwise = tuple(step for step in steps.active(camera) if step.pointwise)
    return _tones_8bit(_development(camera, "srgb", gain_db, illuminant), pointwise)


def tabulated(camera: Camera) -> bool:
    """Whether :func:`tones_8bit` is all of :func:`develop_8bit`."""
    active = steps.active(camera)
    return _leading(active) == len(active)


def in_channels(picture: Tensor, channels: int) -> Tensor:
    """A picture (B, 1 or 3, H, W) in so many channels, those of the one exposed: grey repeated, colours to luma."""
    found = picture.shape[1]
    if found == channels:
        return picture
    if found == 1:
        return picture.expand(-1, channels, -1, -1)
    luma = torch.einsum("c,bchw->bhw", torch.tensor(_LUMA, device=picture.device), picture.float())[:, None]
    return luma.round().to(picture.dtype) if picture.dtype == torch.uint8 else luma.to(picture.dtype)


def _leading(every: tuple[PictureStep, ...]) -> int:
    """How many steps, from the first on, are pointwise."""
    return next((place for place, step in enumerate(every) if not step.pointwise), len(every))


def _fast(dn: Tensor, at: Development, active: tuple[PictureStep, ...]) -> int:
    if at.encoding != "srgb" or dn.device.type != "cpu" or dn.dtype == torch.float64:
        return 0
    return sixteen_bits.supported(active)


def _active(dn: Tensor, camera: Camera) -> tuple[PictureStep, ...]:
    """The steps; of a mosaic ``dn`` has one plane of at least 2 x 2."""
    if camera.cfa not in colour.PLANES and (dn.ndim != 4 or dn.shape[1] != 1 or min(dn.shape[-2:]) < 2):
        raise ValueError(
            f"dn: shape is {tuple(dn.shape)}; cfa = {camera.cfa!r} needs (B, 1, H, W), H and W at least 2"
        )
    return steps.active(camera)


def _digital_numbers(dn: Tensor) -> tuple[Tensor, torch.dtype]:
    """``dn``, and the type of a picture made of it."""
    an_instance("dn", dn, Tensor)
    if dn.dtype in _INTEGERS:
        return dn, torch.float32
    if dn.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"dn: must be integers, float32 or float64, got {dn.dtype}")
    return finite("dn", dn), dn.dtype


def _development(camera: Camera, encoding: Encoding, gain_db: float, illuminant: str | Curve) -> Development:
    an_instance("camera", camera, Camera)
    one_of("encoding", encoding, ("srgb", "linear"))
    check_illuminant(illuminant)
    return Development(camera, limited("gain_db", gain_db), encoding, illuminant)


def _by_16_bits(dn: Tensor, at: Development, every: tuple[PictureStep, ...], kind: torch.dtype) -> Tensor:
    coloured = steps.COLOUR_MATRIX in every
    return sixteen_bits.developed(dn, at, coloured, _tones_of_16_bits(at, every[3 + coloured :], kind))


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _tones_of_16_bits(at: Development, every: tuple[PictureStep, ...], kind: torch.dtype) -> Tensor:
    table = sixteen_bits.tones(at, every)
    return table.mul(255.0).round().to(kind) if kind == torch.uint8 else table.to(kind)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _tones_8bit(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    return _tones(at, every).mul(255.0).round().to(torch.uint8)


@lru_cache(maxsize=8)
@torch.inference_mode(False)
def _tones(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    """The developed value of every digital number, float64 on the CPU."""
    return _developed(torch.arange(at.camera.full_scale_dn + 1, dtype=torch.float64), at, every)


def _developed(dn: Tensor, at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    for step in every:
        dn = step.apply(dn, at)
    return dn
