"""Random fields in which item i of a batch depends on its own seed alone.

The same seed gives the same bits whatever the batch, the number of threads or the order. CPU and CUDA draw
from different generators, so their fields agree in law, not bit for bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import torch
from torch import Tensor

Randomness = torch.Generator | Sequence[int] | int | None
"""A generator to draw one seed per item from, the seeds themselves, one item's seed, or torch's default."""

_SEED_LIMIT = 2**63 - 1


def item_seeds(randomness: Randomness, batch: int) -> list[int]:
    """One seed per item of a batch.

    A generator (None: torch's default one) is advanced by ``batch`` draws. A sequence must hold ``batch``
    integers, an integer serves a batch of one. Raises ``TypeError`` or ``ValueError`` for anything else.
    """
    if randomness is None or isinstance(randomness, torch.Generator):
        device = "cpu" if randomness is None else randomness.device
        drawn = torch.randint(_SEED_LIMIT, (batch,), generator=randomness, device=device)
        return [int(seed) for seed in drawn.tolist()]
    seeds = [randomness] if isinstance(randomness, int) else list(randomness)
    if not all(isinstance(seed, int) and 0 <= seed <= _SEED_LIMIT for seed in seeds):
        raise TypeError(f"generator = {randomness!r}: must be a torch.Generator or integers in [0, 2**63)")
    if len(seeds) != batch:
        raise ValueError(f"generator: got {len(seeds)} seeds for a batch of {batch}; must be one per item")
    return seeds


def standard_normal(seeds: Sequence[int], like: Tensor, stream: str = "frame") -> Tensor:
    """Independent N(0, 1) values of ``like``'s shape (B, ...), dtype and device, item i drawn from seeds[i].

    ``stream`` names what the field is for: fields of other streams are independent, seeds being equal.
    """
    field = torch.empty_like(like, requires_grad=False, memory_format=torch.contiguous_format)
    for item, seed in zip(field, seeds, strict=True):
        item.normal_(generator=_generator(seed, stream, like.device))
    return field


def poisson(mean: Tensor, seeds: Sequence[int], stream: str = "counts") -> Tensor:
    """Poisson counts of the given mean (B, ...), item i drawn from seeds[i]. No gradient passes."""
    mean = mean.detach()
    return torch.stack(
        [
            torch.poisson(item, generator=_generator(seed, stream, mean.device))
            for item, seed in zip(mean, seeds, strict=True)
        ]
    )


def _generator(seed: int, stream: str, device: torch.device) -> torch.Generator:
    digest = hashlib.blake2b(f"{stream} {seed}".encode(), digest_size=8).digest()
    return torch.Generator(device).manual_seed(int.from_bytes(digest, "little") >> 1)
