"""Things that are no stop sign: other boards of every kind, and red, round, lettered and everyday things.

Domain: :func:`thing` gives a sprite of about ``size_px`` in height. No octagon here is red and lettered, and
none is plain red: at a distance that one would be a stop sign.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.random import Generator

from blurnoise_models.scenes.boards import board, letters
from blurnoise_models.scenes.drawing import Colour, Easel, Sprite, cut, dim, joined
from blurnoise_models.scenes.forms import blob, rounded, shaded, sheet
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
    red,
    words,
)
from blurnoise_models.scenes.signs import weathered


def thing(rng: Generator, size_px: int) -> Sprite:
    """Some thing, shaded."""
    draw = _KINDS[int(np.searchsorted(_SHARES, rng.random()))]
    return draw(rng, size_px)


def person(rng: Generator, n: int) -> Sprite:
    """Someone who stands, sits or is seen to the waist."""
    easel = Easel.blank(n, int(n * 0.55))
    skin = colours(rng, 1)[0] if chance(rng, 0.2) else _skin(rng)
    shirt = red(rng) if chance(rng, 0.4) else colour(rng)
    trousers, hair = (
        (dark(rng) if chance(rng, 0.4) else colour(rng)),
        (dark(rng) if chance(rng, 0.6) else colour(rng)),
    )
    c = 0.275
    close = between(rng, 1.0, 2.4)  # how much of the sheet the upper half fills

    def at(x: float, y: float) -> tuple[float, float]:
        return c + x * close, 0.02 + y * close

    lean = rng.normal(0, 0.03, 8)
    for side in (-1, 1):
        foot = at(side * 0.08 + lean[0], 0.97)
        easel.line([at(side * 0.045, 0.5), at(side * 0.06 + lean[side], 0.74), foot], trousers, 0.075 * close)
        easel.ellipse(*foot, 0.05 * close, 0.025 * close, dark(rng))
        hand = at(side * between(rng, 0.05, 0.24), between(rng, 0.2, 0.55))
        easel.line(
            [at(side * 0.09, 0.2), at(side * 0.14, 0.34), hand],
            skin if chance(rng, 0.4) else shirt,
            0.05 * close,
        )
        easel.ellipse(*hand, 0.022 * close, 0.025 * close, skin)
    body = [
        (-0.1, 0.17),
        (0.1, 0.17),
        (0.11, 0.3),
        (0.085 + lean[3], 0.52),
        (-0.085 + lean[4], 0.52),
        (-0.11, 0.3),
    ]
    easel.polygon([at(x, y) for x, y in body], shirt)
    kind = rng.random()
    x0, y0 = at(-0.075, 0.23)
    x1, y1 = at(0.075, between(rng, 0.27, 0.36))
    if kind < 0.35:
        easel.text(
            words(rng),
            (x0, y0, x1, y1),
            pale(rng) if chance(rng, 0.7) else colour(rng),
            font=font(rng),
            stretch=1,
        )
    elif kind < 0.5:
        for y in np.linspace(0.2, 0.5, 7)[:-1]:
            (left, top), (right, bottom) = at(-0.1, y), at(0.1, y + 0.022)
            easel.rectangle(left, top, right, bottom, pale(rng))
    elif kind < 0.65:  # an open jacket, a tie
        easel.polygon([at(-0.04, 0.17), at(0.04, 0.17), at(0.02, 0.5), at(-0.02, 0.5)], pale(rng))
        easel.line([at(0, 0.18), at(0.005, 0.4)], red(rng) if chance(rng, 0.5) else dark(rng), 0.02 * close)
    easel.ellipse(*at(lean[5], 0.09), 0.06 * close, 0.08 * close, hair)
    easel.ellipse(*at(lean[5] + between(rng, -0.02, 0.02), 0.1), 0.047 * close, 0.06 * close, skin)
    if chance(rng, 0.35):  # a cap, a helmet
        cap = red(rng) if chance(rng, 0.5) else colour(rng)
        easel.ellipse(*at(lean[5], 0.05), 0.064 * close, 0.05 * close, cap)
        if chance(rng, 0.5):
            x, y = at(lean[5] - 0.03, 0.03)
            easel.text(words(rng)[:4], (x, y, x + 0.06 * close, y + 0.025 * close), pale(rng), font=font(rng))
    return shaded(rng, easel.sprite(), 0.5)


def car(rng: Generator, n: int) -> Sprite:
    """A car from the side, or from behind or before."""
    easel = sheet(n, 1.7)
    paint = red(rng) if chance(rng, 0.35) else pale(rng) if chance(rng, 0.3) else colour(rng)
    glass, tyre = colours(rng, 1)[0] if chance(rng, 0.3) else dark(rng), dark(rng)
    w = 1.7
    if chance(rng, 0.5):
        roof = np.array(
            [
                (0.02, 0.75),
                (0.04, 0.5),
                (0.4, 0.45),
                (0.6, 0.18),
                (1.15, 0.16),
                (1.4, 0.45),
                (1.66, 0.52),
                (1.68, 0.75),
            ]
        )
        easel.polygon(roof + rng.normal(0, 0.02, roof.shape), paint)
        easel.polygon([(0.5, 0.45), (0.64, 0.23), (0.86, 0.22), (0.86, 0.45)], glass)
        easel.polygon([(0.92, 0.45), (0.92, 0.22), (1.12, 0.22), (1.28, 0.45)], glass)
        for x in (0.38, 1.32):
            easel.ellipse(x, 0.76, 0.16, 0.16, tyre)
            easel.ellipse(x, 0.76, 0.09, 0.09, pale(rng) if chance(rng, 0.5) else colour(rng))
        if chance(rng, 0.25):
            easel.text(words(rng), (0.6, 0.52, 1.15, 0.66), pale(rng), font=font(rng), stretch=1)
    else:
        easel.polygon(
            [(0.1, 0.85), (0.1, 0.5), (0.35, 0.12), (w - 0.35, 0.12), (w - 0.1, 0.5), (w - 0.1, 0.85)], paint
        )
        easel.polygon([(0.3, 0.45), (0.45, 0.18), (w - 0.45, 0.18), (w - 0.3, 0.45)], glass)
        lamp = red(rng) if chance(rng, 0.65) else pale(rng)
        for x in (0.14, w - 0.36):
            easel.rectangle(x, 0.5, x + between(rng, 0.1, 0.22), between(rng, 0.58, 0.7), lamp)
            easel.rectangle(x + 0.03, 0.84, x + 0.2, 0.98, tyre)
        easel.rectangle(w / 2 - 0.17, 0.62, w / 2 + 0.17, 0.72, pale(rng))
        easel.text(words(rng), (w / 2 - 0.15, 0.635, w / 2 + 0.15, 0.705), dark(rng))
    return shaded(rng, easel.sprite(), 0.5)


def tree(rng: Generator, n: int) -> Sprite:
    """A stem and a crown of many leaves, or a bush in flower."""
    easel = Easel.blank(n, n)
    easel.polygon([(0.47, 0.4), (0.53, 0.4), (0.56, 1), (0.44, 1)], colours(rng, 1)[0])
    low = np.array([20, 35, 12]) if chance(rng, 0.8) else np.array(colours(rng, 1)[0]) * 0.4
    high = low * between(rng, 1.8, 3.8)
    bloom = red(rng) if chance(rng, 0.5) else colour(rng)
    blooming = 0.3 if chance(rng, 0.2) else 0.0
    count = 110
    places = np.clip(rng.normal(0, 0.17, (count, 2)), -0.42, 0.42) + np.array([0.5, 0.42])
    for (x, y), t, u, v in zip(places.tolist(), *rng.random((3, count)).tolist(), strict=True):
        shade = low + (high - low) * t
        tint = bloom if u < blooming else (int(shade[0]), int(shade[1]), int(shade[2]))
        easel.ellipse(x, y, 0.025 + 0.06 * v, 0.025 + 0.035 * u, tint, 180 * t)
    return shaded(rng, easel.sprite(), 0.4)


def body(rng: Generator, n: int) -> Sprite:
    """Something smooth and round, textured or plain."""
    easel = Easel.blank(n, n)
    easel.ellipse(0.5, 0.5, 0.49, 0.49, red(rng) if chance(rng, 0.2) else colour(rng))
    sprite = easel.sprite()
    if chance(rng, 0.6):
        dim(sprite, gain(rng, n, n, between(rng, 0.1, 0.7)))
    return rounded(rng, sprite)


def _ball(rng: Generator, n: int) -> Sprite:
    """Balls, fruit, tomatoes, balloons, buttons, lamps: round and shaded, some with words or stripes."""
    h = between(rng, 0.75, 1.3)
    easel = sheet(n, h)
    tint = red(rng) if chance(rng, 0.6) else colour(rng)
    easel.ellipse(h / 2, 0.5, h / 2 - 0.02, 0.46, tint)
    kind = rng.random()
    if kind < 0.25:
        easel.text(words(rng), (0.2 * h, 0.36, 0.8 * h, 0.62), pale(rng), font=font(rng), stretch=1)
    elif kind < 0.45:
        for _ in range(int(rng.integers(1, 5))):
            x, y = rng.uniform(0.25, 0.75, 2).tolist()
            rx, ry = rng.uniform(0.03, 0.14, 2).tolist()
            easel.ellipse(x, y, rx, ry, colour(rng), between(rng, 0, 180))
    elif kind < 0.6:
        easel.line(
            np.column_stack([np.linspace(0.1, 0.9, 9) * h, 0.5 + 0.1 * np.sin(np.linspace(0, 6, 9))]),
            pale(rng),
            0.08,
        )
    elif kind < 0.75:
        easel.ellipse(h / 2, 0.08, 0.15, 0.05, (60, 110, 40), between(rng, -30, 30))
    return rounded(rng, easel.sprite())


def _flower(rng: Generator, n: int) -> Sprite:
    """A flower, seen from above, or a pizza, a plate, a wheel: petals or crumbs about a centre."""
    easel = Easel.blank(n, n)
    tint, heart = (red(rng) if chance(rng, 0.55) else colour(rng)), colour(rng)
    petals, start = int(rng.integers(4, 14)), between(rng, 0, 6)
    if chance(rng, 0.4):
        easel.ellipse(0.5, 0.5, 0.49, 0.49, pale(rng) if chance(rng, 0.4) else colour(rng))
        easel.ellipse(0.5, 0.5, 0.43, 0.43, tint)
        for x, y, a, b, t in rng.uniform(0, 1, (int(rng.integers(5, 40)), 5)).tolist():
            r, turn = 0.37 * math.sqrt(x), 2 * math.pi * y
            fill = (red(rng), heart, pale(rng))[int(3 * t)]
            easel.ellipse(
                0.5 + r * math.cos(turn),
                0.5 + r * math.sin(turn),
                0.02 + 0.06 * a,
                0.02 + 0.05 * b,
                fill,
                180 * t,
            )
    else:
        for k in range(petals):
            turn = start + 2 * math.pi * k / petals
            x, y = 0.5 + 0.26 * math.cos(turn), 0.5 + 0.26 * math.sin(turn)
            easel.ellipse(x, y, 0.22, min(0.2, 0.8 / petals), tint, math.degrees(turn))
        easel.ellipse(0.5, 0.5, 0.12, 0.12, heart)
    return rounded(rng, easel.sprite())


def _stripes(rng: Generator, n: int) -> Sprite:
    """Awnings, flags, barriers, umbrellas: red and white, or any two colours, side by side."""
    w = between(rng, 0.4, 3.0)
    easel = sheet(n, w)
    first, second = (red(rng), pale(rng)) if chance(rng, 0.65) else (colour(rng), colour(rng))
    easel.rectangle(0, 0, w, 1, first)
    count = int(rng.integers(2, 12))
    kind = rng.random()
    if kind < 0.4:
        slant = between(rng, -0.6, 0.6)
        pitch = w / count
        for k in range(-2, count + 2):
            x = k * pitch
            easel.polygon([(x, 0), (x + pitch / 2, 0), (x + pitch / 2 + slant, 1), (x + slant, 1)], second)
    elif kind < 0.6:
        for k in range(count):
            easel.rectangle(0, k / count, w, (k + 0.5) / count, second)
        if chance(rng, 0.5):
            easel.rectangle(0, 0, w * 0.4, 0.5, colour(rng))
    elif kind < 0.8:
        for k in range(0, 2 * count, 2):
            a, b = (math.pi * (k + j) / count for j in (0, 1))
            c = (w / 2, between(rng, 0.4, 0.6))
            easel.polygon(
                [
                    c,
                    (c[0] + 3 * math.cos(a), c[1] + 3 * math.sin(a)),
                    (c[0] + 3 * math.cos(b), c[1] + 3 * math.sin(b)),
                ],
                second,
            )
    else:  # a cross, a bar, a heart of another colour
        t = between(rng, 0.08, 0.3)
        easel.rectangle(0, 0.5 - t / 2, w, 0.5 + t / 2, second)
        if chance(rng, 0.6):
            easel.rectangle(w / 2 - t / 2, 0, w / 2 + t / 2, 1, second)
    sprite = easel.sprite()
    if chance(rng, 0.4):
        mask = sheet(n, w)
        mask.ellipse(w / 2, 0.5, w / 2, 0.5, (255, 255, 255))
        cut(sprite, np.ascontiguousarray(mask.sprite()[..., 3]))
    return shaded(rng, sprite, 0.5)


def _scrap(rng: Generator, n: int) -> Sprite:
    """A red shape of no meaning with pale marks on it: crumpled, torn, smeared."""
    easel = Easel.blank(n, n)
    easel.polygon(blob(rng, int(rng.integers(4, 30)), 1.0), red(rng) if chance(rng, 0.8) else colour(rng))
    for _ in range(int(rng.integers(0, 7))):
        x, y = rng.uniform(0.2, 0.8, 2)
        tint = pale(rng) if chance(rng, 0.7) else colour(rng)
        if chance(rng, 0.5):
            steps = np.cumsum(rng.normal(0, 0.1, (int(rng.integers(2, 7)), 2)), axis=0)
            easel.line(np.clip(steps + np.array([x, y]), 0.15, 0.85), tint, between(rng, 0.01, 0.08))
        else:
            rx, ry = rng.uniform(0.01, 0.12, 2).tolist()
            easel.ellipse(x, y, rx, ry, tint, between(rng, 0, 180))
    return shaded(rng, easel.sprite(), 0.6)


def _hydrant(rng: Generator, n: int) -> Sprite:
    """A hydrant, a letter box, a bottle, a can: stacked parts about an upright axis."""
    easel = Easel.blank(n, int(n * 0.6))
    tint = red(rng) if chance(rng, 0.65) else colour(rng)
    y, parts = 0.02, int(rng.integers(2, 6))
    edges = np.concatenate([[0], np.sort(rng.random(parts - 1)), [1]])
    for top, bottom in pairwise(edges.tolist()):
        half = between(rng, 0.08, 0.26)
        part = tint if chance(rng, 0.7) else colour(rng)
        easel.polygon(
            [
                (0.3 - half * between(rng, 0.5, 1), top),
                (0.3 + half, top),
                (0.3 + half, bottom),
                (0.3 - half, bottom),
            ],
            part,
        )
        if bottom - top > 0.2 and chance(rng, 0.4):
            middle = (top + bottom) / 2
            easel.text(
                words(rng),
                (0.3 - half * 0.85, middle - 0.06, 0.3 + half * 0.85, middle + 0.06),
                pale(rng),
                font=font(rng),
                stretch=1,
            )
    easel.ellipse(0.3, y + 0.02, between(rng, 0.05, 0.15), 0.03, tint)
    if chance(rng, 0.5):
        easel.rectangle(0.06, 0.3, 0.54, 0.4, tint)
    return rounded(rng, easel.sprite())


def _lights(rng: Generator, n: int) -> Sprite:
    """Traffic lights: a case with lamps, one of them lit."""
    easel = Easel.blank(n, int(n * 0.45))
    case = dark(rng) if chance(rng, 0.6) else colour(rng)
    easel.rectangle(0, 0, 0.45, 1, case)
    lit = int(rng.integers(3))
    for k, tint in enumerate([(255, 50, 30), (255, 190, 40), (60, 240, 150)]):
        shown = tint if k == lit else (tint[0] // 5, tint[1] // 5, tint[2] // 5)
        easel.ellipse(0.225, 0.18 + 0.32 * k, 0.13, 0.13, shown)
    return shaded(rng, easel.sprite(), 0.3)


def _clock(rng: Generator, n: int) -> Sprite:
    """A clock, a dial, a wheel: rim, ticks or spokes, hands."""
    easel = Easel.blank(n, n)
    easel.ellipse(0.5, 0.5, 0.49, 0.49, red(rng) if chance(rng, 0.4) else colour(rng))
    r = between(rng, 0.36, 0.46)
    easel.ellipse(0.5, 0.5, r, r, pale(rng) if chance(rng, 0.7) else colour(rng))
    ink = dark(rng)
    for k in range(12):
        turn = math.pi * k / 6
        x, y = math.sin(turn), -math.cos(turn)
        if chance(rng, 0.85):
            easel.line([(0.5 + 0.32 * x, 0.5 + 0.32 * y), (0.5 + 0.36 * x, 0.5 + 0.36 * y)], ink, 0.02)
    for length in (0.18, 0.28):
        turn = between(rng, 0, 2 * math.pi)
        easel.line([(0.5, 0.5), (0.5 + length * math.sin(turn), 0.5 - length * math.cos(turn))], ink, 0.025)
    return weathered(rng, easel.sprite())


def _bus(rng: Generator, n: int) -> Sprite:
    """A bus, a van, a tram, a lorry: a long box with windows, words and wheels."""
    w = between(rng, 1.2, 3.0)
    easel = sheet(n, w)
    paint = red(rng) if chance(rng, 0.6) else colour(rng)
    easel.rectangle(0, 0, w, 0.88, paint)
    if chance(rng, 0.5):
        y = between(rng, 0.5, 0.75)
        easel.rectangle(0, y, w, y + between(rng, 0.05, 0.2), pale(rng) if chance(rng, 0.6) else colour(rng))
    count = int(rng.integers(2, 9))
    glass = dark(rng) if chance(rng, 0.7) else colour(rng)
    for row in range(1 if chance(rng, 0.7) else 2):
        for k in range(count):
            x = (k + 0.1) * w / count
            easel.rectangle(x, 0.12 + 0.38 * row, x + 0.8 * w / count, 0.36 + 0.38 * row, glass)
    if chance(rng, 0.7):
        easel.text(words(rng), (0.2 * w, 0.6, 0.8 * w, 0.75), pale(rng), font=font(rng), stretch=1)
    for x in (0.2 * w, 0.8 * w):
        easel.ellipse(x, 0.86, 0.12, 0.12, dark(rng))
    return shaded(rng, easel.sprite(), 0.5)


def _animal(rng: Generator, n: int) -> Sprite:
    """A body, legs, neck and head in fur."""
    easel = sheet(n, 1.4)
    coat = colours(rng, 1)[0]
    for x in rng.uniform(0.35, 1.05, 4):
        easel.line([(x, 0.55), (x + rng.normal(0, 0.05), 0.97)], coat, between(rng, 0.05, 0.11))
    easel.ellipse(0.7, 0.5, between(rng, 0.36, 0.46), between(rng, 0.16, 0.26), coat)
    hx, hy = between(rng, 0.15, 0.3), between(rng, 0.12, 0.4)
    easel.line([(0.4, 0.45), (hx, hy)], coat, between(rng, 0.1, 0.22))
    easel.ellipse(hx, hy, between(rng, 0.1, 0.15), between(rng, 0.07, 0.12), coat, between(rng, -30, 30))
    easel.line([(1.08, 0.45), (1.3, between(rng, 0.2, 0.8))], coat, 0.03)
    sprite = easel.sprite()
    fur = material(rng, *sprite.shape[:2])
    dim(fur, sprite[..., 3] * np.float32(between(rng, 0.2, 1.0)))
    sprite[..., :3] = 0.5 * sprite[..., :3] + fur
    return shaded(rng, sprite, 0.5)


def _shelf(rng: Generator, n: int) -> Sprite:
    """Books, boxes, goods in a row or in rows: coloured spines with words."""
    w = between(rng, 0.8, 2.5)
    easel = sheet(n, w)
    easel.rectangle(0, 0, w, 1, dark(rng))
    rows = int(rng.integers(1, 4))
    for row in range(rows):
        x = 0.01
        while x < w - 0.05:
            wide, tall = between(rng, 0.06, 0.3) / rows**0.5, between(rng, 0.6, 0.95) / rows
            base = (row + 1) / rows
            tint = red(rng) if chance(rng, 0.25) else colour(rng)
            easel.rectangle(x, base - tall, min(x + wide, w), base - 0.02, tint)
            if chance(rng, 0.4):
                middle = base - tall / 2
                easel.text(
                    words(rng),
                    (x + 0.1 * wide, middle - 0.1 * tall, x + 0.9 * wide, middle + 0.1 * tall),
                    pale(rng),
                    font=font(rng),
                )
            x += wide + 0.006
    return shaded(rng, easel.sprite(), 0.5)


def _plain(rng: Generator, n: int) -> Sprite:
    """A textured shape: furniture, stones, cushions, clouds, whatever."""
    w = between(rng, 0.4, 2.2)
    easel = sheet(n, w)
    if chance(rng, 0.5):
        easel.polygon(blob(rng, int(rng.integers(3, 24)), w), (1, 1, 1))
    else:
        easel.rectangle(0, 0, w, 1, (1, 1, 1))
    coverage = np.ascontiguousarray(easel.sprite()[..., 3])
    tints = (red(rng), red(rng), pale(rng)) if chance(rng, 0.25) else ()
    body = material(rng, coverage.shape[0], coverage.shape[1], tints)
    dim(body, coverage)
    return shaded(rng, joined(body, coverage), 0.5)


def _skin(rng: Generator) -> Colour:
    tone = between(rng, 0, 1)
    return (int(70 + 170 * tone), int(42 + 145 * tone), int(30 + 130 * tone))


_DRAWN: list[tuple[float, Callable[[Generator, int], Sprite]]] = [
    (6, board), (1, person), (0.8, car), (0.6, tree), (1.3, _ball), (0.8, _flower), (1.0, _stripes),
    (1.2, _scrap), (0.8, _hydrant), (0.4, _lights), (0.5, _clock), (0.8, _bus), (0.9, letters),
    (0.5, _animal), (0.4, _shelf), (1.2, _plain),
]  # fmt: skip
_KINDS = [draw for _, draw in _DRAWN]
_SHARES = np.cumsum([share for share, _ in _DRAWN]) / sum(share for share, _ in _DRAWN)
