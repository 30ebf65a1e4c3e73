"""Alternatives to an honest edge: clips, tone curves and sharpening that may have left it, and their cost in MTF50.

An edge is compared with Gaussian edges of the same MTF50 that a fault has changed, each fault by its strength u: 0 of
an honest edge, 1 of the fault as described. What it costs at each strength stands in a table. Clips at one end and
bent tone curves make the two halves of an edge unequal, and are looked for there alone, for any blur leaves halves
alike. Clips at both ends, S-shaped curves and sharpening leave equal halves; so may motion and lenses, and no such
fault is certain before it exceeds what motion does.

A fault that is certain raises a flag. What noise or blur may hide makes the interval longer, mostly to lower MTF50.

Domain: splines scaled to 0 and 1, distances in px along the normal, frequencies in cycles/px.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d, conv1d, pad

from blurnoise.metrics.edge.plausibility import Profile

Fault = Callable[[Tensor, Tensor, Tensor], Tensor]
"""What a fault of strength u (..., 1) makes of an edge (..., K), given also what a Gaussian of ``_MASK_PX`` does."""
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
_FINEST, _COARSEST, _MTF50S = 0.6, 1e-3, 17  # cycles/px, of the table of costs, in even ratios
_STRENGTHS = 4  # of that table, in a unit of u


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


def _clipped(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """By 5 % of the step, below or above."""
    low, high = 0.05 * u.clamp_min(0), 1 + 0.05 * u.clamp_max(0)
    return (torch.minimum(torch.maximum(level, low), high) - low) / (high - low)


def _bent(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """The light to the power of 2.2, or the root, of a dark side with a quarter of the bright one's."""
    power = 2.2**u
    dark: Tensor = 0.25**power
    return ((0.25 + 0.75 * level) ** power - dark) / (1 - dark)


def _clipped_twice(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    cut = 0.05 * u
    return (torch.minimum(torch.maximum(level, cut), 1 - cut) - cut) / (1 - 2 * cut)


def _s_shaped(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """3 x^2 - 2 x^3 of 0.2 to 0.8 of full scale."""
    light = 0.2 + 0.6 * level
    return level + u * ((light * light * (3 - 2 * light) - 0.104) / 0.792 - level)


def _sharpened(level: Tensor, softer: Tensor, u: Tensor) -> Tensor:
    return level + 0.3 * u * (level - softer)


@dataclass(frozen=True)
class _Kind:
    """A fault that leaves one half of the edge as it leaves the other, or not: by its parity, 1 even and -1 odd.

    range: of u. usual: the largest that is reckoned with where there is no trace of it.
    """

    fault: Fault
    parity: float
    range: tuple[float, float]
    usual: float


_KINDS = (
    _Kind(_clipped, 1.0, (-4.0, 4.0), 3.0),
    _Kind(_bent, 1.0, (-1.2, 1.2), 1.1),
    _Kind(_clipped_twice, -1.0, (0.0, 3.0), 1.1),
    _Kind(_s_shaped, -1.0, (0.0, 2.0), 1.1),
    _Kind(_sharpened, -1.0, (0.0, 6.0), 1.1),
)
_LEAST_U, _MOST_U = (end(limit for kind in _KINDS for limit in kind.range) for end in (min, max))


@dataclass(frozen=True)
class Alternatives:
    """unequal, sharpened: (B,) bool, that such a fault is certain.

    likely, largest: share by which hidden faults may have raised MTF50, as found and with its error, (B,). lowered:
    by which, at most, they have lowered it.
    """

    unequal: Tensor
    sharpened: Tensor
    likely: Tensor
    largest: Tensor
    lowered: Tensor


def alternatives(profile: Profile, mtf50: Tensor, rising: Tensor) -> Alternatives:
    """What may have been done to the edges. mtf50: (B,), as measured; rising: (B,), bright at positive places."""
    place, free = profile.place_px, profile.free
    mtf50 = mtf50.clamp(_COARSEST, _FINEST)
    level = GaussianEdge.of(mtf50, place).level
    costs = _Costs.of(mtf50)
    slope = torch.gradient(level, dim=1)[0]
    seen = _at_knots(profile.coefficients)
    explained = {1.0: (slope, torch.ones_like(level)), -1.0: (place * slope, level - 0.5)}
    bases = {
        parity: torch.linalg.qr(torch.stack([each * free for each in both], dim=2)).Q
        for parity, both in explained.items()
    }
    off = {parity: _half(seen - level, free, parity, basis) for parity, basis in bases.items()}
    off[1.0] = torch.where(rising[:, None], 1, -1) * off[1.0]
    limit = _misfit(profile)

    def changes(u: Tensor) -> list[Tensor]:
        """By the faults of strengths u, (F, B), at the MTF50 that they leave."""
        before = GaussianEdge.of(mtf50 / (1 + costs.at(u)), place)
        made = zip(_KINDS, before.level, before.softer, u[..., None], strict=True)
        return [
            _half(kind.fault(*edge) - level, free, kind.parity, bases[kind.parity]) for kind, *edge in made
        ]

    units = changes(torch.ones(len(_KINDS), len(mtf50), dtype=torch.float64))
    weights = [unit / (unit**2).sum(1, keepdim=True).clamp_min(1e-12) for unit in units]
    error = _errors(profile, torch.stack([_at_knots(weight) for weight in weights], 2))
    first = torch.stack(
        [(weight * off[kind.parity]).sum(1) for weight, kind in zip(weights, _KINDS, strict=True)]
    )
    certain = profile.certain(4) * error
    ranges = torch.tensor([kind.range for kind in _KINDS], dtype=torch.float64)
    low, high = ranges[:, :1], ranges[:, 1:]
    guess = torch.minimum(torch.maximum(first, low), high)
    left = [off[kind.parity] - change for kind, change in zip(_KINDS, changes(guess), strict=True)]
    more = torch.stack([(weight * each).sum(1) for weight, each in zip(weights, left, strict=True)])
    fits = torch.stack(
        [
            (_mean(each - by[:, None] * unit).abs() <= limit).all(1) | torch.tensor(kind.parity > 0)
            for each, by, unit, kind in zip(left, more, units, _KINDS, strict=True)
        ]
    )
    steepness = _steepness(guess, first - more)
    u = torch.where(fits, guess + more / steepness, 0.0)
    error = torch.where(fits, error / steepness, 0.0)
    trace = u.abs() > CERTAIN * error
    usual = torch.tensor([[kind.usual] for kind in _KINDS], dtype=torch.float64)
    low, high = (torch.where(trace, end, end.clamp(-usual, usual)) for end in (low, high))
    within = [
        costs.at(torch.minimum(torch.maximum(each, low), high))
        for each in (u, u - CERTAIN * error, u + CERTAIN * error)
    ]
    even = torch.tensor([[kind.parity > 0] for kind in _KINDS])
    unequal = even & (first.abs() > certain) & (costs.at(torch.minimum(u.abs(), high)) > MATTERS)
    motion = (weights[-1] * _half(_moved(mtf50, place) - level, free, -1.0, bases[-1.0])).sum(1)
    likely = within[0].amax(0).clamp_min(0)
    return Alternatives(
        unequal.any(0),
        first[-1] - motion.clamp_min(0) > certain[-1] + _SPARE,
        likely,
        torch.maximum(likely, torch.stack(within).amax((0, 1))),
        -torch.stack(within).amin((0, 1)).clamp_max(0),
    )


def _steepness(u: Tensor, seen: Tensor) -> Tensor:
    """By what more is seen of faults of strength u per u, seen being 1 at 1: between there, or 0, and u."""
    at = (u > 0).to(u)
    away = torch.where((u - at).abs() < 1e-3, 1.0, u - at)
    slope = torch.where(away == 1.0, 1.0, (seen - at) / away)
    return slope.clamp(0.25, 4.0)


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


def _errors(profile: Profile, functionals: Tensor) -> Tensor:
    """Standard errors (F, B) of the coefficients' sums with functionals (B, K, F)."""
    return ((profile.covariance @ functionals) * functionals).sum(1).clamp_min(0).sqrt().mT


@dataclass(frozen=True)
class _Costs:
    """Shares by which faults raise the MTF50 of edges, (F, B, U), at even steps of u."""

    shares: Tensor

    @classmethod
    def of(cls, mtf50: Tensor) -> _Costs:
        """Of edges (B,) that have this MTF50 with the fault."""
        table = _cost_table()
        place = torch.log(mtf50 / _COARSEST) * ((_MTF50S - 1) / math.log(_FINEST / _COARSEST))
        index = place.long().clamp_max(_MTF50S - 2)
        return cls(torch.lerp(table[:, index], table[:, index + 1], (place - index)[:, None]))

    def at(self, u: Tensor) -> Tensor:
        """Of strengths (F, B)."""
        place = (u - _LEAST_U) * _STRENGTHS
        index = place.long().clamp(0, self.shares.shape[2] - 2)[..., None]
        below, above = (self.shares.gather(2, each)[..., 0] for each in (index, index + 1))
        return torch.lerp(below, above, place - index[..., 0])


@cache
def _cost_table() -> Tensor:
    """By what the faults raise MTF50, (F, M, U), by the MTF50 that is then measured."""
    mtf50 = torch.logspace(math.log10(_COARSEST), math.log10(_FINEST), _MTF50S, dtype=torch.float64)
    sigma = GaussianEdge.of(mtf50, torch.zeros(1, dtype=torch.float64)).sigma_px
    step = (sigma / 12).clamp_min(0.125)
    place = step * torch.arange(-80, 81)
    plain = GaussianEdge.of(mtf50, place)
    count = round((_MOST_U - _LEAST_U) * _STRENGTHS) + 1
    strength = torch.linspace(_LEAST_U, _MOST_U, count, dtype=torch.float64)
    table = torch.empty(len(_KINDS), _MTF50S, count, dtype=torch.float64)
    for kind, into in zip(_KINDS, table, strict=True):
        u = strength.clamp(*kind.range)[:, None, None]
        line = torch.diff(kind.fault(plain.level, plain.softer, u))
        found = mtf50.expand(line.shape[:2])
        for _ in range(6):  # of Newton's steps
            angle = math.pi * found
            wave = 2 * angle[..., None] * (place[:, 1:] + place[:, :-1]) / 2
            response = torch.hypot((line * torch.cos(wave)).sum(-1), (line * torch.sin(wave)).sum(-1))
            response = response / torch.sinc(found * step[:, 0])
            steepness = (2 * angle * sigma[:, 0]) ** 2 + 1 - angle / torch.tan(angle)
            found = (found * (1 + torch.log(2 * response) / steepness)).clamp(max=0.95)
        honest = found[round(-_LEAST_U * _STRENGTHS)]
        for column, after in enumerate(found):
            share = np.interp(mtf50.log().numpy(), after.log().numpy(), (after / honest - 1).numpy())
            into[:, column] = torch.from_numpy(share)
    return table


def _moved(mtf50: Tensor, place: Tensor) -> Tensor:
    """The edge of that MTF50 behind steady motion alone, (B, K): the squarest line spread of any blur."""
    return (place * (mtf50 / 0.6034)[:, None] + 0.5).clamp(0, 1)


def _misfit(profile: Profile) -> Tensor:
    """What the mean over 5 knots of what is left of an edge, (B, K), may be by noise, or matters little."""
    windows = profile.covariance.unfold(1, 5, 1).unfold(2, 5, 1).diagonal(dim1=1, dim2=2)
    error = windows.mean((1, 2)).clamp_min(0).sqrt()
    return pad(profile.certain(profile.free.sum(1))[:, None] * error, (2, 2), "replicate").clamp_min(MISFIT)


def _mean(values: Tensor) -> Tensor:
    return avg_pool1d(values, 5, stride=1, padding=2)
