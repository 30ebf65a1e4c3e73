"""Comparison of a simulated picture of a chart with a real one: does each quantity agree within chance?

Domain: two linear pictures of one size as shares of full scale, black level removed; colour as luminance. Quantities
agree where they are no further apart than noise puts any of them in 5 of 100 comparisons (Bonferroni).
The pictures must show the same at the same place to a few pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets import Image
from blurnoise_eval.measure.edges import RESAMPLES
from blurnoise_eval.measure.find_edges import UNUSABLE, find_edges
from blurnoise_eval.measure.linear import Coding, LinearPicture, linear
from blurnoise_eval.system.tables import finite

Floats = NDArray[np.float64]
BLOCK_PX = 16  # side of the squares in which noise is looked for
HEADS = ("quantity", "simulated", "real", "chance", "verdict")
MOST_LEVELS = 8
FEWEST_BLOCKS = 4  # of a level: below, the noise is known to no better than 5 %
MOST_EDGES = 4
SMALLEST_PX = 64
_CELL_PX = 4  # mean of so many squared: structure keeps its variance there, noise loses it
_EVEN = 2.5  # times the variance of cells that noise alone explains
_COARSEST = 4.0  # what demosaicing leaves at low frequencies; beyond it is texture
_MISPLACED_PX = 2  # by which texture that both pictures show may lie apart
_LEAST_NOISE = 0.8  # of a square's variance, that must be noise for it to agree
_Z = 1.96


@dataclass(frozen=True)
class Quantity:
    """One number of both pictures. chance: the relative difference that noise makes, 95 % of them
    or, of several quantities, of their largest; NaN: unknown. noise_share: of what is compared, noise: the rest is
    texture, which both pictures show."""

    name: str
    unit: str
    simulated: float
    real: float
    chance: float
    noise_share: float = 1.0

    @property
    def difference(self) -> float:
        """Of the real one, relative to the simulated one."""
        return self.real / self.simulated - 1 if self.simulated else math.nan

    @property
    def verdict(self) -> str:
        """In words."""
        if not math.isfinite(self.difference) or not math.isfinite(self.chance):
            return "cannot tell"
        least = max(-self.chance, (1 + self.chance) ** -2 - 1)  # no chance makes any loss agree
        if least <= self.difference <= self.chance:
            return "agree" if self.noise_share >= _LEAST_NOISE else "cannot tell"
        digits = ".0f" if abs(self.difference) >= 0.995 else ".2g"
        return f"differs by {100 * self.difference:+{digits}} %"

    def cells(self) -> list[str]:
        """As ``HEADS``, within 80 columns."""
        scale, unit = (100, " %") if self.unit == "of full scale" else (1, "")
        numbers = [f"{scale * number:.4g}{unit}" for number in (self.simulated, self.real)]
        chance = f"±{100 * self.chance:.2g} %" if math.isfinite(self.chance) else "-"
        return [self.name, *numbers, chance, self.verdict]

    def row(self) -> dict[str, Any]:
        """Plain values, None for what is unknown."""
        names = ("simulated", "real", "difference", "chance", "noise_share")
        numbers = {name: finite(getattr(self, name)) for name in names}
        return {"quantity": self.name, "unit": self.unit, **numbers, "verdict": self.verdict}


def pair_of(
    simulated: Image, real: Image, coding: Coding = "auto", **levels: Any
) -> tuple[LinearPicture, LinearPicture]:
    """Make both pictures linear in the same way. levels: of :func:`linear`.

    Raises ``ValueError`` for other sizes or depths, pictures below 64 x 64 px, and what :func:`linear` raises.
    """
    one, other = ("{1} x {0} px, {2} bits".format(*x.shape[:2], 8 * x.itemsize) for x in (simulated, real))
    if one != other:
        raise ValueError(f"simulated, real: are {one} and {other}; must have the same size and depth")
    if min(simulated.shape[:2]) < SMALLEST_PX:
        raise ValueError(f"simulated, real: are {one}; must be at least {SMALLEST_PX} x {SMALLEST_PX} px")
    return linear(simulated, coding, **levels), linear(real, coding, **levels)


def compare(pair: tuple[LinearPicture, LinearPicture]) -> tuple[list[Quantity], list[str]]:
    """Mean, noise by level and MTF50 of slanted edges of both pictures; and notes."""
    notes = list(dict.fromkeys(note for light in pair for note in light.notes))
    shares = np.stack([light.grey / (light.full_scale - light.black_level) for light in pair])
    noise = _noise(shares)
    if not noise:
        notes.append("noise is not compared, as no area is uniform in both pictures")
    for each in noise:
        if each.noise_share < _LEAST_NOISE:
            share = f"{100 * (1 - each.noise_share):.0f} % of the compared variance is texture of the scene"
            notes.append(
                f"{each.name}: {share}; use a uniform surface, or flat frames with 'blurnoise validate'"
            )
    sharpness = _sharpness(pair)
    if not sharpness:
        notes.append("sharpness is not compared, as no slanted edge can be measured in both pictures")
    simulated, real = shares.mean((1, 2)).tolist()
    # chance of the mean: by the noise of the levels alone, the same in every pixel
    variance = sum(each.simulated**2 + each.real**2 for each in noise) / max(1, len(noise))
    error = math.sqrt(variance / shares[0].size)
    mean = Quantity("mean", "of full scale", simulated, real, _Z * error / abs(simulated or math.nan))
    quantities = [mean, *noise, *sharpness]
    wider = NormalDist().inv_cdf(1 - 0.025 / len(quantities)) / _Z  # for all of them together
    return [replace(each, chance=wider * each.chance) for each in quantities], notes


def _noise(shares: Floats) -> list[Quantity]:
    """Noise of the squares that are even in both pictures, by level: squares of like level are parted at the widest
    gaps of the ordered levels, as a chart's patches lie."""
    levels, variances, even, rests = zip(*(_squares(each) for each in shares), strict=True)
    used = np.logical_and(*even) & (np.minimum(*variances) > 0)
    level, variance = np.mean(levels, 0)[used], np.stack(variances, 1)[used]
    order = np.argsort(level, kind="stable")
    gaps = np.diff(level[order])
    wide = np.argsort(-gaps)[: MOST_LEVELS - 1]
    quantities = []
    for members in np.split(order, np.sort(wide[gaps[wide] > 0.01]) + 1):
        if (count := len(members)) < FEWEST_BLOCKS:
            continue
        simulated, real = np.sqrt(variance[members].mean(0)).tolist()
        at = float(level[members].mean())
        # chi-square of all squares' pixels, or the scatter between the squares, whichever is more: of variances
        scatter = variance[members].std(0, ddof=1) / variance[members].mean(0) / math.sqrt(count)
        error = np.maximum(scatter, math.sqrt(2 / (count * (BLOCK_PX**2 - 3)))) / 2
        chance = _Z * math.hypot(*error.tolist())
        texture = _common(*(rest[used][members] for rest in rests)) / (simulated * real)
        name = f"noise at {100 * at:.3g} %"
        quantities.append(Quantity(name, "of full scale", simulated, real, chance, 1 - min(1.0, texture)))
    return quantities


def _common(one: Floats, other: Floats) -> float:
    """Variance that squares (n, side, side) of both pictures have in common, beyond chance, at the best of a few
    displacements: that of texture, as the noise of one is not in the other."""
    product = np.fft.rfft2(one) * np.conj(np.fft.rfft2(other))
    along = np.fft.irfft2(product.mean(0), s=one.shape[1:]) / one[0].size
    near = np.r_[-_MISPLACED_PX : _MISPLACED_PX + 1]
    chance = 3 * math.sqrt(float((one**2).mean() * (other**2).mean()) / one.size)
    return max(0.0, float(along[np.ix_(near, near)].max()) - chance)


def _squares(picture: Floats) -> tuple[Floats, Floats, NDArray[np.bool_], Floats]:
    """Of each square: mean, variance about its plane, whether its cells vary by no more than noise explains, which
    may itself be coarse: then as in most even squares; and what is off its plane."""
    rows, columns = (side // BLOCK_PX for side in picture.shape)
    cut = picture[: rows * BLOCK_PX, : columns * BLOCK_PX].reshape(rows, BLOCK_PX, columns, BLOCK_PX)
    squares = cut.swapaxes(1, 2).reshape(-1, BLOCK_PX, BLOCK_PX)
    level = squares.mean((1, 2))
    place = np.arange(BLOCK_PX) - (BLOCK_PX - 1) / 2
    power = BLOCK_PX * float(place @ place)
    across = np.einsum("bij,j->b", squares, place) / power
    down = np.einsum("bij,i->b", squares, place) / power
    tilt = across[:, None, None] * place + down[:, None, None] * place[:, None]
    rest = squares - level[:, None, None] - tilt
    variance = (rest * rest).sum((1, 2)) / (BLOCK_PX**2 - 3)
    cells = BLOCK_PX // _CELL_PX
    means = rest.reshape(-1, cells, _CELL_PX, cells, _CELL_PX).mean((2, 4))
    seen = (means * means).sum((1, 2)) / (cells**2 - 3)
    structure = seen * _CELL_PX**2 / np.maximum(variance, np.finfo(float).tiny)
    usual = min(max(1.0, float(np.percentile(structure, 25))), _COARSEST)
    return level, variance, structure < _EVEN * usual, rest


def _sharpness(pair: tuple[LinearPicture, LinearPicture]) -> list[Quantity]:
    """MTF50 at edges of the simulated picture that the real one shows at the same place.

    A fault that an edge hides, and its interval allows for, is part of what is compared: no chance.
    """
    found = []
    for roi in find_edges(pair[0]).rois:
        edges = [light.edge(roi, bootstrap=RESAMPLES) for light in pair]
        usable = all(math.isfinite(edge.mtf50) and not UNUSABLE & edge.flags for edge in edges)
        if usable and edges[0].bright_side == edges[1].bright_side:
            one, other = (edge.mtf50 for edge in edges)
            ranges = [edge.noise_intervals["mtf50"] for edge in edges]
            chance = math.hypot(*np.ptp(ranges, axis=1) / 2 / (one, other))
            found.append(Quantity(f"MTF50 at {roi[0]},{roi[1]}", "cycles/px", one, other, chance))
    return found[:MOST_EDGES]
