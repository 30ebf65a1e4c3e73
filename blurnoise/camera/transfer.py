"""One closed-form transfer function per cause of blur; causes that act one after another multiply.

Convention: frequencies in cycles/px, fx to the right and fy down; a function of ``f`` is round and takes the
radial frequency. All are real (no cause here moves the picture), 1 at frequency 0, for any shape of input.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Annotated, Literal

import torch
from annotated_types import Ge, Le
from torch import Tensor

from blurnoise._core.checks import limited
from blurnoise._core.fields import Figure, check_fields
from blurnoise._core.threads import differentiable
from blurnoise.camera.spectra import check_samples


def motion(fx: Tensor, fy: Tensor, displacement_px: Tensor) -> Tensor:
    """Uniform straight motion: sinc(f . d). displacement_px: (..., 2), (x, y); returns (..., *f's shape).

    Differentiable in the displacement, at rest too. MTF50 at 0.603355 / (length cos(angle to f)).

    >>> motion(torch.tensor(0.1), torch.tensor(0.0), torch.tensor([6.03355, 0.0]))
    tensor([[0.5000]])
    """
    dx, dy = displacement_px[..., 0, None, None], displacement_px[..., 1, None, None]
    return sinc(fx * dx + fy * dy)


_MOST_LOST = 1.2173  # 1 - sinc at the sinc's minimum
_LEFT = 0.05  # modulation at which a curve may end below the Nyquist frequency


def motion_error(dx_px: float, dy_px: float) -> float:
    """RMS error, in units of white, of leaving a motion out: a bound for any picture within [0, 1].

    1 - sinc(f . d) is at most (pi f . d)^2 / 6, and f . d at most (|dx| + |dy|) / 2, that of a checkerboard of 1/2
    RMS.

    >>> round(motion_error(0.1, 0.0), 4)
    0.0021
    """
    return min(_MOST_LOST, (math.pi * (abs(dx_px) + abs(dy_px)) / 2) ** 2 / 6) / 2


def motion_variation_error(difference_px: float) -> float:
    """RMS error, in units of white, of one motion where displacements differ from it by up to difference_px.

    |sinc(f . d) - sinc(f . d0)| is at most 1.3703 |f . (d - d0)|, the sinc's steepest slope, and f at most 1 /
    sqrt(2), that of a checkerboard of 1/2 RMS.

    >>> round(motion_variation_error(0.01), 4)  # displacements that differ by 0.01 px
    0.0048
    """
    return min(_MOST_LOST, 1.3703 / math.sqrt(2) * difference_px) / 2


def disc(f: Tensor, radius_px: float) -> Tensor:
    """Defocus of a round aperture, 2 J1(2 pi R f) / (2 pi R f). MTF50 at 0.352542 / R, first 0 at 0.609835 / R.

    >>> disc(torch.tensor([0.0, 0.352542]), 1.0)
    tensor([1.0000, 0.5000])
    """
    x = (2 * math.pi * radius_px * f).abs().clamp_min(1e-20)
    # Near 0 the quotient loses digits; the next term of the series, x^4 / 192, is below 1e-18 there.
    return torch.where(x < 1e-4, 1 - x * x / 8, 2 * torch.special.bessel_j1(x) / x)


def gaussian(f: Tensor, sigma_px: float) -> Tensor:
    """Gaussian spread, exp(-2 pi^2 sigma^2 f^2). MTF50 at 0.187391 / sigma.

    >>> gaussian(torch.tensor([0.187391]), 1.0)
    tensor([0.5000])
    """
    return torch.exp(-2 * (math.pi * sigma_px * f) ** 2)


def diffraction(f: Tensor, lambda_n_px: float) -> Tensor:
    """Aberration-free round aperture in incoherent light, 0 from 1 / lambda_n_px on. MTF50 at 0.403973 of that.

    lambda_n_px: wavelength times f-number over pixel pitch, 0.55 * 2.8 / 3.45 = 0.446 px for a green f/2.8.

    >>> diffraction(torch.tensor([0.403973, 1.0]), 1.0)
    tensor([0.5000, 0.0000])
    """
    x = (f * lambda_n_px).abs().clamp_max(1.0)
    return (torch.acos(x) - x * torch.sqrt(1 - x * x)) * (2 / math.pi)


def pixel(fx: Tensor, fy: Tensor) -> Tensor:
    """Square pixel of full fill factor, sinc(fx) sinc(fy); a sampled picture has been through it once.

    >>> pixel(torch.tensor(0.5), torch.tensor(0.0))
    tensor(0.6366)
    """
    return sinc(fx) * sinc(fy)


def sinc(x: Tensor) -> Tensor:
    """Normalised sinc, sin(pi x) / (pi x).

    >>> sinc(torch.tensor([0.0, 0.5]))
    tensor([1.0000, 0.6366])
    """
    if differentiable(x):
        return torch.sinc(x)
    # The addend avoids 0 / 0 and is lost elsewhere; torch.sinc, which has a mask for it, takes ten times as long.
    phase = (x * math.pi).add_(1e-30)
    return torch.sin(phase).div_(phase)


@dataclass(frozen=True)
class Mtf:
    """A measured, radial MTF of the lens without the pixel: modulation, 0 to 1, at frequencies, linear between.

    frequencies: increasing; at 0 it is 1, beyond the last its value holds. Raises ``TypeError`` or ``ValueError``.

    >>> Mtf((20.0, 160.0), (0.9, 0.1), "lp/mm").per_px(3.45)
    Mtf(frequencies=(0.0, 0.069, 0.552), values=(1.0, 0.9, 0.1), unit='cycles/px')
    """

    frequencies: tuple[float, ...]
    values: tuple[Annotated[Figure, Ge(0), Le(1)], ...]
    unit: Literal["cycles/px", "lp/mm"]

    def __post_init__(self) -> None:
        check_fields(self)
        check_samples("frequencies", self.frequencies, self.values)
        if self.frequencies[0] == 0 and abs(self.values[0] - 1) > 1e-3:
            raise ValueError(f"values: must be 1 at frequency 0, got {self.values[0]:g}")

    def per_px(self, pixel_pitch_um: float) -> Mtf:
        """The MTF over cycles/px, from 0 on. Raises ``ValueError`` if it ends below the Nyquist frequency."""
        per_unit = 1.0 if self.unit == "cycles/px" else pixel_pitch_um / 1e3
        frequencies = tuple(each * per_unit for each in self.frequencies)
        if frequencies[-1] < 0.5 and self.values[-1] > _LEFT:
            must = f"must reach 0.5 cycles/px ({0.5 / per_unit:g} {self.unit}) or a value of {_LEFT:g}"
            end = f"end at {self.frequencies[-1]:g} {self.unit} with {self.values[-1]:g}"
            raise ValueError(f"lens.mtf: frequencies: {must}, {end}")
        first = () if frequencies[0] == 0 else (0.0,)
        return Mtf((*first, *frequencies), (1.0, *self.values[1 - len(first) :]), "cycles/px")

    def at(self, f: Tensor) -> Tensor:
        """Its values at radial frequencies f >= 0, cycles/px, of any shape."""
        known, values = f.new_tensor(self.frequencies), f.new_tensor(self.values)
        index = torch.searchsorted(known, f.contiguous(), right=True).clamp(1, len(known) - 1)
        before, after = known[index - 1], known[index]
        share = ((f - before) / (after - before)).clamp(0, 1)
        return torch.lerp(values[index - 1], values[index], share)

    @property
    def lost(self) -> float:
        """Largest loss of modulation, 1 - value, in the band of a sampled picture, corners included."""
        f = torch.arange(129, dtype=torch.float64) / 256
        return float((1 - self.at(torch.hypot(f, f[:, None]))).abs().max())


@lru_cache(maxsize=16)
def _reach_px(curve: Mtf) -> float:
    """Radius outside which the spread is 1e-4 RMS of white, in white noise."""
    f = torch.fft.fftfreq(256, dtype=torch.float64)
    spread = torch.fft.irfft2(curve.at(torch.hypot(f[:, None], f[:129].abs())), s=(256, 256))
    radius = torch.hypot(f[:, None] * 256, f * 256).flatten()
    # From the outside in, until the light that is cut off would show.
    order = radius.argsort(descending=True)
    outside = spread.flatten()[order].square().cumsum(0).sqrt() / 2
    return float(radius[order][int((outside <= 1e-4).sum().clamp_max(len(order) - 1))])


@dataclass(frozen=True)
class Optics:
    """The lens's blur, in px; 0 or None leaves a cause out.

    defocus_radius_px: of the disc of confusion. gaussian_sigma_px: aberrations and other small spreads.
    diffraction_lambda_n_px: wavelength times f-number over pixel pitch. Raises ``ValueError`` below 0 or above 1000.

    >>> Optics(defocus_radius_px=1.0).response(torch.tensor(0.352542), torch.tensor(0.0))
    tensor(0.5000)
    """

    defocus_radius_px: float = 0.0
    gaussian_sigma_px: float = 0.0
    diffraction_lambda_n_px: float = 0.0
    measured: Mtf | None = None

    def __post_init__(self) -> None:
        for field in fields(self)[:3]:
            limited(field.name, getattr(self, field.name))

    @property
    def reach_px(self) -> float:
        """Radius outside which the spread is too faint to matter: the disc, 5 sigma, 8 Airy radii."""
        airy = 8 * 1.22 * self.diffraction_lambda_n_px
        measured = _reach_px(self.measured) if self.measured else 0.0
        return self.defocus_radius_px + 5 * self.gaussian_sigma_px + airy + measured

    @property
    def error(self) -> float:
        """RMS error, in units of white, of leaving the lens out: a bound for any picture within [0, 1].

        That of a checkerboard of 1/2 RMS, f^2 = 1/2, where 1 - OTF is at most (pi R f)^2 / 2 for the disc,
        2 (pi sigma f)^2 for the Gaussian and (4/pi) lambda N f for diffraction.
        """
        squares = (math.pi * self.defocus_radius_px) ** 2 / 2 + 2 * (math.pi * self.gaussian_sigma_px) ** 2
        lost = squares / 2 + 4 / math.pi * self.diffraction_lambda_n_px / math.sqrt(2)
        lost += self.measured.lost if self.measured else 0.0
        return min(_MOST_LOST, lost) / 2

    def response(self, fx: Tensor, fy: Tensor) -> Tensor:
        """Product of the causes' transfer functions at fx and fy, cycles/px."""
        f = torch.hypot(fx, fy)
        total = torch.ones_like(f)
        figures = self.defocus_radius_px, self.gaussian_sigma_px, self.diffraction_lambda_n_px
        for transfer, figure in zip((disc, gaussian, diffraction), figures, strict=True):
            if figure:
                total = total * transfer(f, figure)
        return total * self.measured.at(f) if self.measured else total


SHARP = Optics()
"""A lens that adds nothing."""
