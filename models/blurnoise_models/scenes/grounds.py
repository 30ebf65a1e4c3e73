"""Backgrounds: streets, rooms, patterns, nature, pages and plain confusion, never the same twice.

Domain: canvases, (size, size, 3) float32 linear RGB.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.random import Generator

from blurnoise_models.scenes.drawing import Colour, Easel, Floats, Plane, dim, linear, over, upright
from blurnoise_models.scenes.paint import (
    between,
    chance,
    colour,
    colours,
    dark,
    font,
    gain,
    material,
    pale,
    pick,
    ramp,
    red,
    texture,
    words,
)
from blurnoise_models.scenes.things import body, car, person, tree


def ground(rng: Generator, size_px: int) -> Floats:
    """Some background, or two that share the picture."""
    canvas = _one(rng, size_px)
    if chance(rng, 0.22):
        other = _one(rng, size_px)
        if chance(rng, 0.5):  # along a wavy border
            share = texture(rng, size_px, size_px)[..., None] > between(rng, 60, 200)
            canvas = np.where(share, other, canvas)
        else:  # a picture on the wall, a window, a poster
            x0, y0 = rng.uniform(0, 0.7, 2)
            x1, y1 = x0 + between(rng, 0.15, 0.8), y0 + between(rng, 0.15, 0.8)
            rows, columns = (slice(int(a * size_px), int(b * size_px)) for a, b in ((y0, y1), (x0, x1)))
            canvas[rows, columns] = other[rows, columns]
    if chance(rng, 0.15):  # out of focus
        width = 2 * int(rng.integers(1, 6)) + 1
        canvas = np.asarray(cv2.blur(cv2.blur(canvas, (width, width)), (width, width)))
    return canvas


def _one(rng: Generator, n: int) -> Floats:
    """One kind of background, turned a little at times."""
    canvas = _KINDS[int(np.searchsorted(_SHARES, rng.random()))](rng, n)
    if chance(rng, 0.2):
        turn = between(rng, -180, 180) if chance(rng, 0.3) else between(rng, -15, 15)
        matrix = cv2.getRotationMatrix2D((n / 2, n / 2), turn, between(rng, 1.0, 1.6))
        canvas = np.asarray(cv2.warpAffine(canvas, matrix, (n, n), borderMode=cv2.BORDER_REFLECT_101))
    return canvas


def _laid(rng: Generator, canvas: Floats, easel: Easel, depth: float) -> Floats:
    """The easel's drawing over the canvas, with the grain of some surface."""
    n = canvas.shape[0]
    over(canvas, easel.sprite())
    dim(canvas, gain(rng, n, n, between(rng, 0, depth)))
    return canvas


def _slope(rng: Generator, n: int, first: Colour, last: Colour) -> Floats:
    """One colour turning into another, downwards or sideways."""
    ends = linear(np.array([[first], [last]], np.uint8))
    t = np.linspace(0, 1, n, dtype=np.float32)[:, None, None]
    column = ends[0] * (1 - t) + ends[1] * t
    canvas = np.repeat(column, n, axis=1)
    return np.ascontiguousarray(canvas.transpose(1, 0, 2)) if chance(rng, 0.2) else canvas


def _sky(rng: Generator, n: int) -> Floats:
    tops: list[Colour] = [
        (60, 120, 200),
        (110, 160, 220),
        (190, 200, 210),
        (235, 238, 242),
        (120, 125, 135),
        (30, 36, 70),
        (200, 130, 90),
    ]
    first = pick(rng, tops)
    last: Colour = (min(255, first[0] + 50), min(255, first[1] + 40), min(255, first[2] + 20))
    canvas = _slope(rng, n, first, last)
    if chance(rng, 0.6):
        table = np.linspace(0, 1, 256) ** between(rng, 1, 4) * between(rng, 0.1, 0.8)
        cloud = np.asarray(cv2.LUT(texture(rng, n, n), table.astype(np.float32)))
        dim(canvas, 1 - cloud)
        canvas += cv2.cvtColor(cloud * np.float32(between(rng, 0.5, 1.0)), cv2.COLOR_GRAY2RGB)
    return canvas


def _surface(rng: Generator, n: int) -> Floats:
    """One material, evenly or unevenly lit; or a smooth wall."""
    if chance(rng, 0.35):
        canvas = _slope(rng, n, *colours(rng, 2))
        dim(canvas, gain(rng, n, n, between(rng, 0, 0.4)))
        return canvas
    canvas = material(rng, n, n)
    dim(canvas, ramp(rng, n, n, between(rng, 0.2, 1.0)))
    return canvas


def _leaves(rng: Generator, n: int) -> Floats:
    """Shapes of all sizes that hide each other (dead leaves: sizes by a power law)."""
    easel = Easel.blank(n, n)
    palette = [*colours(rng, int(rng.integers(3, 12))), red(rng)]
    count = int(between(rng, 40, 220))
    radii = np.sort(np.clip(0.012 * rng.random(count) ** -between(rng, 0.4, 0.8), 0, 0.5))[::-1]
    spots = rng.uniform(-0.05, 1.05, (count, 2))
    shapes = rng.random((count, 4))
    style = rng.random()
    corners = np.column_stack([np.cos(np.arange(4) * math.pi / 2), np.sin(np.arange(4) * math.pi / 2)])
    for (x, y), r, (a, b, t, c) in zip(spots.tolist(), radii.tolist(), shapes.tolist(), strict=True):
        tint = palette[int(c * len(palette))]
        if style < 0.4 or (style < 0.7 and t < 0.5):
            easel.ellipse(x, y, r, r * (0.3 + 0.7 * a), tint, 180 * b)
        elif style < 0.6:
            easel.rectangle(x - r, y - r * (0.3 + a), x + r, y + r * (0.3 + a), tint)
        else:
            turn = np.array([[math.cos(6 * b), -math.sin(6 * b)], [math.sin(6 * b), math.cos(6 * b)]])
            easel.polygon(((corners * (r, r * (0.2 + a))) @ turn + (x, y))[: 3 + int(t * 2)], tint)
    return _laid(rng, _surface(rng, n), easel, 0.5)


def _street(rng: Generator, n: int) -> Floats:
    """Sky, houses on both sides, trees, a road to the horizon, cars and people."""
    canvas = _sky(rng, n)
    easel = Easel.blank(n, n)
    hx, hy = between(rng, 0.2, 0.8), between(rng, 0.35, 0.65)
    land = colours(rng, 1)[0] if chance(rng, 0.4) else (70, 95, 50)
    if chance(rng, 0.9):
        easel.rectangle(0, hy, 1, 1, land)
    for side in (0, 1):  # facades, from far to near, as boxes that face us
        if chance(rng, 0.75):
            for depth in np.sort(rng.uniform(0.05, 1, int(rng.integers(1, 6)))):
                edge = hx + (side - hx) * depth
                wide, tall = between(rng, 0.1, 0.35) * depth, between(rng, 0.15, 0.9) * depth
                left = edge if side else edge - wide
                _house(rng, easel, left, hy - tall, left + wide, hy + 0.12 * depth)
    if chance(rng, 0.85):
        grey = int(between(rng, 45, 150))
        wide = between(rng, 0.4, 1.4)
        foot = between(rng, 0.2, 0.8)
        easel.polygon(
            [(hx - 0.02, hy), (hx + 0.02, hy), (foot + wide / 2, 1), (foot - wide / 2, 1)],
            (grey, grey, grey + 3),
        )
        line = pale(rng) if chance(rng, 0.6) else (220, 180, 40)
        for k in range(6):
            if chance(rng, 0.8):
                a, b = (k / 6) ** 2, ((k + 0.55) / 6) ** 2
                xa, xb = hx + (foot - hx) * a, hx + (foot - hx) * b
                ya, yb = hy + (1 - hy) * a, hy + (1 - hy) * b
                easel.polygon([(xa, ya), (xa + 0.01 * a, ya), (xb + 0.025 * b, yb), (xb, yb)], line)
    for _ in range(int(rng.integers(0, 4))):  # wires and poles
        if chance(rng, 0.5):
            easel.line([(0, between(rng, 0, 0.4)), (1, between(rng, 0, 0.4))], dark(rng), 0.003)
        else:
            x = between(rng, 0, 1)
            easel.rectangle(
                x, between(rng, 0, 0.4), x + between(rng, 0.004, 0.02), hy + 0.15, colours(rng, 1)[0]
            )
    canvas = _laid(rng, canvas, easel, 0.45)
    for _ in range(int(rng.integers(0, 7))):
        depth = between(rng, 0.08, 0.9)
        draw, tall = pick(rng, ((tree, 0.8), (tree, 0.6), (car, 0.22), (car, 0.3), (person, 0.45)))
        sprite = draw(rng, max(24, min(128, int(1.2 * tall * depth * n))))
        h, w = tall * depth, tall * depth * sprite.shape[1] / sprite.shape[0]
        x, y = between(rng, -0.1, 1.1), hy + 0.4 * depth * (1 - hy) + 0.02
        upright(0, 0, n).paste(canvas, sprite, (x - w / 2, y - h, x + w / 2, y))
    return canvas


def _house(rng: Generator, easel: Easel, x0: float, y0: float, x1: float, y1: float) -> None:
    wall, glass = colours(rng, 2)
    easel.rectangle(x0, y0, x1, y1, wall)
    columns, rows = int(rng.integers(1, 7)), int(rng.integers(1, 8))
    dx, dy = (x1 - x0) / columns, (y1 - y0) / rows
    fill = between(rng, 0.3, 0.8)
    lit = pale(rng)
    for i in range(columns):
        for j in range(rows):
            x, y = x0 + (i + (1 - fill) / 2) * dx, y0 + (j + (1 - fill) / 2) * dy
            easel.rectangle(x, y, x + fill * dx, y + fill * dy, lit if chance(rng, 0.15) else glass)
    if chance(rng, 0.4):
        easel.polygon(
            [(x0 - 0.01, y0), ((x0 + x1) / 2, y0 - 0.4 * (x1 - x0)), (x1 + 0.01, y0)], colours(rng, 1)[0]
        )
    if chance(rng, 0.5):  # a shop at street level
        band = y1 - 0.3 * min(x1 - x0, y1 - y0)
        easel.rectangle(x0, band, x1, band + 0.4 * (y1 - band), red(rng) if chance(rng, 0.5) else colour(rng))
        easel.text(
            words(rng),
            (x0, band + 0.08 * (y1 - band), x1, band + 0.32 * (y1 - band)),
            pale(rng),
            font=font(rng),
            stretch=1,
        )


def _room(rng: Generator, n: int) -> Floats:
    """Walls, floor, furniture, shelves, pictures, lamps."""
    wall, floor, side = colours(rng, 3)
    canvas = _slope(rng, n, wall, tuple(int(v * 0.8) for v in wall))  # type: ignore[arg-type]
    easel = Easel.blank(n, n)
    x, y = between(rng, 0.05, 0.6), between(rng, 0.5, 0.85)
    if chance(rng, 0.6):
        easel.polygon([(0, 0), (x, between(rng, 0, 0.2)), (x, y), (0, min(1.0, y + x * 0.7))], side)
    easel.polygon([(0, min(1.0, y + x * 0.7)), (x, y), (1, y), (1, 1), (0, 1)], floor)
    for _ in range(int(rng.integers(3, 22))):
        w, h = rng.uniform(0.03, 0.4, 2)
        left, top = between(rng, -0.1, 0.95), between(rng, 0, 0.95)
        tint = red(rng) if chance(rng, 0.12) else colour(rng)
        edge = between(rng, 0.004, 0.02)
        if chance(rng, 0.75):
            easel.rectangle(left, top, left + w, top + h, tint)
            if chance(rng, 0.5):
                easel.rectangle(left + edge, top + edge, left + w - edge, top + h - edge, colour(rng))
            if chance(rng, 0.3):  # drawers, shelves, tiles
                for k in range(1, int(rng.integers(2, 6))):
                    level = top + h * k / 6
                    easel.rectangle(left, level, left + w, level + 0.006, dark(rng))
        elif chance(rng, 0.5):
            easel.ellipse(left, top, w / 2, h / 3, tint, between(rng, 0, 180))
        else:
            easel.polygon(
                [(left, top), (left + w, top), (left + w * 1.2, top + h / 3), (left - w * 0.2, top + h / 3)],
                tint,
            )
    canvas = _laid(rng, canvas, easel, 0.4)
    if chance(rng, 0.6):
        dim(canvas, ramp(rng, n, n, between(rng, 0.1, 0.7)))
    return canvas


def _pattern(rng: Generator, n: int) -> Floats:
    """Bricks, tiles, stripes, checkers, dots, fences, blinds: something that repeats."""
    easel = Easel.blank(n, n)
    palette = colours(rng, 4)
    if chance(rng, 0.2):
        palette[:2] = [red(rng), pale(rng)]
    dx, dy = between(rng, 0.03, 0.3), between(rng, 0.03, 0.2)
    kind = int(rng.integers(5))
    joint = between(rng, 0.003, 0.012)
    for j in range(math.ceil(1 / dy)):
        for i in range(-1, math.ceil(1 / dx) + 1):
            x, y = i * dx, j * dy
            tint = (
                palette[(i + j) % 2]
                if kind == 1
                else palette[int(rng.integers(3))]
                if chance(rng, 0.3)
                else palette[0]
            )
            if kind == 0:
                easel.rectangle(
                    x + (j % 2) * dx / 2, y, x + (j % 2) * dx / 2 + dx - joint, y + dy - joint, tint
                )
            elif kind in (1, 2):
                easel.rectangle(x, y, x + dx - joint * (kind - 1), y + dy - joint * (kind - 1), tint)
            elif kind == 3:
                easel.ellipse(x + dx / 2, y + dy / 2, 0.35 * dx, 0.35 * dy, tint)
            elif j == 0:
                easel.rectangle(x, 0, x + dx * 0.5, 1, tint)
    return _laid(rng, _surface(rng, n), easel, 0.6)


def _nature(rng: Generator, n: int) -> Floats:
    """Sky, hills or water, grass, sand or snow."""
    canvas = _sky(rng, n)
    level = between(rng, 0.1, 0.6)
    for _ in range(int(rng.integers(1, 5))):
        walk = np.cumsum(rng.normal(0, 1, n))
        line = walk - np.linspace(walk[0], walk[-1], n)
        edge = (level + line / (np.abs(line).max() + 1e-6) * between(rng, 0.005, 0.12)) * n
        below = np.clip(np.arange(n)[:, None] - edge + 0.5, 0, 1).astype(np.float32)
        body = material(rng, n, n)
        dim(body, below * np.float32(between(rng, 0.4, 1.1)))
        dim(canvas, 1 - below)
        canvas += body
        level += between(rng, 0.08, 0.35)
    return canvas


def _page(rng: Generator, n: int) -> Floats:
    """Printed matter, a screen, a wall of posters."""
    easel = Easel.blank(n, n)
    paper, ink = (pale(rng), dark(rng)) if chance(rng, 0.6) else (colour(rng), colour(rng))
    easel.rectangle(0, 0, 1, 1, paper)
    y = between(rng, -0.05, 0.1)
    while y < 1:
        tall = math.exp(between(rng, math.log(0.03), math.log(0.25)))
        face = font(rng)
        x = between(rng, -0.1, 0.3)
        while x < 1:
            text = words(rng)
            wide = len(text) * tall * between(rng, 0.5, 0.9)
            tint = ink if chance(rng, 0.85) else red(rng)
            easel.text(text, (x, y, x + wide, y + tall), tint, font=face)
            x += wide + 0.5 * tall
        y += tall * between(rng, 1.3, 2.2)
    return _laid(rng, _surface(rng, n), easel, 0.3)


def _crowd(rng: Generator, n: int) -> Floats:
    """Many of one kind side by side: people, cars, trees."""
    canvas = _surface(rng, n)
    draw = pick(rng, (person, person, car, tree))
    tall = between(rng, 0.15, 0.6)
    sprites = [draw(rng, max(32, min(128, int(1.2 * tall * n)))) for _ in range(3)]
    count = int(between(rng, 6, 22))
    for y in np.sort(rng.uniform(0.1, 1.3, count)):
        sprite = pick(rng, sprites)
        h = tall * (0.6 + 0.5 * float(y))
        w = h * sprite.shape[1] / sprite.shape[0]
        x = between(rng, -0.1, 1.1)
        upright(0, 0, n).paste(canvas, sprite, (x - w / 2, float(y) - h, x + w / 2, float(y)))
    return canvas


def _close(rng: Generator, n: int) -> Floats:
    """Near things: large smooth bodies before something plain, as on a table."""
    canvas = _surface(rng, n)
    for _ in range(int(rng.integers(2, 7))):
        wide, tall = rng.uniform(0.16, 1.0, 2).tolist()
        plane = Plane.seen(0, 0, between(rng, 0, 180), 10)
        box = np.array([(-wide / 2, -tall / 2), (wide / 2, tall / 2)])
        x, y = rng.uniform(0, n, 2).tolist()
        plane.placed(box, n * max(wide, tall), (x, y)).paste(
            canvas, body(rng, min(160, int(n * max(wide, tall)))), (-wide / 2, -tall / 2, wide / 2, tall / 2)
        )
    dim(canvas, gain(rng, n, n, between(rng, 0, 0.4)))
    return canvas


_DRAWN: list[tuple[float, Callable[[Generator, int], Floats]]] = [
    (1.6, _surface), (2.0, _leaves), (3.0, _street), (2.0, _room), (1.0, _pattern), (1.8, _nature),
    (0.5, _page), (0.9, _crowd), (1.0, _close), (0.5, _sky),
]  # fmt: skip
_KINDS = [draw for _, draw in _DRAWN]
_SHARES = np.cumsum([share for share, _ in _DRAWN]) / sum(share for share, _ in _DRAWN)
