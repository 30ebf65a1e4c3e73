"""Stop signs, after the US R1-1 and its relatives, and what weather, light and people do to them.

Domain: the sign's plane has the octagon's width, flat to flat, as its unit and its centre as origin. Sprites
cover the box [-0.52, 0.52]² of it.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
from numpy.random import Generator

from blurnoise.charts import SIGN_RED, SIGN_WHITE
from blurnoise.charts import stop_sign as chart
from blurnoise_models.scenes.drawing import (
    FONTS,
    Bytes,
    Easel,
    Floats,
    Points,
    Sprite,
    cut,
    dim,
    joined,
    over,
    split,
)
from blurnoise_models.scenes.paint import (
    between,
    chance,
    colour,
    colours,
    dark,
    font,
    gain,
    pale,
    pick,
    ramp,
    texture,
)

HALF = 0.52  # half the sprite's side
BOX = (-HALF, -HALF, HALF, HALF)


def octagon(half: float = 0.5) -> Points:
    """Corners of the upright regular octagon, (8, 2), with ``half`` between centre and flat."""
    turns = (np.arange(8) + 0.5) * (math.pi / 4)
    return np.column_stack([np.cos(turns), np.sin(turns)]) * (half / math.cos(math.pi / 8))


def stop_sign(rng: Generator, size_px: int) -> Sprite:
    """A stop sign, weathered, (size_px, size_px, 4)."""
    face, white = _masks(rng, size_px)
    red, pale_white = _pigments(rng)
    plane = np.concatenate([red, [1.0]])
    light = cv2.transform(white, np.column_stack([np.concatenate([pale_white - red, [0.0]]), plane]))
    sprite = weathered(rng, np.asarray(light, np.float32))
    cut(sprite, face)
    return sprite


def weathered(rng: Generator, sprite: Sprite) -> Sprite:
    """A board's sprite after some years outdoors: dirt, rust, scratches, stickers, snow, shadow, glare."""
    n, m = sprite.shape[:2]
    light, coverage = split(sprite)
    if chance(rng, 0.6):  # dirt, worn paint
        dim(light, gain(rng, n, m, between(rng, 0.05, 0.45)))
    if chance(rng, 0.2):  # bleached in patches
        patch = 1 - gain(rng, n, m, between(rng, 0.1, 0.5))
        paler = np.array(cv2.mean(light)[:3]) * 0.5 + 0.25
        dim(light, 1 - patch)
        light += cv2.transform(patch * coverage, paler[:, None])
    if chance(rng, 0.3):
        marks = _marks(rng, n, m)
        cut(marks, np.ascontiguousarray(coverage))
        over(light, marks)
    if chance(rng, 0.6):  # light that falls unevenly
        dim(light, ramp(rng, n, m, between(rng, 0.3, 0.95)))
    if chance(rng, 0.22):
        dim(light, _shadow(rng, n, m))
    if chance(rng, 0.1):  # glare: the sky in the sheeting
        glare = ramp(rng, n, m, 0.0) ** 3 * np.float32(between(rng, 0.05, 0.4))
        light += cv2.cvtColor(glare * coverage, cv2.COLOR_GRAY2RGB)
    return joined(light, coverage)


def occluder(rng: Generator, size_px: int) -> Sprite:
    """Leaves, a branch, a pole or a post before a sign: a sprite for :data:`BOX`, hiding up to about a third."""
    easel = Easel.blank(size_px, size_px)
    kind = rng.random()
    if kind < 0.5:  # leaves from one side
        turn = between(rng, 0, 2 * math.pi)
        cx, cy = 0.5 + 0.55 * math.cos(turn), 0.5 + 0.55 * math.sin(turn)
        greens = colours(rng, 2) if chance(rng, 0.2) else _leaf_colours(rng)
        spread, size = between(rng, 0.08, 0.2), between(rng, 0.02, 0.09)
        for x, y, ratio, angle, shade in rng.random((int(rng.integers(8, 70)), 5)).tolist():
            x = cx + (x + y - 1) * 2.2 * spread
            y = cy + (y + ratio + angle - 1.5) * 2.2 * spread
            tint = greens[int(shade * len(greens))]
            easel.ellipse(x, y, size, size * (0.3 + 0.5 * ratio), tint, angle * 180)
    elif kind < 0.75:  # branches
        for _ in range(int(rng.integers(1, 5))):
            turn, offset = between(rng, 0, math.pi), between(rng, -0.45, 0.45)
            x, y = 0.5 - offset * math.sin(turn), 0.5 + offset * math.cos(turn)
            dx, dy = 0.8 * math.cos(turn), 0.8 * math.sin(turn)
            bend = rng.normal(0, 0.05, 2)
            points = [(x - dx, y - dy), (x + bend[0], y + bend[1]), (x + dx, y + dy)]
            easel.line(
                points, colours(rng, 1)[0] if chance(rng, 0.3) else dark(rng), between(rng, 0.005, 0.03)
            )
    else:  # something upright or level
        tint, width = colour(rng), between(rng, 0.05, 0.35)
        at = between(rng, -0.05, 0.2) if chance(rng, 0.5) else between(rng, 0.8, 1.05)
        edges = (at - width / 2, at + width / 2)
        if chance(rng, 0.7):
            easel.rectangle(edges[0], 0, edges[1], 1, tint)
        else:
            easel.rectangle(0, edges[0], 1, edges[1], tint)
    sprite = easel.sprite()
    dim(sprite, gain(rng, size_px, size_px, 0.4))
    return sprite


def _masks(rng: Generator, n: int) -> tuple[Floats, Floats]:
    """Where the sign is, and where it is white: (n, n) each, shares."""
    unit = 1 / (2 * HALF)  # the sign's width in sheets
    easel = Easel.blank(n, n)
    white, blank = (255, 255, 255), (0, 0, 0)
    border = between(rng, 0.016, 0.04)
    edge = between(rng, 0.006, 0.02) if chance(rng, 0.15) else 0.0  # some have a red rim
    easel.polygon(octagon(0.5 - edge) * unit + 0.5, white)
    easel.polygon(octagon(0.5 - edge - border) * unit + 0.5, blank)
    style = rng.random()
    height = between(rng, 0.29, 0.37)
    half = between(rng, 0.36, 0.41) * unit
    lift = between(rng, -0.02, 0.02)
    if style < 0.5:
        _stamp(easel, _chart_legend(), half * 2 / 0.787 * between(rng, 0.94, 1.02), height / (1 / 3), lift)
    elif style < 0.9:
        top = 0.5 + (lift - height / 2) * unit
        legend = (
            "STOP" if style < 0.82 else pick(rng, ("ALTO", "PARE", "ARRET", "ARRÊT", "СТОП", "STOPP", "DUR"))
        )
        face = pick(rng, ("DejaVuSans-Bold.ttf", "DejaVuSans.ttf", "cmss10.ttf", "DejaVuSansMono-Bold.ttf"))
        face = face if legend.isascii() else FONTS[0]
        weight = between(rng, 0.0, 0.02) + (0.015 if "Bold" not in face else 0.0)
        easel.text(
            legend, (0.5 - half, top, 0.5 + half, top + height * unit), white, font=face, weight=weight
        )
    else:  # a second line
        second = pick(
            rng, ("ARRET", "ARRÊT", "ALTO", "PARE", "4-WAY", "ALL WAY", "قف", "DUR", "HERE", "SLOW")
        )
        rows = ("STOP", second) if chance(rng, 0.7) else (second, "STOP")
        top = 0.5 - 0.24 * unit
        for row, share in zip(rows, (0.25, 0.17) if rows[0] == "STOP" else (0.17, 0.25), strict=True):
            box = (0.5 - half, top, 0.5 + half, top + share * unit)
            easel.text(row, box, white, weight=between(rng, 0, 0.01), stretch=0.95)
            top += (share + 0.06) * unit
    on = np.ascontiguousarray(easel.sprite()[..., 0])
    if chance(rng, 0.3):  # letters that have lost or gained some paint
        on = np.asarray(cv2.GaussianBlur(on, (0, 0), max(0.3, n * between(rng, 0.003, 0.008))))
        on = np.asarray(np.clip((on - between(rng, 0.35, 0.6)) * 4 + 0.5, 0, 1), np.float32)
    return _face_mask(n), on


@lru_cache(maxsize=64)
def _face_mask(n: int) -> Floats:
    easel = Easel.blank(n, n)
    easel.polygon(octagon() / (2 * HALF) + 0.5, (255, 255, 255))
    return np.ascontiguousarray(easel.sprite()[..., 0])


@lru_cache(maxsize=1)
def _chart_legend() -> Bytes:
    """The chart's letters, (384, 384) of the octagon's square, 255 where white."""
    light = chart(384, height_px=384, width_px=384, background=0.0, supersample=3)[0].numpy()
    # Green and blue tell white from red; the border lies outside the letters' rows and columns.
    share = (light[1] - SIGN_RED[1]) / (SIGN_WHITE[1] - SIGN_RED[1])
    share[: int(0.3 * 384)] = share[int(0.7 * 384) :] = 0.0
    share[:, : int(0.08 * 384)] = share[:, int(0.92 * 384) :] = 0.0
    return np.asarray(np.clip(share, 0, 1) * 255, np.uint8)


def _stamp(easel: Easel, legend: Bytes, wide: float, tall: float, lift: float) -> None:
    """Lay the chart's legend, scaled, onto the easel's first channel."""
    n = easel.rgba.shape[0]
    unit = n / (2 * HALF)
    scale_x, scale_y = wide * n / legend.shape[1], tall * unit / legend.shape[0]
    matrix = np.array(
        [
            [scale_x, 0, n / 2 - scale_x * legend.shape[1] / 2],
            [0, scale_y, n / 2 + lift * unit - scale_y * legend.shape[0] / 2],
        ]
    )
    if scale_x < 0.6:
        legend = np.asarray(cv2.resize(legend, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        matrix[:, :2] *= 2
    laid = cv2.warpAffine(legend, matrix, (n, n), flags=cv2.INTER_LINEAR)
    np.copyto(easel.rgba[..., 0], np.uint8(255), where=laid > 127)


def _pigments(rng: Generator) -> tuple[Floats, Floats]:
    """Linear reflectance of the red and the white of one sign: new, dark, bleached, orange or dim."""
    red = np.array(SIGN_RED) * between(rng, 0.45, 1.35) + np.array([0.0, 1.0, 1.0]) * between(rng, 0.0, 0.03)
    white = (
        np.array(SIGN_WHITE)
        * between(rng, 0.55, 1.15)
        * (1, 1 - between(rng, 0, 0.08), 1 - between(rng, 0, 0.2))
    )
    age = rng.random()
    if age < 0.25:  # bleached towards pink, orange or grey
        faded = np.array([between(rng, 0.45, 0.65), between(rng, 0.12, 0.35), between(rng, 0.1, 0.35)])
        red += (faded - red) * between(rng, 0.15, 0.75)
    elif age < 0.4:  # old dark red
        red *= between(rng, 0.35, 0.8)
    light = math.exp(rng.normal(-0.15, 0.4))  # in the sun, in the shade, against the light
    return np.asarray(red * light, np.float32), np.asarray(white * light, np.float32)


def _leaf_colours(rng: Generator) -> list[tuple[int, int, int]]:
    g = rng.integers(50, 170, 4)
    return [(int(v * between(rng, 0.4, 0.95)), int(v), int(v * between(rng, 0.15, 0.5))) for v in g]


def _marks(rng: Generator, n: int, m: int) -> Sprite:
    """Stickers, scribbles, rust, scratches, holes or snow, each here and there."""
    easel = Easel.blank(n, m)
    for _ in range(int(rng.integers(1, 4))):
        kind = rng.random()
        x, y = rng.random(2)
        if kind < 0.25:
            w, h = rng.uniform(0.03, 0.13, 2)
            easel.rectangle(x, y, x + w, y + h, colour(rng))
        elif kind < 0.45:
            steps = np.cumsum(rng.normal(0, 0.05, (int(rng.integers(4, 12)), 2)), axis=0)
            easel.line(
                steps + rng.random(2),
                dark(rng) if chance(rng, 0.5) else colour(rng),
                between(rng, 0.005, 0.015),
            )
        elif kind < 0.65:
            for dx, dy, r in rng.normal(0, 0.06, (6, 3)).tolist():
                easel.ellipse(x + dx, y + dy, abs(r) / 2, abs(r) / 3, (110, 62, 34))
        elif kind < 0.85:
            for dx, dy in rng.normal(0, 0.15, (4, 2)).tolist():
                easel.line([(x, y), (x + dx, y + dy)], pale(rng) if chance(rng, 0.6) else dark(rng), 0.004)
        elif kind < 0.93:
            for dx, dy in rng.normal(0, 0.2, (5, 2)).tolist():
                easel.ellipse(x + dx, y + dy, 0.014, 0.014, (24, 22, 20))
        else:  # snow that sticks, mostly at the top
            foot = np.column_stack([np.linspace(0, 1, 12), 0.12 + np.abs(rng.normal(0, 0.1, 12))])
            easel.polygon(np.concatenate([[(0, 0)], foot, [(1, 0)]]), (236, 240, 246))
    if chance(rng, 0.15):
        easel.text(
            "".join(pick(rng, "ABEKMRSWXZ139") for _ in range(4)),
            (0.3, 0.7, 0.7, 0.85),
            dark(rng),
            font=font(rng),
        )
    return easel.sprite()


def _shadow(rng: Generator, n: int, m: int) -> Floats:
    """Factor (n, m, 1) of a shadow's edge or of sun through leaves."""
    low = between(rng, 0.2, 0.6)
    if chance(rng, 0.5):
        field = texture(rng, n, m).astype(np.float32) / 255
        field = field + 0.01 * between(rng, -10, 10)
        softness = between(rng, 3, 12)
    else:
        turn, offset = between(rng, 0, 2 * math.pi), between(rng, -0.5, 0.5)
        y, x = np.linspace(-1, 1, n)[:, None], np.linspace(-1, 1, m)
        field = np.asarray(x * math.cos(turn) + y * math.sin(turn) + offset + 0.5, np.float32)
        softness = between(rng, 3, 30)
    lit = np.clip((field - 0.5) * softness + 0.5, 0, 1)
    return np.asarray(low + (1 - low) * lit, np.float32)
