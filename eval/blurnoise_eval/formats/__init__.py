"""The output families, one module each, and which of them a graph belongs to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from blurnoise_eval.contract import FIELDS, Contract, ModelError, exported_fields, preset, stated_contract
from blurnoise_eval.formats import (
    detr,
    fastestdet,
    mmdeploy,
    ppyoloe,
    rfdetr,
    rtdetr,
    yolov5,
    yolov7,
    yolov8,
    yolov10,
    yolox,
)
from blurnoise_eval.formats.signature import Family, Signature

FAMILIES: tuple[Family, ...] = (
    yolov5, yolov7, yolov8, yolov10, yolox, rtdetr, rfdetr, detr, mmdeploy, ppyoloe, fastestdet,
)  # fmt: skip


def resolve(
    model_path: Path, signature: Signature, contract: Contract | str | Path | None = None
) -> tuple[Family, Contract]:
    """Return the graph's family and its contract, with the input size filled in.

    The contract is the caller's, else that of the file beside the model, else the metadata's, else the preset
    of the family that the shapes show, with every field the graph cannot show marked as assumed.
    Raises :class:`ModelError` if no family or several fit, or if contract and graph disagree.
    """
    stated = stated_contract(model_path, signature.metadata, contract)
    if stated is None:
        family, count = _recognise(signature)
        return family, _sized(_assumed(family, count, signature), signature)
    named = [family for family in FAMILIES if stated.family == family.NAME]
    if not named:
        raise ModelError(f"family {stated.family!r}: must be one of {', '.join(f.NAME for f in FAMILIES)}")
    stated_count = named[0].class_count(signature)
    if stated_count is None:
        raise ModelError(
            f"the contract ({stated.sources['family']}) says {stated.family}, "
            f"but the graph has no outputs of that shape:\n{signature.describe()}"
        )
    _check_class_count(stated, stated_count)
    return named[0], _sized(stated, signature)


def _recognise(signature: Signature) -> tuple[Family, int]:
    fitting = [(family, count) for family in FAMILIES if (count := family.class_count(signature)) is not None]
    if len(fitting) == 1:
        return fitting[0]
    problem = (
        f"fits several output families ({', '.join(family.NAME for family, _ in fitting)}): state which"
        if fitting
        else f"fits no output family known here ({', '.join(family.NAME for family in FAMILIES)})"
    )
    raise ModelError(f"the graph {problem}\n{signature.describe()}")


def _assumed(family: Family, count: int, signature: Signature) -> Contract:
    """Return the preset of a recognised family, completed from metadata as Ultralytics' exports write it."""
    base = preset(family.NAME)
    known = exported_fields(signature.metadata)
    shown = "the graph's shapes"
    exported = "author" in signature.metadata and "Ultralytics" in signature.metadata["author"]
    yolov5_export = family.NAME == "yolov5" and {"stride", "names"} <= signature.metadata.keys()
    if exported or yolov5_export:
        sources = dict.fromkeys(FIELDS, f"preset {family.NAME} (metadata of an Ultralytics export)")
        sources["family"] = f"graph: its shapes, and metadata {'author' if exported else 'stride, names'}"
    else:
        sources = dict.fromkeys(FIELDS, f"assumed: preset {family.NAME}, which {shown} suggest")
        sources["family"] = f"assumed: {family.LOOKALIKES}" if family.LOOKALIKES else f"graph: {shown}"
    if "classes" not in known:
        if count not in (0, len(base.classes)):
            raise ModelError(
                f"the graph ({family.NAME}) has {count} classes but nothing names them\n"
                f"{signature.describe()}"
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


def _sized(contract: Contract, signature: Signature) -> Contract:
    """Return the contract with the graph's input size where that is fixed. Raises where the two disagree."""
    height, width = signature.inputs[0].shape[2:]
    if not (isinstance(height, int) and isinstance(width, int)):
        return contract
    size = (height, width)
    source = contract.sources["input_size_px"]
    overridable = contract.input_size_px is None or source.startswith(("preset", "assumed"))
    if not overridable and contract.input_size_px != size:
        raise ModelError(
            f"input_size_px = {contract.input_size_px} ({source}): "
            f"the graph takes only {size} (height, width)"
        )
    return replace(contract, input_size_px=size, sources={**contract.sources, "input_size_px": "graph"})
