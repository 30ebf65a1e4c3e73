"""Contract of a detector, which its graph does not state: how pictures enter it, and what its classes are called.

A :class:`Contract` is stated by the user, by a file beside the model, or by the graph's metadata; every field
carries where it came from, so that nothing is guessed in silence.
"""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from blurnoise._core import checks
from blurnoise_eval.detectors.class_names import COCO80, COCO91

METADATA_KEY = "blurnoise.contract"

EXAMPLE = (
    '{"family": "yolox", "classes": ["stop sign", "yield"], "colour": "bgr", "value_range": "0-255", '
    '"resize": "letterbox-top-left"}'
)


class ModelError(ValueError):
    """A model or its contract cannot be used; the message says what it is and what to do."""


def _class_names(value: object) -> tuple[str, ...]:
    if value in ("coco80", "coco91"):
        return COCO80 if value == "coco80" else COCO91
    if isinstance(value, Mapping):
        by_id = {int(class_id): name for class_id, name in value.items()}
        if sorted(by_id) == list(range(1, len(by_id) + 1)):  # counted from 1, as TensorFlow does
            by_id[0] = "unused 0"
        if sorted(by_id) != list(range(len(by_id))):
            raise ValueError(f"classes: ids must be 0 to {len(value) - 1}, got {list(value)[:8]}")
        value = [by_id[class_id] for class_id in sorted(by_id)]
    if isinstance(value, (list, tuple)) and value and all(isinstance(name, str) for name in value):
        return tuple(value)
    raise ValueError(f"classes = {_shown(value)}: must be a list of names, names by id, 'coco80' or 'coco91'")


def _three(name: str, value: object) -> tuple[float, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise ValueError(f"{name} = {value!r}: must be three numbers, one per channel")
    return tuple(checks.in_range(name, number, -math.inf, math.inf) for number in value)


def _size(value: object) -> tuple[int, int]:
    pair = [value, value] if isinstance(value, int) else value
    if not isinstance(pair, (list, tuple)) or [type(n) for n in pair] != [int, int] or min(pair) < 1:
        raise ValueError(f"input_size_px = {value!r}: must be (height, width), two integers > 0")
    return pair[0], pair[1]


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class Sourced:
    """Mixin of frozen dataclasses whose fields each carry, in ``sources``, where they came from."""

    sources: Mapping[str, str]

    @property
    def assumptions(self) -> list[str]:
        """One sentence per field that nothing stated: what was assumed, why, and how to state it."""
        return [
            f"{name} = {_shown(getattr(self, name))} is {source}; "
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
    of a class is dropped, None where the graph has dropped it itself. sources: for each field where it came
    from. Raises ``ValueError`` or ``TypeError`` naming field, value and what is allowed.
    """

    family: str
    classes: tuple[str, ...]
    colour: str = "rgb"
    value_range: str = "0-1"
    mean: tuple[float, float, float] | None = None
    std: tuple[float, float, float] | None = None
    resize: str = "letterbox"
    pad_value: int = 114
    input_size_px: tuple[int, int] | None = None
    nms_iou: float | None = 0.65
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        checks.one_of("colour", self.colour, ("rgb", "bgr"))
        checks.one_of("value_range", self.value_range, ("0-1", "0-255"))
        checks.one_of("resize", self.resize, ("letterbox", "letterbox-top-left", "stretch", "none"))
        checks.in_range("pad_value", self.pad_value, 0, 255)
        if self.nms_iou is not None:
            checks.in_range("nms_iou", self.nms_iou, 0, 1)
        object.__setattr__(self, "classes", _class_names(self.classes))
        for name in ("mean", "std"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _three(name, getattr(self, name)))
        if self.std is not None and min(self.std) <= 0:
            raise ValueError(f"std = {self.std}: must be > 0")
        if self.input_size_px is not None:
            object.__setattr__(self, "input_size_px", _size(self.input_size_px))
        object.__setattr__(self, "sources", {name: self.sources.get(name, "given") for name in FIELDS})


FIELDS = tuple(f.name for f in fields(Contract) if f.name != "sources")

_IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # mean and std of RGB, 0-1
_IMAGENET_255 = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
_NANODET = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)  # BGR


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
    Contract("fastestdet", COCO80, colour="bgr", resize="stretch", input_size_px=(352, 352), nms_iou=0.45),
)
# fmt: on
PRESETS = {contract.family: contract for contract in _PRESETS}


def preset(name: str) -> Contract:
    """Return the named family's contract with COCO's classes. Raises :class:`ModelError` if there is none."""
    if name not in PRESETS:
        raise ModelError(f"family {name!r} is unknown: must be one of {', '.join(map(repr, PRESETS))}")
    return replace(PRESETS[name], sources=dict.fromkeys(FIELDS, f"preset {name}"))


def parse_contract(stated: object, source: str) -> Contract:
    """Return the contract a mapping states; fields it leaves out follow the preset of its family.

    ``family`` and ``classes`` (names by id, or "coco80") are required. ``source`` names the mapping in
    messages and in ``sources``. Raises :class:`ModelError` for an unknown or missing key or a bad value.
    """
    if not isinstance(stated, Mapping):
        raise ModelError(f"{source}: must map contract fields to values, for example {EXAMPLE}")
    values = {name: value for name, value in stated.items() if name != "sources"}
    if unknown := [repr(name) for name in values if name not in FIELDS]:
        raise ModelError(f"{source}: unknown key {', '.join(unknown)}; known are {', '.join(FIELDS)}")
    if missing := [repr(name) for name in ("family", "classes") if name not in values]:
        raise ModelError(f"{source}: missing key {', '.join(missing)}; for example {EXAMPLE}")
    base = preset(str(values["family"]))
    try:
        return replace(base, **values, sources={**base.sources, **dict.fromkeys(values, source)})
    except (TypeError, ValueError) as error:
        raise ModelError(f"{source}: {error}") from None


def load_contract(name_or_path: str | Path) -> Contract:
    """Return the contract of a preset's name or of a JSON or YAML file.

    Raises :class:`ModelError` if it is neither, cannot be parsed, or states a bad contract.
    """
    if str(name_or_path) in PRESETS:
        return preset(str(name_or_path))
    path = Path(name_or_path)
    if not path.is_file():
        raise ModelError(
            f"contract {str(path)!r}: neither a file nor a preset ({', '.join(map(repr, PRESETS))})"
        )
    return parse_contract(read_mapping(path), f"file {path.name}")


def read_mapping(path: Path) -> object:
    """Return what a JSON or YAML file holds. Raises :class:`ModelError` if it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
        return json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise ModelError(f"contract file {path.name}: cannot be read: {error}") from None


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
    for suffix in ("json", "yaml", "yml"):
        beside = model_path.with_name(f"{model_path.stem}.contract.{suffix}")
        if beside.is_file():
            return load_contract(beside)
    if METADATA_KEY not in metadata:
        return None
    try:
        return parse_contract(json.loads(metadata[METADATA_KEY]), f"metadata {METADATA_KEY}")
    except json.JSONDecodeError as error:
        raise ModelError(f"metadata {METADATA_KEY}: not JSON: {error}") from None


def exported_fields(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Return ``classes`` and ``input_size_px`` where the metadata has Ultralytics' names and imgsz.

    Raises :class:`ModelError` for another task than detection or a value that is no literal.
    """
    if metadata.get("task", "detect") != "detect":
        raise ModelError(f"metadata task = {metadata['task']!r}: only 'detect' can be evaluated")
    known: dict[str, Any] = {}
    for key, name, convert in (("names", "classes", _class_names), ("imgsz", "input_size_px", _size)):
        if key in metadata:
            try:
                known[name] = convert(ast.literal_eval(metadata[key]))
            except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
                raise ModelError(f"metadata {key} = {metadata[key][:60]!r}: {error}") from None
    return known
