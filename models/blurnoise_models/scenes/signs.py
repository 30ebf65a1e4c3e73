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
from blurnoise_models.scenes.drawing import FONTS, Bytes, Easel, Floats, Points, Sprite, cut, dim, over
from blurnoise_models.scenes.paint import Draws

HALF = 0.52  # half the sprite's side
BOX = (-HALF, -HALF, HALF, HALF)
_UNIT = 1 / (2 * HALF)  # the sign's width in sheets
_SECOND_LINES = ("ARRET", "ARRÊT", "ALTO", "PARE", "4-WAY", "ALL WAY", "قف", "DUR", "HERE", "SLOW")
_OTHER_LEGENDS = ("ALTO", "PARE", "ARRET", "ARRÊT", "СТОП", "STOPP", "DUR")


def octagon(half: float = 0.5) -> Points:
    """Corners of the upright regular octagon, (8, 2), with ``half`` between centre and flat."""
    turns = (np.arange(8) + 0.5) * (math.pi / 4)
    return np.column_stack([np.cos(turns), np.sin(turns)]) * (half / math.cos(math.pi / 8))


def stop_sign(rng: Draws, size_px: int) -> Sprite:
    """A stop sign, weathered, (size_px, size_px, 4)."""
    white = _white(rng, size_px)
    red, pale = _pigments(rng)
    light = cv2.transform(white, np.column_stack([[*(pale - red), 0.0], [*red, 1.0]]))
    sprite = weathered(rng, np.asarray(light, np.float32))
    cut(sprite, face_mask(size_px))
    return sprite


def weathered(rng: Draws, sprite: Sprite) -> Sprite:
    """A board's sprite after some years outdoors: dirt, bleached patches, marks, uneven light, shadow, glare."""
    n, m = sprite.shape[:2]
    coverage = np.ascontiguousarray(sprite[..., 3])
    if rng.chance(0.6):  # dirt, worn paint
        dim(sprite, rng.grain(n, m, rng.between(0.05, 0.45)))
    if rng.chance(0.2):  # bleached in patches
        kept = rng.grain(n, m, rng.between(0.1, 0.5))
        paler = np.array(cv2.mean(sprite)[:3]) * 0.5 + 0.25
        dim(sprite, kept)
        sprite[..., :3] += ((1 - kept) * coverage)[..., None] * paler
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
    if rng.chance(0.1):  # glare: the sky in the sheeting
        sprite[..., :3] += (rng.ramp(n, m, 0.0) ** 3 * coverage * np.float32(rng.between(0.05, 0.4)))[
            ..., None
        ]
    return sprite


def occluder(rng: Draws, size_px: int) -> Sprite:
    """Leaves, branches or a post before a sign: a sprite for :data:`BOX`, hiding up to about a third."""
    easel = Easel.blank(size_px, size_px)
    kind = rng.random()
    if kind < 0.5:  # leaves from one side
        turn, spread, size = rng.between(0, 6.28), rng.between(0.08, 0.2), rng.between(0.02, 0.09)
        middle = 0.5 + 0.55 * np.array([math.cos(turn), math.sin(turn)])
        g = rng.integers(50, 170, 4).tolist()
        greens = (
            [rng.colour(), rng.colour()] if rng.chance(0.2) else [(int(0.7 * v), v, int(0.35 * v)) for v in g]
        )
        for x, y in rng.normal(middle, 0.8 * spread, (int(rng.integers(8, 70)), 2)).tolist():
            easel.ellipse(x, y, size, size * rng.between(0.3, 0.8), rng.pick(greens), rng.between(0, 180))
    elif kind < 0.75:
        for _ in range(int(rng.integers(1, 5))):
            turn, offset = rng.between(0, math.pi), rng.between(-0.45, 0.45)
            way = np.array([math.cos(turn), math.sin(turn)])
            middle = 0.5 + offset * np.array([-way[1], way[0]])
            points = np.stack([middle - 0.8 * way, middle + rng.normal(0, 0.05, 2), middle + 0.8 * way])
            easel.line(points, rng.colour() if rng.chance(0.3) else rng.dark(), rng.between(0.005, 0.03))
    else:  # something upright or level
        width = rng.between(0.05, 0.35)
        at = rng.between(-0.05, 0.2) if rng.chance(0.5) else rng.between(0.8, 1.05)
        low, high, tint = at - width / 2, at + width / 2, rng.colour()
        box = (low, 0.0, high, 1.0) if rng.chance(0.7) else (0.0, low, 1.0, high)
        easel.rectangle(*box, colour=tint)
    sprite = easel.sprite()
    dim(sprite, rng.grain(size_px, size_px, 0.4))
    return sprite


@lru_cache(maxsize=64)
def face_mask(n: int) -> Floats:
    """The share of each of (n, n) points of a sprite that the octagon covers."""
    easel = Easel.blank(n, n)
    easel.polygon(octagon() * _UNIT + 0.5, (255, 255, 255))
    return np.ascontiguousarray(easel.sprite()[..., 0])


def _white(rng: Draws, n: int) -> Floats:
    """Where a sign is white, (n, n) shares: its border and legend."""
    easel = Easel.blank(n, n)
    white = (255, 255, 255)
    border = rng.between(0.016, 0.04)
    edge = rng.between(0.006, 0.02) if rng.chance(0.15) else 0.0  # some have a red rim
    easel.polygon(octagon(0.5 - edge) * _UNIT + 0.5, white)
    easel.polygon(octagon(0.5 - edge - border) * _UNIT + 0.5, (0, 0, 0))
    style, height, half = rng.random(), rng.between(0.29, 0.37) * _UNIT, rng.between(0.36, 0.41) * _UNIT
    middle = 0.5 + rng.between(-0.02, 0.02) * _UNIT
    left, right = 0.5 - half, 0.5 + half
    if style < 0.5:
        _stamp(easel, (left, middle - height / 2, right, middle + height / 2))
    elif style < 0.9:
        legend = "STOP" if style < 0.82 else rng.pick(_OTHER_LEGENDS)
        font = rng.font() if legend.isascii() else FONTS[0]
        weight = rng.between(0.0, 0.02) + (0.015 if "Bold" not in font else 0.0)
        easel.text(
            legend, (left, middle - height / 2, right, middle + height / 2), white, font=font, weight=weight
        )
    else:
        rows = [("STOP", 0.25), (rng.pick(_SECOND_LINES), 0.17)]
        top = 0.5 - 0.24 * _UNIT
        for row, part in rows if rng.chance(0.7) else rows[::-1]:
            box = (left, top, right, top + part * _UNIT)
            easel.text(row, box, white, weight=rng.between(0, 0.01), stretch=0.95)
            top += (part + 0.06) * _UNIT
    share = np.ascontiguousarray(easel.sprite()[..., 0])
    if rng.chance(0.3):  # letters that have lost or gained some paint
        share = np.asarray(cv2.GaussianBlur(share, (0, 0), max(0.3, n * rng.between(0.003, 0.008))))
        share = np.asarray(np.clip((share - rng.between(0.35, 0.6)) * 4 + 0.5, 0, 1), np.float32)
    return share


@lru_cache(maxsize=1)
def _chart_legend() -> Bytes:
    """The letters of :func:`blurnoise.charts.stop_sign`, cut out, 255 where white."""
    light = chart(384, height_px=384, width_px=384, background=0.0, supersample=3)[0].numpy()
    share = (light[1] - SIGN_RED[1]) / (SIGN_WHITE[1] - SIGN_RED[1])  # green tells white from red
    letters = share[int(0.3 * 384) : int(0.7 * 384), int(0.08 * 384) : int(0.92 * 384)]
    rows, columns = (np.flatnonzero(letters.max(axis=axis) > 0.5) for axis in (1, 0))
    letters = letters[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return np.asarray(np.clip(letters, 0, 1) * 255, np.uint8)


def _stamp(easel: Easel, box: tuple[float, float, float, float]) -> None:
    """Lay the chart's legend into a box of the easel's first channel."""
    n = easel.rgba.shape[0]
    x0, y0, x1, y1 = (round(edge * n) for edge in box)
    legend = cv2.resize(_chart_legend(), (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
    np.copyto(easel.rgba[y0:y1, x0:x1, 0], np.uint8(255), where=legend > 127)


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
