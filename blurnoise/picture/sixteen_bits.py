"""The fast way of a mosaic through the picture's steps: integers of 16 bits, on the CPU and without derivatives.

Convention: ``demosaic.OFFSET`` is black, ``demosaic.SCALE`` steps are full scale: fine beside the steps of a
converter of up to 12 bits, and noise below black stays as it is until the tone curve. The offset is not in the way:
means of neighbours and matrices whose rows sum to 1 leave it. The physics stands in :mod:`blurnoise.picture.steps`,
whose reference gives the same picture to a few of these steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.threads import side_by_side
from blurnoise.picture import mosaics, steps
from blurnoise.picture.demosaic import OFFSET, SCALE, by_opencv, padded
from blurnoise.picture.step import Development, PictureStep

_LOOKS_UP_16_BITS = int(cv2.__version__.split(".")[0]) >= 5


def supported(active: Sequence[PictureStep]) -> int:
    """How many of these steps, from the first on, are done here: a mosaic's and the pointwise ones after them."""
    mosaic = [step for step in (steps.BLACK_LEVEL, steps.WHITE_BALANCE, steps.DEMOSAIC) if step in active]
    count = len(mosaic)
    if count < 3 or list(active[:count]) != mosaic:
        return 0
    count += active[count : count + 1] == (steps.COLOUR_MATRIX,)
    while count < len(active) and active[count].pointwise:
        count += 1
    return count


def tones(at: Development, pointwise: Sequence[PictureStep]) -> Tensor:
    """What steps make of each linear value that 16 bits hold, float64."""
    values = (torch.arange(1 << 16, dtype=torch.float64) - OFFSET) / SCALE
    for step in pointwise:
        values = step.apply(values, at)
    return values


def developed(dn: Tensor, at: Development, coloured: bool, table: Tensor) -> Tensor:
    """``table``'s values for the colours of planes (B, 1, H, W): (B, 3, H, W), channels last.

    coloured: whether the colour matrix takes part. table: a value for each linear one, see :func:`tones`.
    """
    batch, _, height, width = dn.shape
    camera = at.camera
    gains = np.array(mosaics.site_gains(camera, at.illuminant)).reshape(2, 2)
    gains = gains / (camera.full_scale_dn - camera.black_level_dn)
    columns = (width + 5) // 2  # with its margin
    by_rows = np.tile(gains, (1, columns))[None].astype(np.float32)
    rows = np.array(mosaics.matrix(camera, at.illuminant), np.float32) if coloured else None
    looked_up, highest = table.numpy(), np.float32(mosaics.highest(camera))
    frames = dn.detach().reshape(batch, height, width).numpy()
    out = torch.empty((batch, height, width, 3), dtype=table.dtype)

    def frame(place: int) -> None:
        numbers = np.subtract(frames[place], camera.black_level_dn, dtype=np.float32)
        np.clip(numbers, -camera.black_level_dn, camera.full_scale_dn - camera.black_level_dn, out=numbers)
        light = padded(numbers)
        if height % 2:
            light = np.concatenate([light, light[-1:]])
        pairs = light.reshape(len(light) // 2, 2, -1)
        np.multiply(pairs, by_rows[..., : light.shape[1]], out=pairs)
        np.minimum(light, highest, out=light)
        codes = cv2.addWeighted(
            light[: height + 4], SCALE, light[: height + 4], 0.0, OFFSET, dtype=cv2.CV_16U
        )
        colours = by_opencv(codes, camera.cfa, camera.demosaic)
        if rows is not None:
            colours = cv2.transform(colours, rows)
        _look_up(colours, looked_up, out[place].numpy())

    side_by_side(frame, range(batch), torch.get_num_threads())
    return out.permute(0, 3, 1, 2)


def _look_up(codes: NDArray[np.uint16], table: NDArray[Any], out: NDArray[Any]) -> None:
    if _LOOKS_UP_16_BITS:
        cv2.LUT(codes, table, dst=out)
    else:
        np.take(table, codes, mode="clip", out=out)
