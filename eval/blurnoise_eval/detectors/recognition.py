"""Recognition: which family a graph belongs to, and its contract."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from blurnoise_eval.detectors.contract import EXPORTER, Contract, ModelError
from blurnoise_eval.detectors.contract_files import preset
from blurnoise_eval.detectors.formats import BY_EVIDENCE, FAMILIES, PRESETS, probe
from blurnoise_eval.detectors.formats.anchors import with_head
from blurnoise_eval.detectors.formats.end_to_end import YOLOV10
from blurnoise_eval.detectors.formats.grids import YOLOV5, YOLOV8
from blurnoise_eval.detectors.formats.placement import lay_in
from blurnoise_eval.detectors.formats.signature import Family, Layout, Signature

_HEAD_EXAMPLE = (
    '"head": {"strides": [8, 16, 32], "anchors": [[10,13, 16,30, 33,23], [30,61, 62,45, 59,119], '
    '[116,90, 156,198, 373,326]], "boxes": "yolov5"}'
)


@dataclass(frozen=True)
class _Found:
    """A family that a graph was recognised as, its layout, and what showed it. ``sure``: nothing was guessed."""

    family: Family
    layout: Layout
    why: str
    exported: bool = False  # by Ultralytics' code, whose pre-processing is known
    sure: bool = True


def resolve(signature: Signature, stated: Contract | None = None) -> tuple[Family, Contract, Layout]:
    """Return the graph's family, its contract with the input size filled in, and how the graph is read.

    The contract is what is stated, else the preset of the family that the graph shows, with every field that it
    cannot show marked as assumed. Raises :class:`ModelError` if no family or several fit, or if contract and graph
    disagree.
    """
    if stated is None:
        found = _recognise(signature)
        contract, family, layout = _assumed(found, signature), found.family, found.layout
    else:
        contract, family = stated, _with_head(stated)
        reads = family.describe(signature)
        if reads is None:
            says = f"the contract ({stated.sources['family']}) says {stated.family}"
            raise ModelError(f"{says}, but the graph has no outputs of that shape:\n{signature.describe()}")
        layout = reads
    if layout.classes not in (0, len(contract.classes)):
        raise ModelError(
            f"the graph ({contract.family}) has {layout.classes} classes but the contract names "
            f"{len(contract.classes)} ({contract.sources['classes']}): state all names, in order, "
            "under 'classes' in a contract"
        )
    return family, _fitted(contract, family, signature), layout


def _with_head(stated: Contract) -> Family:
    """The family of a contract, with the anchors that it states."""
    family = FAMILIES[preset(stated.family).family]
    if stated.head is None and family.takes_head:
        needs = f"family {family.name!r} needs the head's anchors in its contract"
        raise ModelError(f"{needs}, for example {_HEAD_EXAMPLE}")
    if stated.head is None:
        return family
    if not family.takes_head:
        heads = ", ".join(sorted(each.name for each in FAMILIES.values() if each.takes_head))
        raise ModelError(f"head: goes with the families {heads}, not with {family.name}")
    return with_head(family, stated.head, len(stated.classes))


def _recognise(signature: Signature) -> _Found:
    exporter, families = _by_metadata(signature)
    groups = (*((family,) for family in families), *BY_EVIDENCE)
    for order, group in enumerate(groups):
        fitting = [(each, layout) for each in group if (layout := each.describe(signature)) is not None]
        if len(fitting) > 1:
            return _choose(fitting, signature)
        if fitting:
            (family, layout), exported = fitting[0], order < len(families)
            return _Found(family, layout, f"metadata {exporter}; " * exported + layout.why, exported)
    raise ModelError(
        f"the graph fits no output family known here ({', '.join(PRESETS)}); a head with "
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
            return "author, end2end or nms", (YOLOV10,)
        return "author", (YOLOV8, YOLOV10)
    return ("stride, names", (YOLOV5,)) if {"stride", "names"} <= metadata.keys() else ("", ())


def _choose(fitting: list[tuple[Family, Layout]], signature: Signature) -> _Found:
    """Which of several families it is: the one with as many classes as there are names, else a probe's."""
    known = exported_fields(signature.metadata).get("classes")
    agreeing = [
        (family, layout)
        for family, layout in fitting
        if layout.classes in (0, len(known or family.preset.classes))
    ]
    if len(agreeing) == 1:
        family, layout = agreeing[0]
        whose = "the metadata names" if known else "COCO has"
        return _Found(family, layout, f"{layout.why}, as many as {whose}", sure=known is not None)
    by_name = {family.name: (family, layout) for family, layout in agreeing or fitting}
    if signature.answer and by_name.keys() == probe.TOLD_APART:
        image = signature.inputs[0]
        blob, _ = lay_in(probe.picture(), PRESETS["yolox"], signature.size_px, axes=image.axes or "nchw")
        if told := probe.told_apart(signature.answer(blob)):
            family, layout = by_name[told[0]]
            return _Found(family, layout, f"{layout.why}; {told[1]}")
    lines = " or ".join(f'"family": "{name}"' for name in by_name)
    raise ModelError(
        f"the graph fits several output families ({', '.join(by_name)}), and nothing in it tells which: write "
        f"{lines} into <model>.contract.json, or give --contract\n{signature.describe()}"
    )


def _assumed(found: _Found, signature: Signature) -> Contract:
    """Return the preset of a recognised family, completed from metadata as Ultralytics' exports write it."""
    name, count = found.family.name, found.layout.classes
    base = preset(name)
    known = exported_fields(signature.metadata)
    if found.exported:
        sources = dict.fromkeys(base.names(), f"preset {name} ({EXPORTER})")
    else:
        sources = dict.fromkeys(base.names(), f"assumed: preset {name}, which the graph suggests")
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
    return replace(base, **known, sources=sources)


def _fitted(contract: Contract, family: Family, signature: Signature) -> Contract:
    """Return the contract with what the graph's input settles: a fixed size, and bytes, which are 0 to 255.

    Raises :class:`ModelError` where a statement and the graph disagree.
    """
    image = signature.inputs[0]
    settled: dict[str, Any] = {}
    if image.type == "tensor(uint8)":
        settled |= {"value_range": "0-255", "mean": None, "std": None}
    if all(isinstance(side, int) for side in image.size_px):
        settled["input_size_px"] = image.size_px
    for name, value in settled.items():
        stated, source = getattr(contract, name), contract.sources[name]
        if stated not in (None, value) and not source.startswith(("preset", "assumed")):
            takes = f"{image.type} {list(image.shape)}"
            only = f"the graph takes only {value or takes}, as its input is {takes}"
            raise ModelError(f"{name} = {stated} ({source}): {only}")
    sources = {**contract.sources, **dict.fromkeys(settled, "graph")}
    if "input_size_px" in settled and contract.resize == "none":
        settled["resize"] = family.fixed_resize
        sources["resize"] = "assumed: the graph takes one size"
    return replace(contract, **settled, sources=sources)


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
