"""Stop signs rendered by :mod:`blurnoise.charts`, to be found or to be read."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets.records import Picture, PictureSet, Target

RENDERED_SIZE_PX = 320
_FRAME: Any = {"height_px": RENDERED_SIZE_PX, "width_px": RENDERED_SIZE_PX}
_SIGNS_PX = (100, 50, 32)


def rendered_signs(sizes_px: Sequence[int] = _SIGNS_PX) -> PictureSet:
    """A stop sign of each size (px across flats) in the middle of an 18 % grey square of 320 px."""
    from blurnoise.charts import stop_sign_box

    targets = [
        Target("stop sign", f"stop sign {size} px", stop_sign_box(size, **_FRAME)) for size in sizes_px
    ]
    return _signs("stop signs", sizes_px, targets)


def rendered_texts(sizes_px: Sequence[int] = _SIGNS_PX) -> PictureSet:
    """The pictures of :func:`rendered_signs`; to be read is the word STOP, a third of the sign in height."""
    from blurnoise.charts import stop_sign_text_box

    targets = [
        Target("text", f"STOP on a sign of {size} px", stop_sign_text_box(size, **_FRAME), text="STOP")
        for size in sizes_px
    ]
    return _signs("texts of stop signs", sizes_px, targets)


def _signs(what: str, sizes_px: Sequence[int], targets: Sequence[Target]) -> PictureSet:
    pictures = tuple(
        Picture(f"stop-sign-{size}px", (target,), partial(_render, size), f"rendered {size} px", number)
        for number, (size, target) in enumerate(zip(sizes_px, targets, strict=True), start=1)
    )
    source = f"{what} of {', '.join(map(str, sizes_px))} px"
    return PictureSet("rendered", source, pictures, {target.label: 1 for target in targets})


def _render(size_px: int) -> NDArray[np.uint8]:
    from blurnoise import charts
    from blurnoise.encoding import srgb_from_linear

    linear = charts.stop_sign(size_px, **_FRAME)
    coded: Any = srgb_from_linear(linear[0]).mul(255).round().byte().permute(1, 2, 0).contiguous().numpy()
    return np.asarray(coded, np.uint8)
