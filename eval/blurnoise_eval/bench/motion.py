"""Benches of motion: every way to blur a picture, and to move an object, a camera, its rows or its road.

Units: errors in 8-bit sRGB numbers, RMS off the borders, against 256 moments of a picture rendered four times finer.
Convention: px, x right, y down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import kornia
import numpy as np
import torch
from torch import Tensor

from blurnoise import Camera, Layer, motion_blur
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.motion.causes import shake
from blurnoise.motion.ego import Vehicle, View
from blurnoise.optics.colour import srgb_from_linear
from blurnoise_eval.bench import scenes
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_eval.bench.scenes import Picture, Where

HEIGHT, WIDTH, EXPOSURE_S, ROW_S = 480, 640, 0.01, 30e-6
LENGTHS_PX = (1.5, 6.0, 25.0, 100.0)
ANGLE_DEG = 17.0
FRAMES = (8, 16, 32)
_MOMENTS = 256
_GLOBAL = Camera(
    name="bench", pixel_pitch_um=3.45, f_number=1.4, transmission=1.0, quantum_efficiency=1.0, full_well_e=1e4,
    system_gain_dn_per_e=0.4, read_noise_e=2.0, black_level_dn=0.0, bit_depth=12, width_px=WIDTH, height_px=HEIGHT,
)  # fmt: skip
_SIGN_PX, _SIGN_MOVES_PX = 64, (30.6, 9.4)
_ROLLED_PX_S = (900.0, -500.0)
_KMH = 100.0
Vector = tuple[float, float]
Floats = Any


def blur(*, quick: bool) -> Contest:
    """Straight motion of several lengths: our methods, Kornia's, OpenCV's, and means of frames."""
    lengths = LENGTHS_PX[1:3] if quick else LENGTHS_PX
    return _contest("blur", "Straight motion", [partial(_straight, each) for each in lengths])


def motion(*, quick: bool) -> Contest:
    """What moves in its own way: a hand, an object before a background, the rows of a rolling shutter, a road."""
    jobs: list[Callable[[], Case]] = [
        _hand_shake,
        partial(_object, (0.0, 0.0)),
        partial(_object, (-15.0, 4.0)),
        _rolling_shutter,
        _road,
    ]
    return _contest("motion", "Things that move", jobs[1:2] if quick else jobs)


def _contest(name: str, title: str, cases: Sequence[Callable[[], Case]]) -> Contest:
    return Contest(name, f"{title}, {WIDTH}x{HEIGHT} in colour", cases, error_unit="DN RMS")


def _straight(length_px: float) -> Case:
    angle, taps = math.radians(ANGLE_DEG), max(3, 2 * round((length_px - 1) / 2) + 1)
    moved = length_px * math.cos(angle), length_px * math.sin(angle)
    picture, where = _picture(), _uniformly(moved[0] / EXPOSURE_S, moved[1] / EXPOSURE_S)
    line = np.outer(moved, _moments().ravel() / EXPOSURE_S)
    turned = torch.tensor([-ANGLE_DEG])
    ways = [
        Contender("motion_blur", lambda: motion_blur(picture, moved), True),
        Contender("motion_blur, transfer", lambda: motion_blur(picture, moved, method="transfer"), True),
        _point_spread(picture, line),
        *_frames(picture, where),
    ]
    if length_px < 50:  # beyond it takes many seconds
        kornias = partial(kornia.filters.motion_blur, picture, taps, turned, torch.zeros(1), "reflect")
        ways.append(Contender("Kornia, nearest odd length", kornias))
    return _judged(f"{length_px:g} px", ways, scenes.truth(_leaves(), where, _moments()), length_px)


def _hand_shake() -> Case:
    held, picture = shake(3, 32.0, EXPOSURE_S), _picture()
    at = _moments().ravel()
    path = np.stack([np.interp(at, held.time_s, along) for along in (held.x_px, held.y_px)])
    path -= path.mean(axis=1, keepdims=True)

    def where(x: Picture, y: Picture, time: Picture) -> tuple[Picture, Picture]:
        by_x, by_y = (np.interp(time, at, along) for along in path)
        return x - by_x, y - by_y

    ways = [_ours(picture, trajectory=held), _point_spread(picture, path), *_frames(picture, where)]
    return _judged("hand shake, 32 px", ways, scenes.truth(_leaves(), where, _moments()), 40)


def _object(background_px: Vector) -> Case:
    left, top = (WIDTH - _SIGN_PX) // 2 - 6, (HEIGHT - _SIGN_PX) // 2 - 6
    fine = np.zeros((HEIGHT * scenes.FINE, WIDTH * scenes.FINE, 4), np.float32)
    drawn = scenes.sign(_SIGN_PX)
    fine[
        top * scenes.FINE : top * scenes.FINE + len(drawn),
        left * scenes.FINE : left * scenes.FINE + len(drawn),
    ] = drawn
    sheet, own = scenes.pixels(_leaves()), scenes.pixels(drawn)
    colour = torch.from_numpy(own / np.maximum(own[..., 3:], 1e-6)).clamp(0, 1)
    velocity, behind = (tuple(along / EXPOSURE_S for along in by) for by in (_SIGN_MOVES_PX, background_px))
    layer = Layer(colour[..., :3].permute(2, 0, 1), torch.from_numpy(own[..., 3]), velocity, (left, top))
    whole = scenes.pixels(fine)
    background = _tensor(sheet)
    still = _tensor(scenes.over(whole, sheet))
    matte = _tensor(whole[..., 3:])

    def naive() -> Tensor:
        share = motion_blur(matte, _SIGN_MOVES_PX).clamp(0, 1)
        return share * motion_blur(still, _SIGN_MOVES_PX) + (1 - share) * motion_blur(still, background_px)

    around = slice(top - 30, top + _SIGN_PX + 42), slice(left - 30, left + _SIGN_PX + 42)
    changes = (slice(None),) * 2 if any(background_px) else around  # beyond it is at rest

    def frames(count: int) -> Picture:
        out, x, y = sheet.copy(), *(along[changes] for along in scenes.places(HEIGHT, WIDTH))
        total = np.zeros_like(sheet[changes])
        for time in _moments(count):
            front = scenes.remapped(whole, *_uniformly(*velocity)(x, y, time))
            still = not any(background_px)
            back = sheet[changes] if still else scenes.remapped(sheet, *_uniformly(*behind)(x, y, time))
            total += scenes.over(front, back)
        out[changes] = total / count
        return out

    truth = scenes.truth(_leaves(), _uniformly(*behind), _moments(), (fine, _uniformly(*velocity)))
    ways = [
        _ours(background, objects=((layer,),), velocity_px_s=behind),
        Contender("blend by the blurred matte", naive),
        *(Contender(f"mean of {count} frames", partial(frames, count)) for count in FRAMES),
    ]
    return _judged(f"sign{', its background moves' if any(background_px) else ''}", ways, truth, around)


def _rolling_shutter() -> Case:
    picture, where = _picture(), _uniformly(*_ROLLED_PX_S)
    rows_s = ((np.arange(HEIGHT) - (HEIGHT - 1) / 2) * ROW_S)[:, None]
    x, y = scenes.places(HEIGHT, WIDTH)
    moved = tuple(along * EXPOSURE_S for along in _ROLLED_PX_S)

    def remapped() -> Picture:
        blurred = motion_blur(picture, moved)[0].permute(1, 2, 0).contiguous().numpy()
        return scenes.remapped(blurred, *where(x, y, rows_s), cv2.INTER_CUBIC)

    truth = scenes.truth(_leaves(), where, _moments() + rows_s)
    camera = replace(_GLOBAL, shutter="rolling", row_time_s=ROW_S)
    ways = [
        _ours(picture, camera, velocity_px_s=_ROLLED_PX_S),
        Contender("motion_blur, then cv2.remap", remapped),
        *_frames(picture, where, rows_s),
    ]
    return _judged("rolling shutter", ways, truth, 40)


def _road() -> Case:
    view, mount = View(WIDTH, HEIGHT, 60.0, "rectilinear"), Vehicle(1.4)
    focal_px, pixels = WIDTH / 2 / math.tan(math.radians(30.0)), view.pixels()
    flow = view.flow_px_s(pixels, mount.road_m(view.rays(pixels)), mount.driving(_KMH / 3.6))
    picture, mean = _picture(), tuple(flow.mean((1, 2)) * EXPOSURE_S)
    middle_x, middle_y = (WIDTH - 1) / 2, (HEIGHT - 1) / 2

    def where(x: Picture, y: Picture, time: Picture) -> tuple[Picture, Picture]:
        """Exactly: what is y below the axis is at depth 1.4 m * focal / y, nearer by what was driven since."""
        scale = 1 / (1 + _KMH / 3.6 * time * np.maximum(y - middle_y, 0) / (1.4 * focal_px))
        return scale * (x - middle_x) + middle_x, scale * (y - middle_y) + middle_y

    ways = [
        _ours(picture, velocity_px_s=torch.from_numpy(flow).float()),
        Contender("one blur for all", lambda: motion_blur(picture, mean)),
        *_frames(picture, where),
    ]
    return _judged("road at 100 km/h", ways, scenes.truth(_leaves(), where, _moments()), 40)


def _leaves() -> Picture:
    return scenes.leaves(HEIGHT, WIDTH)


def _picture() -> Tensor:
    return _tensor(scenes.pixels(_leaves()))


def _tensor(picture: Picture) -> Tensor:
    return torch.from_numpy(picture).permute(2, 0, 1)[None].contiguous()


def _moments(count: int = _MOMENTS) -> Floats:
    """Times in the middle of equal parts of the exposure, (count, 1, 1)."""
    return (((np.arange(count) + 0.5) / count - 0.5) * EXPOSURE_S)[:, None, None]


def _uniformly(x_px_s: float, y_px_s: float) -> Where:
    return lambda x, y, time: (x - x_px_s * time, y - y_px_s * time)


def _ours(picture: Tensor, camera: Camera = _GLOBAL, **moving: Any) -> Contender:
    """The light of ``simulate`` after its motion, whatever moves."""

    def call() -> Tensor:
        at = Conditions.of(picture, camera, exposure_s=EXPOSURE_S, illuminance_lux=1.0, **moving)
        return effects.through(picture, at)

    return Contender("blurnoise", call, True)


def _frames(picture: Tensor, where: Where, rows_s: Floats = 0.0) -> list[Contender]:
    """Means of warped pictures, as one writes them with OpenCV."""
    pixels, (x, y) = picture[0].permute(1, 2, 0).contiguous().numpy(), scenes.places(HEIGHT, WIDTH)

    def mean(count: int) -> Picture:
        total = np.zeros_like(pixels)
        for time in _moments(count):
            cv2.accumulate(scenes.remapped(pixels, *where(x, y, time + rows_s)), total)
        return np.asarray(total / count)

    return [Contender(f"mean of {count} frames", partial(mean, count)) for count in FRAMES]


def _point_spread(picture: Tensor, path_px: Floats) -> Contender:
    """The path's places (2, n), each shared among four pixels as in DeblurGAN (Kupyn et al., CVPR 2018)."""
    pixels = picture[0].permute(1, 2, 0).contiguous().numpy()
    reach = math.ceil(float(np.abs(path_px).max())) + 1

    def call() -> Picture:
        spread = np.zeros((2 * reach + 1,) * 2)
        (x, y), (right, down) = np.floor(path_px).astype(int), path_px - np.floor(path_px)
        for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
            share = np.abs(1 - dy - down) * np.abs(1 - dx - right)
            np.add.at(spread, (y + dy + reach, x + dx + reach), share / path_px.shape[1])
        seen = cv2.filter2D(pixels, -1, spread[::-1, ::-1], borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(seen, np.float32)

    return Contender("cv2.filter2D by the path", call)


def _judged(name: str, ways: Sequence[Contender], truth: Picture, where: float | tuple[slice, slice]) -> Case:
    """Judged in these rows and columns, or farther than a reach from the border."""
    if not isinstance(where, tuple):
        margin = math.ceil(where / 2) + 16
        where = slice(margin, -margin), slice(margin, -margin)

    def coded(picture: Tensor | Picture) -> Tensor:
        planes = picture if isinstance(picture, Tensor) else _tensor(picture)
        return srgb_from_linear(planes[..., *where].double().clamp(0, 1))

    expected = coded(truth)
    return Case(name, ways, lambda seen: 255 * float((coded(seen) - expected).square().mean().sqrt()))
