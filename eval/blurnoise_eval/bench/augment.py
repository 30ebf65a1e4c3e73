"""Bench of the augmentation: what it costs beside the training step that it feeds."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from blurnoise_eval.bench.contest import Case, Contender, Contest


def augment(*, quick: bool) -> Contest:
    """A step of the small detector's training, and augmentations of its batch with several shares of the pictures."""
    return Contest(
        "augment", "Augmentations beside a training step, 320x320 in colour", [partial(_batch, quick)],
        cost_unit="ms per picture", seconds=20.0,
    )  # fmt: skip


def _batch(quick: bool) -> Case:
    import numpy as np
    from blurnoise_models import training
    from blurnoise_models.mixes import blur_and_noise

    from blurnoise import RandomExposure

    count = 8 if quick else training.BATCH
    with tempfile.TemporaryDirectory() as folder:
        pictures, boxes = training.batch(training.pool(Path(folder), count), np.arange(count))
    ours: Any = RandomExposure  # of Kornia's classes, which mypy does not follow
    step = partial(training.learn, *training.beginner(), pictures, boxes)
    ways = [
        Contender(f"training step, {name}", partial(step, bfloat16=name == "bfloat16"))
        for name in ("float32", *(["bfloat16"] if training.has_bfloat16() else []))
    ]
    for p in (0.5, 0.8, 1.0):
        ways.append(Contender(f"RandomExposure, p = {p:g}", partial(ours(p=p), pictures), True))
        ways.append(Contender(f"Kornia's blur and noise, p = {p:g}", partial(blur_and_noise(p), pictures)))
    return Case(f"batch of {count}", ways, units=count)
