"""Edge spread as a spline through every pixel, each at its exact distance from the edge.

Bins blur the edge and need many phases. A cubic B-spline with a knot every quarter of a pixel does neither, and its
transfer function is a finite sum. Its coefficients are 0 before the edge's reach and 1 beyond it.
Domain: upright regions, values scaled so that the sides are 0 and 1, distances in px along the normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from blurnoise.metrics.edge.position import Upright, cosine, row_basis

# Finer knots follow noise, coarser ones blur: these keep .999 of a wave at half a cycle per pixel.
KNOT_PX = 0.25
LINE_ORDER = 3  # of the polynomial that the edge may follow: a lens bends straight edges
CHI_SQUARE_MEDIAN = 0.4549  # of one degree of freedom
ODD_DEVIATIONS, ODD_SHARE = 8.0, 0.05  # of the misfits, and of the step, that make a pixel a hot one
PENALTY = 1e-3  # of the pixels per knot: less lets noise through where phases are few, more bends the edge


def knots_px(count: int) -> Tensor:
    """Places of ``count`` knots about the edge, (count,).

    >>> knots_px(5)
    tensor([-0.5000, -0.2500,  0.0000,  0.2500,  0.5000], dtype=torch.float64)
    """
    return KNOT_PX * torch.arange(-(count // 2), count // 2 + 1, dtype=torch.float64)


@dataclass(frozen=True)
class Pixels:
    """The n pixels within reach of the edge, of regions ``shape`` (B, H, W), and the four B-splines over each.

    pixel, row, region: numbers counted through all regions. first: index of the first of the four coefficients.
    place: between its knots, 0 to 1. All (n,); count: pixels of each region, (B,). size: number of coefficients.

    >>> from blurnoise.metrics.edge.position import find_line, measure_sides
    >>> values = torch.zeros(1, 40, 60, dtype=torch.float64)
    >>> values[:, :, 30:] = 1.0
    >>> line = find_line(values).position_px
    >>> _, upright = measure_sides(values, line)
    >>> Pixels.of(upright, line, torch.tensor([2.0])).count.tolist()  # 2 px to either side in 40 rows
    [160]
    """

    shape: torch.Size
    pixel: Tensor
    row: Tensor
    region: Tensor
    value: Tensor
    first: Tensor
    place: Tensor
    cosine: Tensor
    basis: list[Tensor]
    count: Tensor
    size: int

    @classmethod
    def of(cls, upright: Upright, position_px: Tensor, reach_px: Tensor) -> Pixels:
        """The pixels within ``reach_px`` (B,) of the line ``position_px`` (B, H)."""
        _, height, width = upright.values.shape
        half = math.ceil(float(reach_px.max()) / KNOT_PX) + 3
        cosines = cosine(position_px)
        distance = upright.distance_px(position_px) * cosines[:, None, None]
        near = (distance.abs() < reach_px[:, None, None]) & (upright.inside > 0)
        pixel = near.flatten().nonzero()[:, 0]
        row = pixel // width
        region = row // height
        knots = distance.flatten()[pixel] / KNOT_PX
        t = knots - knots.floor()
        s = 1 - t
        tt, ss = t * t, s * s
        basis = [ss * s / 6, tt * (t / 2 - 1) + 2 / 3, ss * (s / 2 - 1) + 2 / 3, tt * t / 6]
        value, first = upright.values.flatten()[pixel], knots.floor().long() + (half - 1)
        numbers = (near.shape, pixel, row, region)
        return cls(*numbers, value, first, t, cosines[region], basis, near.sum((1, 2)), 2 * half + 1)

    def in_place(self, values: Tensor) -> Tensor:
        """Scatter ``values`` (n,) to regions (B, H, W), 0 at all other pixels."""
        return values.new_zeros(math.prod(self.shape)).index_copy_(0, self.pixel, values).view(self.shape)

    def off(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """Misfit of the values, (n,), and the spline's slope along the row, 1/px, (n,)."""
        line = coefficients.flatten()
        at = self.first + self.region * self.size
        picked = [line[k:][at] for k in range(4)]
        value = sum(c * b for c, b in zip(picked, self.basis, strict=True))
        # The slope is a quadratic spline over the coefficients' differences.
        a, b, c = (right - left for left, right in pairwise(picked))
        t, s = self.place, 1 - self.place
        return self.value - value, (a * s * s + b * (1 + 2 * t * s) + c * t * t) * self.cosine / (2 * KNOT_PX)

    def by_row(self, values: Tensor) -> Tensor:
        """Sum of ``values`` (n,) over each row, (B, H)."""
        sums = values.new_zeros(self.shape[0] * self.shape[1])
        return sums.index_add_(0, self.row, values).view(self.shape[:2])

    def odd(self, off: Tensor) -> Tensor:
        """The misfits ``off`` (n,) of single outliers, hot or dead pixels, else 0."""
        usual = torch.stack([each.median() for each in torch.split(off * off, self.count.tolist())])
        limit = (ODD_DEVIATIONS * (usual / CHI_SQUARE_MEDIAN).sqrt()).clamp_min(ODD_SHARE)
        far = off.abs() > limit[self.region]
        around = avg_pool2d(self.in_place(far.to(off)), 3, stride=1, padding=1) * 9
        return torch.where(far & (around.flatten()[self.pixel] < 2.5), off, 0.0)

    def sums(self, values: Tensor, *, per_row: bool = False) -> Tensor:
        """Sum of value times B-spline, (B, size), or of each row alone, (B, H, size)."""
        shape = (*(self.shape[:2] if per_row else self.shape[:1]), self.size)
        at = self.first + (self.row if per_row else self.region) * self.size
        sums = values.new_zeros(math.prod(shape))
        for k, basis in enumerate(self.basis):
            sums[k:].index_add_(0, at, values * basis)
        return sums.view(shape)

    def products(self) -> Tensor:
        """Sum of the products of two B-splines, (B, size, size)."""
        sums = torch.zeros(self.shape[0], self.size, self.size, dtype=torch.float64)
        at = (self.region * self.size + self.first) * self.size + self.first
        for (k, one), (j, other) in product(enumerate(self.basis), repeat=2):
            sums.view(-1)[k * self.size + j :].index_add_(0, at, one * other)
        return sums


@dataclass(frozen=True)
class Spline:
    """coefficients: (B, K), at :func:`knots_px`. inverse: of their equations, 0 for those that were not fitted.

    inflation: (B,), by which residuals are too small to serve as errors, as in a jackknife.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.position import find_line, measure_sides
    >>> picture = charts.slanted_edge(60, 60, dark=0.0, bright=1.0)[0].double()
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> spline, _ = refine(upright, line, sides.reach_px, sides.variance)
    >>> middle = spline.coefficients.shape[1] // 2
    >>> spline.coefficients[0, [0, middle, -1]].round(decimals=2).abs().tolist()
    [0.0, 0.5, 1.0]
    """

    coefficients: Tensor
    covariance: Tensor
    pixels: Pixels
    inverse: Tensor
    inflation: Tensor

    @cached_property
    def off(self) -> tuple[Tensor, Tensor]:
        """Misfit of the pixels, and the spline's slope along the row, 1/px, (n,) each."""
        return self.pixels.off(self.coefficients)

    @cached_property
    def pulls(self) -> Tensor:
        """Change of the coefficients if a row is counted once more, (B, H, K): the influence of each row."""
        return self.pixels.sums(self.off[0], per_row=True) @ self.inverse * self.inflation[:, None, None]

    def bootstrapped(self, block: int) -> Tensor:
        """Covariance of the coefficients, (B, K, K), by a closed-form bootstrap over blocks of rows."""
        root = torch.stack([rows.sum(1) for rows in torch.split(self.pulls, block, 1)], dim=1)
        return root.mT @ root


def refine(upright: Upright, position_px: Tensor, reach_px: Tensor, noise: Tensor) -> tuple[Spline, Tensor]:
    """Fit the spline and the edge's line together, from a first line (B, H); noise: variance at 0 and 1, (B, 2).

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.position import find_line, measure_sides
    >>> picture = charts.slanted_edge(60, 60, dark=0.0, bright=1.0)[0].double()
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> _, refined = refine(upright, line + 0.1, sides.reach_px, sides.variance)  # from a tenth of a pixel off
    >>> round(float((refined - line).abs().max()), 2)
    0.1
    """
    rows = row_basis(position_px.shape[1], LINE_ORDER)
    pixels = Pixels.of(upright, position_px, reach_px)
    off, pull = pixels.off(_fitted(pixels, reach_px)[0])
    curvature = rows.T @ (pixels.by_row(pull * pull)[..., None] * rows)
    wanted = pixels.by_row(pull * off) @ rows
    # One Gauss-Newton step: the line is so close that a second step would change nothing.
    position_px = position_px - torch.linalg.solve(curvature, wanted[..., None])[..., 0] @ rows.T

    upright = replace(upright, values=upright.values - pixels.in_place(pixels.odd(off)))
    pixels = Pixels.of(upright, position_px, reach_px)
    coefficients, products, factor, free = _fitted(pixels, reach_px)
    spread = torch.sqrt(noise[:, :1] + (noise[:, 1:] - noise[:, :1]) * coefficients.clamp(0, 1))
    inverse = torch.cholesky_inverse(factor) * free[:, None] * free[..., None]
    covariance = inverse @ (spread[:, :, None] * products * spread[:, None, :]) @ inverse
    inflation = pixels.count / (pixels.count - free.sum(1)).clamp_min(1)
    return Spline(coefficients, covariance, pixels, inverse, inflation), position_px


def _fitted(pixels: Pixels, reach_px: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Coefficients; their equations without penalty; the Cholesky factor of those with it; which were fitted."""
    place = knots_px(pixels.size)
    free = place.abs() <= reach_px[:, None] - KNOT_PX
    fixed = ((place > 0) & ~free).to(torch.float64)
    one = torch.eye(pixels.size, dtype=torch.float64)
    # Third differences: lines and parabolas cost nothing, so that smooth edges keep their width.
    rough = torch.diff(one, n=3, dim=0)
    per_knot = pixels.count * KNOT_PX / (2 * reach_px)
    products = pixels.products()
    equations = products + (PENALTY * per_knot)[:, None, None] * (rough.T @ rough)
    wanted = pixels.sums(pixels.value) - (equations @ fixed[..., None])[..., 0]
    factor = torch.linalg.cholesky(torch.where(free[:, :, None] & free[:, None, :], equations, one))
    solution = torch.cholesky_solve((wanted * free)[..., None], factor)[..., 0]
    return solution + fixed, products, factor, free
