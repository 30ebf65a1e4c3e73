"""Bench of the augmentation: what it costs beside the training step that it feeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from torch import Tensor

from blurnoise import RandomExposure
from blurnoise_eval.bench.contest import Case, Contender, Contest

SHARES = (0.5, 0.8, 1.0)


def augment(
    steps: Mapping[str, Callable[[], object]],
    pictures: Tensor,
    rival: Callable[[float], Callable[[Tensor], Tensor]],
) -> Contest:
    """Training steps with a batch of ``pictures``, by precision, and augmentations of several shares of them.

    rival: gives Kornia's augmentation of a share.
    """

    def case() -> Case:
        ours: Any = RandomExposure  # of Kornia's classes, which mypy does not follow
        ways = [Contender(f"training step, {name}", step) for name, step in steps.items()]
        for p in SHARES:
            ways.append(Contender(f"RandomExposure, p = {p:g}", partial(ours(p=p), pictures), True))
            ways.append(Contender(f"Kornia's blur and noise, p = {p:g}", partial(rival(p), pictures)))
        return Case(f"batch of {len(pictures)}", ways, units=len(pictures))

    return Contest(
        "augment", "Augmentations beside a training step, 320x320 in colour", [case],
        cost_unit="ms per picture", seconds=20.0,
    )  # fmt: skip
