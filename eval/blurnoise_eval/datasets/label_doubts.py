"""Signs that labels mean something else than is read, found before anything is computed.

Domain: boxes (n, 6): corners x0, y0, x1, y1 in px as they were read, with width and height of the picture, NaN where
these are unknown. A doubt is a sentence for the terminal and the page; where nothing right can follow, an error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets.folder import Listed

Boxes = NDArray[np.float64]
_BEYOND_PX = 1.0  # tools round outwards
_ROUNDING = 0.01  # of shares
_SCALES = ((100.0, "per cent"), (1000.0, "thousandths"))
_SAME_AREA = 0.01
_MOST_FIT = 0.9  # of the areas; by chance few are the same
_FEWEST = 8  # boxes from which on all of them in one corner of large pictures are a sign
_MOST_CROWDS = 0.5  # of the targets; COCO has 1 %
_MOST_EMPTY = 0.5  # of the pictures; COCO has 1 %


def _xywh(boxes: Boxes) -> Boxes:
    return np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)


def _from_corner(written: Boxes) -> Boxes:
    return np.concatenate([written[:, :2], written[:, :2] + written[:, 2:]], axis=1)


def _from_centre(written: Boxes) -> Boxes:
    half = written[:, 2:] / 2
    return np.concatenate([written[:, :2] - half, written[:, :2] + half], axis=1)


def _centred(boxes: Boxes) -> Boxes:
    return np.concatenate([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]], axis=1)


_LAYOUTS: dict[str, tuple[Callable[[Boxes], Boxes], Callable[[Boxes], Boxes]]] = {
    "x, y, width, height": (_xywh, _from_corner),
    "corners x0, y0, x1, y1": (lambda boxes: boxes, lambda written: written),
    "centre x, y, width, height": (_centred, _from_centre),
}
"""How the four numbers of a box are read: from corners to what is written, and back."""


def shared_names(names: Iterable[str]) -> list[str]:
    """Notes on names that several classes have: the classes are told apart by name.

    >>> shared_names(["car", "bus", "car"])
    ["2 classes are named 'car', and count as one"]
    """
    counts = Counter(names)
    return [f"{n} classes are named {name!r}, and count as one" for name, n in counts.items() if n > 1]


def box_doubts(boxes: Boxes, layout: str) -> list[str]:
    """Boxes that may be shares, per cent, or of another layout. Raises ``ValueError`` where all are in one pixel."""
    corners, sizes = boxes[:, :4], boxes[:, 4:]
    finite = np.isfinite(corners).all(axis=1)
    corners, sizes, count = corners[finite], sizes[finite], int(finite.sum())
    if not count:
        return []
    doubts = []
    tiny = int(((corners.max(axis=1) <= 1 + _ROUNDING) & (corners.min(axis=1) >= -_ROUNDING)).sum())
    if tiny == count:
        raise ValueError(
            f"all {count} boxes are below 1 px: shares of the picture's size? They must be px"
            if count > 1
            else "the only box is below 1 px: shares of the picture's size? It must be px"
        )
    if tiny:
        doubts.append(f"{tiny} of {count} boxes are below 1 px: shares of the picture's size?")
    known = np.isfinite(sizes).all(axis=1)
    for full, name in _SCALES:
        if (
            count >= _FEWEST
            and known.any()
            and 0.5 * full < corners.max() <= full
            and sizes[known].min() >= 1.5 * full
        ):
            doubts.append(
                f"all {count} boxes end within {full:g} px of the corner: {name} of the picture's size?"
            )
    return [*doubts, *_outside(corners[known], sizes[known], layout)]


def area_doubts(boxes: Boxes, areas_px2: NDArray[np.float64], layout: str) -> list[str]:
    """Areas in the labels (NaN: none) that fit corners where boxes are read as x, y, width, height. That of a mask
    fits neither."""
    written, known = _LAYOUTS[layout][0](boxes[:, :4]), areas_px2 > 0
    if layout != "x, y, width, height" or not known.any():
        return []
    of_sizes, of_corners = (
        written[known, 2:].prod(axis=1),
        (written[known, 2:] - written[known, :2]).prod(axis=1),
    )
    areas = areas_px2[known]
    fit = int(
        (np.isclose(of_corners, areas, rtol=_SAME_AREA) & ~np.isclose(of_sizes, areas, rtol=_SAME_AREA)).sum()
    )
    if fit < _MOST_FIT * len(areas):
        return []
    count = f"{fit} of {len(areas)} areas are those of corners x0, y0, x1, y1"
    return [f"{count}: are the boxes corners? They are read as {layout}"]


def _outside(corners: Boxes, sizes: Boxes, layout: str) -> list[str]:
    wrong = ~_fit(corners, sizes)
    if not (count := int(wrong.sum())):
        return []
    written, other = _LAYOUTS[layout][0](corners), "another size of the pictures"
    for name, (_, read) in _LAYOUTS.items():
        if name != layout and _fit(read(written), sizes).all():
            other = name
            break
    else:
        if _fit(_LAYOUTS[layout][1](written[:, [1, 0, 3, 2]]), sizes).all():
            other = "y before x"
    read_as = f"They are read as {layout}"
    flat = " or have no area" * bool((corners[:, 2:] <= corners[:, :2]).any())
    return [f"{count} of {len(corners)} boxes end outside of their picture{flat}: {other}? {read_as}"]


def _fit(corners: Boxes, sizes: Boxes) -> NDArray[np.bool_]:
    low, high = corners[:, :2], corners[:, 2:]
    inside = (low >= -_BEYOND_PX).all(axis=1) & (high <= sizes + _BEYOND_PX).all(axis=1)
    return np.asarray(inside & (high > low).all(axis=1), np.bool_)


def set_doubts(entries: Sequence[Listed], empty_said: int) -> list[str]:
    """Crowds, boxes that occur twice, and pictures without a target. empty_said: how many of these are noted."""
    targets = [target for entry in entries for target in entry.targets or ()]
    crowds = sum(target.crowd for target in targets)
    doubts = []
    texts = any(target.text is not None for target in targets)  # of which many are unreadable
    if targets and crowds >= (1.0 if texts else _MOST_CROWDS) * len(targets):
        doubts.append(f"{crowds} of {len(targets)} targets are crowds, which are neither missed nor wrong")
    twice = 0
    for entry in entries:
        rows = Counter(
            (box_target.label, box_target.text, *(round(side, 1) for side in box_target.box_xyxy))
            for box_target in entry.targets or ()
        )
        twice += sum(count - 1 for count in rows.values())
    if twice:
        repeated = f"{twice} of {len(targets)} boxes occur before, with the same class and corners"
        doubts.append(f"{repeated}; each is a target of its own, as for COCO's tools")
    empty = sum(not entry.targets for entry in entries)
    if empty > max(empty_said, _MOST_EMPTY * len(entries)):
        doubts.append(f"{empty} of {len(entries)} pictures have no target")
    return doubts
