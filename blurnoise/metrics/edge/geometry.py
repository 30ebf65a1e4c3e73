"""Geometry of an edge in its region: its orientation, its line, and the picture sheared so that it stands upright.

Domain: regions (B, H, W) float64, linear. Below the first function the edge is near vertical, of either polarity.
Positions are columns in px at which the edge crosses a row, pixel centres at integer + 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

MARGIN_PX = 2.0  # an edge that comes closer to the side of its region has left it
FLAT_AT_LEAST = 0.05  # share of the width at either side, at first taken to be flat
SIGNIFICANT = 6.0  # standard errors that a step must have


@dataclass(frozen=True)
class Line:
    """Where the edge crosses each row, and whether it is one.

    position_px: (B, H). left, right: levels of the two sides, (B,). no_edge, structured, leaves: (B,) bool.
    """

    position_px: Tensor
    left: Tensor
    right: Tensor
    no_edge: Tensor
    structured: Tensor
    leaves: Tensor


@dataclass(frozen=True)
class Upright:
    """Regions with each row moved by whole pixels so that the edge stands in the middle column.

    values, inside: (B, H, 2 J + 1), and 1 where there was a pixel, else 0. first: (B, H), the column of the picture
    that the first entry of each row was.
    """

    values: Tensor
    inside: Tensor
    first: Tensor

    def distance_px(self, position_px: Tensor) -> Tensor:
        """Distance along the row of every pixel's centre from ``position_px`` (B, H), positive to the right."""
        columns = torch.arange(self.values.shape[2], dtype=torch.float64) + 0.5
        return columns + (self.first - position_px)[:, :, None]

    def within(self, reach_px: int) -> Upright:
        """The middle of it, ``reach_px`` pixels to both sides."""
        middle = self.values.shape[2] // 2
        cut = slice(max(middle - reach_px, 0), middle + reach_px + 1)
        return Upright(self.values[:, :, cut], self.inside[:, :, cut], self.first + cut.start)


def is_horizontal(values: Tensor) -> Tensor:
    """Whether the edge is nearer to horizontal, (B,): a plane through the picture is steeper down than across."""
    return slope(values.mean(2)).abs() > slope(values.mean(1)).abs()


def find_line(values: Tensor) -> Line:
    """Straight line of the edge from the area on its dark side in every row.

    A row's mean says how much of it is dark once the levels are known, whatever the blur, and averages the noise
    of the whole row; the levels come from the columns that the line leaves free.
    """
    _, height, width = values.shape
    columns, rows = values.mean(1), values.mean(2)
    from_left, from_right = columns.cumsum(1), columns.flip(1).cumsum(1)
    near = torch.full((len(values),), max(2, int(FLAT_AT_LEAST * width)))
    far, left, right = near, columns[:, 0], columns[:, -1]
    position = rows
    for _ in range(3):
        left = from_left.gather(1, near[:, None] - 1)[:, 0] / near
        right = from_right.gather(1, far[:, None] - 1)[:, 0] / far
        step = torch.where(right == left, torch.nan, right - left)
        position = smooth((right[:, None] - rows) / step[:, None] * width, order=1).nan_to_num(width / 2)
        near = (position.amin(1) / 2).long().clamp(2, width // 2)
        far = ((width - position.amax(1)) / 2).long().clamp(2, width // 2)
    mean_square = torch.linalg.vector_norm(values, dim=(1, 2)) ** 2 / (height * width)
    total = (mean_square - rows.mean(1) ** 2).clamp_min(0)
    # Second differences: of white noise six times its variance, of smooth pictures next to nothing.
    curved = torch.diff(values[:, ::4], n=2, dim=2)
    noise = (curved * curved).mean((1, 2)) / 6
    standing = SIGNIFICANT * torch.sqrt(noise * (1 / near + 1 / far) / height)
    step_squared = (right - left) ** 2
    # An edge has at most a quarter of its step, squared, as variance; more of it is something else.
    structured = (total - noise > 0.35 * step_squared) & (total > 1.2 * noise)
    no_edge = ~structured & (step_squared <= standing**2)
    leaves = (position.amin(1) < MARGIN_PX) | (position.amax(1) > width - MARGIN_PX)
    return Line(position, left, right, no_edge, structured, leaves)


def straighten(values: Tensor, position_px: Tensor) -> Upright:
    """Move every row by whole pixels so that the edge stands in the middle column."""
    _, _, width = values.shape
    reach = int(torch.maximum(position_px.amax(), width - position_px.amin()).ceil()) + 1
    first = position_px.floor().long() - reach
    columns = first[:, :, None] + torch.arange(2 * reach + 1)
    inside = ((columns >= 0) & (columns < width)).to(torch.float64)
    return Upright(values.gather(2, columns.clamp_(0, width - 1)), inside, first)


def smooth(position_px: Tensor, *, order: int) -> Tensor:
    """Least-squares polynomial of ``order`` through ``position_px`` (B, H) over the rows, at the rows."""
    basis = row_basis(position_px.shape[1], order)
    return position_px @ basis @ basis.T


@cache
def row_basis(rows: int, order: int) -> Tensor:
    """Orthonormal polynomials up to ``order`` over the rows, (rows, order + 1)."""
    row = torch.linspace(-1, 1, rows, dtype=torch.float64)
    basis: Tensor = torch.linalg.qr(torch.stack([row**power for power in range(order + 1)], dim=1)).Q
    return basis


def slope(values: Tensor) -> Tensor:
    """Slope of the straight line through evenly spaced values (B, n), per step: of an edge, columns per row."""
    place = torch.arange(values.shape[1], dtype=torch.float64) - (values.shape[1] - 1) / 2
    return values @ (place / (place @ place))


def largest_phase_gap_px(position_px: Tensor) -> Tensor:
    """Widest stretch along the normal, within one pixel's period, in which no row samples the edge, (B,)."""
    phases = torch.sort(position_px.remainder(1.0), dim=1).values
    around = torch.cat([phases, phases[:, :1] + 1], dim=1)
    return torch.diff(around, dim=1).amax(1) / torch.sqrt(1 + slope(position_px) ** 2)
