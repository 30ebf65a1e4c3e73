"""Contract of a detector, which its graph does not state: how pictures enter it, and what its classes are called.

A :class:`Contract` is stated by the user, by a file beside the model, or by the graph's metadata; every field
carries where it came from, so that nothing is guessed in silence.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Le, Len
from pydantic import BeforeValidator

from blurnoise._core.checks import Characters, check_fields, shown
from blurnoise._core.files import json_of, read_document
from blurnoise_eval.detectors.anchor_head import YOLO_FASTEST_V2, AnchorHead
from blurnoise_eval.detectors.class_names import COCO80, COCO91
from blurnoise_eval.system.storage import is_url, local_file

METADATA_KEY = "blurnoise.contract"
EXPORTER = "metadata of an Ultralytics export"
"""Source of what that exporter's code fixes, such as values 0-1."""

EXAMPLE = (
    '{"family": "yolox", "classes": ["stop sign", "yield"], "colour": "bgr", "value_range": "0-255", '
    '"resize": "letterbox-top-left"}'
)


SHORT_NAMES = {
    "base": "family", "color": "colour", "range": "value_range", "pad": "pad_value", "size": "input_size_px",
    "iou": "nms_iou",
}  # fmt: skip
"""Other names of fields, in a contract's file and on the command line."""

TYPED = (
    "yolox,colour=rgb,value_range=0-1,mean=0.485/0.456/0.406,std=0.229/0.224/0.225,resize=stretch,pad_value=0"
)


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


class Sourced:
    """Mixin of frozen dataclasses whose fields each carry, in ``sources``, where they came from."""

    sources: Mapping[str, str]

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
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()  # type: ignore[call-overload]  # what mixes it in is a dataclass
        }


@dataclass(frozen=True)
class Contract(Sourced):
    """How a picture becomes the network's input, and what the outputs mean.

    family: output layout, a name in :data:`PRESETS`. colour: "rgb" or "bgr". value_range: "0-1" or "0-255".
    mean, std: per channel in the network's channel order and in that range; the input is (x - mean) / std.
    resize: "letterbox" (aspect kept, centred), "letterbox-top-left", "stretch", or "none" (the picture enters
    at its own size). pad_value: grey around a letterboxed picture, 0 to 255. classes: names by class id.
    input_size_px: (height, width), or None where the graph says. nms_iou: overlap above which the weaker box
    of a class is dropped, None where the graph has dropped it itself. head: the anchors of a head that has them.
    sources: for each field where it came from. Raises ``ValueError`` or ``TypeError`` naming field, value and what is
    allowed.
    """

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
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, "sources", {name: self.sources.get(name, "given") for name in FIELDS})


Stated = TypeVar("Stated", bound=Sourced)
FIELDS = tuple(f.name for f in fields(Contract) if f.name != "sources")

_IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # mean and std of RGB, 0-1
_IMAGENET_255 = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
_NANODET = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)  # BGR
INPUT_VALUES: dict[
    str, tuple[Literal["0-1", "0-255"], tuple[float, float, float] | None, tuple[float, float, float] | None]
] = {
    "0-1": ("0-1", None, None),
    "0-255": ("0-255", None, None),
    "0-1 with ImageNet's mean and std": ("0-1", *_IMAGENET),
    "0-255 less ImageNet's mean": ("0-255", _IMAGENET_255[0], None),
    "-1 to 1": ("0-1", (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)),
}
"""What detectors are fed with: value range, mean and std, the latter in the order of red, green, blue."""


def _stretched(family: str, classes: tuple[str, ...], side_px: int, **changes: Any) -> Contract:
    """For a graph that takes one shape of picture and drops double answers itself."""
    size = (side_px, side_px)
    return Contract(
        family, classes, **{"resize": "stretch", "input_size_px": size, "nms_iou": None, **changes}
    )


# Pre-processing and non-maximum suppression as in each family's own repository; input sizes are for graphs
# of dynamic size.
# fmt: off
_PRESETS = (
    Contract("yolov5", COCO80, input_size_px=(640, 640), nms_iou=0.6),
    Contract("yolov6", COCO80, input_size_px=(640, 640), nms_iou=0.65),
    Contract("yolov8", COCO80, input_size_px=(640, 640), nms_iou=0.7),
    Contract("yolox", COCO80, colour="bgr", value_range="0-255", resize="letterbox-top-left",
             input_size_px=(416, 416), nms_iou=0.65),
    Contract("yolov6e2e", COCO80, input_size_px=(640, 640), nms_iou=None),
    Contract("yolov7", COCO80, input_size_px=(640, 640), nms_iou=None),
    Contract("yolov10", COCO80, input_size_px=(640, 640), nms_iou=None),
    _stretched("rtdetr", COCO80, 640),
    _stretched("ppyoloe", COCO80, 640),
    _stretched("detr", COCO91, 800, mean=_IMAGENET[0], std=_IMAGENET[1]),
    _stretched("rfdetr", COCO91, 560, mean=_IMAGENET[0], std=_IMAGENET[1]),
    Contract("mmdeploy", COCO80, value_range="0-255", mean=_IMAGENET_255[0], std=_IMAGENET_255[1],
             resize="letterbox-top-left", pad_value=0, input_size_px=(800, 1344), nms_iou=None),
    Contract("torchvision", COCO91, resize="none", nms_iou=None),
    Contract("tfod", COCO91, value_range="0-255", resize="none", nms_iou=None),
    Contract("nanodet", COCO80, colour="bgr", value_range="0-255", mean=_NANODET[0], std=_NANODET[1],
             resize="letterbox", pad_value=0, input_size_px=(320, 320), nms_iou=0.6),
    Contract("nanodetplus", COCO80, colour="bgr", value_range="0-255", mean=_NANODET[0], std=_NANODET[1],
             resize="stretch", input_size_px=(320, 320), nms_iou=0.6),
    Contract("anchors", COCO80, input_size_px=(640, 640), nms_iou=0.6),
    Contract("yolofastestv2", COCO80, colour="bgr", resize="stretch", input_size_px=(352, 352), nms_iou=0.4,
             head=YOLO_FASTEST_V2),
    Contract("fastestdet", COCO80, colour="bgr", resize="stretch", input_size_px=(352, 352), nms_iou=0.45),
)
# fmt: on
PRESETS = {contract.family: contract for contract in _PRESETS}


def preset(name: str) -> Contract:
    """Return the named family's contract with COCO's classes. Raises :class:`ModelError` if there is none."""
    if not isinstance(name, str) or name not in PRESETS:
        raise ModelError(f"family {shown(name)} is unknown: must be one of {', '.join(map(repr, PRESETS))}")
    return replace(PRESETS[name], sources=dict.fromkeys(FIELDS, f"preset {name}"))


def parse_contract(stated: object, source: str) -> Contract:
    """Return the contract a mapping states; fields it leaves out follow the preset of its family.

    ``family`` and ``classes`` (names by id, or "coco80") are required; ``base``, a family's name in place of
    ``family``, takes its classes, too. Other names of fields are those of ``SHORT_NAMES``. ``source`` names the
    mapping in messages and in ``sources``. Raises :class:`ModelError` for an unknown, missing or doubled key or a bad
    value.
    """
    if isinstance(stated, Mapping):
        named = [SHORT_NAMES.get(name, name) for name in stated]
        if twice := [name for name in stated if named.count(SHORT_NAMES.get(name, name)) > 1]:
            raise ModelError(f"{source}: {' and '.join(map(repr, twice))} are one field; state it once")
        based = "base" in stated
        stated = dict(zip(named, stated.values(), strict=True))
        if based:
            stated = {"classes": preset(stated["family"]).classes, **stated}
    values = stated_values(stated, FIELDS, source, EXAMPLE)
    if missing := [repr(name) for name in ("family", "classes") if name not in values]:
        raise ModelError(f"{source}: missing key {', '.join(missing)}; for example {EXAMPLE}")
    return completed(preset(values["family"]), values, source)


def stated_values(stated: object, names: Sequence[str], source: str, example: str) -> dict[str, Any]:
    """Return what a mapping states of the fields ``names``. Raises :class:`ModelError` for another key."""
    if not isinstance(stated, Mapping):
        raise ModelError(f"{source}: must map contract fields to values, for example {example}")
    values = {name: value for name, value in stated.items() if name != "sources"}
    if unknown := [name for name in values if name not in names]:
        near = get_close_matches(str(unknown[0])[:99], names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ModelError(f"{source}: unknown key {shown(unknown)[1:-1]}; known are {', '.join(names)}{hint}")
    return values


def completed(base: Stated, values: Mapping[str, Any], source: str) -> Stated:
    """Return ``base`` with ``values`` of ``source``. Raises :class:`ModelError` for a bad value."""
    try:
        sources = {**base.sources, **dict.fromkeys(values, source)}
        return replace(base, **values, sources=sources)  # type: ignore[type-var]  # what mixes it in is a dataclass
    except (TypeError, ValueError) as error:
        raise ModelError(f"{source}: {error}") from None


def load_contract(name_or_path: str | Path) -> Contract:
    """Return the contract of a preset's name or of a JSON or YAML file, on this machine or at a URL.

    Either may be followed by fields that differ: "yolox,colour=rgb,range=0-1,mean=0.485/0.456/0.406".
    Raises :class:`ModelError` if it is neither, cannot be parsed, or states a bad contract.
    """
    if str(name_or_path) in PRESETS:
        return preset(str(name_or_path))
    path = _here(name_or_path)
    if not path.is_file():
        base, *fields = str(name_or_path).split(",")
        if fields and all("=" in each for each in fields):
            stated = dict(each.split("=", 1) for each in fields)
            return _varied(load_contract(base), stated, f"--contract {base},...")
        raise ModelError(
            f"contract {str(name_or_path)!r}: neither a file nor a preset ({', '.join(map(repr, PRESETS))})"
        )
    return parse_contract(read_mapping(path), f"file {path.name}")


def _varied(base: Contract, stated: Mapping[str, str], source: str) -> Contract:
    """The contract with fields as they are typed."""
    values: dict[str, Any] = {}
    for short, text in stated.items():
        name = SHORT_NAMES.get(short.strip(), short.strip())
        try:
            values[name] = _typed(name, text.strip())
        except ValueError:
            raise ModelError(
                f"{source}: {name} = {text!r}: must be typed as in {TYPED}; none where there is none"
            ) from None
    return completed(base, stated_values(values, FIELDS, source, TYPED), source)


def _typed(name: str, text: str) -> object:
    if text == "none":
        return None
    if name in ("mean", "std"):
        return tuple(float(part) for part in text.split("/"))
    if name == "input_size_px":
        sides = tuple(int(part) for part in text.split("x"))
        return sides if len(sides) > 1 else sides * 2
    if name == "classes" and text not in ("coco80", "coco91"):
        return tuple(text.split("/"))
    return int(text) if name == "pad_value" else float(text) if name == "nms_iou" else text


def contract_option(contract: Contract) -> str | None:
    """The contract as ``--contract`` takes it: its family, and what differs from that preset.

    None for one that only a file can hold, because of its names of classes or of a head with anchors.
    """
    base = PRESETS[contract.family]
    parts = []
    for name in FIELDS:
        value = getattr(contract, name)
        if value == getattr(base, name):
            continue
        if isinstance(value, tuple):
            text = ("x" if name == "input_size_px" else "/").join(map(str, value))
        else:
            text = "none" if value is None else str(value)
        parts.append(f"{name}={text}")
    typed = ",".join([contract.family, *parts])
    try:
        return typed if load_contract(typed) == contract else None
    except ModelError:
        return None


def contract_document(contract: Contract) -> dict[str, Any]:
    """What a contract's file holds: every field but the sources, COCO's classes by their short name."""
    known = {COCO80: "coco80", COCO91: "coco91"}
    values = {name: value for name, value in contract.to_dict().items() if name != "sources"}
    return values | {"classes": known.get(contract.classes, list(contract.classes))}


def _here(stated: str | Path) -> Path:
    """The file; one at a URL is fetched. Raises :class:`ModelError` where it cannot be."""
    try:
        return local_file(str(stated) if is_url(str(stated)) else Path(stated))
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def read_mapping(path: Path) -> object:
    """Return what a JSON or YAML file holds. Raises :class:`ModelError` if it cannot be read."""
    try:
        return read_document(path)
    except (OSError, ValueError) as error:
        raise ModelError(f"contract file {path.name}: cannot be read: {error}") from None


def metadata_mapping(metadata: Mapping[str, str]) -> object:
    """Return what the metadata states, None for nothing. Raises :class:`ModelError` if it is no JSON."""
    try:
        return json_of(metadata.get(METADATA_KEY, "null"))
    except ValueError as error:
        raise ModelError(f"metadata {METADATA_KEY}: not JSON: {error}") from None


def contract_file(model_path: Path, contract: object = None) -> Path | None:
    """Return the caller's file, else ``model.contract.json``, ``.yaml`` or ``.yml`` beside it, else None."""
    if isinstance(contract, (str, Path)):
        return _here(contract) if _here(contract).is_file() else None
    beside = (model_path.with_name(f"{model_path.stem}.contract.{end}") for end in ("json", "yaml", "yml"))
    return next((path for path in beside if path.is_file()), None)


def stated_contract(
    model_path: Path, metadata: Mapping[str, str], contract: Contract | str | Path | None
) -> Contract | None:
    """Return the contract somebody stated, or None: the caller's, else the file beside the model, else the
    graph's metadata under ``blurnoise.contract``.

    The file beside ``model.onnx`` is ``model.contract.json``, ``.yaml`` or ``.yml``.
    Raises :class:`ModelError` as :func:`load_contract` does.
    """
    if isinstance(contract, Contract):
        return contract
    if contract is not None:
        return load_contract(contract)
    if (beside := contract_file(model_path)) is not None:
        return load_contract(beside)
    if METADATA_KEY not in metadata:
        return None
    return parse_contract(metadata_mapping(metadata), f"metadata {METADATA_KEY}")


def exported_fields(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Return ``classes`` and ``input_size_px`` where the metadata has Ultralytics' names and imgsz.

    Raises :class:`ModelError` for another task than detection or a value that is no literal.
    """
    if metadata.get("task", "detect") != "detect":
        raise ModelError(f"metadata task = {metadata['task']!r}: only 'detect' can be evaluated")
    known: dict[str, Any] = {}
    for key, name in (("names", "classes"), ("imgsz", "input_size_px")):
        if key in metadata:
            try:
                stated = {"classes": "coco80", name: ast.literal_eval(metadata[key])}
                known[name] = getattr(Contract("exported", **stated), name)
            except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
                raise ModelError(f"metadata {key} = {metadata[key][:60]!r}: {error}") from None
    return known
