"""Information in a picture: Shannon capacity, noise-equivalent quanta, and the ideal observer's SNR.

Domain: linear digital numbers with the black level removed, frequencies in cycles/px. ``power`` is |MTF|²: the
square of an MTF, or a measured power whose noise floor has been subtracted, which may then dip below 0.
All functions are differentiable, NaN in a curve gives NaN for that curve, and all arguments broadcast against
``power``: leading axes are a batch, or resamples of one measurement. So an interval needs nothing more than
``torch.quantile(f(resampled curves), torch.tensor([0.025, 0.975]), dim=0)``.

Convention: a frequency axis rises from 0, and then stands for both signs, or from -1/2 or below; it reaches 1/2
or more. Curves are straight between their frequencies, and cut at 1/2. A two-dimensional power is
(..., Fy, Fx). A transfer function that is not even in fx and fy apart (motion along a diagonal) needs at least
one axis with both signs.

Integrals follow the trapezoidal rule: a region of w px gives its transfer function every 1/w cycles/px, but
its power is only resolved every 1/(2w). Pad the line spread function to twice its length, or more.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import pad

from blurnoise._core import checks
from blurnoise.metrics import values

NYQUIST = 0.5
_LEAST = -0.9  # of S/N, where noise has taken a measured power below 0


def shannon_capacity_radial(
    frequency: Tensor, *, power: Tensor, signal_pp: float | Tensor, noise_variance: float | Tensor
) -> Tensor:
    """Shannon information capacity of an isotropic picture, bits/px: 2π ∫ log2(1 + S/N) f df from 0 to 1/2.

    frequency: (F,), from 0. power: (..., F). signal_pp: peak-to-peak signal, DN. noise_variance: DN² per
    pixel; for noise that is not white, its spectrum at ``frequency``. A value per curve is shaped (..., 1).
    Returns (...). S = (signal_pp MTF)²/12, the variance of amplitudes spread evenly over signal_pp
    (I. N. Lin et al. 2024, Sensors 24(16) 5135, eq. 7; N. Koren, Imatest). The disc of radius 1/2 has an area of
    π/4: :func:`shannon_capacity_square` counts the corners, too, and does not take motion for isotropic.

    Power below 0, where a measurement holds nothing but noise, counts with its sign down to S/N = -0.9: strokes
    up and down then make up for each other, where cutting at 0 would leave the upward ones (an edge at CNR 6
    under 6 px of motion: +20 %). What stays is the logarithm's bend, about -s²/2 for an error s of S/N.
    Without noise the capacity is infinite. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    axis = _axis("frequency", frequency)
    if float(axis[0]) != 0:
        raise ValueError(f"frequency: must start at 0 for a radial integral, got {float(axis[0]):g}")
    bits = _bits(values.real("power", power, dims=1), signal_pp, noise_variance)
    _fits("power", bits, -1, "frequency", axis)
    return _sum(bits, _weights(axis) * axis) * math.pi  # the weights hold both signs


def shannon_capacity_square(
    frequency_x: Tensor,
    frequency_y: Tensor,
    *,
    power: Tensor,
    signal_pp: float | Tensor,
    noise_variance: float | Tensor,
) -> Tensor:
    """Shannon information capacity, bits/px: log2(1 + S/N) over the whole square |fx|, |fy| < 1/2.

    power: (..., Fy, Fx), as :func:`separable` makes it of two edges. Returns (...). Arguments, bias, limits
    and errors as in :func:`shannon_capacity_radial`; a value per curve is shaped (..., 1, 1).
    """
    bits = _bits(values.real("power", power, dims=2), signal_pp, noise_variance)
    return square_integral(frequency_x, frequency_y, bits)


def neq(power: Tensor, *, mean_signal: float | Tensor, noise_power_spectrum: float | Tensor) -> Tensor:
    """Noise-equivalent quanta per pixel, mean_signal² |MTF|² / NPS: the photons an ideal sensor would need.

    mean_signal: DN above black. noise_power_spectrum: DN² px², the variance where noise is white; both, and
    power, broadcast. NEQ(0) is the value at frequency 0, the single number for a whole camera is
    ``square_integral(fx, fy, neq(...))``. Not clipped where ``power`` is below 0: sums stay unbiased. Infinite
    without noise. Source: ICRU report 54; Lin et al., eq. 8, as printed there with N for NPS/mean, gives 1/K.
    """
    power = values.real("power", power)
    signal = values.beside("mean_signal", mean_signal, power) ** 2 * power
    return _ratio(signal, values.not_negative("noise_power_spectrum", noise_power_spectrum, signal))


def ideal_observer_snr(
    difference: Tensor, *, power: float | Tensor, noise_power_spectrum: float | Tensor
) -> Tensor:
    """SNR at which an ideal observer tells two pictures apart: SNR² = ∫∫ |ΔG|² |MTF|² / NPS over the square.

    difference: (..., H, W), what the target adds to the picture before the blur, DN, with a margin for it,
    since the picture counts as periodic. power and noise_power_spectrum (DN² px²): numbers, or (..., H, W) at
    ``torch.fft.fftfreq``'s frequencies (:func:`at` and :func:`separable` bring measured curves there).
    Returns (...), not in dB. A w x w square of height dQ in white noise without blur: dQ w / sigma. Infinite
    without noise. Source: ICRU report 54. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    target = values.real("difference", difference, dims=2)
    density = torch.fft.fft2(target).abs() ** 2
    kept = checks.real_tensor("power", power).to(target.device, torch.float64)
    noise = checks.real_tensor("noise_power_spectrum", noise_power_spectrum).to(target.device, torch.float64)
    for name, spectrum in (("power", kept), ("noise_power_spectrum", noise)):
        if spectrum.ndim >= 2 and any(
            n not in (1, m) for n, m in zip(spectrum.shape[-2:], target.shape[-2:], strict=True)
        ):
            raise ValueError(
                f"{name}: must be a number or end in {tuple(target.shape[-2:])}, got {tuple(spectrum.shape)}"
            )
    kept = values.beside("power", kept, density)
    noise = values.not_negative("noise_power_spectrum", noise, density * kept)
    return _ratio(density * kept, noise).mean((-2, -1)).clamp(min=0).sqrt()  # one clip, after the sum


def square_integral(frequency_x: Tensor, frequency_y: Tensor, density: Tensor) -> Tensor:
    """Integral of ``density`` (..., Fy, Fx) over the square |fx|, |fy| < 1/2, area 1. Returns (...).

    Raises ``TypeError`` or ``ValueError`` for an axis that does not cover the band, or does not fit.
    """
    fx, fy = _axis("frequency_x", frequency_x), _axis("frequency_y", frequency_y)
    density = values.real("density", density, dims=2)
    _fits("density", density, -1, "frequency_x", fx)
    _fits("density", density, -2, "frequency_y", fy)
    return _sum(_sum(density, _weights(fx)), _weights(fy))


def separable(power_x: Tensor, power_y: Tensor) -> Tensor:
    """Two-dimensional power (..., Fy, Fx) of one edge across x (..., Fx) and one across y (..., Fy).

    True for motion along an axis, square pixels and Gaussian spread, not for defocus. Negative power is kept in
    one curve; where both dip below 0 the product does, too.
    """
    x = values.real("power_x", power_x, dims=1)[..., None, :]
    y = values.real("power_y", power_y, dims=1)[..., :, None]
    return torch.where((x < 0) & (y < 0), -x * y, x * y)


def at(frequency: Tensor, power: Tensor, wanted: Tensor) -> Tensor:
    """``power`` (..., F), known at ``frequency`` (F,) from 0 on, at the frequencies ``wanted`` (K,): (..., K).

    Either sign of ``wanted`` reads the same value; straight between the points. Raises ``ValueError`` where
    ``wanted`` lies beyond the curve.
    """
    axis, power = _axis("frequency", frequency), values.real("power", power, dims=1)
    _fits("power", power, -1, "frequency", axis)
    place = values.real("wanted", wanted, dims=1).abs()
    if float(axis[0]) != 0 or not bool((place <= axis[-1]).all()):
        raise ValueError(
            f"wanted: must lie in a curve from 0, here {float(axis[0]):g} to {float(axis[-1]):g}"
        )
    right = torch.searchsorted(axis, place).clamp(1, len(axis) - 1)
    share = (place - axis[right - 1]) / (axis[right] - axis[right - 1])
    return torch.lerp(power[..., right - 1], power[..., right], share)


def _bits(power: Tensor, signal_pp: float | Tensor, noise_variance: float | Tensor) -> Tensor:
    signal = values.beside("signal_pp", signal_pp, power) ** 2 / 12 * power
    noise = values.not_negative("noise_variance", noise_variance, signal)
    return torch.log2(1 + _ratio(signal, noise).clamp(min=_LEAST))


def _ratio(signal: Tensor, noise: Tensor) -> Tensor:
    """signal / noise: infinite where only the noise is 0, and 0 where both are."""
    nothing = (signal == 0) & (noise == 0)
    return torch.where(nothing, 0.0, signal / torch.where(nothing, 1.0, noise))


def _axis(name: str, frequency: Tensor) -> Tensor:
    axis = values.real(name, frequency, dims=1)
    if axis.ndim != 1 or not bool(torch.isfinite(axis).all()) or not bool((axis.diff() > 0).all()):
        raise ValueError(f"{name}: must be one rising axis of finite cycles/px, got {tuple(axis.shape)}")
    first, last = float(axis[0]), float(axis[-1])
    if last < NYQUIST or (first != 0 and first > -NYQUIST):
        raise ValueError(f"{name}: must run from 0 or -1/2 to 1/2 cycles/px, got {first:g} to {last:g}")
    return axis


def _fits(name: str, value: Tensor, dim: int, axis_name: str, axis: Tensor) -> None:
    if value.shape[dim] != len(axis):
        raise ValueError(f"{name}: shape {tuple(value.shape)} does not fit {axis_name}'s {len(axis)} values")


def _weights(axis: Tensor) -> Tensor:
    """Weights whose sum with a curve integrates it over |f| < 1/2: trapezia, those at the ends cut."""
    left, right = axis[:-1], axis[1:]
    start, stop = left.clamp(-NYQUIST, NYQUIST), right.clamp(-NYQUIST, NYQUIST)
    share = ((start + stop) / 2 - left) / (right - left)  # of the right end's value in the middle
    weights = pad((stop - start) * (1 - share), (0, 1)) + pad((stop - start) * share, (1, 0))
    return weights * 2 if float(axis[0]) == 0 else weights


def _sum(curve: Tensor, weights: Tensor) -> Tensor:
    used = weights != 0  # an infinite value outside the band is not there
    return (curve[..., used] * weights[used]).sum(-1)
