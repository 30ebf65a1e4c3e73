"""Benches of motion: ways to blur a picture, and to move a camera.

Units: errors in 8-bit sRGB numbers, RMS off the borders, against 256 moments of a picture rendered four times finer.
Convention: px, x right, y down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import cv2
import kornia
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import Camera, motion_blur
from blurnoise.camera.colour import linear_from_srgb, srgb_from_linear
from blurnoise.camera.lens import Lens
from blurnoise.camera.sensor import Sensor
from blurnoise.light import effects
from blurnoise.motion.ego import Vehicle, View
from blurnoise.motion.trajectory import shake
from blurnoise.scene.captures import captures_of_exposure
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise_eval.bench.contest import Case, Contender, Contest

HEIGHT, WIDTH, EXPOSURE_S = 480, 640, 0.01
LENGTHS_PX = (1.5, 6.0, 15.0, 25.0, 31.0, 101.0)
ANGLE_DEG = 17.0
FRAMES = 16
_MOMENTS = 256
_GLOBAL = Camera(
    "bench",
    Lens(f_number=1.4, transmission=1.0),
    Sensor(
        3.45,
        1.0,
        full_well_e=1e4,
        system_gain_dn_per_e=0.4,
        read_noise_e=2.0,
        width_px=WIDTH,
        height_px=HEIGHT,
    ),
)
_SPEED_M_S = 100.0 / 3.6
_MARGIN_PX = 36  # of the border, which is not compared
Picture = NDArray[np.float32]
Where = Callable[[Picture, Picture, Picture], tuple[Picture, Picture]]
"""Where what pixels x, y show at a time was at mid-exposure."""
FINE = 4
"""Samples to a pixel's side of the truth's pictures."""
_LENS_PX = 0.6  # sigma of a Gaussian: with the pixel's own area 0.24 of 0.4 cycles/px is left
_TEXT = "Speed limit 50 km/h, keep RIGHT & yield. " * 8


def blur(*, quick: bool) -> Contest:
    """Straight motion of several lengths: our methods, Kornia's, OpenCV's, and means of frames."""
    lengths = LENGTHS_PX[1:3] if quick else LENGTHS_PX
    return _contest("blur", "Straight motion", [partial(straight, each) for each in lengths])


def motion(*, quick: bool) -> Contest:
    """What moves in its own way: a hand, a road."""
    cases = [_hand_shake] if quick else [_hand_shake, _road]
    return _contest("motion", "Things that move", cases)


def _contest(name: str, title: str, cases: Sequence[Callable[[], Case]]) -> Contest:
    return Contest(name, f"{title}, {WIDTH}x{HEIGHT} in colour", cases, error_unit="DN RMS")


def straight(length_px: float) -> Case:
    """A picture in straight motion."""
    angle, taps = math.radians(ANGLE_DEG), max(3, 2 * round((length_px - 1) / 2) + 1)
    moved = length_px * math.cos(angle), length_px * math.sin(angle)
    shown, where = picture(), _uniformly(moved[0] / EXPOSURE_S, moved[1] / EXPOSURE_S)
    ways = [
        Contender("motion_blur", lambda: motion_blur(shown, moved), True),
        _point_spread(np.outer(moved, _moments().ravel() / EXPOSURE_S)),
    ]
    turned = torch.tensor([-ANGLE_DEG])
    kornias = partial(kornia.filters.motion_blur, shown, taps, turned, torch.zeros(1), "reflect")
    ways.append(Contender("Kornia, nearest odd length", kornias))
    return _against_truth(f"{length_px:g} px", ways, where, math.ceil(length_px / 2) + 16)


def _hand_shake() -> Case:
    held, at = shake(3, 32.0, EXPOSURE_S), _moments().ravel()
    path = np.stack([np.interp(at, held.time_s, along) for along in (held.x_px, held.y_px)])
    path -= path.mean(axis=1, keepdims=True)

    def where(x: Picture, y: Picture, time: Picture) -> tuple[Picture, Picture]:
        return x - np.interp(time, at, path[0]), y - np.interp(time, at, path[1])

    return _against_truth("hand shake, 32 px", [_ours(trajectory=held), _point_spread(path)], where)


def _road() -> Case:
    view, mount = View(WIDTH, HEIGHT, 60.0, "rectilinear"), Vehicle(1.4)
    focal_px, pixels = WIDTH / 2 / math.tan(math.radians(30.0)), view.pixels()
    flow = view.flow_px_s(pixels, mount.road_m(view.rays(pixels)), mount.driving(_SPEED_M_S))
    mean = tuple(flow.mean((1, 2)) * EXPOSURE_S)
    middle_x, middle_y = (WIDTH - 1) / 2, (HEIGHT - 1) / 2

    def where(x: Picture, y: Picture, time: Picture) -> tuple[Picture, Picture]:
        """Exactly: what is y below the axis is at depth 1.4 m * focal / y, nearer by what was driven since."""
        scale = 1 / (1 + _SPEED_M_S * time * np.maximum(y - middle_y, 0) / (1.4 * focal_px))
        return scale * (x - middle_x) + middle_x, scale * (y - middle_y) + middle_y

    shown = picture()
    one = Contender("one blur for all", lambda: motion_blur(shown, mean))
    ours = _ours(velocity_px_s=torch.from_numpy(flow).float())
    return _against_truth("road at 100 km/h", [ours, one], where)


def picture() -> Tensor:
    """What moves, linear (1, 3, H, W)."""
    return _tensor(pixels(leaves(HEIGHT, WIDTH)))


def _tensor(pixels: Picture) -> Tensor:
    return torch.from_numpy(pixels).permute(2, 0, 1)[None].contiguous()


def _moments(count: int = _MOMENTS) -> Any:
    """Times in the middle of equal parts of the exposure, (count, 1, 1)."""
    return (((np.arange(count) + 0.5) / count - 0.5) * EXPOSURE_S)[:, None, None]


def _uniformly(x_px_s: float, y_px_s: float) -> Where:
    return lambda x, y, time: (x - x_px_s * time, y - y_px_s * time)


def _ours(**moving: Any) -> Contender:
    """The light of ``simulate`` after its motion, whatever moves."""

    shown = picture()
    scene, exposure = Scene(shown), Exposure(_GLOBAL, EXPOSURE_S, 1.0, **moving, seed=[0])

    def call() -> Tensor:
        ((at, _),) = captures_of_exposure(scene, exposure, 1)
        return effects.through(shown, at)

    return Contender("blurnoise", call, True)


def _point_spread(path_px: Any) -> Contender:
    """The path's places (2, n), each shared among four pixels as in DeblurGAN (Kupyn et al., CVPR 2018)."""
    sharp = pixels(leaves(HEIGHT, WIDTH))
    reach = math.ceil(float(np.abs(path_px).max())) + 1

    def call() -> Picture:
        spread = np.zeros((2 * reach + 1,) * 2)
        (x, y), (right, down) = np.floor(path_px).astype(int), path_px - np.floor(path_px)
        for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
            share = np.abs(1 - dy - down) * np.abs(1 - dx - right)
            np.add.at(spread, (y + dy + reach, x + dx + reach), share / path_px.shape[1])
        seen = cv2.filter2D(sharp, -1, spread[::-1, ::-1], borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(seen, np.float32)

    return Contender("cv2.filter2D by the path", call)


def _against_truth(name: str, ways: Sequence[Contender], where: Where, margin_px: int = _MARGIN_PX) -> Case:
    """The ways, and the mean of warped pictures as one writes it with OpenCV; errors off a margin from the picture
    that moves as ``where`` says."""
    sharp, (y, x) = pixels(leaves(HEIGHT, WIDTH)), np.indices((HEIGHT, WIDTH), np.float32)

    def mean() -> Picture:
        total = np.zeros_like(sharp)
        for time in _moments(FRAMES):
            cv2.accumulate(remapped(sharp, *where(x, y, time)), total)
        return np.asarray(total / FRAMES)

    def coded(seen: Tensor | Picture) -> Tensor:
        planes = seen if isinstance(seen, Tensor) else _tensor(seen)
        inside = slice(margin_px, -margin_px)
        return srgb_from_linear(planes[..., inside, inside].double().clamp(0, 1))

    expected = coded(truth(leaves(HEIGHT, WIDTH), where, _moments()))
    every = [*ways, Contender(f"mean of {FRAMES} frames", mean)]
    return Case(name, every, lambda seen: 255 * float((coded(seen) - expected).square().mean().sqrt()))


@cache
def leaves(height: int, width: int, seed: int = 0) -> Picture:
    """Dead leaves with text on them, ``FINE`` times finer than (H, W); not to be written to.

    Discs that cover one another, their radii of density r^-3, have the spectrum and the edges of photographs (Lee,
    Mumford and Huang, Int. J. Computer Vision 41, 2001).
    """
    drawn = np.random.default_rng(seed)
    sheet = np.full((height * FINE, width * FINE, 3), 90, np.uint8)
    least, largest = 1.5 * FINE, height * FINE / 4
    count = round(9 * sheet[..., 0].size / (2 * np.pi * np.log(largest / least) / (least**-2 - largest**-2)))
    radii = (least**-2 - drawn.random(count) * (least**-2 - largest**-2)) ** -0.5
    x, y = drawn.random((2, count)) * np.array([[sheet.shape[1]], [sheet.shape[0]]])
    colours = np.clip(drawn.uniform(10, 235, (count, 1)) + drawn.uniform(-20, 20, (count, 3)), 0, 255)
    for radius, left, top, colour in zip(radii, x, y, colours, strict=True):
        cv2.circle(sheet, (round(left), round(top)), round(radius), colour.tolist(), -1)
    for line in range(16):
        capital = (10, 14, 20, 28)[line % 4] * FINE
        place = -10 * FINE * line, round(sheet.shape[0] * (line + 0.8) / 16)
        ink = (15, 15, 15) if line % 2 else (240, 240, 240)
        cv2.putText(sheet, _TEXT, place, cv2.FONT_HERSHEY_SIMPLEX, capital / 21, ink, round(capital / 8))
    fine = linear_from_srgb(torch.arange(256) / 255).numpy()[sheet]
    blurred = cv2.GaussianBlur(fine, (0, 0), _LENS_PX * FINE, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(blurred, np.float32)


def pixels(fine: Picture) -> Picture:
    """The mean of each ``FINE`` x ``FINE`` samples."""
    height, width = (side // FINE for side in fine.shape[:2])
    return np.asarray(fine.reshape(height, FINE, width, FINE, -1).mean((1, 3)))


def truth(fine: Picture, where: Where, times_s: Picture) -> Picture:
    """The mean of moments of what pixels see, (H, W, C): ``FINE`` times finer than they, averaged over their area.

    times_s: (n, 1, 1). What lies beyond the picture is reflected.
    """
    averaged = cv2.blur(fine, (FINE, FINE))  # sample i is the mean about i - 1/2
    y, x = np.indices((fine.shape[0] // FINE, fine.shape[1] // FINE), np.float32)
    total = np.zeros((*x.shape, fine.shape[2]))
    for times in times_s:
        across, down = where(x, y, times)
        total += remapped(averaged, FINE * (across + 0.5), FINE * (down + 0.5), cv2.INTER_CUBIC)
    return np.asarray(total / len(times_s), np.float32)


def remapped(picture: Picture, x: Picture, y: Picture, how: int = cv2.INTER_LINEAR) -> Picture:
    """What a picture shows at x, y."""
    x, y = (np.ascontiguousarray(along, np.float32) for along in np.broadcast_arrays(x, y))
    return np.asarray(cv2.remap(picture, x, y, how, borderMode=cv2.BORDER_REFLECT_101), np.float32)
