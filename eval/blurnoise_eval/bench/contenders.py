"""Contenders of the bench of motion blur, called alike: our methods and other people's.

Convention: x right, y down; a motion of length L px at angle a is L (cos a, sin a). All continue the border
by reflection. Lengths that a library does not know become its nearest, as its user would have to do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any, cast

import cv2
import kornia
import torch
from torch import Tensor

from blurnoise import motion_blur
from blurnoise.blur.convolution import Method
from blurnoise_eval.bench.line_kernel import line_kernel

Blur = Callable[[Tensor, float, Sequence[float]], Tensor]
"""Pictures (B, C, H, W) float32, length in px, an angle in degrees for each picture -> pictures."""
BASELINE = "kornia"
"""The one whose times others are compared with."""


@dataclass(frozen=True)
class Contender:
    """One way to blur. Motions beyond ``longest_px`` would take it many seconds and are left out."""

    name: str
    about: str
    blur: Blur
    ours: bool = False
    longest_px: float = math.inf


def contenders() -> list[Contender]:
    """Our methods first; albumentations where :func:`albumentations_state` finds it usable."""
    dense_px = 110.0
    every = [
        Contender("auto", "blurnoise.motion_blur", _ours("auto"), True),
        Contender("transfer", "blurnoise.motion_blur(method='transfer')", _ours("transfer"), True),
        Contender("tiles", "blurnoise.motion_blur(method='tiles')", _ours("tiles"), True),
        Contender("kernel", "kornia.filters.filter2d with a sub-pixel line", _by_kernel, False, dense_px),
        Contender(BASELINE, "kornia.filters.motion_blur, called directly", _kornia, False, dense_px),
        Contender(
            "kornia bilinear", "blurnoise.motion_blur(method='kornia')", _ours("kornia"), False, dense_px
        ),
        Contender("opencv", "cv2.filter2D of every plane, taps of the same line", _opencv),
    ]
    if albumentations_state().endswith("measured"):
        every.append(Contender("albumentations", "albumentations.MotionBlur", _albumentations))
    return every


def albumentations_state() -> str:
    """Why albumentations is or is not measured."""
    fault = import_fault("albumentations")
    if fault is not None:
        return fault
    fixed = hasattr(_transform(3, 0.0), "angle_range")
    return f"{version('albumentations')}, " + ("measured" if fixed else "left out: its angle is random")


def import_fault(library: str) -> str | None:
    """Why a peer cannot be measured, or None: one that is installed may still not start beside our versions."""
    if find_spec(library) is None:
        return "not installed"
    try:
        import_module(library)
    except Exception as error:
        return f"installed, but does not start here: {error!r}"
    return None


def displacements(length_px: float, angles_deg: Sequence[float]) -> Tensor:
    """Motions (B, 2) in px."""
    angles = [math.radians(angle) for angle in angles_deg]
    return torch.tensor([[length_px * math.cos(a), length_px * math.sin(a)] for a in angles])


def nearest_odd(length_px: float) -> int:
    """The odd number nearest to the length, 3 at least, which is Kornia's and albumentations' smallest."""
    return max(3, 2 * round((length_px - 1) / 2) + 1)


def _ours(method: Method) -> Blur:
    def blur(image: Tensor, length_px: float, angles_deg: Sequence[float]) -> Tensor:
        return motion_blur(image, displacements(length_px, angles_deg), method=method)

    return blur


def _kornia(image: Tensor, length_px: float, angles_deg: Sequence[float]) -> Tensor:
    counter_clockwise = -torch.tensor(angles_deg, dtype=image.dtype)
    centred = torch.zeros_like(counter_clockwise)
    blurred = kornia.filters.motion_blur(image, nearest_odd(length_px), counter_clockwise, centred)
    return cast(Tensor, blurred)


def _by_kernel(image: Tensor, length_px: float, angles_deg: Sequence[float]) -> Tensor:
    kernels = line_kernel(displacements(length_px, angles_deg))
    return cast(Tensor, kornia.filters.filter2d(image, kernels, border_type="reflect"))


def _opencv(image: Tensor, length_px: float, angles_deg: Sequence[float]) -> Tensor:
    out = torch.empty_like(image)
    for picture, target, motion in zip(image, out, displacements(length_px, angles_deg), strict=True):
        taps = line_kernel(motion[None])[0].numpy()
        for plane, into in zip(picture.numpy(), target.numpy(), strict=True):
            cv2.filter2D(plane, -1, taps, dst=into, borderType=cv2.BORDER_REFLECT_101)
    return out


def _albumentations(image: Tensor, length_px: float, angles_deg: Sequence[float]) -> Tensor:
    blurred = []
    for picture, angle in zip(image, angles_deg, strict=True):
        pixels = _transform(nearest_odd(length_px), angle)(image=picture.permute(1, 2, 0).numpy())["image"]
        blurred.append(torch.from_numpy(pixels).permute(2, 0, 1))
    return torch.stack(blurred)


def _transform(taps: int, angle_deg: float) -> Any:
    """One motion without chance. Its angle turns clockwise as displayed, whatever its documentation says."""
    angle, certain = angle_deg % 360, {"direction_range": (0.0, 0.0), "allow_shifted": False, "p": 1.0}
    library = import_module("albumentations")
    return library.MotionBlur(blur_limit=(taps, taps), angle_range=(angle, angle), **certain)
