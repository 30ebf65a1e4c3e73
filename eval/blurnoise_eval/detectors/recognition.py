"""Recognition of the family of a graph, and of its contract."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import COCO80, COCO91, EXPORTER, Contract, ModelError
from blurnoise_eval.detectors.contract_files import preset, settled
from blurnoise_eval.detectors.formats import BY_EVIDENCE, FAMILIES, PRESETS
from blurnoise_eval.detectors.formats.boxes import lay_in
from blurnoise_eval.detectors.formats.columns import matched, named, readings, refuted
from blurnoise_eval.detectors.formats.exporters import RTDETR_V83, RTDETR_V84, YOLOV5, YOLOV8, YOLOV10
from blurnoise_eval.detectors.formats.family import Family, OutputLayout, Signature
from blurnoise_eval.detectors.formats.grids import with_head
from blurnoise_eval.detectors.model import TensorInfo
from blurnoise_eval.detectors.outputs import EXAMPLE, parsed

_HEAD_EXAMPLE = (
    '"head": {"strides": [8, 16, 32], "anchors": [[10,13, 16,30, 33,23], [30,61, 62,45, 59,119], '
    '[116,90, 156,198, 373,326]], "boxes": "yolov5"}'
)
_SPARE = "scores by sigmoid, background"
_LIKELY = (
    "xyxy, score, class", "picture, xyxy, score, class", "count; xyxy; score; class", "xyxy; score; class",
    "xyxy, score; class", "cxcywh, objectness, scores", "cxcywh, scores", "xyxy; scores",
    "xyxy; scores by softmax, background",
)  # fmt: skip
"""Outputs of exporters that are not known, which other readings are tried of."""
_RAW_SIZE_LIMIT = 16.0
"""YOLOX's raw sizes are logarithms of strides, rarely above 4; boxes in px reach this in the 99th percentile."""


def resolve(signature: Signature, stated: Contract | None = None) -> tuple[Contract, OutputLayout]:
    """Return a graph's contract with the input size filled in, and how its family reads it.

    The contract is what is stated, else the preset of the family that the graph shows, with every field that it
    cannot show marked as assumed. Raises :class:`ModelError` if no family or several fit, or if contract and graph
    disagree.
    """
    if stated is None:
        layout, source = _recognise(signature)
        contract = _assumed(layout, source, signature)
    elif (reads := _as_stated(stated := _with_columns(stated), signature)) is not None:
        contract, layout = stated, reads
    else:
        says = f"family = {stated.family!r} ({stated.sources['family']})"
        says += f", outputs = {stated.outputs!r} ({stated.sources['outputs']})" * (stated.outputs is not None)
        raise ModelError(f"{says}: the graph has no such outputs:\n{signature.describe()}")
    contract = _with_background(contract, layout)
    if layout.classes not in (0, _slots(contract)):
        raise ModelError(
            f"the graph ({contract.family}) has {layout.classes} classes but the contract names "
            f"{len(contract.classes)} ({contract.sources['classes']}); list all names, in order, "
            "as 'classes' of a contract"
        )
    contract = _fitted(contract, layout.family, signature.inputs[0])
    if stated is None:
        contract = _read(contract, layout, signature)
    return contract, layout.bound(contract)


def _with_columns(stated: Contract) -> Contract:
    """With those of its family, where nothing is said of them."""
    usual = preset(stated.family)
    if stated.outputs is not None or usual.outputs is None:
        return stated
    return replace(
        stated, outputs=usual.outputs, sources={**stated.sources, "outputs": usual.sources["outputs"]}
    )


def _slots(contract: Contract) -> int:
    """Columns of scores that the shapes show as classes."""
    return len(contract.classes) + (contract.outputs is not None and _SPARE in contract.outputs)


def _with_background(contract: Contract, layout: OutputLayout) -> Contract:
    """Of a family whose own classes are followed by one for none, with that column."""
    text = contract.outputs
    if not layout.family.background_last or text is None or _SPARE in text:
        return contract
    if layout.classes != len(contract.classes) + 1:
        return contract
    named = f"as {len(contract.classes)} classes are named"
    why = f"graph: the last of {layout.classes} columns of scores is the background, {named}"
    outputs = text.replace("scores by sigmoid", _SPARE)
    return replace(contract, outputs=outputs, sources={**contract.sources, "outputs": why})


def _as_stated(stated: Contract, signature: Signature) -> OutputLayout | None:
    """How the graph is read by a contract; None where it has no such outputs."""
    family = _with_head(stated)
    usual = preset(stated.family).outputs
    if stated.outputs is None and family.name == "columns":
        raise ModelError(f"family {family.name!r} needs the outputs in the contract, for example {EXAMPLE!r}")
    if stated.outputs == usual:
        return family.describe(signature)
    outputs = parsed(stated.outputs or "")
    matching = matched(outputs, signature.outputs, len(stated.classes))
    if matching is None:
        return None
    columns = [column for output in outputs for column in output.columns]
    dense = any(column.kind == "scores" and column.how != "by softmax" for column in columns)
    family = replace(family, several_classes=family.several_classes if usual else dense)
    shapes = ", ".join(f"{output.name!r} {list(output.shape)}" for output in matching)
    return OutputLayout(
        family, tuple(output.name for output in matching), 0, f"output{'s' * (len(matching) > 1)} {shapes}"
    )


def _read(contract: Contract, layout: OutputLayout, signature: Signature) -> Contract:
    """With another reading of the columns, where the answers for a grey picture refute the family's own."""
    if contract.outputs is None or not signature.answers:
        return contract
    text, answers = (
        named(contract.outputs, layout.outputs),
        [[signature.answers[name] for name in layout.outputs]],
    )
    allowed, why = readings(text, answers, signature.size_px, len(contract.classes), others=False)
    if not why or not allowed:
        return contract
    source = f"assumed: of a grey picture {why} with {contract.outputs!r}"
    return replace(contract, outputs=allowed[0], sources={**contract.sources, "outputs": source})


def _with_head(stated: Contract) -> Family:
    """The family of a contract, with the anchors that it states."""
    family = FAMILIES[preset(stated.family).family]
    if family.takes_head and stated.head is not None:
        return with_head(family, stated.head, len(stated.classes))
    if family.takes_head:
        needs = f"family {family.name!r} needs the anchors of its head in the contract"
        raise ModelError(f"{needs}, for example {_HEAD_EXAMPLE}")
    if stated.head is not None:
        heads = ", ".join(
            sorted(
                family_with_head.name for family_with_head in FAMILIES.values() if family_with_head.takes_head
            )
        )
        raise ModelError(f"head: is for the families {heads}, not for {family.name}")
    return family


def _recognise(signature: Signature) -> tuple[OutputLayout, str]:
    """How the graph is read, and what shows it, "graph: ..." or "assumed: ..."."""
    exporter, groups = _by_metadata(signature.metadata)
    known = exported_fields(signature.metadata).get("classes")
    unnamed = list[OutputLayout]()
    # What the exporter says of itself is the surest, then what only one family can have: see BY_EVIDENCE.
    for group in (*groups, *BY_EVIDENCE):
        exported = f"metadata {exporter}; " * (group in groups)
        fitting = list(filter(None, (family.describe(signature) for family in group)))
        if fitting and all(
            reading.family.by_shape
            and reading.classes not in (0, len(known or reading.family.preset.classes))
            for reading in fitting
        ):
            unnamed += fitting
            continue
        if len(fitting) > 1:
            return _choose(fitting, signature, exported)
        for layout in fitting:
            return layout, f"graph: {exported}{layout.why}"
    for layout in (*_by_columns(signature), *unnamed):
        return layout, f"assumed: {layout.why}, of no known exporter"
    raise ModelError(
        f"the graph matches none of the known families ({', '.join(PRESETS)}); a head with "
        f'anchors needs a contract with "family": "anchors" and {_HEAD_EXAMPLE}\n'
        f"{signature.describe()}"
    )


def _by_columns(signature: Signature) -> Iterator[OutputLayout]:
    """Readings of a graph of no known exporter whose outputs may be columns, the likeliest first."""
    family = FAMILIES["columns"]
    known = exported_fields(signature.metadata).get("classes")
    for text, classes in product(_LIKELY, [known] if known else [COCO80, COCO91]):
        outputs = parsed(text)
        matching = matched(outputs, signature.outputs, len(classes))
        if matching is None or len(matching) < len(signature.outputs):
            continue
        names = tuple(output.name for output in matching)
        answers = [[signature.answers[name] for name in names]] if signature.answers else []
        allowed, _ = readings(named(text, names), answers, signature.size_px, len(classes), others=True)
        if allowed:
            shapes = ", ".join(f"{output.name!r} {list(output.shape)}" for output in matching)
            dense = "scores" in text and "softmax" not in text
            as_read = replace(family.preset, outputs=text, classes=classes)
            family = replace(family, preset=as_read, several_classes=dense)
            yield OutputLayout(
                family, names, len(classes) if "scores" in text else 0, f"outputs {shapes} as {text!r}"
            )


def _by_metadata(metadata: Mapping[str, str]) -> tuple[str, tuple[tuple[Family, ...], ...]]:
    """Which metadata say who exported the graph, and the families that are exported so, as in the table."""
    if "Ultralytics" in metadata.get("author", ""):
        try:
            suppressed = ast.literal_eval(metadata.get("args", "{}")).get("nms") is True
        except (ValueError, SyntaxError, AttributeError, MemoryError, RecursionError):
            suppressed = False
        if suppressed or metadata.get("end2end") == "True":
            return "author, end2end or nms", ((YOLOV10, RTDETR_V84),)
        return "author", ((YOLOV8,), (YOLOV10, RTDETR_V84), (RTDETR_V83,))
    return ("stride, names", ((YOLOV5,),)) if {"stride", "names"} <= metadata.keys() else ("", ())


def _choose(fitting: list[OutputLayout], signature: Signature, exported: str) -> tuple[OutputLayout, str]:
    """Which of several families it is: the one with as many classes as there are names, whose columns the values
    allow, else a probe's."""
    known = exported_fields(signature.metadata).get("classes")
    agreeing = [
        reading for reading in fitting if reading.classes in (0, len(known or reading.family.preset.classes))
    ]
    if len(agreeing) == 1:
        named = "graph: {}, as many as the metadata names" if known else "assumed: {}, as many as COCO has"
        return agreeing[0], named.format(agreeing[0].why)
    agreeing = (
        [reading for reading in agreeing or fitting if not _refuted(reading, signature)]
        or agreeing
        or fitting
    )
    by_name = {layout.family.name: layout for layout in agreeing}
    if signature.answer and by_name.keys() == {"yolox", "yolov6"}:
        axes = signature.inputs[0].axes or "nchw"
        blob, _ = lay_in(drawn_picture(), PRESETS["yolox"], signature.size_px, axes=axes)
        if decided := _yolox_or_yolov6(signature.answer(blob)):
            return by_name[decided[0]], f"graph: {by_name[decided[0]].why}; {decided[1]}"
    first = agreeing[0]
    if all(reading.family.preset.outputs for reading in agreeing):
        others = ", ".join(list(by_name)[1:])
        source = (
            f"assumed: {first.why}; so are {others}"
            if others
            else f"graph: {exported}{first.why}, and its values"
        )
        if exported:  # of which the first is by far the commoner
            source = f"graph: {exported}{first.why}"
        return first, source
    lines = " or ".join(f'"family": "{name}"' for name in by_name)
    raise ModelError(
        f"the graph matches several families ({', '.join(by_name)}); to choose one, write "
        f"{lines} into <model>.contract.json, or use --contract\n{signature.describe()}"
    )


def _refuted(layout: OutputLayout, signature: Signature) -> str:
    """Why the answers for a grey picture are not of this family; "" where they may be."""
    usual = layout.family.preset
    if usual.outputs is None or not signature.answers:
        return ""
    answers = [[signature.answers[name] for name in layout.outputs]]
    return refuted(answers, usual.outputs, signature.size_px, layout.classes or len(usual.classes))


def drawn_picture(side_px: int = 416) -> NDArray[np.uint8]:
    """A stop sign and bars before a gradient, (side, side, 3) RGB, the same for every call.

    It needs structure: on a flat grey a detector sees nothing anywhere, and then boxes and objectness say little
    about what they mean.
    """
    from blurnoise import charts  # torch takes a second to import, and few graphs need this picture
    from blurnoise.camera.colour import srgb_from_linear

    sign = charts.stop_sign(side_px / 3, height_px=side_px, width_px=side_px, background=0.18)
    coded = srgb_from_linear(sign[0]).mul(255).permute(1, 2, 0).numpy()
    y, x = np.mgrid[:side_px, :side_px] / side_px
    scene = 60 + 120 * (1 - y)[..., None] * np.array([0.8, 0.9, 1.0])
    scene[(x >= 0.05) & (x < 0.25) & (y >= 0.55) & (y < 0.95)] = 30
    scene[(x >= 0.72) & (x < 0.96) & (y >= 0.6) & (y < 0.75)] = 220
    third = slice(side_px // 3 - 2, side_px - side_px // 3 + 2)
    scene[third, third] = coded[third, third]
    return np.asarray(scene.round(), np.uint8)


def _yolox_or_yolov6(outputs: Sequence[NDArray[np.float32]]) -> tuple[str, str] | None:
    """Decide between YOLOX and YOLOv6 by the answer to a test picture; return family and evidence, or None."""
    rows = outputs[0][0].astype(np.float32)
    if (rows[:, 4] == 1).all():
        return "yolov6", "the objectness of a test picture is 1 everywhere"
    largest = float(np.percentile(rows[:, 2:4], 99))
    if largest < _RAW_SIZE_LIMIT:
        return (
            "yolox",
            f"99 % of the box sizes of a test picture are below {largest:.3g}, so they are logarithms",
        )
    return None


def _assumed(layout: OutputLayout, source: str, signature: Signature) -> Contract:
    """Return the preset of a recognised family, completed from metadata as Ultralytics' exports write it."""
    name, count = layout.family.name, layout.classes
    base = replace(layout.family.preset, sources=preset(name).sources)
    known = exported_fields(signature.metadata)
    exported = source.startswith("graph: metadata")  # by a code whose pre-processing is known
    whence = (
        f"preset {name} ({EXPORTER})" if exported else f"assumed: preset {name}, which the graph suggests"
    )
    sources = {**dict.fromkeys(base.names(), whence), "family": source}
    if base.head is None:
        sources["head"] = f"preset {name}"  # there is nothing to state
    if base.outputs is None:
        sources["outputs"] = f"preset {name}"
    if "classes" not in known:
        if count not in (0, len(base.classes)):
            heads = f"; a head of other anchors needs {_HEAD_EXAMPLE}" if layout.family.takes_head else ""
            lacks = (
                f"the graph ({name}) has {count} classes without names; set 'classes' of a contract{heads}"
            )
            raise ModelError(f"{lacks}\n{signature.describe()}")
        shows = f"the graph has {count}" if count else "the graph does not show how many it has"
        sources["classes"] = f"assumed: COCO's {len(base.classes)} classes, because {shows}"
    return replace(base, **known, sources={**sources, **dict.fromkeys(known, "metadata")})


def _fitted(contract: Contract, family: Family, image: TensorInfo) -> Contract:
    """Return the contract with what the graph's input settles: a fixed size, and bytes, which are 0 to 255.

    Raises :class:`ModelError` where a statement and the graph disagree.
    """
    values: dict[str, Any] = {}
    if image.channels == 1:
        values["colour"] = "grey"
    if image.type == "tensor(uint8)":
        values |= {"value_range": "0-255", "mean": None, "std": None}
    if fixed := all(isinstance(side, int) for side in image.size_px):
        values["input_size_px"] = image.size_px
    fitted = settled(contract, values, "graph", f"the graph's input is {image.type} {list(image.shape)}")
    if fixed and contract.resize == "none":
        sources = {**fitted.sources, "resize": "assumed: the graph takes one size"}
        fitted = replace(fitted, resize=family.fixed_resize, sources=sources)
    return fitted


def exported_fields(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Return ``classes`` and ``input_size_px`` where the metadata has Ultralytics' names and imgsz.

    Raises :class:`ModelError` for another task than detection or a value that is no literal.
    """
    if metadata.get("task", "detect") != "detect":
        raise ModelError(f"metadata task = {metadata['task']!r}: must be 'detect'")
    known: dict[str, Any] = {}
    for key, name in (("names", "classes"), ("imgsz", "input_size_px")):
        if key in metadata:
            try:
                fields = {"classes": "coco80", name: ast.literal_eval(metadata[key])}
                known[name] = getattr(Contract("exported", **fields), name)
            except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
                raise ModelError(f"metadata {key} = {metadata[key][:60]!r}: {error}") from None
    return known
