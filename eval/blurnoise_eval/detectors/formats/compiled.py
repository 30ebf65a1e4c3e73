"""Suppression by Numba: the boxes that onnxruntime's NonMaxSuppression keeps, in a part of the time.

Convention: float32 throughout, without fused multiply-adds, as onnxruntime is built; whoever comes here makes sure.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba import types

_ZERO = np.float32(0.0)


@numba.njit(  # type: ignore[untyped-decorator]
    types.boolean[::1](types.float32[:, ::1], types.int64[::1], types.float32, types.int64, types.int64),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def kept(boxes_xyxy: Any, class_ids: Any, nms_iou: float, per_class: int, most: int) -> Any:
    """Which boxes (n, 4), highest score first, stay, (n,): at most so many of each class, and ``most`` of all."""
    count, of_all = len(boxes_xyxy), 0
    of_class = np.zeros(class_ids.max() + 1, np.int64)
    low_x, high_x, low_y, high_y, area = np.empty((5, count), np.float32)
    free, stays = np.ones(count, np.bool_), np.zeros(count, np.bool_)
    for i in range(count):
        x0, y0, x1, y1 = boxes_xyxy[i]
        low_x[i], high_x[i], low_y[i], high_y[i] = min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)
        area[i] = (high_x[i] - low_x[i]) * (high_y[i] - low_y[i])
    for i in range(count):
        number = class_ids[i]
        if not free[i] or of_class[number] == per_class:
            continue
        stays[i] = True
        of_class[number] += 1
        of_all += 1
        if of_all == most:
            break
        left, right, top, bottom, own = low_x[i], high_x[i], low_y[i], high_y[i], area[i]
        if own <= _ZERO:
            continue
        after = i + 1
        lefts, rights, tops, bottoms = low_x[after:], high_x[after:], low_y[after:], high_y[after:]
        areas, classes, open_ = area[after:], class_ids[after:], free[after:]
        for j in range(count - after):
            width = (rights[j] if rights[j] < right else right) - (lefts[j] if lefts[j] > left else left)
            height = (bottoms[j] if bottoms[j] < bottom else bottom) - (tops[j] if tops[j] > top else top)
            shared = width * height
            union = own + areas[j] - shared
            meets = (
                (width > _ZERO) & (height > _ZERO) & (shared > _ZERO) & (areas[j] > _ZERO) & (union > _ZERO)
            )
            open_[j] &= not (meets & (shared / union > nms_iou) & (classes[j] == number))
    return stays
