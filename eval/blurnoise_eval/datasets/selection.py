"""Selection of boxes and pictures of a labelled set: which count, and how many do not."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

from blurnoise_eval.datasets.records import Target, size_group


class Selection:
    """What of a labelled set is used: boxes of the ``labels`` asked for (all, if none are), pictures with them.

    keep_empty: pictures without any of the labels, too: what is found there is wrong.
    """

    def __init__(self, labels: Sequence[str], keep_empty: bool) -> None:
        self._labels = tuple(labels)
        self._keep_empty = keep_empty
        self._left_out: Counter[str] = Counter()

    def target(
        self,
        label: str,
        box_xyxy: tuple[float, float, float, float],
        size_px: tuple[float, float] | None = None,
        *,
        group: str | None = None,
        **beside: Any,
    ) -> list[Target]:
        """The box as a target, or nothing. size_px: (width, height) of the picture, where that is known.

        group: by default its size class. ``beside``: the target's other fields. Boxes partly outside the
        picture stay as they are.
        """
        if self._labels and label not in self._labels:
            return []
        x0, y0, x1, y1 = box_xyxy
        width, height = x1 - x0, y1 - y0
        if not math.isfinite(width * height):
            return self.leave_out("with numbers that are not finite")
        if width <= 0 or height <= 0:
            return self.leave_out("of no area")
        if size_px and (x1 <= 0 or y1 <= 0 or x0 >= size_px[0] or y0 >= size_px[1]):
            return self.leave_out("outside the picture")
        group = group or size_group(width, height, label if self._labels else "objects")
        return [Target(label, group, box_xyxy, **beside)]

    def takes(self, targets: Sequence[Target]) -> bool:
        """Whether a picture with these targets counts; crowds alone are no reason to look at it."""
        return not self._labels or self._keep_empty or not all(target.crowd for target in targets)

    @property
    def chosen(self) -> str:
        """The choice in words; "" for all boxes."""
        return (
            ", ".join([*sorted(self._labels), *["pictures without them"] * self._keep_empty])
            if self._labels
            else ""
        )

    def check(self, known: Collection[str], pictures: Sequence[object]) -> None:
        """Raise ``ValueError`` for a label that the set does not know, or where no picture is left."""
        if unknown := [label for label in self._labels if label not in known]:
            raise ValueError(f"target = {unknown}: not among the categories {sorted(known)}")
        if not pictures:
            raise ValueError(f"lists no pictures{f' with {list(self._labels)}' if self._labels else ''}")

    def leave_out(self, why: str) -> list[Target]:
        """Count a box that is left out, and be no target in its place."""
        self._left_out[why] += 1
        return []

    def notes(self) -> tuple[str, ...]:
        """What was left out, a sentence each."""
        return tuple(
            f"{count} {'box' if count == 1 else 'boxes'} {why} left out"
            for why, count in self._left_out.items()
        )
