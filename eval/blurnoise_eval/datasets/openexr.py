"""OpenEXR pictures: linear light as floats, read by the package OpenEXR where that is installed.

Shape (H, W) or (H, W, 3), float32, of the data window. Colours are channels R, G, B, light alone is Y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def size_px(path: Path) -> tuple[int, int]:
    """Width and height. Raises as :func:`read` does."""
    import OpenEXR

    with OpenEXR.File(str(path), header_only=True) as file:
        low, high = file.header()["dataWindow"]
    width, height = (np.asarray(high, int) - np.asarray(low, int) + 1).tolist()
    return width, height


def read(path: Path) -> NDArray[np.float32]:
    """The light of the first part.

    Raises ``ImportError`` where the package is missing, ``RuntimeError`` for what it cannot read, ``ValueError`` for
    a file without R, G, B or Y, or with channels of several sizes.
    """
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    names = ("R", "G", "B") if {"R", "G", "B"} <= channels.keys() else ("Y",)
    missing = [name for name in names if name not in channels]
    if missing:
        raise ValueError(f"has channels {', '.join(channels)}: must have R, G, B or Y")
    planes = [np.asarray(channels[name], np.float32) for name in names]
    if len({plane.shape for plane in planes}) > 1:
        raise ValueError("has channels of several sizes: must be of one")
    return planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)
