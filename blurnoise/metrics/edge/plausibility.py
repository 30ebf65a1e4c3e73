"""Plausibility of an edge's shape: what no lens, no motion and no pixel does to a step, told from the noise.

Each test compares something that blur cannot make with its own error, which is the bootstrap's over rows in closed
form: the rows' scores squared and summed. So noise of any law, also a hot pixel, counts as itself. A test raises a
false alarm with a probability of ``FALSE_ALARM`` at most, whatever the number of places it looks at (Bonferroni,
Student's law with a row's degree of freedom each); beyond that, what is found must be large enough to matter.

A tone curve that is odd about the middle of the step makes another edge that is plausible in all of this.

Domain: splines scaled to 0 and 1, distances in px along the normal, frequencies in cycles/px.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor
from torch.nn.functional import pad

from blurnoise.metrics.edge.geometry import slope
from blurnoise.metrics.edge.sides import NOISELESS, Sides
from blurnoise.metrics.edge.spline import KNOT_PX, Spline

FALSE_ALARM = 1e-3
LOPSIDED, LOPSIDED_COMPRESSED = 0.004, 0.008
"""Share of the step by which the edge may differ from itself turned by half a turn: 1 % of clipping.

Where the noise is correlated, as compression leaves it, what it leaves of the edge is that uneven, too.
"""
OVERSHOOT = 0.008
"""Share of the step by which an edge may go beyond its sides: light only adds, so no blur does."""
DIP = 0.5
"""Share of its lower neighbour by which the line spread may dip between two humps."""
DISPLACED = 0.02
"""Share of MTF50 that displaced rows may cost."""
UNEVEN_NOISE, UNEVEN_SMOOTH = 12.0, 2.5
"""Variance of the noise upon the edge over that of its sides: compression at quality 90 leaves 5 to 10, with noise of
a power at 0 of 3 to 7 variances; after a Gaussian of 1 px it is 13.
"""
SMOOTH_NOISE = 7.5
"""Power at frequency 0, over the variance, of noise that a filter has smoothed."""
SHARPER = 1.03
"""MTF50 over that of bare pixels."""
_BARE = 0.6034
"""MTF50 of a pixel, cycles/px: sinc(f) = 1/2."""
_CLOSE, _WIDE = (1 + torch.linspace(-half, half, 9, dtype=torch.float64) for half in (0.06, 0.2))
"""Cycles/px about 1, where pixels average everything away."""
NEGATIVE = 0.04
"""Share of the light, in half a pixel, by which what lies before the pixels may be less than none."""
_SPARE, _TAIL_MATTERS = 1.3, 0.015
"""By which factor, and by which response beside it, a spline's power there is off."""
_CHI_SQUARE_MEDIAN = 0.4549  # of one degree of freedom
_MEDIAN_ERROR = 1.65  # standard error of a median of n chi squares over that of their mean, sqrt(2/n)


@dataclass(frozen=True)
class Profile:
    """The spline and the error of anything linear in it.

    coefficients: (B, K). covariance: theirs, (B, K, K), of so many rows. free: (B, K), 1 for coefficients that were
    fitted and whose mirror image was. tilt: px per row, (B,). white: whether rows were taken one by one.
    """

    coefficients: Tensor
    covariance: Tensor
    rows: int
    free: Tensor
    tilt: Tensor
    white: bool

    @classmethod
    def of(cls, spline: Spline, position_px: Tensor, block: int = 1) -> Profile:
        """block: rows whose noise belongs together; at least 16 of them are kept apart."""
        kept = max(1, min(block, position_px.shape[1] // 16))
        free = (spline.inverse.diagonal(dim1=1, dim2=2) > 0).to(torch.float64)
        rows = math.ceil(position_px.shape[1] / kept)
        tilt = slope(position_px)
        return cls(
            spline.coefficients, spline.bootstrapped(kept), rows, free * free.flip(1), tilt, block == 1
        )

    @property
    def place_px(self) -> Tensor:
        """Of the knots, (K,)."""
        half = self.coefficients.shape[1] // 2
        return KNOT_PX * torch.arange(-half, half + 1, dtype=torch.float64)

    def error(self, functional: Tensor) -> Tensor:
        """Standard errors of coefficients @ functional, (K, n): (B, n)."""
        return ((self.covariance @ functional) * functional).sum(1).clamp_min(0).sqrt()

    def certain(self, places: Tensor | int) -> Tensor:
        """Errors by which one of ``places`` numbers must be off to be no accident: a number, or (B,)."""
        freedom = max(self.rows - 1, 4)
        tail = FALSE_ALARM / 2 / torch.as_tensor(places, dtype=torch.float64).clamp_min(1)
        z = -torch.special.ndtri(tail)
        # Student's quantile by Cornish and Fisher.
        t: Tensor = z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)
        return t


def lopsided(profile: Profile) -> Tensor:
    """Whether the edge differs from itself turned by half a turn, (B,): clipping, tone curves, shifted colours.

    Its place, the sum of its sides' levels and shading across it are what may differ. Averaged over 3 and 7 knots.
    """
    c, free, x = profile.coefficients, profile.free, profile.place_px
    line = pad(c[:, 2:] - c[:, :-2], (1, 1))
    even, odd = line + line.flip(1), c - c.flip(1)
    basis = torch.linalg.qr(torch.stack([even * free, free, x * odd * free], dim=2)).Q
    left = torch.diag_embed(free) - basis @ basis.mT  # of a difference, without what may differ
    difference = (left @ (c + c.flip(1) - 1)[..., None])[..., 0]
    both = profile.covariance + profile.covariance.flip(1)
    covariance = left @ (both + both.flip(2)) @ left
    found = torch.zeros(len(c), dtype=torch.bool)
    for knots in (3, 7):
        mean = _moving(c.shape[1], knots)
        error = ((mean @ covariance) * mean).sum(2).clamp_min(0).sqrt()
        least = LOPSIDED if profile.white else LOPSIDED_COMPRESSED
        limit = (profile.certain(free.sum(1))[:, None] * error).clamp_min(least)
        found |= ((difference @ mean).abs() > limit).any(1)
    return found


def overshoots(profile: Profile) -> Tensor:
    """Whether the edge, in the mean over a pixel, goes beyond one of its sides, (B,)."""
    c = profile.coefficients
    mean = torch.eye(c.shape[1], dtype=torch.float64).unfold(0, round(1 / KNOT_PX), 1).mean(-1)
    edge, error = c @ mean.T, profile.error(mean.T)
    beyond = torch.maximum(edge - 1, -edge)
    limit = profile.certain(profile.free.sum(1))[:, None] * error
    return (beyond > limit.clamp_min(OVERSHOOT)).any(1)


def two_humps(profile: Profile, reach_px: Tensor) -> Tensor:
    """Whether the line spread dips between two humps, (B,): two edges, or motion that lingers at its ends.

    It is averaged over an eighth of the reach, at least half a pixel. Humps closer to the dip than 3/4 px do not
    count: so does a filter of the picture's own pixels ring.
    """
    apart = round(0.75 / KNOT_PX)
    found = torch.zeros(len(profile.coefficients), dtype=torch.bool)
    own = profile.covariance.diagonal(dim1=1, dim2=2)
    widths = (reach_px / 8 / KNOT_PX).round().long().clamp_min(2)
    for width in set(widths.tolist()):
        of = widths == width
        line = profile.coefficients[:, width:] - profile.coefficients[:, :-width]
        error = (
            (own[:, width:] + own[:, :-width] - 2 * profile.covariance.diagonal(width, 1, 2))
            .clamp_min(0)
            .sqrt()
        )
        left, at_left = (each[:, : -2 * apart] for each in line.cummax(1))
        right, at_right = (each.flip(1)[:, 2 * apart :] for each in line.flip(1).cummax(1))
        lower = torch.where(left < right, at_left, line.shape[1] - 1 - at_right)
        hump, low = torch.minimum(left, right), line[:, apart:-apart]
        of_both = torch.sqrt(error[:, apart:-apart] ** 2 + error.gather(1, lower) ** 2)
        places = (profile.free.sum(1) / width) ** 3  # two humps and what lies between them
        limit = torch.maximum(profile.certain(places)[:, None] * of_both, DIP * hump)
        found |= of & ((hump - low > limit) & (hump > 0.1 * line.amax(1, keepdim=True))).any(1)
    return found


def too_abrupt(profile: Profile, mtf50: Tensor, scatter: Tensor) -> Tensor:
    """Whether the edge is sharper than its pixels allow, (B,): cut at both sides, by clipping or a tone curve.

    A pixel as wide as its pitch lets nothing through at 1 cycle/px, and little about it, whatever the lens, the
    motion and filters of the picture do to the rest. Close about it and in a wider band, the power is held against
    that pixel's; and so is MTF50. scatter: its standard deviation as a share, (B,).
    """
    cosine = 1 / torch.sqrt(1 + profile.tilt**2)
    sine = torch.sqrt((1 - cosine**2).clamp_min(0))
    bare = _BARE / cosine
    found = mtf50.isfinite() & (mtf50 / bare - 1 > (5 * scatter).clamp_min(SHARPER - 1))
    for band in (_CLOSE, _WIDE):
        allowed = _SPARE * (_pixel(band, cosine, sine) ** 2).sum(1) + len(band) * _TAIL_MATTERS**2
        waves = _waves(profile.coefficients.shape[1], band)
        power = ((profile.coefficients @ waves) ** 2).sum(1)
        covariance = waves.mT @ profile.covariance @ waves
        mean = covariance.diagonal(dim1=1, dim2=2).sum(1)
        # A sum of squares as a scaled chi square, and that as a normal number (Satterthwaite; Wilson and Hilferty).
        freedom = mean**2 / (covariance**2).sum((1, 2)).clamp_min(1e-30)
        shift = 2 / (9 * freedom.clamp_min(1e-3))
        ratio = (power - allowed).clamp_min(0) / mean.clamp_min(1e-15)
        found |= (ratio ** (1 / 3) - (1 - shift)) / shift.sqrt() > profile.certain(1)
    return found


def negative(profile: Profile) -> Tensor:
    """Whether such an edge asks for less than no light somewhere before the pixels, (B,): clipped, or sharpened.

    The edge spread is that of lens and motion, P, averaged over a pixel: E'(u) = P(u + 1/2) - P(u - 1/2). So P is a
    sum of E' at places a pixel apart, from the left or from the right, and must never fall: a line spread that
    ends sooner than a pixel takes to leave it does so. Means over adjacent halves of a pixel are compared.
    """
    c = profile.coefficients.float()
    count = c.shape[1]
    knot = torch.arange(count) - count // 2
    cosine = (1 / torch.sqrt(1 + profile.tilt**2)).float()
    place = (torch.arange(count + 8) - count // 2 - 4)[:, None] * cosine[
        :, None, None
    ]  # knots; a pixel is 4 of them
    away = (place - knot).abs()
    spline = torch.where(away < 1, 2 / 3 - away * away * (1 - away / 2), (2 - away).clamp_min(0) ** 3 / 6)
    rises = _rises(count + 8) @ spline
    found = (rises @ c[..., None])[..., 0]
    beyond = (1 - spline.sum(2)) * (place[..., 0] > 0)  # where there are no knots any more, the edge is 1
    found += beyond @ _rises(count + 8).T
    error = ((rises @ profile.covariance.float()) * rises).sum(2).clamp_min(0).sqrt()
    limit = profile.certain(profile.free.sum(1))[:, None] * error
    return (-found > limit.clamp_min(NEGATIVE)).any(1)


@cache
def _rises(count: int) -> Tensor:
    """By how much P rises from a half of a pixel to the next, of an edge at quarters of a pixel, (n, count)."""
    one = torch.eye(count)
    curved = 2 * (one[4:] - 2 * one[2:-2] + one[:-4])
    place = torch.arange(len(curved))
    after = place[:, None] - place
    aligned = (after % 4 == 0).float()
    return torch.cat([(aligned * (after >= 0)) @ curved, -(aligned * (after < 0)) @ curved])


def displaced(spline: Spline, noise: Tensor, mtf50: Tensor) -> Tensor:
    """Whether rows are displaced against each other by more than noise moves them, (B,), and what it costs MTF50.

    A row's own place follows from its misfit along the edge's slope. Displacements of variance s^2 lower the
    response at f by 2 (pi f s)^2, and MTF50 by that over its logarithmic slope, -2 ln 2 for a Gaussian. The median
    over rows stands for all of them: a hot pixel moves one. noise: :func:`noise_expected`.
    """
    off, pull = spline.off
    curvature = spline.pixels.by_row(pull * pull).clamp_min(1e-12)
    place = spline.pixels.by_row(pull * off) / curvature
    expected = spline.pixels.by_row(pull * pull * noise) / curvature**2
    rows = place.shape[1]
    ratio = (place**2 / expected.clamp_min(1e-18)).median(1).values / _CHI_SQUARE_MEDIAN
    certain = ratio - 1 > 5 * _MEDIAN_ERROR * math.sqrt(2 / rows)
    excess = ((ratio - 1) * expected.mean(1)).clamp_min(0)
    cost = 2 * (math.pi * mtf50.nan_to_num(0, 0, 0)) ** 2 * excess / (2 * math.log(2))
    return certain & (cost > DISPLACED)


def smoothed(spline: Spline, noise: Tensor, sides: Sides) -> Tensor:
    """Whether the sides have certainly less noise than the edge between them, (B,): denoised, clipped, curved.

    Of light, noise in between lies between theirs. The median over pixels, for a hot one changes nothing.
    """
    off, _ = spline.off
    share = spline.pixels.value - off
    core = ((share > 0.1) & (share < 0.9)).nonzero()[:, 0]
    count = torch.bincount(spline.pixels.region[core], minlength=spline.pixels.batch)
    squares, usual = (torch.split(each[core], count.tolist()) for each in (off**2, noise.clamp_min(1e-18)))
    found = torch.zeros(len(count), dtype=torch.bool)
    limit = torch.where(sides.power_at_0 > SMOOTH_NOISE, UNEVEN_SMOOTH, UNEVEN_NOISE).tolist()
    for index, (square, expected) in enumerate(zip(squares, usual, strict=True)):
        if len(square) < 20:
            continue
        error = math.sqrt(2 / len(square))
        ratio = float((square / expected).median()) / _CHI_SQUARE_MEDIAN
        found[index] = ratio > max(1 + 5 * _MEDIAN_ERROR * error, limit[index])
    noisy = sides.variance.amax(1) > NOISELESS * sides.step**2
    return found & noisy


def noise_expected(spline: Spline, sides: Sides) -> Tensor:
    """Variance of each of the spline's pixels by its light, from the sides', (n,)."""
    variance = sides.variance / sides.step[:, None] ** 2
    dark, bright = variance.unbind(1)
    share = (spline.pixels.value - spline.off[0]).clamp(0, 1)
    return dark[spline.pixels.region] + (bright - dark)[spline.pixels.region] * share


def _moving(count: int, width: int) -> Tensor:
    """Matrix of the mean over ``width`` neighbours, (count, count)."""
    away = torch.arange(count)[:, None] - torch.arange(count)
    return (away.abs() <= width // 2).to(torch.float64) / width


def _pixel(frequency: Tensor, cosine: Tensor, sine: Tensor) -> Tensor:
    """Modulus of the response of a square pixel along the normal, (B, F)."""
    across, along = cosine[:, None] * frequency, sine[:, None] * frequency
    return (torch.sinc(across) * torch.sinc(along)).abs()


def _waves(count: int, band: Tensor) -> Tensor:
    """Real and imaginary parts of the response at ``band`` as sums over coefficients, (count, 2 F)."""
    place = KNOT_PX * (torch.arange(count - 1, dtype=torch.float64) - (count - 2) / 2)
    angle = 2 * math.pi * place[:, None] * band
    waves = torch.cat([torch.cos(angle), torch.sin(angle)], dim=1) * (torch.sinc(KNOT_PX * band) ** 3).repeat(
        2
    )
    return pad(waves, (0, 0, 1, 0)) - pad(waves, (0, 0, 0, 1))
