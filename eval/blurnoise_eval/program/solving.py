"""The exposure for each light, by dynamic programming.

Convention: lights rise along the first axis, exposures along the second; NaN: not allowed, or not known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def solve(worth: Array) -> tuple[int, ...] | None:
    """Of each light's exposures the one by which the sum of ``worth`` (L, S) is largest, none longer than that of
    less light; of equals the shortest. None where nothing is allowed.

    More light with a longer exposure would let a control loop swing. O(L S).
    """
    allowed = np.where(np.isnan(worth), -np.inf, worth)
    best = allowed[0]
    came_from = []
    for row in allowed[1:]:
        source = np.empty(len(best), int)
        top = len(best) - 1
        for place in range(len(best) - 1, -1, -1):
            if best[place] >= best[top]:
                top = place
            source[place] = top
        came_from.append(source)
        best = row + best[source]
    last = int(np.argmax(best))
    if not np.isfinite(best[last]):
        return None
    chosen = [last]
    for source in reversed(came_from):
        chosen.append(int(source[chosen[-1]]))
    return tuple(reversed(chosen))
