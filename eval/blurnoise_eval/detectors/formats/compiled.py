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
    types.int64[::1](
        *(types.float32[:, ::1], types.int64[::1], types.int64[::1]),
        *(types.float32, types.int64, types.int64),
    ),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def kept(boxes_xyxy: Any, class_ids: Any, order: Any, nms_iou: float, per_class: int, most: int) -> Any:
    """Which boxes (n, 4) stay: their places, in ``order``, highest score first; at most so many of each class, and
    ``most`` of all.

    Each is held against those that stay already, which are few.
    """
    stay = np.empty(min(most, len(order)), np.int64)
    of_class = np.zeros(class_ids.max() + 1, np.int64)
    lefts, rights, tops, bottoms, areas = np.empty((5, len(stay)), np.float32)
    classes = np.empty(len(stay), np.int32)
    of_all = 0
    for place in order:
        number = class_ids[place]
        if of_class[number] == per_class:
            continue
        x0, y0, x1, y1 = boxes_xyxy[place]
        left, right, top, bottom = min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)
        own = (right - left) * (bottom - top)
        alike, free = np.int32(number), True
        if own > _ZERO:
            for j in range(of_all):
                width = (rights[j] if rights[j] < right else right) - (lefts[j] if lefts[j] > left else left)
                height = (bottoms[j] if bottoms[j] < bottom else bottom) - (tops[j] if tops[j] > top else top)
                shared = width * height
                union = own + areas[j] - shared
                meets = (width > _ZERO) & (height > _ZERO) & (shared > _ZERO) & (areas[j] > _ZERO)
                free &= not (meets & (union > _ZERO) & (shared / union > nms_iou) & (classes[j] == alike))
        if free:
            lefts[of_all], rights[of_all], tops[of_all], bottoms[of_all] = left, right, top, bottom
            areas[of_all], classes[of_all], stay[of_all] = own, number, place
            of_class[number] += 1
            of_all += 1
            if of_all == most:
                break
    return stay[:of_all]
