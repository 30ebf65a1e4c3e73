"""Development: digital numbers to a picture for viewing and for detectors, through all picture steps."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from blurnoise._core.checks import in_range, one_of
from blurnoise._core.lookup import look_up
from blurnoise.camera import Camera
from blurnoise.encoding import Encoding
from blurnoise.picture import steps
from blurnoise.picture.steps import Development, PictureStep

MOST_GAIN_DB = 120.0


def develop(dn: Tensor, camera: Camera, *, encoding: Encoding = "srgb", gain_db: float = 0.0) -> Tensor:
    """Digital numbers to a picture in [0, 1]; no automatic gain.

    (dn - black) / (full scale - black) times 10^(gain_db / 20), clamped, then sRGB-coded unless ``encoding`` is
    "linear": ``STEPS`` in their order. dn: any shape, integral values within the converter's range. Returns dn's
    floating dtype. Where gradients are asked for it goes by the formulas, else by a table of them.
    Raises ``ValueError`` naming encoding or gain_db.
    """
    at = _development(camera, encoding, gain_db)
    if (dn.requires_grad and torch.is_grad_enabled()) or not _tabulated(steps.STEPS):
        return _developed(dn, at, steps.STEPS)
    return look_up(_tones(at, steps.STEPS).to(dn), dn)


def develop_8bit(dn: Tensor, camera: Camera, gain_db: float = 0.0) -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, same shape."""
    if not _tabulated(steps.STEPS):
        return develop(dn, camera, gain_db=gain_db).mul(255.0).round().to(torch.uint8)
    return look_up(tones_8bit(camera, gain_db).to(dn.device), dn)


def tones_8bit(camera: Camera, gain_db: float = 0.0) -> Tensor:
    """The 8-bit sRGB value of every digital number, uint8 on the CPU, by the steps that look at one number only."""
    return _tones_8bit(_development(camera, "srgb", gain_db), steps.STEPS)


def tabulated() -> bool:
    """Whether :func:`tones_8bit` is all of :func:`develop_8bit`."""
    return _tabulated(steps.STEPS)


def _tabulated(every: tuple[PictureStep, ...]) -> bool:
    return all(step.pointwise for step in every)


def _development(camera: Camera, encoding: Encoding, gain_db: float) -> Development:
    one_of("encoding", encoding, ("srgb", "linear"))
    return Development(camera, in_range("gain_db", gain_db, -MOST_GAIN_DB, MOST_GAIN_DB), encoding)


@lru_cache(maxsize=32)
def _tones_8bit(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    return _tones(at, every).mul(255.0).round().to(torch.uint8)


@lru_cache(maxsize=8)
def _tones(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    """The developed value of every digital number, float64 on the CPU."""
    pointwise = tuple(step for step in every if step.pointwise)
    return _developed(torch.arange(at.camera.full_scale_dn + 1, dtype=torch.float64), at, pointwise)


def _developed(dn: Tensor, at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    for step in every:
        dn = step.apply(dn, at)
    return dn
