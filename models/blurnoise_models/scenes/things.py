"""Things that are no stop sign: boards of every shape, letters, stacked parts, foliage, scraps and plain shapes.

Domain: :func:`thing` gives a sprite of about ``size_px`` in height. No octagon here is red: at a distance it would
be a stop sign.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from blurnoise_models.scenes.drawing import Colour, Easel, Points, Sprite, dim
from blurnoise_models.scenes.paint import Draws
from blurnoise_models.scenes.signs import weathered

_OCTAGONS: list[Colour] = [(30, 60, 140), (40, 110, 60), (128, 128, 128), (225, 225, 222), (225, 190, 40)]
_SIGNALS: list[Colour] = [(236, 180, 30), (240, 130, 20), (20, 70, 160), (40, 110, 190), (20, 90, 50)]


def thing(rng: Draws, size_px: int) -> Sprite:
    """One thing, shaded.

    >>> thing(Draws(1), 64).shape[2]
    4
    """
    draw = rng.pick((board, board, board, board, board, _stack, _stack, _clutter, _clutter, _plain))
    return draw(rng, size_px)


def board(rng: Draws, n: int) -> Sprite:
    """A traffic sign, shop sign, label or dial: a shape with a border, and words or strokes on it; or these alone.

    >>> board(Draws(1), 64).shape[2]
    4
    """
    corners, width = _shape(rng)
    easel = _sheet(n, width)
    middle = np.array([width / 2, 0.5])
    face, ink = _colours(rng, is_octagon=len(corners) == 8)
    if rng.chance(0.85):  # else words on a road or a wall
        easel.polygon(corners, ink if rng.chance(0.6) else face)
        easel.polygon(middle + (corners - middle) * rng.between(0.7, 0.97), face)
    half = middle * rng.between(0.45, 0.75)
    (left, top), (right, bottom) = (middle - half).tolist(), (middle + half).tolist()
    kind = rng.random()
    if kind < 0.6:
        rows, font = int(rng.integers(1, 4)), rng.font()
        for edge in np.linspace(top, bottom, rows, endpoint=False).tolist():
            legend = "STOP" if rng.chance(0.05) else rng.words()
            box = (left, edge, right, edge + 0.8 * (bottom - top) / rows)
            easel.text(legend, box, ink, font=font, weight=rng.between(0, 0.02), stretch=1.3)
    elif kind < 0.85:  # an arrow, a cross, a dial: a few strokes through the middle
        for turn in rng.uniform(0, 2 * math.pi, int(rng.integers(1, 4))):
            end = 0.3 * np.array([math.cos(turn), math.sin(turn)])
            easel.line([tuple(middle - end * rng.random()), tuple(middle + end)], ink, rng.between(0.02, 0.1))
    elif kind < 0.93:  # the bar of "no entry"
        easel.rectangle(left, 0.41, right, 0.59, ink)
    return weathered(rng, easel.sprite())


def _shape(rng: Draws) -> tuple[Points, float]:
    """Corners of a board on its sheet, and the sheet's width in heights."""
    kind, width = rng.random(), rng.between(0.6, 3.0)
    if kind < 0.3:
        return np.array([(0.01, 0.01), (width - 0.01, 0.01), (width - 0.01, 0.99), (0.01, 0.99)]), width
    if kind < 0.4:
        return _blob(rng, int(rng.integers(4, 8)), width), width
    sides = rng.pick((48, 48, 48, 48, 3, 3, 4, 5, 6, 8, 8))
    turn = {3: rng.pick((1, -1)) * math.pi / 2, 4: 0.0, 8: math.pi / 8}.get(sides, rng.between(0, 6))
    turns = np.arange(sides) * 2 * math.pi / sides + turn
    return 0.5 + 0.49 * np.column_stack([np.cos(turns), np.sin(turns)]), 1.0


def _colours(rng: Draws, *, is_octagon: bool) -> tuple[Colour, Colour]:
    """Colours of a board's face and ink."""
    ink = rng.pale() if rng.chance(0.5) else rng.dark()
    if is_octagon:
        return rng.pick(_OCTAGONS), ink
    if rng.chance(0.6):
        pair = rng.red(), rng.pale() if rng.chance(0.8) else rng.colour()
    else:
        pair = rng.pick([*_SIGNALS, rng.pale(), rng.colour()]), ink
    return pair[::-1] if rng.chance(0.3) else pair


def _sheet(n: int, width: float) -> Easel:
    """A sheet ``width`` heights wide, with no more points than n x n."""
    height = n / math.sqrt(max(1.0, width))
    return Easel.blank(max(8, int(height)), max(8, int(height * width)))


def _blob(rng: Draws, corners: int, width: float) -> Points:
    """A star-shaped polygon about the sheet's middle, rough or smooth."""
    turns = np.sort(rng.random(corners)) * 2 * math.pi
    radii = np.clip(1 + rng.normal(0, rng.between(0.1, 0.35), corners), 0.3, 1.5) / 1.5
    return np.column_stack([width / 2 * (1 + radii * np.cos(turns)), 0.5 * (1 + radii * np.sin(turns))])


def _shaded(rng: Draws, sprite: Sprite) -> Sprite:
    """The sprite with texture and a fall of light."""
    n, m = sprite.shape[:2]
    dim(sprite, rng.grain(n, m, rng.between(0, 0.5)))
    dim(sprite, rng.ramp(n, m, rng.between(0.2, 1.0)) * np.float32(rng.between(0.6, 1.2)))
    return sprite


def _stack(rng: Draws, n: int) -> Sprite:
    """Houses, buses, shelves, awnings, letter boxes: parts one above the other, with windows or words, and wheels."""
    w = rng.between(0.35, 2.6)
    easel = _sheet(n, w)
    paint, other = rng.red() if rng.chance(0.4) else rng.colour(), rng.pick([rng.pale(), rng.colour()])
    edges = np.concatenate([[0], np.sort(rng.random(int(rng.integers(0, 5)))), [0.95]]).tolist()
    for top, bottom in pairwise(edges):
        left, right = (rng.between(0, 0.2) * w for _ in range(2))
        part = paint if rng.chance(0.7) else other
        easel.polygon([(left, top), (w - right, top), (w - right * 0.6, bottom), (left * 0.6, bottom)], part)
        kind, margin = rng.random(), rng.between(0, 0.25) * (bottom - top)
        if kind < 0.4:  # windows, or stripes
            count, ink = int(rng.integers(2, 10)), rng.pick([rng.dark(), rng.pale(), rng.colour()])
            pitch = (w - left - right) / count
            for x in (left + (np.arange(count) + 0.2) * pitch).tolist():
                easel.rectangle(x, top + margin, x + 0.6 * pitch, bottom - margin, ink)
        elif kind < 0.65:
            box = (left + 0.1 * w, top + margin, w - right - 0.1 * w, bottom - margin)
            easel.text(rng.words(), box, rng.pale(), font=rng.font(), stretch=1.2)
    if rng.chance(0.4):
        for x in (0.22 * w, 0.78 * w):
            easel.ellipse(x, 0.87, 0.12, 0.12, rng.dark())
    return _shaded(rng, easel.sprite())


def _clutter(rng: Draws, n: int) -> Sprite:
    """Trees, flowers, crumbs, torn paper: small shapes of few colours about a middle, some on a larger one."""
    easel = Easel.blank(n, n)
    first = rng.pick([rng.red(), rng.colour(), (40, 70, 25)])
    if rng.chance(0.5):
        easel.polygon(_blob(rng, int(rng.integers(4, 30)), 1.0), first)
    low, high = np.array(first) * 0.4, np.array(rng.pick([first, rng.pale(), rng.colour()]))
    size, spread = rng.between(0.02, 0.1), rng.between(0.08, 0.17)
    for x, y in np.clip(rng.normal(0.5, spread, (int(rng.between(3, 90)), 2)), 0.1, 0.9).tolist():
        r, g, b = (low + (high - low) * rng.random()).astype(int).tolist()
        rx, ry = size * rng.between(0.4, 1), size * rng.between(0.2, 1)
        easel.ellipse(x, y, rx, ry, (r, g, b), rng.between(0, 180))
    return _shaded(rng, easel.sprite())


def _plain(rng: Draws, n: int) -> Sprite:
    """A textured shape: furniture, stones, cushions, skin, fur."""
    w = rng.between(0.4, 2.2)
    easel = _sheet(n, w)
    if rng.chance(0.6):
        easel.polygon(_blob(rng, int(rng.integers(3, 24)), w), (255, 255, 255))
    else:
        easel.rectangle(0, 0, w, 1, (255, 255, 255))
    sprite = easel.sprite()
    sprite[..., :3] *= rng.material(*sprite.shape[:2])
    return _shaded(rng, sprite)
