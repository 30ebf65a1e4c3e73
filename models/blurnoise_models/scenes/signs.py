"""Stop signs, after the US R1-1 and its relatives, and what weather, light and people do to them.

Domain: the sign's plane has the octagon's width, flat to flat, as its unit and its centre as origin. Sprites
cover the box [-0.52, 0.52]² of it.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from blurnoise.charts import SIGN_RED, SIGN_WHITE
from blurnoise.charts import stop_sign as chart
from blurnoise_models.scenes.drawing import FONTS, Easel, Floats, Points, Sprite, cut, dim, over
from blurnoise_models.scenes.paint import Draws

HALF = 0.52  # half the sprite's side
BOX = (-HALF, -HALF, HALF, HALF)
_UNIT = 1 / (2 * HALF)  # the sign's width in sheets
_OTHER_LEGENDS = ("ALTO", "PARE", "ARRET", "ARRÊT", "СТОП", "STOPP", "DUR")


def octagon(half: float = 0.5) -> Points:
    """Corners of the upright regular octagon, (8, 2), with ``half`` between centre and flat.

    >>> corners = octagon()
    >>> corners.shape, round(float(np.ptp(corners[:, 0])), 3)
    ((8, 2), 1.0)
    """
    turns = (np.arange(8) + 0.5) * (math.pi / 4)
    return np.column_stack([np.cos(turns), np.sin(turns)]) * (half / math.cos(math.pi / 8))


def stop_sign(rng: Draws, size_px: int) -> Sprite:
    """A stop sign, weathered, (size_px, size_px, 4).

    >>> stop_sign(Draws(1), 64).shape
    (64, 64, 4)
    """
    white = _white(rng, size_px)
    red, pale = _pigments(rng)
    light = cv2.transform(white, np.column_stack([[*(pale - red), 0.0], [*red, 1.0]]))
    sprite = weathered(rng, np.asarray(light, np.float32))
    cut(sprite, face_mask(size_px))
    return sprite


def weathered(rng: Draws, sprite: Sprite) -> Sprite:
    """A board's sprite after some years outdoors: dirt, marks, uneven light, shadow.

    >>> sprite = stop_sign(Draws(1), 64)
    >>> weathered(Draws(2), sprite.copy()).shape == sprite.shape
    True
    """
    n, m = sprite.shape[:2]
    coverage = np.ascontiguousarray(sprite[..., 3])
    if rng.chance(0.6):  # dirt, worn paint
        dim(sprite, rng.grain(n, m, rng.between(0.05, 0.45)))
    if rng.chance(0.3):
        marks = _marks(rng, n, m)
        cut(marks, coverage)
        over(sprite, marks)
    if rng.chance(0.6):  # light that falls unevenly
        dim(sprite, rng.ramp(n, m, rng.between(0.3, 0.95)))
    if rng.chance(0.22):  # a shadow's edge, or sun through leaves
        field = rng.texture(n, m) / np.float32(255) if rng.chance(0.5) else rng.ramp(n, m, 0.0)
        lit = np.clip((field - rng.between(0.4, 0.6)) * rng.between(3, 20) + 0.5, 0, 1)
        low = rng.between(0.2, 0.6)
        dim(sprite, np.asarray(low + (1 - low) * lit, np.float32))
    return sprite


@lru_cache(maxsize=64)
def face_mask(n: int) -> Floats:
    """The share of each of (n, n) points of a sprite that the octagon covers.

    >>> face_mask(64).shape
    (64, 64)
    """
    easel = Easel.blank(n, n)
    easel.polygon(octagon() * _UNIT + 0.5, (255, 255, 255))
    return np.ascontiguousarray(easel.sprite()[..., 0])


def _white(rng: Draws, n: int) -> Floats:
    """Where a sign is white, (n, n) shares: its border and legend; of half of all signs, the chart's."""
    if rng.chance(0.5):
        return np.asarray(cv2.resize(_chart(), (n, n), interpolation=cv2.INTER_AREA))
    easel = Easel.blank(n, n)
    white = (255, 255, 255)
    border = rng.between(0.016, 0.04)
    edge = rng.between(0.006, 0.02) if rng.chance(0.15) else 0.0  # some have a red rim
    easel.polygon(octagon(0.5 - edge) * _UNIT + 0.5, white)
    easel.polygon(octagon(0.5 - edge - border) * _UNIT + 0.5, (0, 0, 0))
    height, half = rng.between(0.29, 0.37) * _UNIT, rng.between(0.36, 0.41) * _UNIT
    middle = 0.5 + rng.between(-0.02, 0.02) * _UNIT
    box = (0.5 - half, middle - height / 2, 0.5 + half, middle + height / 2)
    legend = "STOP" if rng.chance(0.8) else rng.pick(_OTHER_LEGENDS)
    font = rng.font() if legend.isascii() else FONTS[0]
    weight = rng.between(0.0, 0.02) + (0.015 if "Bold" not in font else 0.0)
    easel.text(legend, box, white, font=font, weight=weight)
    share = np.ascontiguousarray(easel.sprite()[..., 0])
    if rng.chance(0.3):  # letters that have lost or gained some paint
        share = np.asarray(cv2.GaussianBlur(share, (0, 0), max(0.3, n * rng.between(0.003, 0.008))))
        share = np.asarray(np.clip((share - rng.between(0.35, 0.6)) * 4 + 0.5, 0, 1), np.float32)
    return share


@lru_cache(maxsize=1)
def _chart() -> Floats:
    """Where :func:`blurnoise.charts.stop_sign` is white, (384, 384) shares of a sprite."""
    pixels = round(384 * _UNIT)
    light = chart(pixels, height_px=384, width_px=384, background=0.0)[
        0, 1
    ].numpy()  # green tells white from red
    return np.asarray(np.clip((light - SIGN_RED[1]) / (SIGN_WHITE[1] - SIGN_RED[1]), 0, 1), np.float32)


def _pigments(rng: Draws) -> tuple[Floats, Floats]:
    """Linear reflectance of the red and the white of one sign: new, dark, bleached, orange or dim."""
    red = np.array(SIGN_RED) * rng.between(0.45, 1.35) + np.array([0.0, 1.0, 1.0]) * rng.between(0.0, 0.03)
    yellowed = (1, 1 - rng.between(0, 0.08), 1 - rng.between(0, 0.2))
    white = np.array(SIGN_WHITE) * rng.between(0.55, 1.15) * yellowed
    age = rng.random()
    if age < 0.25:  # bleached towards pink, orange or grey
        faded = np.array([rng.between(0.45, 0.65), rng.between(0.12, 0.35), rng.between(0.1, 0.35)])
        red += (faded - red) * rng.between(0.15, 0.75)
    elif age < 0.4:  # old dark red
        red *= rng.between(0.35, 0.8)
    light = math.exp(rng.normal(-0.15, 0.4))  # in the sun, in the shade, against the light
    return np.asarray(red * light, np.float32), np.asarray(white * light, np.float32)


def _marks(rng: Draws, n: int, m: int) -> Sprite:
    """Stickers, scribbles, rust, holes or snow, each here and there."""
    easel = Easel.blank(n, m)
    for _ in range(int(rng.integers(1, 4))):
        kind, spot = rng.random(), rng.random(2)
        tint = rng.pick([rng.colour(), rng.dark(), rng.pale(), (110, 62, 34)])
        if kind < 0.3:
            (x, y), (wide, tall) = spot.tolist(), rng.uniform(0.03, 0.13, 2).tolist()
            easel.rectangle(x, y, x + wide, y + tall, tint)
        elif kind < 0.6:
            steps = np.cumsum(rng.normal(0, 0.07, (int(rng.integers(2, 12)), 2)), axis=0)
            easel.line(spot + steps, tint, rng.between(0.004, 0.015))
        elif kind < 0.93:
            for x, y in rng.normal(spot, 0.08, (6, 2)).tolist():
                easel.ellipse(x, y, rng.between(0.01, 0.05), rng.between(0.01, 0.03), tint)
        else:  # snow that sticks at the top
            foot = np.column_stack([np.linspace(0, 1, 12), 0.12 + np.abs(rng.normal(0, 0.1, 12))])
            easel.polygon(np.concatenate([[(0, 0)], foot, [(1, 0)]]), (236, 240, 246))
    return easel.sprite()
