"""Bench of the read-out: every way to draw a noisy digital number, time beside distance from the exact law.

Units: electrons (e-), digital numbers (DN). A law is the probability of every digital number. All contenders turn
mean electrons into shot noise, read noise, gain, black level, rounding and limits.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.optics.camera import Camera
from blurnoise.sensor.readout import read_out
from blurnoise_eval.bench.contest import Case, Contender, Contest

MEANS_E = (1.0, 10.0, 100.0, 1000.0)
READ_NOISES_E = (2.44, 0.3)
SHAPE = (8, 3, 512, 512)
BLACK_DN, FULL_SCALE_DN = 32, 65535
Law = NDArray[np.float64]


def noise(*, quick: bool) -> Contest:
    """Ours, PyTorch's and NumPy's Poisson counts, and the plain normal, in the dark and in light."""
    cases = list(product(READ_NOISES_E, MEANS_E))
    shape = (2, 3, 256, 256) if quick else SHAPE
    return Contest(
        "noise", "A noisy digital number", [partial(_case, shape, *each) for each in cases[:4:3] if quick]
        or [partial(_case, shape, *each) for each in cases],
        cost_unit="ns per value", error_unit="total variation",
    )  # fmt: skip


def camera(read_noise_e: float) -> Camera:
    """A camera with this read noise, 1 DN/e- and nothing else."""
    return Camera(
        name="bench", pixel_pitch_um=3.45, f_number=1.4, transmission=1.0, quantum_efficiency=1.0,
        full_well_e=float(FULL_SCALE_DN), system_gain_dn_per_e=1.0, read_noise_e=read_noise_e,
        black_level_dn=float(BLACK_DN), bit_depth=16,
    )  # fmt: skip


def exact_law(mean_e: float, read_noise_e: float) -> Law:
    """P(DN) = sum over n of Poisson(n; mean) P(DN | n), from 0 to full scale."""
    spread = 12 * math.sqrt(mean_e) + 40
    counts = torch.arange(
        max(0, math.floor(mean_e - spread)), math.ceil(mean_e + spread) + 1, dtype=torch.float64
    )
    chances = (counts * math.log(mean_e) - mean_e - torch.lgamma(counts + 1)).exp()
    edges = torch.arange(FULL_SCALE_DN + 2, dtype=torch.float64) - 0.5
    near = slice(0, int(counts[-1]) + BLACK_DN + math.ceil(9 * read_noise_e) + 3)
    below = torch.special.ndtr((edges[near] - BLACK_DN - counts[:, None]) / read_noise_e)
    below[:, 0] = 0.0  # what is lower is clipped to 0
    law = np.zeros(FULL_SCALE_DN + 1)
    law[near.start : near.stop - 1] = (chances[:, None] * below.diff(dim=1)).sum(0).numpy()
    return law


def distance(dn: Tensor, law: Law) -> float:
    """Total variation distance of values' frequencies from a law, less what exact samples of it have on average."""
    share = np.bincount(dn.numpy().astype(np.int64).ravel(), minlength=len(law)) / dn.numel()
    # E|X/n - p| of a binomial share: 2 p (1 - p)^n below one sample on average, beyond as of a normal
    few, many = 2 * law * (1 - law) ** dn.numel(), np.sqrt(2 * law * (1 - law) / (math.pi * dn.numel()))
    spread = np.where(law * dn.numel() < 1, few, many)
    return max(0.0, float(0.5 * (np.abs(share - law).sum() - spread.sum())))


def _case(shape: tuple[int, ...], read_noise_e: float, mean_e: float) -> Case:
    means, cam, law = torch.full(shape, mean_e), camera(read_noise_e), exact_law(mean_e, read_noise_e)
    seeds = range(shape[0])

    def normal(deviation: float) -> Tensor:
        return deviation * torch.randn(shape)

    ours = partial(read_out, means, cam, exposure_s=0.0, temperature_c=20.0, generator=seeds)
    ways = [
        Contender("blurnoise, auto", ours, True),
        Contender("blurnoise, full", partial(ours, fidelity="full"), True),
        Contender(
            "torch.poisson + normal",
            lambda: _digital(torch.poisson(means) + read_noise_e * torch.randn(shape)),
        ),
        Contender("numpy poisson + normal", partial(_numpy, means, read_noise_e)),
        Contender(
            "one plain normal", lambda: _digital(means + normal(math.hypot(mean_e**0.5, read_noise_e)))
        ),
    ]
    name = f"{mean_e:g} e-, read noise {read_noise_e:g} e-"
    return Case(name, ways, lambda dn: distance(dn, law), units=means.numel() / 1e6)


def _numpy(means: Tensor, read_noise_e: float) -> Tensor:
    generator = np.random.default_rng(1)
    electrons = generator.poisson(means.numpy()) + read_noise_e * generator.standard_normal(
        means.shape, np.float32
    )
    return _digital(torch.from_numpy(electrons.astype(np.float32)))


def _digital(electrons: Tensor) -> Tensor:
    return electrons.add_(BLACK_DN).round_().clamp_(0, FULL_SCALE_DN)
