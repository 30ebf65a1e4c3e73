"""The output families, one module each, and which of them a graph belongs to."""

from __future__ import annotations

import ast
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from blurnoise_eval.detectors.contract import (
    EXPORTER,
    FIELDS,
    Contract,
    ModelError,
    exported_fields,
    preset,
    stated_contract,
)
from blurnoise_eval.detectors.formats import (
    anchors,
    detr,
    fastestdet,
    mmdeploy,
    nanodet,
    nanodetplus,
    ppyoloe,
    probe,
    rfdetr,
    rtdetr,
    tfod,
    torchvision,
    yolofastestv2,
    yolov5,
    yolov6,
    yolov6e2e,
    yolov7,
    yolov8,
    yolov10,
    yolox,
)
from blurnoise_eval.detectors.formats.placement import lay_in
from blurnoise_eval.detectors.formats.signature import Family, Layout, Signature

# By what shows a family, the surest first: where one kind of evidence is there, later ones are not asked.
_BY_EVIDENCE: tuple[tuple[Family, ...], ...] = (
    (ppyoloe, rtdetr, torchvision),  # inputs beside the picture, answers without a batch
    (detr, rfdetr, mmdeploy, yolov6e2e),  # names of outputs
    (tfod,),  # the picture's own form: bytes with the channels last
    (yolov5, yolov8, yolox, yolov6, fastestdet, nanodet, nanodetplus, yolofastestv2),  # numbers of grid cells
    (yolov10, yolov7),  # rows of six or seven
    (anchors,),  # none: the contract's head tells
)
_HEAD_EXAMPLE = (
    '"head": {"strides": [8, 16, 32], "anchors": [[10,13, 16,30, 33,23], [30,61, 62,45, 59,119], '
    '[116,90, 156,198, 373,326]], "boxes": "yolov5"}'
)
FAMILIES: tuple[Family, ...] = tuple(family for families in _BY_EVIDENCE for family in families)


@dataclass(frozen=True)
class _Found:
    """A family that a graph was recognised as, its layout, and what showed it. ``sure``: nothing was guessed."""

    family: Family
    layout: Layout
    why: str
    exported: bool = False  # by Ultralytics' code, whose pre-processing is known
    sure: bool = True


def resolve(
    model_path: Path, signature: Signature, contract: Contract | str | Path | None = None
) -> tuple[Family, Contract, Layout]:
    """Return the graph's family, its contract with the input size filled in, and how the graph is read.

    The contract is the caller's, else that of the file beside the model, else the metadata's, else the preset
    of the family that the graph shows, with every field that it cannot show marked as assumed.
    Raises :class:`ModelError` if no family or several fit, or if contract and graph disagree.
    """
    stated = stated_contract(model_path, signature.metadata, contract)
    if stated is None:
        found = _recognise(signature)
        return found.family, _fitted(_assumed(found, signature), signature), found.layout
    named = [family for family in FAMILIES if stated.family == family.NAME]
    if not named:
        raise ModelError(f"family {stated.family!r}: must be one of {', '.join(f.NAME for f in FAMILIES)}")
    family = _with_head(named[0], stated)
    layout = family.describe(signature) if signature.outputs else None
    if layout is None:
        raise ModelError(
            f"the contract ({stated.sources['family']}) says {stated.family}, "
            f"but the graph has no outputs of that shape:\n{signature.describe()}"
        )
    _check_class_count(stated, layout.classes)
    return family, _fitted(stated, signature), layout


def _with_head(family: Family, contract: Contract) -> Family:
    """The family with the anchors and classes that the contract states."""
    heads = {anchors.NAME, yolofastestv2.NAME}
    if family.NAME not in heads:
        if contract.head is not None:
            raise ModelError(
                f"head: goes with the families {', '.join(sorted(heads))}, not with {family.NAME}"
            )
        return family
    if contract.head is None:
        raise ModelError(
            f"family {family.NAME!r} needs the head's anchors in its contract, for example {_HEAD_EXAMPLE}"
        )
    return anchors.WithAnchors(family.NAME, contract.head, len(contract.classes), family.UNKNOWN)


def _recognise(signature: Signature) -> _Found:
    exporter, families = _by_metadata(signature)
    groups = (*((family,) for family in families), *_BY_EVIDENCE) if signature.outputs else ()
    for order, group in enumerate(groups):
        fitting = [(each, layout) for each in group if (layout := each.describe(signature)) is not None]
        if len(fitting) > 1:
            return _choose(fitting, signature)
        if fitting:
            (family, layout), exported = fitting[0], order < len(families)
            return _Found(family, layout, f"metadata {exporter}; " * exported + layout.why, exported)
    raise ModelError(
        f"the graph fits no output family known here ({', '.join(family.NAME for family in FAMILIES)}); a head with "
        f'anchors needs a contract with "family": "anchors" and {_HEAD_EXAMPLE}\n'
        f"{signature.describe()}"
    )


def _by_metadata(signature: Signature) -> tuple[str, tuple[Family, ...]]:
    """Which metadata say who exported the graph, and the families that are exported so; else nothing."""
    metadata = signature.metadata
    if "Ultralytics" in metadata.get("author", ""):
        try:
            suppressed = ast.literal_eval(metadata.get("args", "{}")).get("nms") is True
        except (ValueError, SyntaxError, AttributeError, MemoryError, RecursionError):
            suppressed = False
        if suppressed or metadata.get("end2end") == "True":
            return "author, end2end or nms", (yolov10,)
        return "author", (yolov8, yolov10)
    return ("stride, names", (yolov5,)) if {"stride", "names"} <= metadata.keys() else ("", ())


def _choose(fitting: list[tuple[Family, Layout]], signature: Signature) -> _Found:
    """Which of several families it is: the one with as many classes as there are names, else a probe's."""
    known = exported_fields(signature.metadata).get("classes")
    agreeing = [
        (family, layout)
        for family, layout in fitting
        if layout.classes in (0, len(known or preset(family.NAME).classes))
    ]
    if len(agreeing) == 1:
        family, layout = agreeing[0]
        whose = "the metadata names" if known else "COCO has"
        return _Found(family, layout, f"{layout.why}, as many as {whose}", sure=known is not None)
    by_name = {family.NAME: (family, layout) for family, layout in agreeing or fitting}
    if signature.answer and signature.size_px and by_name.keys() == {"yolox", "yolov6"}:
        image = signature.inputs[0]
        blob, _ = lay_in(probe.picture(), preset("yolox"), signature.size_px, axes=image.axes or "nchw")
        if told := probe.told_apart(set(by_name), signature.answer(blob)):
            family, layout = by_name[told[0]]
            return _Found(family, layout, f"{layout.why}; {told[1]}")
    lines = " or ".join(f'"family": "{name}"' for name in by_name)
    raise ModelError(
        f"the graph fits several output families ({', '.join(by_name)}), and nothing in it tells which: write "
        f"{lines} into <model>.contract.json, or give --contract\n{signature.describe()}"
    )


def _assumed(found: _Found, signature: Signature) -> Contract:
    """Return the preset of a recognised family, completed from metadata as Ultralytics' exports write it."""
    name, count = found.family.NAME, found.layout.classes
    base = preset(name)
    known = exported_fields(signature.metadata)
    if found.exported:
        sources = dict.fromkeys(FIELDS, f"preset {name} ({EXPORTER})")
    else:
        sources = dict.fromkeys(FIELDS, f"assumed: preset {name}, which the graph suggests")
    if base.head is None:
        sources["head"] = f"preset {name}"  # there is nothing to state
    sources["family"] = f"{'graph' if found.sure else 'assumed'}: {found.why}"
    if "classes" not in known:
        if count not in (0, len(base.classes)):
            raise ModelError(
                f"the graph ({name}) has {count} classes but nothing names them\n{signature.describe()}"
            )
        shows = f"the graph has {count}" if count else "the graph does not show how many it has"
        sources["classes"] = f"assumed: COCO's {len(base.classes)} classes, because {shows}"
    sources.update(dict.fromkeys(known, "metadata"))
    contract = replace(base, **known, sources=sources)
    _check_class_count(contract, count)
    return contract


def _check_class_count(contract: Contract, count: int) -> None:
    if count not in (0, len(contract.classes)):
        raise ModelError(
            f"the graph ({contract.family}) has {count} classes but the contract names "
            f"{len(contract.classes)} ({contract.sources['classes']}): state all names, in order, "
            "under 'classes' in a contract"
        )


def _fitted(contract: Contract, signature: Signature) -> Contract:
    """Return the contract with what the graph's input settles: a fixed size, and bytes, which are 0 to 255.

    Raises :class:`ModelError` where a statement and the graph disagree.
    """
    image = signature.inputs[0]
    settled: dict[str, Any] = {}
    if image.type == "tensor(uint8)":
        settled |= {"value_range": "0-255", "mean": None, "std": None}
    height, width = image.shape[1:3] if image.axes == "nhwc" else image.shape[-2:]
    if isinstance(height, int) and isinstance(width, int):
        settled["input_size_px"] = (height, width)
        if (
            contract.resize == "none"
        ):  # TensorFlow's detectors squeeze pictures themselves, torchvision's do not
            settled["resize"] = "stretch" if contract.family == "tfod" else "letterbox-top-left"
    sources = {**contract.sources, **dict.fromkeys(settled, "graph")}
    for name, value in settled.items():
        stated, source = getattr(contract, name), contract.sources[name]
        if stated in (None, value) or source.startswith(("preset", "assumed")):
            continue
        takes = f"{image.type} {list(image.shape)}"
        raise ModelError(
            f"{name} = {stated} ({source}): the graph takes only {value or takes}, as its input is {takes}"
        )
    if "resize" in settled:
        sources["resize"] = "assumed: the graph takes one size"
    return replace(contract, **settled, sources=sources)
