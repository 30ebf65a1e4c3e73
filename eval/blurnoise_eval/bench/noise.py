"""Bench of the read-out: ways to draw a noisy digital number, time beside distance from the exact law.

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

from blurnoise.camera import Camera
from blurnoise.camera.lens import Lens
from blurnoise.camera.sensor import Sensor
from blurnoise.sensor.readout import read_out
from blurnoise_eval.bench.contest import Case, Contender, Contest

MEANS_E = (1.0, 10.0, 100.0, 1000.0)
READ_NOISES_E = (2.44, 0.3)
BLACK_DN, FULL_SCALE_DN = 32, 65535
_CAMERA = Camera(
    "bench",
    Lens(f_number=1.4, transmission=1.0),
    Sensor(
        3.45, 1.0, float(FULL_SCALE_DN), 1.0, read_noise_e=2.44, black_level_dn=float(BLACK_DN), bit_depth=16
    ),
)
Law = NDArray[np.float64]


def noise(*, quick: bool) -> Contest:
    """Ours, PyTorch's Poisson counts, and the plain normal, in the dark and in light."""
    shape = (2, 3, 256, 256) if quick else (8, 3, 512, 512)
    cases = [partial(_case, shape, *each) for each in product(READ_NOISES_E, MEANS_E)]
    return Contest(
        "noise", "A noisy digital number", cases[:4:3] if quick else cases,
        cost_unit="ns per value", error_unit="total variation",
    )  # fmt: skip


def exact_law(mean_e: float, read_noise_e: float) -> Law:
    """P(DN) = sum over n of Poisson(n; mean) P(DN | n), from 0 to full scale."""
    spread = 12 * math.sqrt(mean_e) + 40
    first, last = max(0, math.floor(mean_e - spread)), math.ceil(mean_e + spread)
    counts = torch.arange(first, last + 1, dtype=torch.float64)
    chances = (counts * math.log(mean_e) - mean_e - torch.lgamma(counts + 1)).exp()
    edges = torch.arange(last + BLACK_DN + math.ceil(9 * read_noise_e) + 3, dtype=torch.float64) - 0.5
    below = torch.special.ndtr((edges - BLACK_DN - counts[:, None]) / read_noise_e)
    below[:, 0] = 0.0  # what is lower is clipped to 0
    law = np.zeros(FULL_SCALE_DN + 1)
    law[: len(edges) - 1] = (chances[:, None] * below.diff(dim=1)).sum(0).numpy()
    return law


def distance(dn: Tensor, law: Law) -> float:
    """Total variation distance of values' frequencies from a law, less what exact samples of it have on average."""
    share = np.bincount(dn.numpy().astype(np.int64).ravel(), minlength=len(law)) / dn.numel()
    # E|X/n - p| of a binomial share: 2 p (1 - p)^n below one sample on average, beyond as of a normal
    few, many = 2 * law * (1 - law) ** dn.numel(), np.sqrt(2 * law * (1 - law) / (math.pi * dn.numel()))
    spread = np.where(law * dn.numel() < 1, few, many)
    return max(0.0, float(0.5 * (np.abs(share - law).sum() - spread.sum())))


def digital(electrons: Tensor) -> Tensor:
    """Digital numbers of electrons, in place."""
    return electrons.add_(BLACK_DN).round_().clamp_(0, FULL_SCALE_DN)


def _case(shape: tuple[int, ...], read_noise_e: float, mean_e: float) -> Case:
    means, law = torch.full(shape, mean_e), exact_law(mean_e, read_noise_e)
    ours = partial(
        read_out, means, _CAMERA.with_figures(read_noise_e=read_noise_e), exposure_s=0.0, temperature_c=20.0,
        generator=range(shape[0]),
    )  # fmt: skip

    def with_torch() -> Tensor:
        return digital(torch.poisson(means) + read_noise_e * torch.randn(shape))

    def plain_normal() -> Tensor:
        return digital(means + math.hypot(mean_e**0.5, read_noise_e) * torch.randn(shape))

    ways = [
        Contender("blurnoise, auto", ours, True),
        Contender("blurnoise, full", partial(ours, fidelity="full"), True),
        Contender("torch.poisson + normal", with_torch),
        Contender("one plain normal", plain_normal),
    ]
    name = f"{mean_e:g} e-, read noise {read_noise_e:g} e-"
    return Case(name, ways, lambda dn: distance(dn, law), units=means.numel() / 1e6)
