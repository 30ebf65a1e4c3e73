"""Development: digital numbers to a picture for viewing and for detectors, through all picture steps."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from blurnoise._core.checks import an_instance, finite, one_of
from blurnoise._core.limits import limited
from blurnoise._core.lookup import look_up
from blurnoise._core.uncompiled import uncompiled
from blurnoise.camera import Camera
from blurnoise.encoding import Encoding
from blurnoise.picture import steps
from blurnoise.picture.step import Development, PictureStep

_INTEGERS = (
    *(torch.int8, torch.int16, torch.int32, torch.int64),
    *(torch.uint8, torch.uint16, torch.uint32, torch.uint64),
)


@uncompiled
def develop(dn: Tensor, camera: Camera, *, encoding: Encoding = "srgb", gain_db: float = 0.0) -> Tensor:
    """Digital numbers to a picture in [0, 1]; no automatic gain.

    (dn - black) / (full scale - black) times 10^(gain_db / 20), clamped, then sRGB-coded unless ``encoding`` is
    "linear": ``STEPS`` in their order. dn: any shape, integral values within the converter's range, beyond which they
    count as its ends; integers of any size, float32 or float64. Returns dn's floating dtype, for integers float32.
    Where gradients are asked for it goes by the formulas, else by a table of them.
    Raises ``TypeError`` or ``ValueError`` naming dn (NaN and Inf are none), camera, encoding or gain_db.
    """
    dn, kind = _digital_numbers(dn)
    at = _development(camera, encoding, gain_db)
    if (dn.requires_grad and torch.is_grad_enabled()) or not _tabulated(steps.STEPS):
        return _developed(dn.to(kind), at, steps.STEPS)
    return look_up(_tones(at, steps.STEPS).to(dn.device, kind), dn)


def develop_8bit(dn: Tensor, camera: Camera, gain_db: float = 0.0) -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, same shape."""
    if not _tabulated(steps.STEPS):
        return develop(dn, camera, gain_db=gain_db).mul(255.0).round().to(torch.uint8)
    return look_up(tones_8bit(camera, gain_db).to(dn.device), _digital_numbers(dn)[0])


def tones_8bit(camera: Camera, gain_db: float = 0.0) -> Tensor:
    """The 8-bit sRGB value of every digital number, uint8 on the CPU, by the steps that look at one number only."""
    return _tones_8bit(_development(camera, "srgb", gain_db), steps.STEPS)


def tabulated() -> bool:
    """Whether :func:`tones_8bit` is all of :func:`develop_8bit`."""
    return _tabulated(steps.STEPS)


def _tabulated(every: tuple[PictureStep, ...]) -> bool:
    return all(step.pointwise for step in every)


def _digital_numbers(dn: Tensor) -> tuple[Tensor, torch.dtype]:
    """``dn``, and the type of a picture made of it."""
    an_instance("dn", dn, Tensor)
    if dn.dtype in _INTEGERS:
        return dn, torch.float32
    if dn.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"dn: must be integers, float32 or float64, got {dn.dtype}")
    return finite("dn", dn), dn.dtype


def _development(camera: Camera, encoding: Encoding, gain_db: float) -> Development:
    an_instance("camera", camera, Camera)
    one_of("encoding", encoding, ("srgb", "linear"))
    return Development(camera, limited("gain_db", gain_db), encoding)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _tones_8bit(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    return _tones(at, every).mul(255.0).round().to(torch.uint8)


@lru_cache(maxsize=8)
@torch.inference_mode(False)
def _tones(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    """The developed value of every digital number, float64 on the CPU."""
    pointwise = tuple(step for step in every if step.pointwise)
    return _developed(torch.arange(at.camera.full_scale_dn + 1, dtype=torch.float64), at, pointwise)


def _developed(dn: Tensor, at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    for step in every:
        dn = step.apply(dn, at)
    return dn
