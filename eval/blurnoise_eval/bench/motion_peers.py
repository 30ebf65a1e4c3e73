"""What others do where things move, for the bench: means of warped pictures, one line, point spreads of paths.

Convention: px, x right, y down; pictures (H, W, C) float32 for OpenCV, (1, C, H, W) for PyTorch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import import_module
from itertools import cycle

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise_eval.bench.contenders import Contender, albumentations_state, contenders, import_fault
from blurnoise_eval.bench.motion_job import Call, Picture
from blurnoise_eval.bench.motion_truth import Floats, moments

FRAMES = "frames"
"""The family of means of warped pictures."""
_BORDER = cv2.BORDER_REFLECT_101


def lines() -> dict[str, Contender]:
    """The blurs along a line that are here, of other libraries, by name."""
    return {each.name: each for each in contenders() if each.name in ("kornia", "albumentations")}


def absent() -> dict[str, str]:
    """Libraries that cannot take part, and why."""
    faults = {"deepinv": import_fault("deepinv")}
    if "albumentations" not in lines():
        faults["albumentations"] = albumentations_state()
    return {name: fault for name, fault in faults.items() if fault}


def straight(line: Contender, picture: Tensor, moved_px: tuple[float, float]) -> Call:
    """A library's blur along the nearest line that it knows."""
    x, y = moved_px
    length, angle = math.hypot(x, y), math.degrees(math.atan2(y, x))
    return lambda: line.blur(picture, length, [angle])


def mean_of_frames(count: int, at: Callable[[float], Picture]) -> Picture:
    """The mean of what is seen at ``count`` moments of an exposure from -1/2 to 1/2."""
    times = moments(count).tolist()
    total = at(times[0]).copy()
    for time in times[1:]:
        cv2.accumulate(at(time), total)
    total /= count
    return total


def displaced(picture: Picture, x_px: float, y_px: float) -> Picture:
    """Displaced by linear interpolation."""
    matrix = np.array([[1.0, 0.0, x_px], [0.0, 1.0, y_px]])
    size = picture.shape[1], picture.shape[0]
    return np.asarray(
        cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_LINEAR, borderMode=_BORDER), np.float32
    )


def mapped(picture: Picture, x_px: Picture, y_px: Picture, flags: int = cv2.INTER_LINEAR) -> Picture:
    """What lies at places (H, W) of a picture."""
    return np.asarray(cv2.remap(picture, x_px, y_px, flags, borderMode=_BORDER), np.float32)


def spread_of(places_px: Floats, side_px: int, *, whole: bool) -> NDArray[np.float64]:
    """A path's point spread (side, side), odd, of places (2, n) from its middle that take equal time.

    whole: each counted in the pixel that holds it, as in deepinv's histogram; else shared among the four around it,
    as in DeblurGAN's (Kupyn et al., CVPR 2018).
    """
    x, y = places_px + side_px // 2
    if whole:
        x, y = np.rint(x), np.rint(y)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    spread = np.zeros((side_px, side_px))
    for row, down in ((top, 1 - (y - top)), (top + 1, y - top)):
        for column, across in ((left, 1 - (x - left)), (left + 1, x - left)):
            np.add.at(spread, (row.clip(0, side_px - 1), column.clip(0, side_px - 1)), down * across)
    return np.asarray(spread / places_px.shape[1])


def deepinv_path(picture: Tensor, places_px: Floats, side_px: int) -> Call:
    """deepinv's point spread of motion and its convolution, with these places (2, n) for its own random ones.

    Its histogram goes from -1 to 1 over side_px pixels, first axis down.
    """
    generators, functional = (
        import_module(f"deepinv.physics.{name}") for name in ("generator", "functional")
    )
    generator = generators.MotionBlurGenerator(psf_size=(side_px, side_px), n_steps=places_px.shape[1])
    along_y, along_x = (
        torch.from_numpy(2 * along / side_px).float()[None] for along in places_px[::-1].copy()
    )
    axes = cycle((along_y, along_x))
    generator.f_matern = lambda *_: next(axes)

    def blur() -> Tensor:
        spread = generator.step()["filter"]
        blurred: Tensor = functional.conv2d_fft(picture, spread, padding="reflect")
        return blurred

    return blur
