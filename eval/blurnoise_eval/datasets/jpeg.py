"""JPEG files: the quality and the subsampling with which they were encoded last, by their headers."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np
from PIL import Image, JpegImagePlugin

from blurnoise_eval.system.urls import Location, local_file

Subsampling = Literal["4:4:4", "4:2:2", "4:2:0"]
_LUMA = (
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56,
    14, 17, 22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92,
    49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
)  # fmt: skip
"""ITU-T T.81, table K.1: libjpeg's at quality 50."""


class Encoding(NamedTuple):
    """quality: that of libjpeg with the nearest table of luma. subsampling: of chroma; None: another, or none."""

    quality: int
    subsampling: Subsampling | None


def encoding(file: Location) -> Encoding | None:
    """How a JPEG was encoded; None for other files, and for those that cannot be read."""
    try:
        with Image.open(local_file(file)) as opened:
            if not isinstance(opened, JpegImagePlugin.JpegImageFile):
                return None
            place = JpegImagePlugin.get_sampling(opened)
            sampling = get_args(Subsampling)[place] if 0 <= place < 3 else None
            return Encoding(quality(opened.quantization[0]), sampling)
    except (OSError, KeyError):
        return None


def quality(table: list[int]) -> int:
    """The quality at which libjpeg's table of luma is nearest to one, (64,) in any order, by its mean.

    >>> quality([1] * 64), quality([*_LUMA])
    (100, 50)
    """
    base, every = np.array(_LUMA), np.arange(1, 101)[:, None]
    scale = np.where(every < 50, 5000 // every, 200 - 2 * every)
    tables = np.clip((base * scale + 50) // 100, 1, 255)
    return int(np.abs(tables.mean(1) - np.mean(table)).argmin()) + 1
