"""Contract of a detector: how pictures enter it, and what its classes are called. A graph does not contain this.

A :class:`Contract` is stated by the user, by a file beside the model, or by the graph's metadata; every field
carries where it came from, so that nothing is guessed in silence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Ge, Le, Len
from pydantic import BeforeValidator

from blurnoise._core.checks import shown
from blurnoise._core.fields import Characters, check_fields
from blurnoise_eval.detectors.outputs import checked

# The 80 classes of COCO detection in the order every COCO-trained detector of these families uses.
# fmt: off
COCO80 = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow",
    "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee",
    "skis", "snowboard", "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard",
    "tennis racket", "bottle", "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple",
    "sandwich", "orange", "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch",
    "potted plant", "bed", "dining table", "toilet", "tv", "laptop", "mouse", "remote", "keyboard",
    "cell phone", "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase", "scissors",
    "teddy bear", "hair drier", "toothbrush",
)
# fmt: on
# Some families number the same classes by COCO's own ids, which skip these.
_UNUSED_IDS = (0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83)
_names = iter(COCO80)
COCO91 = tuple(f"unused {number}" if number in _UNUSED_IDS else next(_names) for number in range(91))
METADATA_KEY = "blurnoise.contract"
EXPORTER = "metadata of an Ultralytics export"
"""Source of fields that the code of this exporter fixes, such as values 0-1."""


SHORT_NAMES = {
    "base": "family", "color": "colour", "range": "value_range", "pad": "pad_value", "size": "input_size_px",
    "filter": "resize_filter",    "iou": "nms_iou",
}  # fmt: skip
"""Other names of fields, in a contract's file and on the command line."""


class ModelError(ValueError):
    """A model or its contract cannot be used; the message says why, and what to do."""


def _pairs(value: object) -> object:
    """Widths and heights in turn, as darknet's and YOLOv5's files list them, or in pairs already."""
    try:
        levels = [np.asarray(level, float).reshape(-1, 2).tolist() for level in value]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        return value
    return tuple(tuple(map(tuple, level)) for level in levels)


_Px = Annotated[float, Ge(1e-3), Le(1e5)]
_Level = Annotated[tuple[tuple[_Px, _Px], ...], Len(1)]
_Scale = Annotated[float, Ge(1), Le(4)]
_Stride = Annotated[int, Ge(1), Le(1024)]


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

    >>> head = AnchorHead(strides=(8, 16), anchors=[[10, 13, 16, 30], [30, 61, 62, 45]])
    >>> head.per_cell, head.anchors[0]
    (2, ((10.0, 13.0), (16.0, 30.0)))
    """

    strides: Annotated[tuple[_Stride, ...], Len(1), "must be a list of integers, 1 to 1024"]
    anchors: Annotated[
        tuple[_Level, ...], BeforeValidator(_pairs), "must be widths and heights in turn, px > 0"
    ]
    boxes: Literal["yolov3", "yolov4", "yolov5"] = "yolov5"
    activated: bool = False
    order: Literal["anchor", "cell"] = "anchor"
    xy_scales: Annotated[tuple[_Scale, ...] | None, "must be a number from 1 to 4 for each stride"] = None

    def __post_init__(self) -> None:
        check_fields(self)
        numbers = {len(level) for level in self.anchors}
        if not len(self.anchors) == len(self.strides) == len(self.scales) or len(numbers) != 1:
            must = "must have the same number of anchors, and one of xy_scales, for each stride"
            raise ValueError(f"anchors = {shown(self.anchors)}, strides = {list(self.strides)}: {must}")
        if self.boxes == "yolov4" and self.xy_scales is None:
            raise ValueError("xy_scales: must be set for boxes of yolov4, such as 1.2, 1.1, 1.05")

    @property
    def per_cell(self) -> int:
        """Anchors of one cell."""
        return len(self.anchors[0])

    @property
    def scales(self) -> tuple[float, ...]:
        """The factor by which the centre is stretched about the middle of the cell, for each stride."""
        return self.xy_scales or (2.0 if self.boxes == "yolov5" else 1.0,) * len(self.strides)


def _listed(value: object) -> object:
    """Names in order: of COCO, or by id."""
    if value in ("coco80", "coco91"):
        return COCO80 if value == "coco80" else COCO91
    if not isinstance(value, Mapping):
        return value
    try:
        by_id = {int(class_id): name for class_id, name in value.items()}
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"classes: ids must be integers, got {shown(list(value))}") from None
    by_id.setdefault(0, "unused 0")  # counted from 1, as TensorFlow does
    if sorted(by_id) != list(range(len(by_id))):
        raise ValueError(f"classes: ids must be 0 to {len(value) - 1}, got {shown(list(value))}")
    return tuple(by_id[class_id] for class_id in sorted(by_id))


def _square(value: object) -> object:
    return (value, value) if isinstance(value, int) else value


def _head(value: object) -> object:
    """A head as a file states it."""
    try:
        return AnchorHead(**value) if isinstance(value, Mapping) else value
    except (TypeError, ValueError) as error:
        raise ValueError(f"head: {str(error).removeprefix('AnchorHead.__init__() ')}") from None


Colour = Literal["rgb", "bgr", "grey"]
_Deviation = Annotated[float, Ge(1e-6)]
PerChannel = Annotated[tuple[float, float, float] | None, "must be three numbers, one per channel"]
Spread = Annotated[
    tuple[_Deviation, _Deviation, _Deviation] | None, "must be three numbers > 0, one per channel"
]
_Side = Annotated[int, Ge(1), Le(1 << 16)]
_TWO_SIDES = "must be (height, width), two integers > 0 and <= 65536"
_Size = Annotated[tuple[_Side, _Side] | None, BeforeValidator(_square), _TWO_SIDES]
_NAMES = "must be a list of names, names by id, 'coco80' or 'coco91'"
_Names = Annotated[tuple[Characters, ...], Len(1), BeforeValidator(_listed), _NAMES]


@dataclass(frozen=True)
class Sourced:
    """A contract; ``sources`` has the source of each field."""

    EXAMPLE: ClassVar[str]

    sources: Mapping[str, str] = field(default_factory=dict, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        check_fields(self)
        sources = {name: self.sources.get(name, "given") for name in self.names()}
        object.__setattr__(self, "sources", sources)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the fields."""
        return tuple(entry.name for entry in fields(cls) if entry.name != "sources")

    @classmethod
    def assumed(cls, why: str) -> Self:
        """The defaults, each field marked as assumed."""
        return cls(sources=dict.fromkeys(cls.names(), f"assumed: {why}"))

    @property
    def assumptions(self) -> list[str]:
        """A sentence for each assumed field: its value, the reason, and how to set it."""
        return [
            f"{name} = {shown(getattr(self, name))} is {source}; "
            f"to set it, put {name!r} into <model>.contract.json beside the model"
            for name, source in self.sources.items()
            if source.startswith("assumed")
        ]

    def states(self, name: str) -> bool:
        """Whether somebody, or the graph, stated a field: it is no preset's and not assumed."""
        return not self.sources[name].startswith(("preset", "assumed"))

    def to_dict(self) -> dict[str, Any]:
        """The fields in types of JSON, with ``sources``. A contract file may contain sources; they are ignored."""
        values = asdict(self)
        ordered = {name: values[name] for name in (*self.names(), "sources")}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in ordered.items()}


@dataclass(frozen=True)
class Contract(Sourced):
    """How a picture becomes the network's input, and what the outputs mean.

    family: output layout, a name of a preset. colour: "rgb", "bgr", or "grey" of one channel, whose mean and std are
    the first of three. value_range: "0-1" or "0-255".
    mean, std: per channel in the network's channel order and in that range; the input is (x - mean) / std.
    resize: "letterbox" (aspect kept, centred), "letterbox-top-left", "stretch", or "none" (the picture enters
    at its own size). resize_filter: "bilinear" (OpenCV's, as the families' own code has it), "area" (OpenCV's), or
    "antialiased" (bilinear of PIL, and of torchvision and transformers by default). pad_value: grey around a
    letterboxed picture, 0 to 255. classes: names by class id.
    input_size_px: (height, width), or None where the graph says. nms_iou: overlap above which the weaker box
    of a class is dropped, None where the graph has dropped it itself. head: the anchors of a head that has them.
    outputs: their columns, as :mod:`blurnoise_eval.detectors.outputs` has them; None of a family that computes boxes.
    Raises ``ValueError`` or ``TypeError`` naming field, value and what is allowed.

    >>> Contract("yolox", ["stop sign"], colour="bgr", input_size_px=416).input_size_px
    (416, 416)
    >>> Contract("yolox", ["stop sign"], colour="blue")
    Traceback (most recent call last):
        ...
    ValueError: colour = 'blue': must be one of 'rgb', 'bgr', 'grey'
    """

    EXAMPLE = (
        '{"family": "yolox", "classes": ["stop sign", "yield"], "colour": "bgr", "value_range": "0-255", '
        '"resize": "letterbox-top-left"}'
    )
    family: str
    classes: _Names
    colour: Colour = "rgb"
    value_range: Literal["0-1", "0-255"] = "0-1"
    mean: PerChannel = None
    std: Spread = None
    resize: Literal["letterbox", "letterbox-top-left", "stretch", "none"] = "letterbox"
    resize_filter: Literal["bilinear", "area", "antialiased"] = "bilinear"
    pad_value: Annotated[int, Ge(0), Le(255)] = 114
    input_size_px: _Size = None
    nms_iou: Annotated[float | None, Ge(0), Le(1)] = 0.65
    head: Annotated[AnchorHead | None, BeforeValidator(_head), "must map strides and anchors"] = None
    outputs: Annotated[str | None, BeforeValidator(checked), "must be text, such as 'xyxy, score, class'"] = (
        None
    )


IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of red, green, blue, 0-1."""
IMAGENET_255 = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
"""The same of 0-255."""
_Three = tuple[float, float, float]
INPUT_VALUES: dict[str, tuple[Literal["0-1", "0-255"], _Three | None, _Three | None]] = {
    "0-1": ("0-1", None, None),
    "0-255": ("0-255", None, None),
    "0-1 with ImageNet's mean and std": ("0-1", *IMAGENET),
    "0-255 less ImageNet's mean": ("0-255", IMAGENET_255[0], None),
    "-1 to 1": ("0-1", (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)),
}
"""What detectors are fed with: value range, mean and std, the latter in the order of red, green, blue."""
