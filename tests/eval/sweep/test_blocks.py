"""Blocks: whose pictures are kept for people to look at."""

from __future__ import annotations

import numpy as np
from blurnoise_eval.datasets import Picture, PictureSet, Target
from blurnoise_eval.sweep.work import blocks
from plans import plan as swept


def test_examples_are_of_the_pictures_with_the_largest_targets() -> None:
    """By area: a long thin target is small. Of each three pictures at most."""

    def picture(name: str, width_px: float, height_px: float) -> Picture:
        target = Target("sign", "signs", (5.0, 5.0, 5.0 + width_px, 5.0 + height_px))
        return Picture(name, (target,), lambda: np.zeros((99, 199, 3), np.uint8), name)

    sizes = {"thin": (180.0, 2.0), "large": (40.0, 40.0), "medium": (30.0, 30.0), "small": (20.0, 20.0)}
    shown = PictureSet("folder", "here", tuple(picture(name, *size) for name, size in sizes.items()), {})
    plan = swept((0.01, 0.02), (50.0,))
    kept = {block.picture.name for block in blocks(shown, plan) if block.examples}
    assert kept == {"large", "medium", "small"}
