"""MeasureComparison of a simulated picture of a chart with a real one: mean, noise and sharpness.

Domain: two linear pictures of one size, colour as luminance. They must show the same scene at the same place to a few
pixels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets import Image
from blurnoise_eval.measure.comparison import CANNOT_TELL, Measure, MeasureComparison, compared, corrected
from blurnoise_eval.measure.edges import RESAMPLES
from blurnoise_eval.measure.find_edges import UNUSABLE, find_edges
from blurnoise_eval.measure.linear import Coding, LinearPicture, linear

Floats = NDArray[np.float64]
BLOCK_PX = 16  # side of the squares in which noise is measured
MOST_LEVELS = 8
FEWEST_BLOCKS = 4  # of a level: with fewer, the noise is known to no better than 5 %
MOST_EDGES = 4
SMALLEST_PX = 64
_CELL_PX = 4  # averaging over such cells keeps the variance of structure and reduces that of noise
_EVEN = 2.5  # variance of cells over that of noise alone, below which a square counts as uniform
_COARSEST = 4.0  # what demosaicing leaves at low frequencies; beyond it is texture
_MISPLACED_PX = 2  # largest displacement between the pictures for which common texture is found
_GAP = 0.01  # of full scale, between the levels of neighbouring patches
_Z = 1.96


def linear_pair(
    real: Image,
    simulated: Image,
    coding: Coding = "auto",
    *,
    black_level: float | None = None,
    full_scale: float | None = None,
) -> tuple[LinearPicture, LinearPicture]:
    """Make both pictures linear in the same way, as :func:`linear` does.

    Raises ``ValueError`` for other sizes or depths, pictures below 64 x 64 px, and what :func:`linear` raises.
    """
    sizes = ["{1} x {0} px, {2} bits".format(*x.shape[:2], 8 * x.itemsize) for x in (real, simulated)]
    if sizes[0] != sizes[1]:
        raise ValueError(f"real, simulated: are {sizes[0]} and {sizes[1]}; must have the same size and depth")
    if min(real.shape[:2]) < SMALLEST_PX:
        raise ValueError(
            f"real, simulated: are {sizes[0]}; must be at least {SMALLEST_PX} x {SMALLEST_PX} px"
        )
    one, other = (
        linear(picture, coding, black_level=black_level, full_scale=full_scale)
        for picture in (real, simulated)
    )
    return one, other


def compare(real: LinearPicture, simulated: LinearPicture) -> tuple[list[MeasureComparison], list[str]]:
    """Compare mean, noise at each level and MTF50 of slanted edges; also returns notes, a sentence each."""
    notes = list(dict.fromkeys([*real.notes, *simulated.notes]))
    noise, sharpness = _compare_noise(real, simulated), _compare_sharpness(real, simulated)
    if not noise:
        notes.append("noise is not compared, as no area is uniform in both pictures")
    if not sharpness:
        notes.append("sharpness is not compared, as no slanted edge can be measured in both pictures")
    means = [float(picture.grey.mean()) for picture in (real, simulated)]
    # the noise of the levels is the only random part of the mean, independent from pixel to pixel
    variance = sum(level.real**2 + level.simulated**2 for level in noise) / max(1, len(noise))
    error = math.sqrt(variance / real.grey.size) / abs(means[1] or math.nan)
    mean = compared(Measure("mean", f"mean, {real.unit}"), means[0], means[1], error)
    comparisons = corrected([mean, *noise, *sharpness])
    for comparison in comparisons:
        if comparison.texture and comparison.verdict == CANNOT_TELL:
            share = f"{100 * comparison.texture:.0f} % of the compared variance is texture of the scene"
            advice = "use a uniform surface, or flat frames with 'blurnoise validate FRAMES'"
            notes.append(f"{comparison.measure.title}: {share}; {advice}")
    return comparisons, notes


class Squares(NamedTuple):
    """Squares of a picture: mean, variance about a plane, whether it is uniform, and the rest (n, side, side)."""

    level: Floats
    variance: Floats
    uniform: NDArray[np.bool_]
    rest: Floats


def _compare_noise(real: LinearPicture, simulated: LinearPicture) -> list[MeasureComparison]:
    """Noise of the squares that are uniform in both pictures, level by level: the levels are separated at the widest
    gaps, as the patches of a chart are."""
    pair = [squares(picture.grey) for picture in (real, simulated)]
    used = pair[0].uniform & pair[1].uniform & (np.minimum(pair[0].variance, pair[1].variance) > 0)
    level = np.mean([squares.level for squares in pair], 0)[used]
    variance = np.stack([squares.variance for squares in pair], 1)[used]
    rests = [squares.rest[used] for squares in pair]
    order = np.argsort(level, kind="stable")
    gaps = np.diff(level[order])
    widest = np.argsort(-gaps)[: MOST_LEVELS - 1]
    borders = np.sort(widest[gaps[widest] > _GAP * (real.full_scale - real.black_level)]) + 1
    comparisons = []
    for members in np.split(order, borders):
        if (count := len(members)) < FEWEST_BLOCKS:
            continue
        deviations = np.sqrt(variance[members].mean(0)).tolist()
        # relative error of a variance: chi-square of all pixels, or the scatter of the squares, the larger of both
        scatter = variance[members].std(0, ddof=1) / variance[members].mean(0) / math.sqrt(count)
        error = np.maximum(scatter, math.sqrt(2 / (count * (BLOCK_PX**2 - 3)))) / 2
        common = _common_variance(*(rest[members] for rest in rests)) / math.prod(deviations)
        at = float(level[members].mean())
        measure = Measure(f"noise_at_{at:.3g}", f"noise at {at:.3g}, {real.unit}")
        of_both = math.hypot(*error.tolist())
        comparisons.append(compared(measure, deviations[0], deviations[1], of_both, texture=min(1.0, common)))
    return comparisons


def _common_variance(one: Floats, other: Floats) -> float:
    """Variance that squares (n, side, side) of both pictures have in common, beyond chance, at the best of a few
    displacements: that of texture, because the noise of the pictures is independent."""
    product = np.fft.rfft2(one) * np.conj(np.fft.rfft2(other))
    correlation = np.fft.irfft2(product.mean(0), s=one.shape[1:]) / one[0].size
    near = np.r_[-_MISPLACED_PX : _MISPLACED_PX + 1]
    chance = 3 * math.sqrt(float((one**2).mean() * (other**2).mean()) / one.size)
    return max(0.0, float(correlation[np.ix_(near, near)].max()) - chance)


def squares(picture: Floats) -> Squares:
    """Cut a picture in squares. Uniform are those whose cells vary by no more than noise explains; noise may itself
    be coarse, so the lower quartile of all squares is the reference."""
    rows, columns = (side // BLOCK_PX for side in picture.shape)
    cropped = picture[: rows * BLOCK_PX, : columns * BLOCK_PX].reshape(rows, BLOCK_PX, columns, BLOCK_PX)
    squares = cropped.swapaxes(1, 2).reshape(-1, BLOCK_PX, BLOCK_PX)
    level = squares.mean((1, 2))
    x = np.arange(BLOCK_PX) - (BLOCK_PX - 1) / 2
    power = BLOCK_PX * float(x @ x)
    across = np.einsum("bij,j->b", squares, x) / power
    down = np.einsum("bij,i->b", squares, x) / power
    plane = level[:, None, None] + across[:, None, None] * x + down[:, None, None] * x[:, None]
    rest = squares - plane
    variance = (rest * rest).sum((1, 2)) / (BLOCK_PX**2 - 3)
    cells = BLOCK_PX // _CELL_PX
    means = rest.reshape(-1, cells, _CELL_PX, cells, _CELL_PX).mean((2, 4))
    of_cells = (means * means).sum((1, 2)) / (cells**2 - 3)
    structure = of_cells * _CELL_PX**2 / np.maximum(variance, np.finfo(float).tiny)
    usual = min(max(1.0, float(np.percentile(structure, 25))), _COARSEST)
    return Squares(level, variance, structure < _EVEN * usual, rest)


def _compare_sharpness(real: LinearPicture, simulated: LinearPicture) -> list[MeasureComparison]:
    """MTF50 at edges of the simulated picture that the real one shows at the same place.

    Both edges hide the same faults, so only the part of their intervals that comes from noise counts.
    """
    comparisons = []
    for roi in find_edges(simulated).rois:
        edges = [picture.edge(roi, bootstrap=RESAMPLES) for picture in (real, simulated)]
        usable = all(math.isfinite(edge.mtf50) and not UNUSABLE & edge.flags for edge in edges)
        if usable and edges[0].bright_side == edges[1].bright_side:
            values = [edge.mtf50 for edge in edges]
            widths = np.ptp([edge.noise_intervals["mtf50"] for edge in edges], axis=1)
            error = math.hypot(*widths / 2 / values) / _Z
            measure = Measure(f"mtf50_at_{roi[0]}_{roi[1]}", f"MTF50 at {roi[0]},{roi[1]}")
            comparisons.append(compared(measure, values[0], values[1], error))
    return comparisons[:MOST_EDGES]
