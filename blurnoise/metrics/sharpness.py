"""Sharpness beside MTF50: acutance of a slanted edge, and the response of a Siemens star (s-SFR).

Domain: linear digital numbers above the black level; frequencies in cycles/px. All raise ``TypeError`` or
``ValueError`` that names the argument.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import checks
from blurnoise.metrics import values
from blurnoise.metrics.edge.measurement import SlantedEdge
from blurnoise.metrics.values import Estimate

Floats = NDArray[np.float64]
PX_PER_DEGREE = 60.0
"""Of the usual viewing condition: a pixel is a minute of arc, the finest that a normal eye resolves."""
SEGMENTS = 8
"""Of a ring of the star, as ISO 12233 has them: displaced or direction-dependent phases then do not cancel."""
Z = NormalDist().inv_cdf(0.975)
_RING = 0.06  # width over radius: the frequency within a ring is alike to 3 %
_FINEST, _SMALLEST_PX = 0.8, 8.0  # cycles/px, and radius of a ring: those further in have too few pixels
_CENTRING = (
    0.5,
    0.35,
    0.25,
    0.18,
)  # smallest radius, of the largest, of the rings that place the centre, in turn
_FEWEST_PERIODS, _BESIDE = 16, 6  # of a star; and how far its spectrum spreads
_LEAST_POWER = 1e-6  # of a star: a modulation of 0.1 %
_CERTAIN = 10.0  # standard errors of the outer ring's power, at least, if it is a star's


def contrast_sensitivity(cycles_per_degree: Tensor) -> Tensor:
    """Sensitivity of the eye for luminance, 75 v^0.8 exp(-0.2 v) / 34.05, v in cycles per degree, of its shape.

    Source: IEEE Std 1858-2016, 5.4; in public D. Baxter et al. 2012, "Development of the I3A CPIQ spatial metrics".

    >>> contrast_sensitivity(torch.tensor([0.0, 4.0, 60.0])).round(decimals=2)  # highest at 0.8 / 0.2
    tensor([0., 3., 0.], dtype=torch.float64)
    """
    v = values.real("cycles_per_degree", cycles_per_degree)
    return 75 * v**0.8 * torch.exp(-0.2 * v) / 34.05


def acutance(edge: SlantedEdge, *, px_per_degree: float = PX_PER_DEGREE) -> Estimate:
    """Acutance of an edge, its response as the eye weighs it: 1 without blur, more than that where sharpened.

    The integral of the response times :func:`contrast_sensitivity` over that of the sensitivity alone, up to
    1 cycle/px. px_per_degree: pixels per degree of the viewer's field, > 0. No interval of an edge without bootstrap.

    >>> from blurnoise import charts, slanted_edge
    >>> edge = slanted_edge(charts.slanted_edge(60, 60)[0], bootstrap=0)
    >>> round(acutance(edge).value, 2), round(acutance(edge, px_per_degree=20).value, 2)  # from nearer, less sharp
    (0.95, 0.73)
    """
    checks.an_instance("edge", edge, SlantedEdge)
    scale = checks.in_range("px_per_degree", px_per_degree, 0.0, 1e6, above=True)
    flags = frozenset(flag.name.lower() for flag in edge.flags)
    if not edge.power.numel():
        return Estimate(math.nan, flags=flags)
    used = edge.frequencies <= 1
    weights = contrast_sensitivity(scale * edge.frequencies[used])

    def seen(power: Tensor) -> Tensor:
        return power[..., used].clamp_min(0).sqrt() @ weights / weights.sum()

    value = float(seen(edge.power))
    if edge.resamples is None:
        return Estimate(value, flags=flags)
    drawn = seen(edge.resamples.power)
    low, high = torch.quantile(drawn - drawn.mean(), torch.tensor([0.025, 0.975], dtype=drawn.dtype)).tolist()
    return Estimate(value, value + low, value + high, flags)


class StarResponse(NamedTuple):
    """Response of a star, of the mean power of its segments, at frequencies that rise.

    frequency, power, error: (F,); power is the squared response less that of noise, error its standard error.
    centre_px: (x, y). mtf50: frequency of a response of 1/2, cycles/px, or NaN and a flag.

    >>> from blurnoise import charts
    >>> [round(at, 3) for at in star_response(charts.siemens_star(150)[0, 0]).centre_px]
    [75.0, 75.0]
    """

    frequency: Tensor
    power: Tensor
    error: Tensor
    centre_px: tuple[float, float]
    mtf50: Estimate


def star_response(
    picture: Tensor, *, cycles: int | None = None, modulation: float | None = None
) -> StarResponse:
    """s-SFR of a sinusoidal Siemens star (ISO 12233) in the middle of ``picture``, (H, W). cycles: None counts them.

    A wave is fitted to each of eight segments of each ring; its amplitude over its mean is its modulation, and the
    centre is where phases agree. modulation: the chart's, (bright - dark)/(bright + dark); None: that of the outer
    ring, whose response then is 1. Flags: "no_star"; "too_coarse", that ring is below 1/2; "never_reaches_50".

    >>> from blurnoise import charts
    >>> star = star_response(charts.siemens_star(200)[0, 0], modulation=7 / 9)
    >>> round(star.mtf50.value, 1)  # of a pixel, whose own response is 1/2 at 0.6 along rows and columns
    0.6
    """
    pixels = values.real("picture", picture, dims=2).detach().numpy()
    if pixels.ndim != 2 or not np.isfinite(pixels).all():
        raise ValueError(f"picture: must be (H, W) and finite, got {pixels.shape}")
    cycles = _periods(pixels) if cycles is None else checks.counted("cycles", cycles)
    largest, finest = min(pixels.shape) / 2, max(_SMALLEST_PX, cycles / (2 * math.pi * _FINEST))
    if modulation is not None:
        modulation = checks.in_range("modulation", modulation, 0.0, 1.0, above=True)
    if largest < 3 * finest:
        must = f"must be {math.ceil(6 * finest)} px or more per side for a star of {cycles} periods"
        raise ValueError(f"picture: {must}, got {pixels.shape}")
    radii = [largest]
    while radii[-1] > finest:
        radii.append(radii[-1] - max(1.0, _RING * radii[-1]))
    edges_px = np.array(radii[::-1])
    middle = np.array([pixels.shape[1], pixels.shape[0]]) / 2
    centre = middle.copy()
    for least in _CENTRING:
        centre += _off_centre(_waves(pixels, centre, edges_px, cycles), least * largest, cycles)
        centre = centre.clip(middle - largest / 4, middle + largest / 4)
    waves = _waves(pixels, centre, edges_px, cycles)
    frequency = cycles / (2 * math.pi * waves.radius_px.mean(1)[::-1])
    level2 = np.maximum(waves.level.mean(1), 1e-100) ** 2
    power = ((np.abs(waves.wave) ** 2 - waves.noise).mean(1) / level2)[::-1]
    error = (np.sqrt((2 * waves.noise * np.abs(waves.wave) ** 2).mean(1) / SEGMENTS) / level2)[::-1]
    # Rings beyond the star have no modulation; the first within it may be cut by the star's border.
    first = min(int(np.argmax(power > power.max() / 4)) + 1, len(power) - 1)
    frequency, power, error = frequency[first:], power[first:], error[first:]
    flag = "" if power[0] > max(_CERTAIN * error[0], _LEAST_POWER) else "no_star"
    if not flag:
        reference = power[0] if modulation is None else modulation**2
        power, error = power / reference, error / reference
    low, value, high = (_half(frequency, power + sign * Z * error) for sign in (-1, 0, 1))
    flag = flag or {0.0: "too_coarse", math.inf: "never_reaches_50"}.get(value, "")
    mtf50 = Estimate(math.nan, flags=frozenset({flag})) if flag else Estimate(value, low, high)
    of_f, of_power, of_error = (torch.from_numpy(each.copy()) for each in (frequency, power, error))
    return StarResponse(of_f, of_power, of_error, (float(centre[0]), float(centre[1])), mtf50)


def _periods(pixels: Floats) -> int:
    """Periods around the middle, by the spectrum of its outer rings; from off the centre it widens, evenly."""
    angle = 2 * math.pi * np.arange(2048) / 2048
    radius = min(pixels.shape) / 2 * np.linspace(0.5, 0.95, 10)[:, None]
    y, x = (
        side / 2 + radius * wave
        for side, wave in zip(pixels.shape, (np.sin(angle), np.cos(angle)), strict=True)
    )
    power = (np.abs(np.fft.rfft(pixels[y.astype(int), x.astype(int)])) ** 2).sum(0)
    power[:_FEWEST_PERIODS] = 0
    peak = int(power.argmax())
    near = np.arange(max(0, peak - _BESIDE), min(len(power), peak + _BESIDE + 1))
    return round(float(near @ power[near]) / max(float(power[near].sum()), 1e-300)) or _FEWEST_PERIODS


class _Waves(NamedTuple):
    """Of rings, inner to outer, and their segments, (R, 8): mean radius, level, complex wave, noise of its power."""

    radius_px: Floats
    level: Floats
    wave: NDArray[np.complex128]
    noise: Floats


def _waves(pixels: Floats, centre: Floats, edges_px: Floats, cycles: int) -> _Waves:
    """Least-squares waves about a centre, between radii that rise."""
    y, x = np.indices(pixels.shape) + 0.5
    right, up = x - centre[0], centre[1] - y
    radius = np.hypot(right, up)
    used = (radius >= edges_px[0]) & (radius < edges_px[-1])
    radius, angle, seen = radius[used], np.arctan2(up[used], right[used]), pixels[used]
    # Segments are centred on rows, columns and diagonals.
    segment = np.floor(angle / (2 * math.pi) * SEGMENTS + 0.5).astype(int) % SEGMENTS
    rings = len(edges_px) - 1
    group = (np.searchsorted(edges_px, radius, side="right") - 1) * SEGMENTS + segment

    def total(of: Floats | None = None) -> Floats:
        return np.bincount(group, of, rings * SEGMENTS).astype(float)

    columns = np.stack([np.ones_like(angle), np.cos(cycles * angle), np.sin(cycles * angle)])
    normal = np.array([[total(one * other) for other in columns] for one in columns]).transpose(2, 0, 1)
    inverse = np.linalg.pinv(normal, hermitian=True)
    fitted = np.einsum("gij,jg->ig", inverse, np.array([total(column * seen) for column in columns]))
    count = total()
    rest = total((seen - (columns * fitted[:, group]).sum(0)) ** 2) / np.maximum(count - 3, 1)
    noise = rest * (inverse[:, 1, 1] + inverse[:, 2, 2])
    shape = rings, SEGMENTS
    wave = (fitted[1] + 1j * fitted[2]).reshape(shape)
    middle_px = total(radius) / np.maximum(count, 1)
    return _Waves(middle_px.reshape(shape), fitted[0].reshape(shape), wave, noise.reshape(shape))


def _off_centre(waves: _Waves, least_px: float, cycles: int) -> Floats:
    """From the centre that was taken to the star's, (x, y) with y down, by the phases of rings beyond a radius.

    Seen from elsewhere, the star's angle at radius r changes by (x sin + y cos)/r.
    """
    angle = np.arange(SEGMENTS) * (2 * math.pi / SEGMENTS)
    phase = np.angle(waves.wave * waves.wave.sum(1, keepdims=True).conj())
    weight = np.where(waves.radius_px > least_px, np.abs(waves.wave), 0.0)
    lever = (
        -cycles
        / np.maximum(waves.radius_px, 1)
        * np.stack(np.broadcast_arrays(np.sin(angle), np.cos(angle)))[:, None]
    )
    solved = np.linalg.lstsq((lever * weight).reshape(2, -1).T, (phase * weight).ravel())
    return np.asarray(solved[0])


def _half(frequency: Floats, power: Floats) -> float:
    """First frequency where the response falls below 1/2, along lines between rings; 0 or inf where none does."""
    below = np.flatnonzero(power < 0.25)
    if not len(below) or not below[0]:
        return 0.0 if len(below) else math.inf
    near = slice(below[0] - 1, below[0] + 1)
    left, right = np.sqrt(np.maximum(power[near], 0))
    return float(np.interp((left - 0.5) / (left - right), (0, 1), frequency[near]))
