"""Backgrounds: surfaces, shapes that hide each other, outdoors.

Domain: (size_px, size_px, 3) linear RGB.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from blurnoise_models.scenes.drawing import Colour, Easel, Floats, dim, linear, over
from blurnoise_models.scenes.paint import Draws

_SKIES = ((60, 120, 200), (110, 160, 220), (190, 200, 210), (235, 238, 242), (120, 125, 135), (30, 36, 70))


def ground(rng: Draws, size_px: int) -> Floats:
    """One background, or two along a wavy border; some out of focus.

    >>> ground(Draws(1), 64).shape
    (64, 64, 3)
    """
    draws = (_surface, _surface, _leaves, _leaves, _leaves, _outdoors, _outdoors, _outdoors)
    canvas = rng.pick(draws)(rng, size_px)
    if rng.chance(0.2):
        share = rng.texture(size_px, size_px)[..., None] > rng.between(60, 200)
        canvas = np.where(share, rng.pick(draws)(rng, size_px), canvas)
    if rng.chance(0.15):
        canvas = np.asarray(cv2.GaussianBlur(canvas, (0, 0), rng.between(1, 6) * size_px / 320))
    return canvas


def _laid(rng: Draws, canvas: Floats, easel: Easel) -> Floats:
    """The easel's drawing over the canvas, with the grain of some surface."""
    n = canvas.shape[0]
    over(canvas, easel.sprite())
    dim(canvas, rng.grain(n, n, rng.between(0, 0.5)))
    return canvas


def _slope(n: int, first: Colour, last: Colour) -> Floats:
    """One colour turning into another, downwards."""
    ends = linear(np.array([first, last], np.uint8)[:, None])
    t = np.linspace(0, 1, n, dtype=np.float32)[:, None, None]
    return np.repeat(ends[0] * (1 - t) + ends[1] * t, n, axis=1)


def _surface(rng: Draws, n: int) -> Floats:
    """One material or a smooth wall, evenly or unevenly lit."""
    canvas = _slope(n, rng.colour(), rng.colour()) if rng.chance(0.35) else rng.material(n, n)
    dim(canvas, rng.ramp(n, n, rng.between(0.2, 1.0)))
    return canvas


def _leaves(rng: Draws, n: int) -> Floats:
    """Shapes of all sizes that hide each other (dead leaves: sizes by a power law)."""
    easel = Easel.blank(n, n)
    palette = [rng.red(), *(rng.colour() for _ in range(int(rng.integers(3, 12))))]
    count, round_share = int(rng.between(40, 220)), rng.pick((0.0, 0.5, 1.0))
    radii = np.sort(np.clip(0.012 * rng.random(count) ** -rng.between(0.4, 0.8), 0, 0.5))[::-1]
    for radius, (x, y, flat, turn, kind) in zip(radii.tolist(), rng.random((count, 5)).tolist(), strict=True):
        tint, tall = rng.pick(palette), radius * (0.3 + 0.7 * flat)
        if kind < round_share:
            easel.ellipse(x, y, radius, tall, tint, 180 * turn)
        else:
            at, way = np.array([x, y]), np.array([math.cos(6 * turn), math.sin(6 * turn)])
            along, across = way * radius, np.array([-way[1], way[0]]) * tall
            corners = np.stack([-along - across, along - across, along + across, -along + across]) + at
            easel.polygon(corners[: rng.pick((3, 4))], tint)
    return _laid(rng, _surface(rng, n), easel)


def _outdoors(rng: Draws, n: int) -> Floats:
    """Sky and clouds, hills or roofs before it, land, a road to the horizon, poles and wires."""
    r, g, b = rng.pick(_SKIES)
    canvas = _slope(n, (r, g, b), (min(255, r + 50), min(255, g + 40), min(255, b + 20)))
    land = rng.material(n, n)
    dim(canvas, rng.grain(n, n, rng.between(0, 0.4)))
    level = rng.between(0.25, 0.7)
    walk = np.cumsum(rng.normal(0, 1, n))
    if rng.chance(0.5):  # roofs
        walk = np.repeat(rng.normal(0, 1, n), int(rng.between(10, 60)))[:n]
    line = walk - np.linspace(walk[0], walk[-1], n)
    edge = (level + line / (np.abs(line).max() + 1e-6) * rng.between(0.005, 0.25)) * n
    below = np.clip(np.arange(n)[:, None] - edge + 0.5, 0, 1).astype(np.float32)
    dim(land, below * np.float32(rng.between(0.4, 1.1)))
    dim(canvas, 1 - below)
    canvas += land
    easel = Easel.blank(n, n)
    if rng.chance(0.7):
        x, foot, wide = rng.between(0.2, 0.8), rng.between(0.2, 0.8), rng.between(0.2, 0.7)
        tint = rng.dark() if rng.chance(0.3) else rng.colour()
        easel.polygon([(x - 0.02, level), (x + 0.02, level), (foot + wide, 1), (foot - wide, 1)], tint)
        for t in (np.arange(6) / 6).tolist():
            start, end = ((x + (foot - x) * s * s, level + (1 - level) * s * s) for s in (t, t + 0.09))
            easel.line([start, end], rng.pale(), 0.01)
    for _ in range(int(rng.integers(0, 4))):
        x, y = rng.random(2).tolist()
        ends = [(x, 0.5 * y), (x, level + 0.15)] if rng.chance(0.5) else [(0.0, x / 2), (1.0, y / 2)]
        easel.line(ends, rng.dark(), 0.006)
    return _laid(rng, canvas, easel)
