"""Tables of a value for every digital number."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.threads import in_pieces

# Earlier versions of cv2.LUT take 8 bits only.
_LOOKS_UP_16_BITS = int(cv2.__version__.split(".")[0]) >= 5


def look_up(table: Tensor, dn: Tensor) -> Tensor:
    """``table``'s value for each digital number, clipped to the table; the table's dtype, dn's shape.

    dn: integers or floats without NaN, which no integer stands for.

    >>> look_up(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([0, 2, 9]))
    tensor([0., 1., 1.])
    """
    last, dn = len(table) - 1, dn.detach()
    if dn.device.type != "cpu":
        return table[(dn if dn.is_floating_point() else dn.long()).clamp(0, last).int()]
    numbers, values = dn.reshape(-1).numpy(), table.numpy()
    out = np.empty(len(numbers), values.dtype)
    highest = last if dn.is_floating_point() else min(last, np.iinfo(numbers.dtype).max)

    def one(piece: slice) -> None:
        inside = np.clip(numbers[piece], 0, highest)  # before integers, which large floats would overflow
        np.take(values, inside.astype(np.int32), mode="clip", out=out[piece])

    in_pieces(one, len(numbers), torch.get_num_threads())
    return torch.from_numpy(out).view(dn.shape)


def look_up_codes(table: NDArray[Any], codes: NDArray[np.uint16], out: NDArray[Any]) -> None:
    """Write the value for each code of 16 bits, of a table of all of them, to ``out``.

    >>> table, out = (np.arange(65_536) // 256).astype(np.uint8), np.empty((1, 2), np.uint8)
    >>> look_up_codes(table, np.array([[255, 65_535]], np.uint16), out)
    >>> out.tolist()
    [[0, 255]]
    """
    if _LOOKS_UP_16_BITS and codes.shape[1] > 1:  # the strides of a single pixel are no layout of OpenCV's
        cv2.LUT(codes, table[None], dst=out)
    else:
        np.take(table, codes, mode="clip", out=out)


def look_up_mosaic(tables: NDArray[Any], codes: NDArray[np.uint16]) -> None:
    """Replace each code of 16 bits of a mosaic (H, W) by its value in the table of its place, (2, 65536, 2).

    >>> tables = np.arange(4, dtype=np.uint16).reshape(2, 1, 2).repeat(65_536, axis=1)
    >>> codes = np.zeros((3, 3), np.uint16)
    >>> look_up_mosaic(tables, codes)
    >>> codes.tolist()
    [[0, 1, 0], [2, 3, 2], [0, 1, 0]]
    """
    even = codes.shape[1] // 2 * 2
    for row, table in enumerate(tables):
        pairs = codes[row::2, :even].reshape(len(codes[row::2]), -1, 2)
        if _LOOKS_UP_16_BITS and even:
            cv2.LUT(pairs, table[None], dst=pairs)
        else:
            for column in range(2):
                pairs[..., column] = table[pairs[..., column], column]
        if even < codes.shape[1]:
            codes[row::2, even] = table[codes[row::2, even], 0]
