"""Samplers of a noisy digital number that the bench compares: our two, and what else one might write.

All do the same work: mean electrons (B, C, H, W) float32 to shot noise, read noise, gain, black level,
rounding and the converter's limits, those of ``laws.Converter``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from blurnoise.optics.camera import Camera
from blurnoise.sensor import readout as sensor
from blurnoise.sensor.stage import MERGE_READ_NOISE_E
from blurnoise_eval.bench import laws
from blurnoise_eval.bench.laws import Converter, Law

Draw = Callable[[Tensor, Converter], Tensor]
Integrate = Callable[[Tensor, Converter, Tensor], Law]


@dataclass(frozen=True)
class Sampler:
    """One way to draw. ``law`` integrates it over N(0, 1) values of equal weight, where one decides a count."""

    name: str
    about: str
    draw: Draw
    law: Integrate | None = None
    ours: bool = False


def samplers() -> list[Sampler]:
    """Ours first."""
    full = "sensor.read_out(fidelity='full'): torch.poisson and a normal"
    return [
        Sampler("auto", "sensor.read_out(fidelity='auto')", _auto, _auto_law, True),
        Sampler("full", full, _full, ours=True),
        Sampler("torch.poisson", "torch.poisson(mean) + read * normal", _torch),
        Sampler("numpy poisson", "numpy.random.Generator.poisson(mean) + read * normal", _numpy),
        Sampler("plain normal", "mean + sqrt(mean + read^2) * normal", _plain, _plain_law),
    ]


def camera(converter: Converter) -> Camera:
    """Our camera with this converter and nothing else."""
    return Camera(
        name="bench",
        pixel_pitch_um=3.45,
        f_number=1.4,
        transmission=1.0,
        quantum_efficiency=1.0,
        full_well_e=converter.full_scale_dn / converter.gain_dn_per_e,
        system_gain_dn_per_e=converter.gain_dn_per_e,
        read_noise_e=converter.read_noise_e,
        black_level_dn=converter.black_dn,
        bit_depth=converter.full_scale_dn.bit_length(),
    )


def equal_chances(shape: tuple[int, ...]) -> Tensor:
    """The normal's quantiles at the middles of equal steps of probability, float32."""
    count = math.prod(shape)
    levels = (torch.arange(count, dtype=torch.float64) + 0.5) / count
    quantiles: Tensor = torch.special.ndtri(levels)
    return quantiles.float().reshape(shape)


def _auto(mean_e: Tensor, converter: Converter, normal: Tensor | None = None) -> Tensor:
    drawn: dict[str, Any] = (
        {} if normal is None else {"draw": lambda seeds, like, stream: normal[list(seeds)]}
    )
    return sensor.read_out(
        mean_e, camera(converter), exposure_s=0.0, temperature_c=20.0, generator=range(len(mean_e)), **drawn
    )  # fmt: skip


def _full(mean_e: Tensor, converter: Converter) -> Tensor:
    return sensor.read_out(
        mean_e, camera(converter), exposure_s=0.0, temperature_c=20.0, generator=range(len(mean_e)), fidelity="full"
    )  # fmt: skip


def _auto_law(mean_e: Tensor, converter: Converter, normal: Tensor) -> Law:
    """Where counts are drawn apart, the law of a camera without read noise meets the exact read noise."""
    if converter.read_noise_e >= MERGE_READ_NOISE_E:
        return laws.of_values(_auto(mean_e, converter, normal).numpy(), converter.full_scale_dn)
    counting = Converter(read_noise_e=0.0, black_dn=0.0)
    counts = laws.of_values(_auto(mean_e, counting, normal).numpy(), counting.full_scale_dn)
    return laws.read_out(np.arange(len(counts)), counts, converter)


def _torch(mean_e: Tensor, converter: Converter) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    counts = torch.poisson(mean_e, generator=generator)
    read = torch.randn(mean_e.shape, generator=generator)
    return _digital(counts.add_(read, alpha=converter.read_noise_e), converter)


def _numpy(mean_e: Tensor, converter: Converter) -> Tensor:
    generator = np.random.default_rng(1)
    electrons = generator.standard_normal(mean_e.shape, dtype=np.float32)
    electrons *= converter.read_noise_e
    electrons += generator.poisson(mean_e.numpy())
    return _digital(torch.from_numpy(electrons), converter)


def _plain(mean_e: Tensor, converter: Converter) -> Tensor:
    return _normal(mean_e, converter, torch.randn(mean_e.shape, generator=torch.Generator().manual_seed(1)))


def _plain_law(mean_e: Tensor, converter: Converter, normal: Tensor) -> Law:
    return laws.of_values(_normal(mean_e, converter, normal.clone()).numpy(), converter.full_scale_dn)


def _normal(mean_e: Tensor, converter: Converter, normal: Tensor) -> Tensor:
    spread = (mean_e + converter.read_noise_e**2).sqrt_()
    return _digital(normal.mul_(spread).add_(mean_e), converter)


def _digital(electrons: Tensor, converter: Converter) -> Tensor:
    dn = electrons.mul_(converter.gain_dn_per_e).add_(converter.black_dn)
    return dn.round_().clamp_(0, converter.full_scale_dn)
