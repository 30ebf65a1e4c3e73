"""Straight edges whose every pixel is known in closed form, and the transfer function they must give.

Seen along its normal, an edge blurred by square pixels, straight motion and a Gaussian is a step convolved with
boxes of widths |cos|, |sin| (the pixel's two sides) and the motion's share along the normal, and with the
Gaussian. Nothing is rasterised: a pixel's value is that function of the distance of its centre from the edge.

Convention: as in :mod:`blurnoise.charts`: x right, y down, pixel centres at integer + 0.5; at 0° the bright side
is on the right, at 90° at the top. Distances are positive on the bright side.
"""

import math
from itertools import product

import numpy as np
import torch
from scipy.optimize import brentq

_THIN_PX = 1e-3  # a box below it is a Gaussian of its variance, to w^4 = 1e-12


def _boxes_and_sigma(angle_deg, sigma_px, motion_px):
    """Widths of the boxes along the normal, px, and the Gaussian's standard deviation, px."""
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    widths = [abs(cos), abs(sin), abs(motion_px[0] * cos - motion_px[1] * sin)]
    thin = sum(width**2 / 12 for width in widths if width < _THIN_PX)
    return [width for width in widths if width >= _THIN_PX], math.sqrt(sigma_px**2 + thin)


def edge_spread(distance_px, boxes_px, sigma_px):
    """Unit step convolved with boxes and a Gaussian, at ``distance_px``: 0 far on the dark side, 1 on the other.

    n boxes are an n-fold difference of the n-th antiderivative of the Gaussian's distribution function over the
    product of their widths. Taken at -|d|, where that antiderivative is small, nothing cancels.
    """
    below = -np.abs(distance_px)
    total = np.zeros_like(below)
    for signs in product((-0.5, 0.5), repeat=len(boxes_px)):
        shift = sum(sign * width for sign, width in zip(signs, boxes_px, strict=True))
        side = math.prod(2 * sign for sign in signs)
        total += side * _antiderivative(below + shift, len(boxes_px), sigma_px)
    total /= math.prod(boxes_px)
    return np.where(distance_px > 0, 1 - total, total)


def _antiderivative(x, order, sigma):
    """Of the normal distribution function of standard deviation ``sigma`` (0: of the step), ``order`` times."""
    if not sigma:
        return np.maximum(x, 0) ** order / math.factorial(order)
    t = x / sigma
    density = np.exp(-t * t / 2) / math.sqrt(2 * math.pi)
    below = torch.special.ndtr(torch.from_numpy(t)).numpy()
    before, now = density, below  # n I_n = t I_(n-1) + I_(n-2)
    for n in range(1, order + 1):
        before, now = now, (t * now + before) / n
    return now * sigma**order


def closed_edge(
    height_px,
    width_px,
    *,
    angle_deg=5.0,
    sigma_px=0.5,
    motion_px=(0.0, 0.0),
    offset_px=(0, 0),
    dark=0.1,
    bright=0.8,
):
    """Edge through the picture's centre, moved by ``offset_px`` (x, y), (H, W) float64."""
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    x = np.arange(width_px) + 0.5 - width_px / 2 - offset_px[0]
    y = np.arange(height_px) + 0.5 - height_px / 2 - offset_px[1]
    distance = x * cos - y[:, None] * sin
    spread = edge_spread(distance, *_boxes_and_sigma(angle_deg, sigma_px, motion_px))
    return torch.from_numpy(dark + (bright - dark) * spread)


def closed_mtf(frequency, *, angle_deg=5.0, sigma_px=0.5, motion_px=(0.0, 0.0)):
    """Modulus of the transfer function along the edge's normal at ``frequency``, cycles/px."""
    boxes, sigma = _boxes_and_sigma(angle_deg, sigma_px, motion_px)
    f = np.asarray(frequency, np.float64)
    gaussian = np.exp(-2 * (math.pi * sigma * f) ** 2)
    return np.asarray(gaussian * np.abs(np.prod([np.sinc(width * f) for width in boxes], axis=0)))


def closed_mtf50(**edge):
    """First frequency, cycles/px, at which :func:`closed_mtf` is 1/2."""
    reach = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 400)])
    first = int(np.argmax(closed_mtf(reach, **edge) < 0.5))
    return brentq(lambda f: float(closed_mtf(f, **edge)) - 0.5, *reach[first - 1 : first + 1], xtol=1e-15)
