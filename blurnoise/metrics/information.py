"""Information in pictures and slanted edges: Shannon capacity, noise-equivalent quanta, ideal observer's SNR.

Domain: linear digital numbers with the black level removed, frequencies in cycles/px. ``power`` is |MTF|²; where it
is measured, its noise floor has been subtracted, and it may dip below 0.

Functions of curves are differentiable and broadcast against ``power``; NaN in a curve gives NaN. A frequency axis
rises from 0 to 1/2 or beyond and represents both signs. Integrals are trapezoidal and end at 1/2. Power is resolved
every 1/(2w) cycles/px only, so pad a line spread function to at least twice its length.

Functions of edges take measurements by :func:`blurnoise.metrics.slanted_edge` with a bootstrap, and return 95 %
intervals. They assume white noise; if it significantly is not, NEQ(0) uses its power at frequency 0, and the flag is
"noise_not_white". Noise biases log2(1 + S/N) of power clipped at 0 (+53 % for 20 px of motion at CNR 20). Resamples
contain the noise twice, so the bias of their mean C* is twice that of the plain C: the value is 2C - C* (bias 1 %),
at least 0, and the interval is theirs, shifted to it.

All raise ``TypeError`` or ``ValueError`` that names the argument.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from blurnoise._core import checks
from blurnoise.metrics import values
from blurnoise.metrics.edge.measurement import Resamples, SlantedEdge
from blurnoise.metrics.values import Estimate

Number = float | Tensor
NOT_WHITE = "noise_not_white"
NYQUIST = 0.5
_LEAST = -0.9  # of S/N: noise can make a measured power negative, and log2(1 + S/N) needs S/N > -1
_GRID = torch.arange(129, dtype=torch.float64) / 256
"""Cycles/px of both axes of two-dimensional integrals: half the step that 128 px resolve."""
# A quantile of 2.5 % needs about 40; each takes a plane of 129 x 129 frequencies.
_RESAMPLES_2D = 60
# As large as targets get, the limit of target_px.
_CANVAS_PX = 128


def shannon_capacity_radial(
    frequency: Tensor, *, power: Tensor, signal_pp: Number, noise_variance: Number
) -> Tensor:
    """Shannon information capacity of an isotropic picture, bits/px: 2π ∫ log2(1 + S/N) f df from 0 to 1/2.

    frequency: (F,), from 0. power: (..., F). signal_pp: peak-to-peak signal, DN. noise_variance: DN² per pixel, or
    the noise's spectrum at ``frequency``. A value per curve is shaped (..., 1). S = (signal_pp MTF)²/12
    of amplitudes spread evenly over signal_pp (I. N. Lin et al. 2024, Sensors 24(16) 5135, eq. 7; N. Koren, Imatest).
    The disc's area is π/4: :func:`shannon_capacity_square` counts the corners, too. Power below 0 counts with its
    sign down to S/N = -0.9, so that noise averages out. Infinite without noise.

    >>> f, perfect = torch.linspace(0, 0.5, 65), torch.ones(65)
    >>> shannon_capacity_radial(f, power=perfect, signal_pp=math.sqrt(12), noise_variance=1.0)  # 1 bit x pi/4
    tensor(0.7854, dtype=torch.float64)
    """
    bits = _bits(values.real("power", power, dims=1), signal_pp, noise_variance)
    axis = _axis("frequency", frequency, bits.shape[-1])
    return _sum(bits, _weights(axis) * axis) * math.pi  # the weights hold both signs


def shannon_capacity_square(
    frequency_x: Tensor, frequency_y: Tensor, *, power: Tensor, signal_pp: Number, noise_variance: Number
) -> Tensor:
    """Shannon information capacity, bits/px: log2(1 + S/N) over the whole square |fx|, |fy| < 1/2.

    power: (..., Fy, Fx); a value per curve is shaped (..., 1, 1). The rest as in :func:`shannon_capacity_radial`.

    >>> f, perfect = torch.linspace(0, 0.5, 65), torch.ones(65, 65)
    >>> shannon_capacity_square(f, f, power=perfect, signal_pp=math.sqrt(12), noise_variance=1.0)
    tensor(1., dtype=torch.float64)
    """
    bits = _bits(values.real("power", power, dims=2), signal_pp, noise_variance)
    return square_integral(frequency_x, frequency_y, bits)


def neq(power: Tensor, *, mean_signal: Number, noise_power_spectrum: Number) -> Tensor:
    """Noise-equivalent quanta per pixel, mean_signal² |MTF|² / NPS: the photons an ideal sensor would need.

    mean_signal: DN above black. noise_power_spectrum: DN² px², the variance where noise is white. Negative where
    ``power`` is, infinite without noise. Source: ICRU report 54; Lin et al., eq. 8, as printed, gives 1/K.

    >>> neq(torch.tensor([1.0, 0.25]), mean_signal=100.0, noise_power_spectrum=100.0)
    tensor([100.,  25.], dtype=torch.float64)
    """
    power = values.real("power", power)
    signal = values.beside("mean_signal", mean_signal, power) ** 2 * power
    return _ratio(signal, values.beside("noise_power_spectrum", noise_power_spectrum, signal, low=0))


def ideal_observer_snr(difference: Tensor, *, power: Number, noise_power_spectrum: Number) -> Tensor:
    """SNR at which an ideal observer tells two pictures apart: SNR² = ∫∫ |ΔG|² |MTF|² / NPS over the square.

    difference: (..., H, W), what the target adds to the picture before the blur, DN, with a margin: it is periodic.
    power and noise_power_spectrum (DN² px²): numbers, or (..., H, W) at ``torch.fft.fftfreq``'s frequencies. Returns
    (...), a ratio: of a w x w square of height dQ in white noise dQ w / sigma. Source: ICRU report 54.

    >>> square = torch.zeros(16, 16)
    >>> square[4:8, 4:8] = 5.0
    >>> ideal_observer_snr(square, power=1.0, noise_power_spectrum=4.0)  # 5 x 4 px / 2
    tensor(10., dtype=torch.float64)
    """
    target = values.real("difference", difference, dims=2)
    density = torch.fft.fft2(target).abs() ** 2
    signal = density * values.beside("power", power, density)
    noise = values.beside("noise_power_spectrum", noise_power_spectrum, signal, low=0)
    squared = _ratio(signal, noise)
    if squared.shape[-2:] != target.shape[-2:]:
        raise ValueError(
            f"power, noise_power_spectrum: must be numbers or end in {tuple(target.shape[-2:])}, "
            f"got {tuple(signal.shape)} and {tuple(noise.shape)}"
        )
    return squared.mean((-2, -1)).clamp(min=0).sqrt()  # clipped after the sum, where noise has averaged out


def square_integral(frequency_x: Tensor, frequency_y: Tensor, density: Tensor) -> Tensor:
    """Integral of ``density`` (..., Fy, Fx) over the square |fx|, |fy| < 1/2, area 1. Returns (...).

    >>> f = torch.linspace(0, 0.5, 65)
    >>> float(square_integral(f, f, torch.full((65, 65), 3.0)))  # the square has the area 1
    3.0
    """
    density = values.real("density", density, dims=2)
    fx = _axis("frequency_x", frequency_x, density.shape[-1])
    fy = _axis("frequency_y", frequency_y, density.shape[-2])
    return _sum(_sum(density, _weights(fx)), _weights(fy))


def capacity_radial(edge: SlantedEdge) -> Estimate:
    """:func:`shannon_capacity_radial` of an edge, bits/px; exact for isotropic blur.

    >>> from blurnoise import charts, slanted_edge
    >>> noise = 10 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0))
    >>> edge = slanted_edge(1000 * charts.slanted_edge(60, 60)[0] + noise, full_scale=2000.0, bootstrap=20)
    >>> bits = capacity_radial(edge)  # bits/px, below those without blur: pi/4 log2(1 + 700^2 / 12 / 10^2)
    >>> 2.0 < bits.low < bits.high < math.pi / 4 * math.log2(1 + 700**2 / 12 / 10**2)
    True
    """

    def bits(at: _EdgeDraws) -> Tensor:
        power = at.power.clamp_min(0)
        return shannon_capacity_radial(
            edge.frequencies, power=power, signal_pp=at.step, noise_variance=at.noise
        )

    return _estimate(bits, None, edge=edge)


def capacity_square(across_x: SlantedEdge, across_y: SlantedEdge) -> Estimate:
    """:func:`shannon_capacity_square` of two edges, bits/px, of blur that is separable in x and y.

    Motion along an axis, square pixels and Gaussian spread are separable, defocus is not.

    >>> from blurnoise import charts, slanted_edge
    >>> noise = 10 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0))
    >>> picture = 1000 * charts.slanted_edge(60, 60)[0] + noise
    >>> edges = slanted_edge(torch.stack([picture, picture.mT]), full_scale=2000.0, bootstrap=20)
    >>> capacity_square(*edges).value > capacity_radial(edges[0]).value  # the corners count, too
    True
    """

    def bits(at: _EdgeDraws) -> Tensor:
        power = at.power.clamp_min(0)
        return shannon_capacity_square(_GRID, _GRID, power=power, signal_pp=at.step, noise_variance=at.noise)

    return _estimate(bits, _GRID, across_x=across_x, across_y=across_y)


def neq_0(edge: SlantedEdge) -> Estimate:
    """Noise-equivalent quanta of the bright side at frequency 0: its squared signal-to-noise ratio.

    >>> from blurnoise import charts, slanted_edge
    >>> noise = 10 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0))
    >>> edge = slanted_edge(1000 * charts.slanted_edge(60, 60)[0] + noise, full_scale=2000.0, bootstrap=50)
    >>> quanta = neq_0(edge)  # of the bright side, (800 / 10)^2
    >>> quanta.low < 6400 < quanta.high
    True
    """
    checks.an_instance("edge", edge, SlantedEdge)
    if math.isnan(edge.bright) or edge.resamples is None:
        return Estimate(math.nan, flags=_flags(edge))
    if edge.noise_variance_bright <= 0:
        return Estimate(math.nan, flags=frozenset({"noiseless"}))
    drawn = edge.resamples.bright**2 / (edge.resamples.noise_variance_bright * edge.noise_power_at_0)
    value = edge.bright**2 / (edge.noise_variance_bright * edge.noise_power_at_0)
    return Estimate(value, *_interval(drawn), _flags(edge))


def neq_integral(across_x: SlantedEdge, across_y: SlantedEdge) -> Estimate:
    """:func:`neq` of the bright side, integrated over the square of frequencies, quanta per pixel.

    >>> from blurnoise import charts, slanted_edge
    >>> noise = 10 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0))
    >>> picture = 1000 * charts.slanted_edge(60, 60)[0] + noise
    >>> edges = slanted_edge(torch.stack([picture, picture.mT]), full_scale=2000.0, bootstrap=20)
    >>> neq_integral(*edges).value < neq_0(edges[0]).value  # the pixel's own blur costs some
    True
    """

    def quanta(at: _EdgeDraws) -> Tensor:
        density = neq(at.power, mean_signal=at.bright, noise_power_spectrum=at.noise_bright)
        return square_integral(_GRID, _GRID, density)

    return _estimate(quanta, _GRID, across_x=across_x, across_y=across_y)


def square_snr(across_x: SlantedEdge, across_y: SlantedEdge, *, side_px: int) -> Estimate:
    """:func:`ideal_observer_snr` (a ratio) of a square of ``side_px`` as bright as one side, on the other.

    >>> from blurnoise import charts, slanted_edge
    >>> noise = 10 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0))
    >>> picture = 1000 * charts.slanted_edge(60, 60)[0] + noise
    >>> edges = slanted_edge(torch.stack([picture, picture.mT]), full_scale=2000.0, bootstrap=20)
    >>> snr = square_snr(*edges, side_px=10).value  # at most 700 DN x 10 px / 10 DN
    >>> 600 < snr < 700
    True
    """
    checks.counted("side_px", side_px, "target_px")
    target = torch.zeros(_CANVAS_PX, _CANVAS_PX, dtype=torch.float64)
    target[:side_px, :side_px] = 1
    grid = torch.fft.fftfreq(_CANVAS_PX, dtype=torch.float64)

    def ratio(at: _EdgeDraws) -> Tensor:
        snr = ideal_observer_snr(target, power=at.power, noise_power_spectrum=1.0)
        return snr * (at.step / at.noise.sqrt()).flatten()

    return _estimate(ratio, grid, across_x=across_x, across_y=across_y)


class _EdgeDraws(NamedTuple):
    """n draws of one edge, power (n, F), or of two on a grid, (n, K, K), and their mean levels beside it."""

    power: Tensor
    step: Tensor
    noise: Tensor
    bright: Tensor
    noise_bright: Tensor


def _draws(
    edges: list[SlantedEdge], sources: Sequence[SlantedEdge | Resamples], grid: Tensor | None
) -> _EdgeDraws:
    """The sources' numbers; the sources are the edges themselves, one draw, or their resamples."""
    curves, levels = [], []
    for edge, source in zip(edges, sources, strict=True):
        power, *level = (
            torch.as_tensor(getattr(source, each.name), dtype=torch.float64) for each in fields(Resamples)
        )
        power = power.reshape(-1, len(edge.frequencies))
        curves.append(power if grid is None else _at(edge.frequencies, power[:_RESAMPLES_2D], grid))
        levels.append(torch.stack([each.reshape(-1)[: len(curves[0])] for each in level]))
    power = curves[0] if grid is None else _separable(*curves)
    beside_power = (4, -1, *[1] * (power.ndim - 1))
    dark, bright, noise_dark, noise_bright = torch.stack(levels).mean(0).view(beside_power)
    return _EdgeDraws(power, bright - dark, (noise_dark + noise_bright) / 2, bright, noise_bright)


def _at(frequency: Tensor, power: Tensor, wanted: Tensor) -> Tensor:
    """``power`` (n, F) at ``frequency`` (F,), from 0, interpolated at ``wanted`` (K,), either sign: (n, K)."""
    magnitude = wanted.abs()
    right = torch.searchsorted(frequency, magnitude).clamp(1, len(frequency) - 1)
    share = (magnitude - frequency[right - 1]) / (frequency[right] - frequency[right - 1])
    return torch.lerp(power[:, right - 1], power[:, right], share)


def _separable(power_x: Tensor, power_y: Tensor) -> Tensor:
    """Power (n, Fy, Fx) of an edge across x (n, Fx) and one across y (n, Fy), negative where either is."""
    x, y = power_x[:, None, :], power_y[:, :, None]
    return torch.where((x < 0) & (y < 0), -x * y, x * y)


def _estimate(number: Callable[[_EdgeDraws], Tensor], grid: Tensor | None, **named: SlantedEdge) -> Estimate:
    for name, edge in named.items():
        checks.an_instance(name, edge, SlantedEdge)
    edges = list(named.values())
    flags = _flags(*edges)
    if any(math.isnan(edge.bright) for edge in edges):
        return Estimate(math.nan, flags=flags)
    resamples = [edge.resamples for edge in edges if edge.resamples is not None]
    if len(resamples) < len(edges):
        raise ValueError("edge: must be measured with bootstrap > 0, for the interval")
    plain, drawn = float(number(_draws(edges, edges, grid))[0]), number(_draws(edges, resamples, grid))
    if not (math.isfinite(plain) and bool(torch.isfinite(drawn).all())):  # infinite without noise
        return Estimate(math.nan, flags=flags | {"noiseless"})
    value, (low, high) = 2 * plain - float(drawn.mean()), _interval(drawn - drawn.mean())
    return Estimate(max(0.0, value), max(0.0, value + low), max(0.0, value + high), flags)


def _interval(drawn: Tensor) -> tuple[float, float]:
    low, high = torch.quantile(drawn, torch.tensor([0.025, 0.975], dtype=drawn.dtype)).tolist()
    return low, high


def _flags(*edges: SlantedEdge) -> frozenset[str]:
    """The edges' flags, and one if their noise is not white (an edge without numbers has NaN, which raises none)."""
    coloured = {NOT_WHITE for edge in edges if abs(edge.noise_power_at_0 - 1) > 0}
    return frozenset(coloured | {flag.name.lower() for edge in edges for flag in edge.flags})


def _bits(power: Tensor, signal_pp: Number, noise_variance: Number) -> Tensor:
    signal = values.beside("signal_pp", signal_pp, power) ** 2 / 12 * power
    noise = values.beside("noise_variance", noise_variance, signal, low=0)
    return torch.log2(1 + _ratio(signal, noise).clamp(min=_LEAST))


def _ratio(signal: Tensor, noise: Tensor) -> Tensor:
    """signal / noise: infinite where only the noise is 0, and 0 where both are."""
    nothing = (signal == 0) & (noise == 0)
    return torch.where(nothing, 0.0, signal / torch.where(nothing, 1.0, noise))


def _axis(name: str, frequency: Tensor, count: int) -> Tensor:
    axis = values.real(name, frequency, dims=1)
    rising = axis.shape == (count,) and float(axis[0]) == 0 and bool((axis.diff() > 0).all())
    if not rising or not NYQUIST <= float(axis[-1]) < math.inf:
        must = f"must be {count} frequencies that rise from 0 to 1/2 cycles/px or beyond"
        raise ValueError(f"{name} = {checks.shown(axis)}: {must}")
    return axis


def _weights(axis: Tensor) -> Tensor:
    """Weights whose sum with a curve integrates it over |f| < 1/2: trapezia, those at the ends cut."""
    # Each trapezium weighs its two ends; one that 1/2 cuts weighs them by the line between them.
    left, right = axis[:-1], axis[1:]
    start, stop = left.clamp(-NYQUIST, NYQUIST), right.clamp(-NYQUIST, NYQUIST)
    share = ((start + stop) / 2 - left) / (right - left)  # of the right end's value in the middle
    weights = pad((stop - start) * (1 - share), (0, 1)) + pad((stop - start) * share, (1, 0))
    return weights * 2


def _sum(curve: Tensor, weights: Tensor) -> Tensor:
    used = weights != 0  # so that infinite values outside the band do not count
    return (curve[..., used] * weights[used]).sum(-1)
