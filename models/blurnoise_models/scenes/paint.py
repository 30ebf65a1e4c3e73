"""Random choices, colours, words, textures and light: what everything in a scene is painted with.

Domain: colours are sRGB-coded triples of 0-255. Textures are cut from a bank that depends on nothing but this file,
so that a scene depends on its own seed alone.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.random import PCG64, Generator

from blurnoise_models.scenes.drawing import FONTS, Bytes, Colour, Floats, linear

T = TypeVar("T")

_BANK_SEED = 1729
_BANK = 40  # textures
_BANK_PX = 512
WORDS = """
    SALE EXIT OPEN CLOSED CAFE HOTEL BANK TAXI BUS POLICE SHOP BAR PARK AUTO FOTO Cola TOYS BOOKS HOT FREE NEW 50% 23
    42 99 30 50 60 80 100 P H A1 STORE FRESH FOOD Burger Bakery Flowers Museum Station School Street YIELD SLOW AHEAD
    ONLY WAY ENTER DANGER KEEP OUT NO PARKING PUSH POST SHOT SPOT TOPS POTS SOAP SHOE SPORT STEP STAR TOP SOS SNOW
""".split()  # noqa: SIM905 - eighty quotes would hide the words


class Draws(Generator):
    """A random generator that also draws colours, words, textures and light. seeds: non-negative integers.

    >>> Draws(1, 2).colour() == Draws(1, 2).colour(), 0 <= Draws(3).between(0.0, 2.0) < 2
    (True, True)
    """

    def __init__(self, *seeds: int) -> None:
        super().__init__(PCG64(seeds))

    def chance(self, probability: float) -> bool:
        """Whether something happens."""
        return bool(self.random() < probability)

    def pick(self, items: Sequence[T]) -> T:
        """One of the items."""
        return items[int(self.integers(len(items)))]

    def between(self, low: float, high: float) -> float:
        """A number, all equally likely."""
        return low + (high - low) * float(self.random())

    def colour(self) -> Colour:
        """Earth, wood, brick or skin; grey; leaves; sky; or any hue. Mostly muted."""
        hue_deg = self.pick(
            [self.normal(28, 14), self.normal(28, 14), self.normal(95, 25), self.normal(212, 15)]
        )
        hue_deg = self.between(0, 360) if self.chance(0.2) else hue_deg
        saturation = self.random() if self.chance(0.25) else 0.6 * self.random() ** 1.5
        r, g, b = colorsys.hsv_to_rgb(hue_deg / 360 % 1, saturation, self.between(0.05, 0.98))
        return int(255 * r), int(255 * g), int(255 * b)

    def red(self) -> Colour:
        """A red: fresh, dark, pinkish, brick or orange."""
        value = self.between(90, 250)
        rest = value * self.between(0.02, 0.5) ** 1.3
        return int(value), int(rest * self.between(0.7, 1.5)), int(rest * self.between(0.7, 1.3))

    def pale(self) -> Colour:
        """A white, light grey or cream."""
        value = self.between(170, 252)
        return int(value), int(value * self.between(0.94, 1)), int(value * self.between(0.82, 1.01))

    def dark(self) -> Colour:
        """Nearly black."""
        value = self.between(5, 60)
        return int(value), int(value + self.between(-5, 5)), int(value + self.between(-5, 8))

    def words(self) -> str:
        """One to three words, digits or mere letters."""
        kind = self.random()
        if kind < 0.8:
            return " ".join(self.pick(WORDS) for _ in range(1 if kind < 0.65 else self.pick((2, 3))))
        letters = "0123456789" if kind < 0.9 else "ABCDEFGHIKLMNOPRSTUVWXYZaeionrst"
        return "".join(self.pick(letters) for _ in range(int(self.integers(1, 8))))

    def font(self) -> str:
        """A font's file name; bold sans serif more often than others."""
        return FONTS[0] if self.chance(0.3) else self.pick(FONTS)

    def texture(self, height_px: int, width_px: int) -> Bytes:
        """A grey texture, (H, W) uint8, full range: a part of the bank, mirrored and scaled."""
        source = _bank(int(self.integers(_BANK)))
        zoom = math.exp(self.between(math.log(0.7), math.log(3.0))) * max(height_px, width_px) / 320
        rows, columns = (min(_BANK_PX, math.ceil(side / zoom)) for side in (height_px, width_px))
        x, y = (int(self.between(0, _BANK_PX - side + 1)) for side in (columns, rows))
        part = source[y : y + rows, x : x + columns][:: self.pick((1, -1)), :: self.pick((1, -1))]
        return np.asarray(cv2.resize(np.ascontiguousarray(part), (width_px, height_px)), np.uint8)

    def material(self, height_px: int, width_px: int) -> Floats:
        """A texture in two to four colours or in shades of one, (H, W, 3) linear light."""
        stops = np.array([self.colour() for _ in range(int(self.integers(2, 5)))], float)
        if self.chance(0.5):
            stops = stops[0] * self.uniform(0.45, 1.5, (len(stops), 1))
        places = np.linspace(0, 255, len(stops))
        blend = np.stack([np.interp(np.arange(256), places, stops[:, k]) for k in range(3)], 1)
        field = cv2.cvtColor(self.texture(height_px, width_px), cv2.COLOR_GRAY2RGB)
        return np.asarray(cv2.LUT(field, linear(np.clip(blend, 0, 255).astype(np.uint8))[None]), np.float32)

    def grain(self, height_px: int, width_px: int, depth: float) -> Floats:
        """A texture as a factor, (H, W), between 1 - depth and 1."""
        table = np.linspace(1 - depth, 1, 256, dtype=np.float32)
        return np.asarray(cv2.LUT(self.texture(height_px, width_px), table), np.float32)

    def ramp(self, height_px: int, width_px: int, low: float) -> Floats:
        """Light that falls off to one side or around a spot, (H, W), between about ``low`` and 1."""
        y, x = (np.linspace(-1, 1, side, dtype=np.float32) for side in (height_px, width_px))
        y = y[:, None]
        turn = self.between(0, 2 * math.pi)
        cos, sin = math.cos(turn), math.sin(turn)
        if self.chance(0.6):
            steep = (1 - low) * 0.5 * self.between(0.5, 0.75)
            return np.asarray((0.5 + 0.5 * low) + x * (cos * steep) + y * (sin * steep), np.float32)
        width = self.between(0.2, 1.2)
        fall = ((1 - low) * np.exp((x - cos) ** 2 * -width)) * np.exp((y - sin) ** 2 * -width)
        return np.asarray(low + fall, np.float32)


@lru_cache(maxsize=_BANK)
def _bank(index: int) -> Bytes:
    """Texture ``index`` of the bank, (512, 512): noise, foliage, noise or cells in turn."""
    rng, n = Draws(_BANK_SEED, index), _BANK_PX
    stretch = rng.between(4, 15) if rng.chance(0.2) else 1.0  # as wood is
    radius = np.hypot(np.fft.fftfreq(n)[:, None] * stretch, np.fft.rfftfreq(n))
    radius[0, 0] = 1.0
    phases = np.exp(2j * math.pi * rng.random(radius.shape))
    field = np.asarray(np.fft.irfft2(phases * radius ** -rng.between(0.7, 2.0), s=(n, n)), np.float32)
    field = np.abs(field) if rng.chance(0.3) else field
    if index % 4 == 1:  # foliage, gravel: small shapes that hide each other
        field *= 0.25 / field.std()
        shapes, size = np.zeros((n, n), np.float32), rng.between(7, 18)
        slim = rng.between(0.1, 0.6)  # down to blades of grass
        for x, y, wide, tall, turn, shade in rng.random((int(6 * n * n / size**2), 6)).tolist():
            axes = (int(size * (0.4 + wide)), int(size * (0.05 + slim * tall)))
            turn_deg = 360 * turn if slim > 0.3 else 60 + 60 * turn
            cv2.ellipse(shapes, (int(n * x), int(n * y)), axes, turn_deg, 0, 360, shade, cv2.FILLED)
        field += shapes
    elif index % 4 == 3:  # stones, cracks: the distance to the nearest of many points
        seeds = np.full((n, n), 255, np.uint8)
        count = int(rng.between(60, 1500))
        seeds[rng.integers(0, n, count), rng.integers(0, n, count)] = 0
        field = np.asarray(cv2.distanceTransform(seeds, cv2.DIST_L2, 5), np.float32)
    low, high = np.percentile(field, (0.5, 99.5))
    return np.asarray(np.clip((field - low) / (high - low) * 255, 0, 255), np.uint8)
