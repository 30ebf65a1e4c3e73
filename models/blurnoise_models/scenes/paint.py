"""Chance, colours and textures: what everything in a scene is painted with.

Domain: colours are sRGB-coded triples of 0-255. Textures are uint8 fields, cut from a bank that depends on
nothing but this file, so that a scene depends on its own seed alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from blurnoise_models.scenes.drawing import FONTS, Bytes, Colour, Floats, linear

T = TypeVar("T")

_BANK_SEED = 1729
_BANK = 45  # textures
_BANK_PX = 512
_UNIT = np.linspace(0, 1, 256, dtype=np.float32)

# Colours of places and things: greys, woods, bricks, plants, skies, skins, cloths, food.
ANCHORS = np.array(
    [
        (12, 12, 14), (35, 33, 32), (62, 62, 64), (90, 90, 92), (122, 120, 118), (150, 150, 152),
        (180, 180, 178), (205, 205, 204), (228, 228, 226), (248, 248, 246),
        (58, 40, 26), (92, 62, 38), (128, 88, 54), (160, 118, 76), (196, 160, 116), (222, 196, 156),
        (110, 52, 40), (150, 74, 54), (172, 100, 78), (140, 40, 34), (186, 44, 36), (214, 62, 50),
        (28, 48, 20), (46, 74, 28), (70, 102, 38), (104, 134, 52), (142, 164, 80), (178, 190, 120),
        (24, 40, 78), (40, 74, 130), (70, 118, 178), (120, 164, 212), (170, 202, 232), (208, 226, 242),
        (88, 56, 44), (150, 104, 82), (198, 148, 120), (226, 184, 156), (242, 212, 190),
        (222, 186, 60), (236, 150, 44), (196, 92, 30), (244, 222, 130), (112, 60, 120), (180, 90, 140),
        (232, 160, 180), (30, 110, 110), (90, 160, 150),
    ],
    np.uint8,
)  # fmt: skip

WORDS = """
    SALE EXIT OPEN CLOSED CAFE PIZZA HOTEL BANK TAXI BUS POLICE FIRE SHOP MARKET BAR GRILL PARK AUTO FOTO
    Coca Cola Pepsi Cola KFC TOYS BOOKS MUSIC HOT COLD FREE NEW NOW WOW 50% -30% LOVE TEAM USA CANADA 23
    7 10 42 99 30 50 60 80 100 P H M A1 K9 STORE SUPER MEGA FRESH FOOD LUNCH DINNER Burger Chicken Noodles
    Restaurant Bakery Flowers Pharmacy Cinema Theatre Museum Airport Station School Church Street Road Ave
    YIELD SLOW AHEAD ONLY WAY ONE ENTER DANGER KEEP OUT WARNING CAUTION NO PARKING TOW AWAY PUSH PULL POST
    SHOT SPOT TOPS POTS SOAP SHOE SPORT STORY STEP STAR START TOP SOS OPTS SNOW SOUP SODA Spar Esso Shell
    Virgin Target Levis Lego Sony Canon Nikon Apple the and for with you your from this that have more
    Welcome Thanks Happy Birthday Merry Summer Winter Vote Peace RED CROSS AID Milk Tea Coffee Beer Wine
""".split()  # noqa: SIM905 - a hundred quotes would hide the words


def chance(rng: Generator, probability: float) -> bool:
    """Whether something happens."""
    return bool(rng.random() < probability)


def pick(rng: Generator, items: Sequence[T]) -> T:
    """One of the items."""
    return items[int(rng.integers(len(items)))]


def between(rng: Generator, low: float, high: float) -> float:
    """A number, all equally likely."""
    return low + (high - low) * float(rng.random())


def colours(rng: Generator, count: int) -> list[Colour]:
    """Natural colours."""
    palette = _palette()
    return [palette[k] for k in rng.integers(len(palette), size=count).tolist()]


def colour(rng: Generator) -> Colour:
    """One natural, or, one time in four, any colour."""
    if chance(rng, 0.25):
        r, g, b = rng.integers(0, 256, 3).tolist()
        return r, g, b
    return colours(rng, 1)[0]


def red(rng: Generator) -> Colour:
    """A red: fresh, dark, pinkish, brick or orange."""
    value = between(rng, 90, 250)
    rest = value * between(rng, 0.02, 0.5) ** 1.3
    return int(value), int(rest * between(rng, 0.7, 1.5)), int(rest * between(rng, 0.7, 1.3))


def pale(rng: Generator) -> Colour:
    """A white, light grey or cream."""
    value = between(rng, 170, 252)
    return int(value), int(value * between(rng, 0.94, 1)), int(value * between(rng, 0.82, 1.01))


def dark(rng: Generator) -> Colour:
    """Nearly black."""
    value = between(rng, 5, 60)
    return int(value), int(value + between(rng, -5, 5)), int(value + between(rng, -5, 8))


def words(rng: Generator) -> str:
    """A word, a few words, digits or mere letters."""
    kind = rng.random()
    if kind < 0.65:
        return pick(rng, WORDS)
    if kind < 0.8:
        return " ".join(pick(rng, WORDS) for _ in range(int(rng.integers(2, 4))))
    if kind < 0.9:
        return str(int(rng.integers(1, 10 ** int(rng.integers(1, 5)))))
    alphabet = "ABCDEFGHIKLMNOPRSTUVWXYZaeionrst"
    return "".join(pick(rng, alphabet) for _ in range(int(rng.integers(2, 8))))


def font(rng: Generator) -> str:
    """A font's file name; bold sans serif more often than others."""
    return FONTS[0] if chance(rng, 0.3) else pick(rng, FONTS)


def texture(rng: Generator, height_px: int, width_px: int) -> Bytes:
    """A grey texture, (H, W) uint8, full range: some part of the bank, turned and scaled."""
    source = _bank(int(rng.integers(_BANK)))
    zoom = math.exp(between(rng, math.log(0.7), math.log(3.0))) * max(height_px, width_px) / 320
    if chance(rng, 0.85):  # upright, which is fast
        rows, columns = (min(_BANK_PX, math.ceil(side / zoom)) for side in (height_px, width_px))
        x, y = (int(between(rng, 0, _BANK_PX - side + 1)) for side in (columns, rows))
        part = source[y : y + rows, x : x + columns]
        part = part[:: 1 if chance(rng, 0.5) else -1, :: 1 if chance(rng, 0.5) else -1]
        return np.asarray(cv2.resize(np.ascontiguousarray(part), (width_px, height_px)), np.uint8)
    turn = between(rng, 0, 2 * math.pi)
    cos, sin = math.cos(turn) / zoom, math.sin(turn) / zoom
    x, y = rng.random(2).tolist()
    matrix = np.array([[cos, -sin, x * _BANK_PX], [sin, cos, y * _BANK_PX]])
    way = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(source, matrix, (width_px, height_px), flags=way, borderMode=cv2.BORDER_REFLECT_101),
        np.uint8,
    )


def material(rng: Generator, height_px: int, width_px: int, tints: Sequence[Colour] = ()) -> Floats:
    """A texture in two to four colours, (H, W, 3) linear light. tints: the colours, else natural ones."""
    stops = list(tints) or colours(rng, int(rng.integers(2, 5)))
    if chance(rng, 0.5):  # shades of one colour as often as a medley
        stops = _triples(np.array(stops[0]) * rng.uniform(0.45, 1.5, (len(stops), 1)))
    places = np.linspace(0, 255, len(stops))
    blend = np.stack([np.interp(np.arange(256), places, [stop[k] for stop in stops]) for k in range(3)], 1)
    field = cv2.cvtColor(texture(rng, height_px, width_px), cv2.COLOR_GRAY2RGB)
    return np.asarray(cv2.LUT(field, linear(blend.astype(np.uint8))[None]), np.float32)


def gain(rng: Generator, height_px: int, width_px: int, depth: float) -> Floats:
    """A texture as a factor, (H, W), between 1 - depth and 1."""
    table = (1 - depth) + depth * _UNIT
    return np.asarray(cv2.LUT(texture(rng, height_px, width_px), table), np.float32)


def ramp(rng: Generator, height_px: int, width_px: int, low: float) -> Floats:
    """Light that falls off to one side or around a spot, (H, W), between about ``low`` and 1."""
    y, x = axis(height_px)[:, None], axis(width_px)
    turn = between(rng, 0, 2 * math.pi)
    cos, sin = math.cos(turn), math.sin(turn)
    if chance(rng, 0.6):
        steep = (1 - low) * 0.5 * between(rng, 0.5, 0.75)
        return np.asarray((0.5 + 0.5 * low) + x * (cos * steep) + y * (sin * steep), np.float32)
    width = between(rng, 0.2, 1.2)
    fall = ((1 - low) * np.exp((x - cos) ** 2 * -width)) * np.exp((y - sin) ** 2 * -width)
    return np.asarray(low + fall, np.float32)


@lru_cache(maxsize=512)
def axis(size_px: int) -> Floats:
    """Places from -1 to 1 along one side, (size_px,)."""
    return np.linspace(-1, 1, size_px, dtype=np.float32)


@lru_cache(maxsize=1)
def _palette() -> list[Colour]:
    """The anchors, each jittered many times."""
    rng = default_rng(_BANK_SEED)
    return _triples(np.tile(ANCHORS, (64, 1)) + rng.normal(0.0, 13.0, (64 * len(ANCHORS), 3)))


def _triples(values: NDArray[np.float64]) -> list[Colour]:
    return [(r, g, b) for r, g, b in np.clip(values, 0, 255).astype(int).tolist()]


@lru_cache(maxsize=_BANK)
def _bank(index: int) -> Bytes:
    """Texture ``index`` of the bank, (512, 512)."""
    rng = default_rng([_BANK_SEED, index])
    kinds = (_fractal, _leaves, _fractal, _cells, _grain, _fractal, _blades, _leaves, _weave)
    field = kinds[index % len(kinds)](rng)
    low, high = np.percentile(field, (0.5, 99.5))
    return np.asarray(np.clip((field - low) / (high - low) * 255, 0, 255), np.uint8)


def _spectrum(rng: Generator, slope: float, stretch: float) -> Floats:
    """Noise whose amplitude falls with frequency^-slope, drawn out ``stretch`` times along y."""
    n = _BANK_PX
    fy, fx = np.fft.fftfreq(n)[:, None] * stretch, np.fft.rfftfreq(n)
    radius = np.hypot(fx, fy)
    radius[0, 0] = 1.0
    phases = np.exp(2j * math.pi * rng.random(radius.shape))
    return np.asarray(np.fft.irfft2(phases * radius**-slope, s=(n, n)), np.float32)


def _fractal(rng: Generator) -> Floats:
    field = _spectrum(rng, between(rng, 0.7, 2.0), 1.0)
    return np.abs(field) if chance(rng, 0.3) else field


def _grain(rng: Generator) -> Floats:
    """Wood: rings pulled along the stem."""
    warp = _spectrum(rng, 1.6, between(rng, 6.0, 20.0))
    return np.asarray(np.sin(warp / warp.std() * between(rng, 2, 7)) + 0.3 * rng.random(warp.shape))


def _leaves(rng: Generator) -> Floats:
    """Foliage, gravel, crumpled things: small shapes that hide each other."""
    n = _BANK_PX
    field = np.zeros((n, n), np.float32)
    size = between(rng, 7, 18)
    count = int(6 * n * n / (size * size))
    shapes = zip(
        rng.integers(0, n, (count, 2)).tolist(),
        (size * rng.uniform(0.3, 1.0, (count, 2))).astype(int).tolist(),
        rng.uniform(0, 360, count).tolist(),
        rng.uniform(0, 1, count).tolist(),
        strict=True,
    )
    for centre, axes, turn, shade in shapes:
        cv2.ellipse(field, centre, axes, turn, 0, 360, shade, cv2.FILLED)
    low = _spectrum(rng, 1.5, 1.0)
    return np.asarray(field + 0.25 * low / low.std(), np.float32)


def _cells(rng: Generator) -> Floats:
    """Stones, scales, cracks: the distance to the nearest of many points."""
    n = _BANK_PX
    seeds = np.full((n, n), 255, np.uint8)
    count = int(between(rng, 60, 1500))
    seeds[rng.integers(0, n, count), rng.integers(0, n, count)] = 0
    return np.asarray(cv2.distanceTransform(seeds, cv2.DIST_L2, 5), np.float32)


def _blades(rng: Generator) -> Floats:
    """Grass, hair, fur: strokes of about one direction."""
    n = _BANK_PX
    field = np.zeros((n, n), np.float32)
    count, length = 9000, between(rng, 8, 40)
    feet = rng.integers(0, n, (count, 2))
    turns = rng.normal(math.pi / 2, between(rng, 0.1, 0.6), count)
    tips = feet + (length * np.column_stack([np.cos(turns), -np.sin(turns)])).astype(int)
    for foot, tip, shade in zip(feet.tolist(), tips.tolist(), rng.random(count).tolist(), strict=True):
        cv2.line(field, foot, tip, shade, 1 + int(shade > 0.7))
    return field


def _weave(rng: Generator) -> Floats:
    """Cloth, tiles, mesh: two waves, somewhat irregular."""
    n = _BANK_PX
    y, x = np.mgrid[:n, :n].astype(np.float32)
    bend = _spectrum(rng, 2.0, 1.0)
    bend = bend / bend.std() * between(rng, 0, 6)
    pitch_x, pitch_y = rng.uniform(5, 50, 2)
    wave = np.sin((x + bend) * 2 * math.pi / pitch_x) + np.sin((y + bend) * 2 * math.pi / pitch_y)
    sharp = between(rng, 0.7, 5)
    grain = _spectrum(rng, 0.8, 1.0)
    return np.asarray(np.tanh(wave * sharp) + 0.25 * grain / grain.std(), np.float32)
