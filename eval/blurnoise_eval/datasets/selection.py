"""Selection of boxes and pictures of a labelled set: which count, and how many do not."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

from blurnoise._core.checks import shown
from blurnoise_eval.datasets.records import Target, size_group


class Selection:
    """What of a labelled set is used: boxes of the ``labels`` asked for (all, if none are), pictures with them.

    keep_empty: pictures without any of the labels, too: what is found there is wrong.
    """

    def __init__(self, labels: Sequence[str], keep_empty: bool) -> None:
        self._labels = tuple(labels)
        self._keep_empty = keep_empty
        self._counted: Counter[str] = Counter()
        self._alike: list[str] = []

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
        self._alike = sorted(name for name, count in Counter(known).items() if count > 1)
        if unknown := [label for label in self._labels if label not in known]:
            raise ValueError(f"target = {unknown}: not among the categories {sorted(known)}")
        if not pictures:
            raise ValueError(f"lists no pictures{f' with {list(self._labels)}' if self._labels else ''}")

    def leave_out(self, why: str) -> list[Target]:
        """Count a box that is left out, and be no target in its place."""
        self.count(f"{why} left out")
        return []

    def count(self, what: str) -> None:
        """Count a box of which the notes say ``what``."""
        self._counted[what] += 1

    def notes(self) -> tuple[str, ...]:
        """What was left out or is not as it should be, a sentence each."""
        alike = f"{len(self._alike)} names stand for several classes each, which count as one"
        if len(self._alike) == 1:
            alike = "1 name stands for several classes, which count as one"
        return (
            *(f"{count} {'box' if count == 1 else 'boxes'} {what}" for what, count in self._counted.items()),
            *([f"{alike} (first: {shown(self._alike[0])})"] if self._alike else []),
        )
