"""Edges made apart from the project's charts: an error function integrated over pixels, and what deceives upon it.

Domain: linear pictures (H, W) float64, 0 without light and 1 at full scale; noise as a share of the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

Picture = NDArray[np.float64]
Change = Callable[[Picture], Picture]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Gauss and Legendre's points in a pixel, -1 to 1: exact to 1e-6 of the step for sigma of 0.4 px and more."""


@dataclass(frozen=True)
class Edge:
    """A straight edge behind a Gaussian lens.

    gradient: share by which light grows from one side of the region to the other. bright_left: its polarity.
    """

    sigma_px: float = 1.0
    angle_deg: float = 5.0
    noise: float = 0.01
    shot: float = 0.0
    dark: float = 0.2
    bright: float = 0.8
    gradient: float = 0.0
    bright_left: bool = False
    height_px: int = 100
    width_px: int = 110
    x_px: float = 0.0

    @property
    def mtf50(self) -> float:
        """The truth, cycles/px: Gaussian times the square pixel's response along the normal."""
        cosine, sine = math.cos(math.radians(self.angle_deg)), math.sin(math.radians(self.angle_deg))

        def response(f: float) -> float:
            lens = math.exp(-2 * (math.pi * f * self.sigma_px) ** 2)
            return lens * float(np.sinc(f * cosine) * np.sinc(f * sine)) - 0.5

        return float(brentq(response, 1e-4, 0.99))

    def share(self) -> Picture:
        """0 on the dark side, 1 on the bright one, without noise."""
        angle = math.radians(self.angle_deg)
        x = np.arange(self.width_px) + 0.5 - self.width_px / 2 - self.x_px
        y = np.arange(self.height_px) + 0.5 - self.height_px / 2
        total = np.zeros((self.height_px, self.width_px))
        for across, of_x in zip(_NODES / 2, _WEIGHTS / 2, strict=True):
            for down, of_y in zip(_NODES / 2, _WEIGHTS / 2, strict=True):
                away = (x + across) * math.cos(angle) - (y[:, None] + down) * math.sin(angle)
                total += of_x * of_y * ndtr(away / self.sigma_px)
        return total[:, ::-1] if self.bright_left else total

    def light(self) -> Picture:
        """The picture without noise."""
        level = self.dark + (self.bright - self.dark) * self.share()
        return level * (1 + self.gradient * np.linspace(-0.5, 0.5, self.width_px))

    def noisy(self, picture: Picture, seed: int) -> Picture:
        """With white noise; ``shot`` is the share of its variance, at full light, that grows with the light."""
        deviation = self.noise * (self.bright - self.dark)
        lit: Picture = 1 - self.shot + self.shot * picture.clip(0) / self.bright
        drawn_at_random: Picture = np.random.default_rng(seed).standard_normal(picture.shape)
        found: Picture = picture + deviation * drawn_at_random * np.sqrt(lit)
        return found

    def before(self, change: Change, seed: int) -> Picture:
        """Noise first, then the change: what a camera does to its own picture."""
        return change(self.noisy(self.light(), seed))

    def after(self, change: Change, seed: int) -> Picture:
        """The change first, then noise: what hides a change best."""
        return self.noisy(change(self.light()), seed)


def drawn(seed: int, **given: float | bool) -> Edge:
    """An edge of 3 to 12 degrees, of either polarity, somewhere within a pixel; ``given`` fixes fields."""
    random = np.random.default_rng(10_000 + seed)
    edge = Edge(
        angle_deg=random.uniform(3, 12) * random.choice([-1, 1]),
        bright_left=bool(random.integers(2)),
        x_px=random.uniform(-1, 1),
    )
    return replace(edge, **given)  # type: ignore[arg-type]


def clipped(low: float, high: float) -> Change:
    """Cut at these shares of a step from 0.2 to 0.8."""
    return lambda picture: picture.clip(0.2 + 0.6 * low, 0.2 + 0.6 * high)


def smoothstep(picture: Picture) -> Picture:
    """3 x^2 - 2 x^3 of full scale."""
    x = picture.clip(0, 1)
    return x * x * (3 - 2 * x)


def power(exponent: float) -> Change:
    """A power of the light."""
    return lambda picture: picture.clip(0) ** exponent


def unsharp(amount: float, sigma_px: float) -> Change:
    """An unsharp mask."""
    return lambda picture: picture + amount * (picture - cv2.GaussianBlur(picture, (0, 0), sigma_px))


def laplacian(amount: float) -> Change:
    """The four neighbours' Laplacian, taken off."""
    kernel = amount * np.array([[0, -1, 0], [-1, 4, -1], [0, -1, 0]], dtype=np.float64)
    kernel[1, 1] += 1
    return lambda picture: cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REPLICATE)


def bilateral(levels: float, sigma_px: float) -> Change:
    """A bilateral filter over a range of ``levels`` of full scale."""
    return lambda picture: cv2.bilateralFilter(
        picture.astype(np.float32), 0, levels, sigma_px, borderType=cv2.BORDER_REPLICATE
    ).astype(np.float64)
