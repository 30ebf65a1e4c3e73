"""Job of the bench of moving things: a picture blurred by the path of a camera that is held by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import cv2
import numpy as np
import torch

from blurnoise.blur.convolution import path_blur, polyline_blur
from blurnoise.motion.causes import shake
from blurnoise.motion.trajectory import Polyline
from blurnoise_eval.bench import motion_scenes, motion_truth
from blurnoise_eval.bench.contenders import Contender
from blurnoise_eval.bench.motion_job import EXPOSURE_S, OURS, Call, Case, Extent, Job, Method, Picture
from blurnoise_eval.bench.motion_peers import (
    FRAMES,
    absent,
    deepinv_path,
    displaced,
    lines,
    mean_of_frames,
    spread_of,
    straight,
)

_SEED = 3  # of a path that turns
_ROOM_PX = 16


@dataclass(frozen=True)
class Paths(Case):
    """path: as the exposure sees it. places_px: (2, n), equally long each, their mean 0, of the same."""

    path: Polyline
    places_px: motion_truth.Floats

    @property
    def side_px(self) -> int:
        """Odd side of a point spread that holds it."""
        return 2 * math.ceil(float(np.abs(self.places_px).max())) + 3

    @property
    def chord_px(self) -> tuple[float, float]:
        """From its beginning to its end."""
        x, y = (self.places_px[:, -1] - self.places_px[:, 0]).tolist()
        return x, y


def _case(extent: Extent) -> Paths:
    held = shake(_SEED, extent.moved_px, EXPOSURE_S)
    knots = np.array([held.x_px, held.y_px])  # at equal times
    places = (knots[:, 1:] + knots[:, :-1]) / 2
    places -= places.mean(1, keepdims=True)
    light = motion_scenes.leaves(extent.height_px, extent.width_px)
    margin = math.ceil(float(np.abs(places).max())) + _ROOM_PX
    rows, columns = (slice(margin, side - margin) for side in light.shape[1:])
    truth = motion_truth.along_path(light, *places)[:, rows, columns]
    picture = torch.from_numpy(light).float()[None]
    return Paths(picture, truth, rows, columns, held.seen(EXPOSURE_S), places)


def _cached(case: Paths) -> Call:
    return lambda: path_blur(case.picture, case.path)


def _new_path(case: Paths) -> Call:
    numbers = count(1)

    def call() -> torch.Tensor:
        scale = 1 + 1e-9 * next(numbers)  # never seen before, yet the same
        x, y = (tuple(scale * along for along in each) for each in (case.path.x_px, case.path.y_px))
        return path_blur(case.picture, Polyline(x, y, case.path.shares))

    return call


def _optimised(case: Paths) -> Call:
    knots = torch.from_numpy(case.path.knots.T.copy()).requires_grad_()
    shares = torch.tensor(case.path.shares)
    return lambda: polyline_blur(case.picture, knots, shares).detach()


def _spread(*, whole: bool) -> Callable[[Paths], Call]:
    def of(case: Paths) -> Call:
        def call() -> Picture:
            spread = spread_of(case.places_px, case.side_px, whole=whole)[::-1, ::-1]
            return np.asarray(
                cv2.filter2D(case.pixels, -1, spread, borderType=cv2.BORDER_REFLECT_101), np.float32
            )

        return call

    return of


def _deepinv(case: Paths) -> Call:
    return deepinv_path(case.picture, case.places_px, case.side_px)


def _chord(line: Contender) -> Callable[[Paths], Call]:
    return lambda case: straight(line, case.picture, case.chord_px)


def _frames(number: int) -> Method:
    def of(case: Paths) -> Call:
        times = np.linspace(-0.5, 0.5, case.places_px.shape[1])
        x, y = case.places_px

        def call() -> Picture:
            return mean_of_frames(
                number,
                lambda time: displaced(
                    case.pixels, *(float(np.interp(time, times, along)) for along in (x, y))
                ),
            )

        return call

    return Method(f"{number} frames", FRAMES, f"mean of {number} pictures, cv2.warpAffine", of, str(number))


def job() -> Job:
    """Ours from the cache, anew, and differentiable; point spreads of others; one line; frames."""
    missing = absent()
    ways = [
        Method(OURS, OURS, "blurnoise.blur.convolution.path_blur of a path that it has seen before", _cached),
        Method(
            "ours, a new path",
            OURS,
            "blurnoise.blur.convolution.path_blur of a path that it has not",
            _new_path,
            "new",
        ),
        Method(
            "ours, polyline_blur", OURS, "blurnoise.blur.convolution.polyline_blur", _optimised, "polyline"
        ),
    ]
    if "deepinv" not in missing:
        ways.append(Method("deepinv", "deepinv", "MotionBlurGenerator with this path, conv2d_fft", _deepinv))
    for mark, about in (("splatted", "over four pixels, as DeblurGAN"), ("histogram", "in whole pixels")):
        of = _spread(whole=mark == "histogram")
        ways.append(Method(f"{mark} PSF", "PSF", f"path {about}, cv2.filter2D", of, mark))
    for name, each in lines().items():
        ways.append(Method(f"{name}, chord", name, f"{each.about}, along the chord", _chord(each)))
    ways += [_frames(number) for number in (8, 16, 32)]
    return Job("path", "a path: hand shake", _case, tuple(ways), missing)
