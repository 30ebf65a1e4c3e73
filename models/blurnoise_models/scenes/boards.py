"""Boards and lettering: traffic signs that are no stop signs, shop fronts, plates, loose letters."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator

from blurnoise_models.scenes.drawing import Colour, Easel, Sprite
from blurnoise_models.scenes.forms import blob, shaded, sheet
from blurnoise_models.scenes.paint import between, chance, colour, dark, font, pale, pick, red, words
from blurnoise_models.scenes.signs import octagon, weathered


def board(rng: Generator, n: int) -> Sprite:
    """A traffic sign, shop sign, poster, label or logo: a shape, a border, words or a pictogram."""
    kind = rng.random()
    if kind < 0.42:
        return _traffic(rng, n)
    w = between(rng, 0.6, 3.0)
    easel = sheet(n, w)
    reddish = chance(rng, 0.6)
    face = red(rng) if reddish else colour(rng)
    ink = pale(rng) if reddish and chance(rng, 0.8) else colour(rng)
    if kind < 0.55:
        easel.ellipse(w / 2, 0.5, w / 2 - 0.01, 0.48, face)
        if chance(rng, 0.5):
            easel.ellipse(w / 2, 0.5, w / 2 - 0.05, 0.44, ink)
            easel.ellipse(w / 2, 0.5, w / 2 - 0.09, 0.4, face)
    elif kind < 0.65:
        easel.polygon(blob(rng, int(rng.integers(4, 8)), w), face)  # never eight corners
    else:
        edge = between(rng, 0.02, 0.06)
        easel.rectangle(0, 0, w, 1, ink if chance(rng, 0.4) else face)
        easel.rectangle(edge, edge, w - edge, 1 - edge, face)
    lines = 1 if chance(rng, 0.6) else int(rng.integers(2, 5))
    rows = [words(rng) if chance(rng, 0.93) else "STOP" for _ in range(lines)]
    margin = 0.22 if kind < 0.65 else 0.1
    if chance(rng, 0.88):
        _rows(rng, easel, rows, (margin * w, margin, (1 - margin) * w, 1 - margin), ink)
    else:
        _pictogram(rng, easel, w / 2, 0.5, 0.28, ink)
    return weathered(rng, easel.sprite())


def _traffic(rng: Generator, n: int) -> Sprite:
    """Signs of traffic that are no stop signs."""
    easel = Easel.blank(n, n)
    kind = int(rng.integers(11))
    signal = red(rng)
    white, ink = pale(rng), dark(rng)
    if kind == 0:  # no entry
        easel.ellipse(0.5, 0.5, 0.49, 0.49, white)
        easel.ellipse(0.5, 0.5, 0.465, 0.465, signal)
        if chance(rng, 0.75):
            easel.rectangle(0.15, between(rng, 0.38, 0.43), 0.85, between(rng, 0.57, 0.62), white)
            if chance(rng, 0.35):
                easel.text("DO NOT", (0.25, 0.2, 0.75, 0.34), white)
                easel.text("ENTER", (0.25, 0.66, 0.75, 0.8), white)
        else:
            easel.text(words(rng), (0.15, 0.35, 0.85, 0.65), white, font=font(rng), stretch=1)
    elif kind in (1, 2):  # limits and prohibitions
        easel.ellipse(0.5, 0.5, 0.49, 0.49, signal)
        easel.ellipse(0.5, 0.5, between(rng, 0.36, 0.41), 0.38, white)
        if chance(rng, 0.5):
            easel.text(str(10 * int(rng.integers(1, 13))), (0.22, 0.33, 0.78, 0.67), ink, stretch=0.9)
        else:
            _pictogram(rng, easel, 0.5, 0.5, 0.22, ink)
            if chance(rng, 0.6):
                easel.line([(0.2, 0.2), (0.8, 0.8)], signal, 0.08)
    elif kind in (3, 4):  # yield, or a warning the other way up
        flip = kind == 4
        corners = np.array([(0.02, 0.08), (0.98, 0.08), (0.5, 0.92)])
        middle = np.array([0.5, 0.36])
        inner = middle + (corners - middle) * between(rng, 0.5, 0.75)
        if flip:
            corners[:, 1], inner[:, 1] = 1 - corners[:, 1], 1 - inner[:, 1]
        easel.polygon(corners, signal)
        easel.polygon(inner, white if chance(rng, 0.8) else (240, 200, 40))
        if flip:
            _pictogram(rng, easel, 0.5, 0.66, 0.15, ink)
        elif chance(rng, 0.4):
            easel.text("YIELD", (0.32, 0.22, 0.68, 0.36), signal)
    elif kind in (5, 6):  # an octagon of another colour
        faces: list[Colour] = [
            (30, 60, 140),
            (40, 110, 60),
            (128, 128, 128),
            (225, 225, 222),
            (150, 105, 60),
            (225, 190, 40),
            (20, 20, 22),
        ]
        face = pick(rng, faces)
        rim = white if chance(rng, 0.6) else face
        easel.polygon(octagon(0.49) + 0.5, rim)
        easel.polygon(octagon(0.45) + 0.5, face)
        if chance(rng, 0.7):
            light = sum(face) < 450
            easel.text(
                words(rng), (0.12, 0.34, 0.88, 0.66), white if light else ink, font=font(rng), stretch=1.2
            )
    elif kind == 7:  # diamond
        half = between(rng, 0.44, 0.49)
        for size, tint in (
            (half, ink),
            (half - 0.025, pick(rng, [(236, 180, 30), (240, 130, 20), (230, 220, 60), signal])),
        ):
            easel.polygon(
                np.array([(0.5, 0.5 - size), (0.5 + size, 0.5), (0.5, 0.5 + size), (0.5 - size, 0.5)]), tint
            )
        if chance(rng, 0.5):
            _pictogram(rng, easel, 0.5, 0.5, 0.2, ink)
        else:
            _rows(
                rng,
                easel,
                [pick(rng, ("STOP", "SLOW", "ROAD", "BUMP", "DIP")), "AHEAD"],
                (0.25, 0.33, 0.75, 0.67),
                ink,
            )
    elif kind == 8:  # a blue or green disc
        easel.ellipse(0.5, 0.5, 0.49, 0.49, white)
        easel.ellipse(0.5, 0.5, 0.46, 0.46, pick(rng, [(20, 70, 160), (40, 110, 190), (20, 120, 70)]))
        _pictogram(rng, easel, 0.5, 0.5, 0.3, white)
    elif kind == 9:  # a plate
        face, text = pick(
            rng,
            [(white, ink), (white, signal), ((20, 90, 50), white), ((20, 60, 140), white), (signal, white)],
        )
        easel.rectangle(0.08, 0, 0.92, 1, text)
        easel.rectangle(0.11, 0.03, 0.89, 0.97, face)
        _rows(rng, easel, [words(rng) for _ in range(int(rng.integers(1, 5)))], (0.16, 0.1, 0.84, 0.9), text)
    else:  # hexagons, shields, houses, pentagons
        sides = pick(rng, (5, 6))
        turns = (np.arange(sides) / sides + between(rng, 0, 1)) * 2 * math.pi
        shape = np.column_stack([np.cos(turns), np.sin(turns)])
        easel.polygon(shape * 0.49 + 0.5, white)
        easel.polygon(shape * 0.45 + 0.5, signal if sides == 5 else colour(rng))
        easel.text(words(rng), (0.2, 0.38, 0.8, 0.62), white, font=font(rng), stretch=1)
    return weathered(rng, easel.sprite())


def letters(rng: Generator, n: int) -> Sprite:
    """Words without a board, STOP painted on a road among them."""
    w = between(rng, 1.0, 4.0)
    easel = sheet(n, w)
    tint = pale(rng) if chance(rng, 0.45) else red(rng) if chance(rng, 0.5) else colour(rng)
    text = "STOP" if chance(rng, 0.25) else words(rng)
    easel.text(
        text, (0.02, 0.05, w - 0.02, 0.95), tint, font=font(rng), weight=between(rng, 0, 0.03), stretch=1.5
    )
    return shaded(rng, easel.sprite(), 0.6)


def _rows(
    rng: Generator, easel: Easel, rows: list[str], box: tuple[float, float, float, float], ink: Colour
) -> None:
    """Write rows of words, one below the other, in one font."""
    x0, y0, x1, y1 = box
    face, step = font(rng), (y1 - y0) / len(rows)
    weight = between(rng, 0, 0.02) / len(rows)
    for k, row in enumerate(rows):
        easel.text(
            row,
            (x0, y0 + (k + 0.1) * step, x1, y0 + (k + 0.9) * step),
            ink,
            font=face,
            weight=weight,
            stretch=1.3,
        )


def _pictogram(rng: Generator, easel: Easel, x: float, y: float, r: float, ink: Colour) -> None:
    """An arrow, a walker, an exclamation mark, a cross or a few bars."""
    kind = int(rng.integers(5))
    if kind == 0:
        turn = between(rng, 0, 2 * math.pi)
        ux, uy = math.cos(turn) * r, math.sin(turn) * r
        easel.line([(x - ux, y - uy), (x + ux * 0.5, y + uy * 0.5)], ink, r * 0.3)
        easel.polygon([(x + ux, y + uy), (x - uy * 0.6, y + ux * 0.6), (x + uy * 0.6, y - ux * 0.6)], ink)
    elif kind == 1:
        easel.ellipse(x, y - 0.8 * r, 0.2 * r, 0.2 * r, ink)
        easel.line([(x, y - 0.5 * r), (x, y + 0.2 * r), (x - 0.4 * r, y + r)], ink, 0.25 * r)
        easel.line([(x, y + 0.2 * r), (x + 0.4 * r, y + r)], ink, 0.2 * r)
        easel.line([(x - 0.5 * r, y), (x, y - 0.4 * r), (x + 0.5 * r, y)], ink, 0.15 * r)
    elif kind == 2:
        easel.rectangle(x - 0.12 * r, y - r, x + 0.12 * r, y + 0.4 * r, ink)
        easel.ellipse(x, y + 0.8 * r, 0.16 * r, 0.16 * r, ink)
    elif kind == 3:
        easel.line([(x - r, y - r), (x + r, y + r)], ink, 0.25 * r)
        easel.line([(x - r, y + r), (x + r, y - r)], ink, 0.25 * r)
    else:
        for k in range(3):
            easel.rectangle(x - r, y + (0.7 * k - 0.9) * r, x + r, y + (0.7 * k - 0.5) * r, ink)
