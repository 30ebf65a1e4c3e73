"""Alternatives to an honest edge: clips, tone curves and sharpening that may have left it, and their cost in MTF50.

An edge is compared with Gaussian edges of the same MTF50 that a fault has changed, each fault by one number u: 0 of
an honest edge, 1 of that fault. Clips at one end and bent tone curves make the two halves of an edge unequal, and are
looked for there alone, for any blur leaves halves alike. Clips at both ends, S-shaped curves and sharpening leave
equal halves; so may motion and lenses, and no such fault is certain before it exceeds what motion does.

A fault that is certain raises a flag. What noise or blur may hide makes the interval longer, towards lower MTF50.

Domain: splines scaled to 0 and 1, distances in px along the normal, frequencies in cycles/px.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d, conv1d

from blurnoise.metrics.edge.plausibility import Profile

Fault = Callable[[Tensor, Tensor], Tensor]
"""What becomes of an edge (..., K), given also what a Gaussian of ``_MASK_PX`` makes of it."""
_MASK_PX = 0.7
MATTERS = 0.015
"""Share of MTF50 that a fault must have cost before it raises a flag."""
CERTAIN = 1.96
"""Standard errors of u that the interval covers."""
MISFIT = 0.004
"""Share of the step by which an edge may differ from a Gaussian one with the fault before the fault is ruled out."""
_SPARE = 1.0
"""u of sharpening that knots a quarter of a pixel apart may feign upon an edge without a lens."""
_SHARPEST_PX = 0.05


@dataclass(frozen=True)
class GaussianEdge:
    """A Gaussian of ``sigma_px`` (..., 1) over square pixels, at ``place_px`` (K,) from the edge.

    level: between 0 and 1, (..., K). softer: the same after the sharpening's Gaussian.
    """

    sigma_px: Tensor
    level: Tensor
    softer: Tensor

    @classmethod
    def of(cls, mtf50: Tensor, place_px: Tensor) -> GaussianEdge:
        """The one of that MTF50, (...), or the sharpest."""
        squared = torch.log((2 * torch.sinc(mtf50)).clamp_min(1)) / (2 * (math.pi * mtf50) ** 2)
        sigma = squared.clamp_min(_SHARPEST_PX**2).sqrt()[..., None]
        both = torch.stack([sigma, torch.sqrt(sigma**2 + _MASK_PX**2)])
        level, softer = both * (_area((place_px + 0.5) / both) - _area((place_px - 0.5) / both))
        return cls(sigma, level, softer)


def _area(place: Tensor) -> Tensor:
    """Area under the normal law's distribution function."""
    area: Tensor = place * torch.special.ndtr(place) + torch.exp(-place * place / 2) / math.sqrt(2 * math.pi)
    return area


def _clipped(level: Tensor, _: Tensor) -> Tensor:
    return (level - 0.05).clamp_min(0) / 0.95


def _bent(level: Tensor, _: Tensor) -> Tensor:
    """The light to the power of 2.2, of a dark side with a quarter of the bright one's, to 0.02 of the step."""
    return level * (0.4 + 0.6 * level)


def _clipped_twice(level: Tensor, _: Tensor) -> Tensor:
    return (level.clamp(0.05, 0.95) - 0.05) / 0.9


def _s_shaped(level: Tensor, _: Tensor) -> Tensor:
    """3 x^2 - 2 x^3 of 0.2 to 0.8 of full scale."""
    light = 0.2 + 0.6 * level
    return (light * light * (3 - 2 * light) - 0.104) / 0.792


def _sharpened(level: Tensor, softer: Tensor) -> Tensor:
    return level + 0.3 * (level - softer)


@dataclass(frozen=True)
class _Family:
    """Faults that leave one half of the edge as it leaves the other, or not: with its parity, 1 even and -1 odd.

    faults: each with the power of u by which its cost grows, the largest u that there is, and the largest one that
    is reckoned with where there is no trace of it.
    """

    parity: float
    faults: tuple[tuple[Fault, int, float, float], ...]


_UNEQUAL = _Family(1.0, ((_clipped, 1, 4.0, 3.0), (_bent, 2, 1.2, 1.2)))
_EQUAL = _Family(-1.0, ((_clipped_twice, 1, 3.0, 1.5), (_s_shaped, 1, 2.0, 1.2), (_sharpened, 1, 6.0, 1.5)))


@dataclass(frozen=True)
class Alternatives:
    """unequal, sharpened: (B,) bool, that such a fault is certain.

    likely, largest: share by which hidden faults may have raised MTF50, as found and with its error, (B,).
    """

    unequal: Tensor
    sharpened: Tensor
    likely: Tensor
    largest: Tensor


def alternatives(profile: Profile, mtf50: Tensor) -> Alternatives:
    """What may have been done to the edges. mtf50: (B,), as measured."""
    place, free = profile.place_px, profile.free
    mtf50 = mtf50.clamp(1e-3, 0.6)
    plain = GaussianEdge.of(mtf50, place)
    level, seen = plain.level, _at_knots(profile.coefficients)
    faults = [fault for family in (_UNEQUAL, _EQUAL) for fault, *_ in family.faults]
    costs = _costs(plain, torch.stack([fault(level, plain.softer) for fault in faults]), profile, mtf50)
    before = GaussianEdge.of(mtf50 / (1 + costs), place)
    made = iter(zip(costs, before.level, before.softer, strict=True))
    slope = torch.gradient(level, dim=1)[0]
    unequal = torch.zeros(len(mtf50), dtype=torch.bool)
    sharpened, likely, largest = unequal.clone(), torch.zeros_like(mtf50), torch.zeros_like(mtf50)
    explained = {1.0: (slope, torch.ones_like(level)), -1.0: (place * slope, level - 0.5)}
    for family in (_UNEQUAL, _EQUAL):
        basis = torch.linalg.qr(torch.stack([each * free for each in explained[family.parity]], dim=2)).Q
        off = _half(seen - level, free, family.parity, basis)
        for fault, grows, most, usual in family.faults:
            cost, *edge = next(made)
            change = _half(fault(*edge) - level, free, family.parity, basis)
            weight = change / (change**2).sum(1, keepdim=True).clamp_min(1e-12)
            u, error = (weight * off).sum(1), _error(profile, _at_knots(weight))
            certain = profile.certain(4) * error
            if family is _UNEQUAL:
                u = u.abs()
                unequal |= (u > certain) & (cost * u**grows > MATTERS)
            else:
                if fault is _sharpened:
                    motion = (weight * _half(_moved(mtf50, place) - level, free, -1.0, basis)).sum(1)
                    sharpened |= u - motion.clamp_min(0) > certain + _SPARE
                fits = _fits(profile, off - u[:, None] * change)
                u, error = (torch.where(fits, each, 0.0) for each in (u.clamp_min(0), error))
            top = u + CERTAIN * error
            top = torch.where(u > CERTAIN * error, top.clamp_max(most), top.clamp_max(usual))
            likely = torch.maximum(likely, cost * u.clamp_max(most) ** grows)
            largest = torch.maximum(largest, cost * top**grows)
    return Alternatives(unequal, sharpened, likely, largest)


def _half(values: Tensor, free: Tensor, parity: float, basis: Tensor) -> Tensor:
    """The even part of ``values`` (B, K), or the odd one, without what ``basis`` explains."""
    part = (values + parity * values.flip(1)) / 2 * free
    left: Tensor = part - (basis @ (basis.mT @ part[..., None]))[..., 0]
    return left


def _at_knots(coefficients: Tensor) -> Tensor:
    """A cubic spline's values at its knots."""
    kernel = coefficients.new_tensor([[[1 / 6, 4 / 6, 1 / 6]]])
    wide = torch.cat([coefficients[:, :1], coefficients, coefficients[:, -1:]], dim=1)
    return conv1d(wide[:, None], kernel)[:, 0]


def _error(profile: Profile, functional: Tensor) -> Tensor:
    """Standard error of (coefficients * functional).sum(1), (B,)."""
    return ((profile.covariance @ functional[..., None])[..., 0] * functional).sum(1).clamp_min(0).sqrt()


def _costs(plain: GaussianEdge, after: Tensor, profile: Profile, mtf50: Tensor) -> Tensor:
    """Shares by which faults raise MTF50, (F, B), in two of Newton's steps. after: the edges with them, (F, B, K)."""
    place = profile.place_px
    middle, step = (place[1:] + place[:-1]) / 2, torch.diff(after) * profile.free[:, 1:]
    step = step / step.sum(-1, keepdim=True)
    found = mtf50.expand(after.shape[:-1])
    for _ in range(2):
        angle = math.pi * found
        wave = 2 * angle[..., None] * middle
        response = torch.hypot((step * torch.cos(wave)).sum(-1), (step * torch.sin(wave)).sum(-1))
        response = response / torch.sinc(found * (place[1] - place[0]))
        steepness = (2 * angle * plain.sigma_px[:, 0]) ** 2 + 1 - angle / torch.tan(angle)
        found = found * (1 + torch.log(2 * response) / steepness)
    return (found / mtf50 - 1).clamp(0, 1)


def _moved(mtf50: Tensor, place: Tensor) -> Tensor:
    """The edge of that MTF50 behind steady motion alone, (B, K): the squarest line spread of any blur."""
    return (place * (mtf50 / 0.6034)[:, None] + 0.5).clamp(0, 1)


def _fits(profile: Profile, left: Tensor) -> Tensor:
    """Whether what is ``left`` (B, K) of an edge, in the mean over 5 knots, may be noise or matters little, (B,)."""
    mean = avg_pool1d(left, 5, stride=1, padding=2)
    variance = avg_pool1d(profile.covariance, 5, stride=1, padding=2)
    variance = avg_pool1d(variance.mT, 5, stride=1, padding=2).diagonal(dim1=1, dim2=2)
    limit = profile.certain(profile.free.sum(1))[:, None] * variance.clamp_min(0).sqrt()
    return (mean.abs() <= limit.clamp_min(MISFIT)).all(1)
