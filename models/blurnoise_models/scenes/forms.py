"""Forms that many things share: a sheet to draw on, an outline, shading flat or round."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator

from blurnoise_models.scenes.drawing import Easel, Points, Sprite, dim
from blurnoise_models.scenes.paint import axis, between, chance, gain, ramp


def sheet(n: int, width: float) -> Easel:
    """A sheet ``width`` heights wide, with no more points than n x n."""
    height = n / math.sqrt(max(1.0, width))
    return Easel.blank(max(8, int(height)), max(8, int(height * width)))


def blob(rng: Generator, corners: int, width: float) -> Points:
    """A star-shaped polygon about the sheet's middle, rough or smooth."""
    turns = np.sort(rng.random(corners) if corners < 8 else np.arange(corners) / corners) * 2 * math.pi
    radii = np.clip(1 + rng.normal(0, between(rng, 0.1, 0.35), corners), 0.3, 1.5) / 1.5
    return np.column_stack([width / 2 * (1 + radii * np.cos(turns)), 0.5 * (1 + radii * np.sin(turns))])


def shaded(rng: Generator, sprite: Sprite, depth: float) -> Sprite:
    """The sprite with texture and a fall of light."""
    n, m = sprite.shape[:2]
    dim(sprite, gain(rng, n, m, between(rng, 0, depth)))
    if chance(rng, 0.7):
        dim(sprite, ramp(rng, n, m, between(rng, 0.2, 0.9)) * np.float32(between(rng, 0.6, 1.2)))
    return sprite


def rounded(rng: Generator, sprite: Sprite) -> Sprite:
    """The sprite shaded as a ball, with a highlight."""
    n, m = sprite.shape[:2]
    y, x = axis(n)[:, None], axis(m)
    across = (x - np.float32(between(rng, -0.5, 0.5))) ** 2
    down = (y - np.float32(between(rng, -0.6, 0.2))) ** 2
    steep = between(rng, 0.15, 0.5)
    dim(sprite, np.clip((1.1 - steep * across) - steep * down, 0.1, 1.1))
    if chance(rng, 0.6):
        sharp = between(rng, 8, 80)
        glint = (between(rng, 0.1, 0.8) * np.exp(-sharp * across)) * np.exp(-sharp * down) * sprite[..., 3]
        sprite[..., :3] += glint[..., None]
    return sprite
