"""Contract of a detector, which its graph does not state: how pictures enter it, and what its classes are called.

A :class:`Contract` is stated by the user, by a file beside the model, or by the graph's metadata; every field
carries where it came from, so that nothing is guessed in silence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, Len
from pydantic import BeforeValidator

from blurnoise._core.checks import Characters, check_fields, shown
from blurnoise_eval.detectors.anchor_head import AnchorHead
from blurnoise_eval.detectors.class_names import COCO80, COCO91

METADATA_KEY = "blurnoise.contract"
EXPORTER = "metadata of an Ultralytics export"
"""Source of what that exporter's code fixes, such as values 0-1."""


SHORT_NAMES = {
    "base": "family", "color": "colour", "range": "value_range", "pad": "pad_value", "size": "input_size_px",
    "iou": "nms_iou",
}  # fmt: skip
"""Other names of fields, in a contract's file and on the command line."""


class ModelError(ValueError):
    """A model or its contract cannot be used; the message says what it is and what to do."""


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
    if sorted(by_id) == list(range(1, len(by_id) + 1)):  # counted from 1, as TensorFlow does
        by_id[0] = "unused 0"
    if sorted(by_id) != list(range(len(by_id))):
        raise ValueError(f"classes: ids must be 0 to {len(value) - 1}, got {shown(list(value))}")
    return tuple(by_id[class_id] for class_id in sorted(by_id))


def _square(value: object) -> object:
    return (value, value) if isinstance(value, int) else value


def _head(value: object) -> object:
    """A head as a file states it."""
    if not isinstance(value, Mapping):
        return value
    if missing := [name for name in ("strides", "anchors") if name not in value]:
        raise ValueError(f"head: missing key {', '.join(map(repr, missing))}")
    if unknown := [name for name in value if name not in AnchorHead.__dataclass_fields__]:
        known = ", ".join(AnchorHead.__dataclass_fields__)
        raise ValueError(f"head: unknown key {shown(unknown)[1:-1]}; known are {known}")
    try:
        return AnchorHead(**value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"head: {error}") from None


Colour = Literal["rgb", "bgr"]
_Mean = Annotated[float, Ge(-1e6), Le(1e6)]
PerChannel = Annotated[
    tuple[_Mean, _Mean, _Mean] | None, "must be three numbers, one per channel, within 1e6 of 0"
]
_Deviation = Annotated[float, Ge(1e-6), Le(1e6)]
Spread = Annotated[
    tuple[_Deviation, _Deviation, _Deviation] | None,
    "must be > 0, three numbers, one per channel, from 1e-6 to 1e6",
]
_Side = Annotated[int, Ge(1), Le(1 << 16)]
_Size = Annotated[
    tuple[_Side, _Side] | None,
    BeforeValidator(_square),
    "must be (height, width), two integers > 0 and <= 65536",
]
_Names = Annotated[
    tuple[Characters, ...],
    Len(1),
    BeforeValidator(_listed),
    "must be a list of names, names by id, 'coco80' or 'coco91'",
]


@dataclass(frozen=True)
class Sourced:
    """A contract whose fields each carry, in ``sources``, where they came from."""

    EXAMPLE: ClassVar[str]
    TYPED: ClassVar[str]

    sources: Mapping[str, str] = field(default_factory=dict, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        check_fields(self)
        sources = {name: self.sources.get(name, "given") for name in self.names()}
        object.__setattr__(self, "sources", sources)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The fields that a contract can state."""
        return tuple(entry.name for entry in fields(cls) if entry.name != "sources")

    @property
    def assumptions(self) -> list[str]:
        """One sentence per field that nothing stated: what was assumed, why, and how to state it."""
        return [
            f"{name} = {shown(getattr(self, name))} is {source}; "
            f"to state it, put {name!r} into <model>.contract.json beside the model"
            for name, source in self.sources.items()
            if source.startswith("assumed")
        ]

    def to_dict(self) -> dict[str, Any]:
        """Every field in JSON's types, and ``sources``; a contract file may hold it, its sources are made anew."""
        values = asdict(self)
        ordered = {name: values[name] for name in (*self.names(), "sources")}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in ordered.items()}


@dataclass(frozen=True)
class Contract(Sourced):
    """How a picture becomes the network's input, and what the outputs mean.

    family: output layout, a name of a preset. colour: "rgb" or "bgr". value_range: "0-1" or "0-255".
    mean, std: per channel in the network's channel order and in that range; the input is (x - mean) / std.
    resize: "letterbox" (aspect kept, centred), "letterbox-top-left", "stretch", or "none" (the picture enters
    at its own size). pad_value: grey around a letterboxed picture, 0 to 255. classes: names by class id.
    input_size_px: (height, width), or None where the graph says. nms_iou: overlap above which the weaker box
    of a class is dropped, None where the graph has dropped it itself. head: the anchors of a head that has them.
    Raises ``ValueError`` or ``TypeError`` naming field, value and what is allowed.
    """

    EXAMPLE = (
        '{"family": "yolox", "classes": ["stop sign", "yield"], "colour": "bgr", "value_range": "0-255", '
        '"resize": "letterbox-top-left"}'
    )
    TYPED = "yolox,colour=rgb,value_range=0-1,mean=0.485/0.456/0.406,std=0.229/0.224/0.225,resize=stretch,pad_value=0"

    family: str
    classes: _Names
    colour: Colour = "rgb"
    value_range: Literal["0-1", "0-255"] = "0-1"
    mean: PerChannel = None
    std: Spread = None
    resize: Literal["letterbox", "letterbox-top-left", "stretch", "none"] = "letterbox"
    pad_value: Annotated[int, Ge(0), Le(255)] = 114
    input_size_px: _Size = None
    nms_iou: Annotated[float | None, Ge(0), Le(1)] = 0.65
    head: Annotated[
        AnchorHead | None, BeforeValidator(_head), "must be a mapping with strides and anchors"
    ] = None


IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of red, green, blue, 0-1."""
IMAGENET_255 = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
"""The same of 0-255."""
INPUT_VALUES: dict[
    str, tuple[Literal["0-1", "0-255"], tuple[float, float, float] | None, tuple[float, float, float] | None]
] = {
    "0-1": ("0-1", None, None),
    "0-255": ("0-255", None, None),
    "0-1 with ImageNet's mean and std": ("0-1", *IMAGENET),
    "0-255 less ImageNet's mean": ("0-255", IMAGENET_255[0], None),
    "-1 to 1": ("0-1", (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)),
}
"""What detectors are fed with: value range, mean and std, the latter in the order of red, green, blue."""
