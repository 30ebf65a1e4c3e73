"""Anchors of a detector's head: sizes about which it states boxes, and how; px of the network's input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le, Len
from pydantic import BeforeValidator

from blurnoise._core.checks import check_fields


def _pairs(value: object) -> object:
    """Widths and heights in turn, as darknet's and YOLOv5's files list them, or in pairs already."""
    if not isinstance(value, (list, tuple)):
        return value
    levels: list[object] = []
    for level in value:
        if not isinstance(level, (list, tuple)):
            return value
        flat = [side for pair in level for side in (pair if isinstance(pair, (list, tuple)) else [pair])]
        if not flat or len(flat) % 2:
            return value
        levels.append(tuple(zip(flat[::2], flat[1::2], strict=True)))
    return tuple(levels)


_Px = Annotated[float, Ge(1e-3), Le(1e5)]
_Level = Annotated[tuple[tuple[_Px, _Px], ...], Len(1)]
_Scale = Annotated[float, Ge(1), Le(4)]


@dataclass(frozen=True)
class AnchorHead:
    """How a head with anchors states its boxes: by level, cell and anchor.

    strides: of the levels, px, in the order in which one output holds them; levels with an output of their own are
    told by their sizes. anchors: for each stride as many (width, height), px. boxes: "yolov3": centre = sigmoid +
    cell, size = exp · anchor; "yolov4": the same with the centre stretched about the cell's middle by ``xy_scales``;
    "yolov5" (and YOLOv7, YOLO-FastestV2): centre = 2 sigmoid - 0.5 + cell, size = (2 sigmoid)² · anchor. activated:
    whether the graph has applied the sigmoids (and softmax) itself. order: of rows that hold one box each, "anchor"
    (a level's first anchor over all cells, then the next, as YOLOv5) or "cell" (a cell's anchors, then the next
    cell's). Raises ``TypeError`` or ``ValueError`` naming field, value and what is allowed.
    """

    strides: Annotated[
        tuple[Annotated[int, Ge(1), Le(1024)], ...], Len(1), "must be a list of integers, 1 to 1024"
    ]
    anchors: Annotated[
        tuple[_Level, ...],
        BeforeValidator(_pairs),
        "must be a list for each stride of widths and heights in turn, px > 0",
    ]
    boxes: Literal["yolov3", "yolov4", "yolov5"] = "yolov5"
    activated: bool = False
    order: Literal["anchor", "cell"] = "anchor"
    xy_scales: Annotated[tuple[_Scale, ...] | None, "must be a number from 1 to 4 for each stride"] = None

    def __post_init__(self) -> None:
        check_fields(self)
        numbers = {len(level) for level in self.anchors}
        if len(self.anchors) != len(self.strides) or len(numbers) != 1:
            raise ValueError(
                f"anchors: {[len(level) for level in self.anchors]} for strides {list(self.strides)}; must be "
                "equally many for each stride"
            )
        if len(set(self.strides)) != len(self.strides):
            raise ValueError(f"strides = {list(self.strides)}: must differ")
        if self.boxes == "yolov4" and self.xy_scales is None:
            raise ValueError(
                "xy_scales: must be given with yolov4's boxes, one for each stride, as 1.2, 1.1, 1.05"
            )
        if self.xy_scales is not None and len(self.xy_scales) != len(self.strides):
            raise ValueError(
                f"xy_scales = {list(self.xy_scales)}: must be one for each of {len(self.strides)} strides"
            )

    @property
    def per_cell(self) -> int:
        """Anchors of one cell."""
        return len(self.anchors[0])

    @property
    def scales(self) -> tuple[float, ...]:
        """By how much the centre is stretched about the cell's middle, for each stride."""
        own = {"yolov3": 1.0, "yolov4": 1.0, "yolov5": 2.0}[self.boxes]
        return self.xy_scales or (own,) * len(self.strides)


YOLO_FASTEST_V2 = AnchorHead(
    strides=(16, 32),
    anchors=(
        ((12.64, 19.39), (37.88, 51.48), (55.71, 138.31)),
        ((126.91, 78.23), (131.57, 214.55), (279.92, 258.87)),
    ),
    activated=True,
)
"""Of COCO at 352 px: the repository's data/coco.data."""
