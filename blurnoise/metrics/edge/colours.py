"""Colours of an edge: whether they lie apart, as behind a lens of lateral colour or in a mosaic read wrongly.

Domain: linear colours (B, 3, H, W), the edge near vertical; places in px, frequencies in cycles/px.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from blurnoise.metrics.edge.geometry import find_line
from blurnoise.metrics.edge.plausibility import DISPLACED
from blurnoise.metrics.regions import LUMINANCE

_CERTAIN = 2.2
"""Errors, on the safe side as they are, that the colours' distance must have: of 400 grey edges none has 1.1."""
_LEVELS = 2.0
"""Error of an edge's place over that from its rows alone: the levels that place it have errors, too."""


def apart(colours: Tensor, mtf50: Tensor) -> Tensor:
    """Whether the colours' edges certainly lie apart so far that their luminance's MTF50 (B,) suffers, (B,).

    Places of variance s^2, each colour that has a step counting by its share of it, lower the response
    as displaced rows do.
    """
    batch, _, height, width = colours.shape
    line = find_line(colours.flatten(0, 1))
    step = line.right - line.left
    rows = (line.right[:, None] - colours.flatten(0, 1).mean(2)) / step[:, None] * width
    scatter = _LEVELS * (rows - line.position_px).std(1) / math.sqrt(height)
    told = (line.position_px.mean(1), scatter.nan_to_num(0, 0, 0), step.abs())
    place, error, step = (each.view(batch, 3) for each in told)
    weight = torch.where(line.no_edge.view(batch, 3), 0.0, step * torch.tensor(LUMINANCE, dtype=step.dtype))
    weight = weight / weight.sum(1, keepdim=True)
    middle = (weight * place).sum(1, keepdim=True)
    spread, noise = (weight * (place - middle) ** 2).sum(1), (weight * error**2).sum(1)
    cost = 2 * (math.pi * mtf50) ** 2 * (spread - noise) / (2 * math.log(2))
    return (spread > _CERTAIN**2 * noise) & (cost > DISPLACED)
