"""Stop signs rendered by :mod:`blurnoise.charts` before many backgrounds, to be found or to be read.

Backgrounds are plain, graded, rough as nature is, and cluttered, none like another: linear RGB reflectance,
(1, 3, N, N) float32, from 0.02 (soot) to 0.9 (snow).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import charts
from blurnoise._core.checks import integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.blur.layer import Layer
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.scene.cutting import Cut
from blurnoise_eval.datasets.records import Picture, PictureSet, Target

RENDERED_SIZE_PX = 320
RENDERED_PICTURES = 20
"""As many as intervals over pictures ask for."""
SIZE_SPREAD = 0.05
"""A sign is up to this share smaller or larger than its group says, so that no answer is one raster's."""
_MOST_PICTURES = 10_000
_SIGNS_PX = (100, 50, 32)
_APART_PX = 24.0  # signs from one another and from the border, at least
_SMEAR_PX = 45.0  # to either side of a sign
_FAINT = 1e-3  # share of a pixel: below any that the charts know
_FRAME: Any = {"height_px": RENDERED_SIZE_PX, "width_px": RENDERED_SIZE_PX}
_DARKEST, _BRIGHTEST = 0.02, 0.9
_MEANS = math.log(0.04), math.log(0.5)  # of the logarithm: asphalt when wet to light concrete
_TINT = 0.12  # standard deviation of the channels' logarithms: most things are nearly grey
_FINER = 4  # points per pixel along a side, of the clutter's edges


class _Sign(NamedTuple):
    """A sign in a picture: its group's size and its own, across flats, and its centre (x, y), px."""

    group_px: float
    size_px: float
    centre_px: tuple[float, float]


class _RenderedScene(NamedTuple):
    """Picture ``number`` of a seed, and its signs."""

    signs: tuple[_Sign, ...]
    number: int
    seed: int

    def background(self) -> Tensor:
        """What is behind the signs, (1, 3, N, N)."""
        rng = np.random.default_rng([self.seed, self.number])
        return torch.from_numpy(background(self.number, rng, RENDERED_SIZE_PX))

    def load(self) -> NDArray[np.uint8]:
        """The picture, the caller's own."""
        return _rendered(self).copy()

    def cut(self) -> Cut:
        """The signs as layers, and what is behind them: nothing of it is invented."""
        behind = self.background()
        return Cut(behind, tuple(map(_layer, self.signs)), np.zeros(behind.shape[-2:], bool))


def rendered_signs(
    sizes_px: Sequence[float] = _SIGNS_PX,
    *,
    count: int = RENDERED_PICTURES,
    seed: int = 0,
    reads: bool = False,
) -> PictureSet:
    """Squares of 320 px with a stop sign of each size (px across flats), before ``count`` backgrounds.

    Signs are within 5 % of their size and stand at random, to fractions of a pixel, one above the other, with room
    for 90 px of motion along x. Backgrounds are plain, graded, of 1/f texture and cluttered in turn, dark to bright.
    What picture i shows depends on sizes, ``seed`` and i alone. reads: targets are to be read, the word STOP, a third
    of the sign in height. Raises ``TypeError`` or ``ValueError`` for sizes that do not fit, a count that is no
    integer from 1 to 10000, a seed that is none from 0 on.

    >>> from blurnoise_eval import datasets
    >>> first = datasets.rendered_signs((50,), count=1).pictures[0]
    >>> first.load().shape, first.targets[0].group
    ((320, 320, 3), 'stop sign 50 px')
    """
    for size in sizes_px:
        charts.stop_sign_box(size, **_FRAME)
    room_px = RENDERED_SIZE_PX - _APART_PX * (len(sizes_px) + 1)
    if len(sizes_px) > 1 and sum(sizes_px) * (1 + SIZE_SPREAD) > room_px:
        raise ValueError(f"sizes_px = {[*sizes_px]}: must fit side by side into {RENDERED_SIZE_PX} px")
    integer("count", count, 1, _MOST_PICTURES)
    integer("seed", seed, 0, LAST_SEED)
    listed = "-".join(f"{size:g}" for size in sizes_px)
    pictures = []
    for number in range(count):
        scene = _RenderedScene(_placed(sizes_px, number, seed), number, seed)
        name = f"stop-signs-{listed}px-{number + 1:02}"
        identity = f"rendered {listed} px, {number} of seed {seed}"
        targets = tuple(_target(sign, reads) for sign in scene.signs)
        pictures.append(Picture(name, targets, scene.load, identity, number + 1, scene.cut))
    what = "texts of stop signs" if reads else "stop signs"
    source = f"{what} of {', '.join(f'{size:g}' for size in sizes_px)} px before {count} backgrounds"
    return PictureSet("rendered", source, tuple(pictures), {"text" if reads else "stop sign": 1})


rendered_texts = partial(rendered_signs, reads=True)
"""The pictures of :func:`rendered_signs`, to be read."""


def _target(sign: _Sign, reads: bool) -> Target:
    if not reads:
        box = charts.stop_sign_box(sign.size_px, centre_px=sign.centre_px, **_FRAME)
        return Target("stop sign", f"stop sign {sign.group_px:g} px", box)
    box = charts.stop_sign_text_box(sign.size_px, centre_px=sign.centre_px, **_FRAME)
    return Target("text", f"STOP on a sign of {sign.group_px:g} px", box, text="STOP")


def _placed(sizes_px: Sequence[float], number: int, seed: int) -> tuple[_Sign, ...]:
    """Signs of these sizes in picture ``number``, one above the other in random order."""
    rng = np.random.default_rng([seed, number, 1])
    most = min(1 + SIZE_SPREAD, max(1.0, RENDERED_SIZE_PX / sum(sizes_px)))
    sizes = [size * rng.uniform(1 - SIZE_SPREAD, most) for size in sizes_px]
    free = max(0.0, RENDERED_SIZE_PX - sum(sizes))
    apart = min(_APART_PX, free / (len(sizes) + 1))
    gaps = apart + np.diff(np.sort(rng.uniform(0, free - (len(sizes) + 1) * apart, len(sizes))), prepend=0.0)
    placed: dict[int, _Sign] = {}
    top = 0.0
    for gap, index in zip(gaps.tolist(), rng.permutation(len(sizes)).tolist(), strict=True):
        half = sizes[index] / 2
        margin = half + max(0.0, min(_SMEAR_PX, RENDERED_SIZE_PX / 2 - half))
        x = rng.uniform(margin, RENDERED_SIZE_PX - margin)
        placed[index] = _Sign(sizes_px[index], sizes[index], (x, top + gap + half))
        top += gap + 2 * half
    return tuple(placed[index] for index in range(len(sizes)))


@lru_cache(maxsize=2 * RENDERED_PICTURES)  # 0.3 MB and 0.1 s each; sweeps load some twice
def _rendered(scene: _RenderedScene) -> NDArray[np.uint8]:
    picture = scene.background()
    for sign in scene.signs:
        picture = charts.stop_sign(sign.size_px, centre_px=sign.centre_px, background=picture)
    coded: Any = srgb_from_linear(picture[0]).mul(255).round().byte().permute(1, 2, 0).contiguous().numpy()
    return np.asarray(coded, np.uint8)


def _layer(sign: _Sign) -> Layer:
    """From the sign before black, which is its light times its matte, and before white."""
    where: Any = {"centre_px": sign.centre_px, **_FRAME}
    x0, y0, x1, y1 = charts.stop_sign_box(sign.size_px, **where)
    left, top, right, bottom = math.floor(x0), math.floor(y0), math.ceil(x1), math.ceil(y1)
    black, white = (
        charts.stop_sign(sign.size_px, background=level, **where)[0, :, top:bottom, left:right]
        for level in (0.0, 1.0)
    )
    alpha = (1 - (white - black).mean(0)).clamp(0, 1)
    return Layer(black / alpha.clamp_min(_FAINT), alpha, place_px=(left, top))


def background(number: int, rng: Generator, size_px: int) -> NDArray[np.float32]:
    """Background ``number`` of a series that takes the kinds in turn, drawn from ``rng``."""
    level = rng.uniform(*_MEANS)
    logarithm = _KINDS[number % len(_KINDS)](rng, size_px, level) + rng.normal(0, _TINT, 3)
    reflectance = np.exp(logarithm).clip(_DARKEST, _BRIGHTEST)
    return np.asarray(reflectance.transpose(2, 0, 1)[None], np.float32)


# Each returns natural logarithms of reflectance, (N, N, 1) or (N, N, 3), about ``level``.


def _plain(rng: Generator, size_px: int, level: float) -> Any:
    return np.full((size_px, size_px, 1), level)


def _graded(rng: Generator, size_px: int, level: float) -> Any:
    """One level that turns into another, up to four times as bright, in some direction."""
    turn, rise = rng.uniform(0, 2 * math.pi), rng.uniform(0.3, 1.0) * math.log(4)
    along = np.linspace(-0.5, 0.5, size_px)
    return (level + rise * (math.cos(turn) * along + math.sin(turn) * along[:, None]))[..., None]


def _rough(rng: Generator, size_px: int, level: float) -> Any:
    """Texture with the amplitude spectrum of natural scenes, 1/f (Field 1987); RMS 0.2 to 0.6 in the logarithm."""
    fx, fy = np.fft.rfftfreq(size_px), np.fft.fftfreq(size_px)[:, None]
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = np.inf
    white = np.fft.rfft2(rng.standard_normal((size_px, size_px)))
    field = np.fft.irfft2(white / frequency, (size_px, size_px))
    return (level + rng.uniform(0.2, 0.6) * field / field.std())[..., None]


def _cluttered(rng: Generator, size_px: int, level: float) -> Any:
    """Things of all sizes that hide each other, each of a reflectance and colour of its own (dead leaves)."""
    side = size_px * _FINER
    canvas = np.full((side, side, 3), level, np.float32)
    radii = np.sort(rng.uniform(0.02, 0.25, 80) ** 2 * 4)[::-1] * side / 2
    for radius in radii.tolist():
        x, y = rng.uniform(0, side, 2).tolist()
        long, turn, round_one = rng.uniform(0.4, 1.0), rng.uniform(0, 180), rng.random() < 0.5
        tint = (level + rng.normal(0, 0.7) + rng.normal(0, 0.25, 3)).tolist()
        if round_one:
            sides = (2 * radius, 2 * radius * long)
            cv2.ellipse(canvas, ((x, y), sides, turn), tint, cv2.FILLED)
        else:
            corners = cv2.boxPoints(((x, y), (2 * radius, 2 * radius * long), turn))
            cv2.fillConvexPoly(canvas, corners.astype(np.int32), tint)
    light = cv2.resize(np.exp(canvas), (size_px, size_px), interpolation=cv2.INTER_AREA)
    return np.log(light)


_KINDS: tuple[Callable[[Generator, int, float], Any], ...] = (_plain, _graded, _rough, _cluttered)
