"""Tables of a value for every digital number."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.threads import in_pieces


def look_up(table: Tensor, dn: Tensor) -> Tensor:
    """``table``'s value for each digital number, clipped to the table; the table's dtype, dn's shape."""
    if dn.device.type != "cpu":
        return table[dn.detach().clamp(0, len(table) - 1).int()]
    numbers, values = dn.detach().reshape(-1).numpy(), table.numpy()
    out = np.empty(len(numbers), values.dtype)

    def look_up(piece: slice) -> None:
        np.take(values, numbers[piece].astype(np.int32), mode="clip", out=out[piece])

    in_pieces(look_up, len(numbers), torch.get_num_threads())
    return torch.from_numpy(out).view(dn.shape)
