"""Contracts from presets, files, options and the metadata of a graph.

The same for every kind of contract: detectors' (:class:`~blurnoise_eval.detectors.contract.Contract`), and text
recognisers'. ``presets``: those of a kind, by the name of their family.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

from typing_extensions import TypeVar

from blurnoise._core.checks import an_instance, known, shown
from blurnoise._core.files import json_of
from blurnoise_eval.detectors.contract import (
    COCO80,
    COCO91,
    METADATA_KEY,
    SHORT_NAMES,
    Contract,
    ModelError,
    Sourced,
)
from blurnoise_eval.detectors.formats import PRESETS
from blurnoise_eval.detectors.model import contract_file, fetched_file, read_mapping

Kind = TypeVar("Kind", bound=Sourced, default=Contract)
Given = str | Path | Mapping[str, Any]
"""A contract as it may be given: a preset's name, a file, fields typed after one of these, or a mapping."""


def stated_contract(
    presets: Mapping[str, Kind], model_path: Path, metadata: Mapping[str, str], contract: Kind | Given | None
) -> Kind | None:
    """Return the contract somebody stated, or None: the caller's, else the file beside the model, else the
    graph's metadata under ``blurnoise.contract``.

    The file beside ``model.onnx`` is ``model.contract.json``, ``.yaml`` or ``.yml``.
    Raises :class:`ModelError` as :func:`load_contract` does.
    """
    if contract is None:
        entry = beside(model_path, metadata)
        return None if entry is None else parse_contract(*entry, presets)
    if isinstance(contract, Mapping):
        return parse_contract(contract, "given", presets)
    if isinstance(contract, (str, Path)):
        return load_contract(contract, presets)
    an_instance("contract", contract, type(next(iter(presets.values()))))
    return contract


def settled(contract: Kind, values: Mapping[str, Any], source: str, why: str) -> Kind:
    """The contract with ``values`` that its graph settles. Raises :class:`ModelError` where another was stated."""
    for name, value in values.items():
        current, where = getattr(contract, name), contract.sources[name]
        if current not in (None, value) and not where.startswith(("preset", "assumed")):
            raise ModelError(f"{name} = {current!r} ({where}): must be {value!r}, because {why}")
    return replace(contract, **values, sources={**contract.sources, **dict.fromkeys(values, source)})


def beside(model_path: Path, metadata: Mapping[str, str]) -> tuple[object, str] | None:
    """What a file beside a model or its metadata state, and where that is. Raises :class:`ModelError`."""
    if (file := contract_file(model_path)) is not None:
        return read_mapping(file), f"file {file.name}"
    if METADATA_KEY not in metadata:
        return None
    source = f"metadata {METADATA_KEY}"
    try:
        return json_of(metadata[METADATA_KEY]), source
    except ValueError as error:
        raise ModelError(f"{source}: must be JSON: {error}") from None


def preset(name: object, presets: Mapping[str, Kind] = PRESETS) -> Kind:  # type: ignore[assignment]  # of Contract
    """Return the named family's contract. Raises :class:`ModelError` if there is none."""
    if not isinstance(name, str) or name not in presets:
        raise ModelError(f"family = {shown(name)}: must be one of {', '.join(map(repr, presets))}")
    base = presets[name]
    return replace(base, sources=dict.fromkeys(base.names(), f"preset {name}"))


def parse_contract(stated: object, source: str, presets: Mapping[str, Kind] = PRESETS) -> Kind:  # type: ignore[assignment]  # as above
    """Return the contract of a mapping; other fields come from the preset of its family.

    A detector's ``family`` and ``classes`` (names by id, or "coco80") are required; ``base``, a family's name in
    place of ``family``, takes its classes, too. Other names of fields are those of ``SHORT_NAMES``. ``source`` names
    the mapping in messages and in ``sources``. Raises :class:`ModelError` for an unknown, missing or doubled key or a
    bad value.
    """
    usual = next(iter(presets.values()))
    if not isinstance(stated, Mapping):
        raise ModelError(f"{source}: must map contract fields to values, for example {usual.EXAMPLE}")
    required = [entry.name for entry in fields(usual) if entry.default is entry.default_factory is MISSING]
    if "outputs" in stated and isinstance(usual, Contract):
        stated = {"family": "columns", **stated} if "base" not in stated else stated
    if missing := [repr(name) for name in required if name not in stated and "base" not in stated]:
        raise ModelError(f"{source}: missing key {', '.join(missing)}; for example {usual.EXAMPLE}")
    base = preset(stated.get("base", stated.get("family", next(iter(presets)))), presets)
    defaults = {"classes": base.classes} if isinstance(base, Contract) and "classes" not in stated else {}
    return _completed(base, {**defaults, **stated}, source)


def load_contract(name_or_path: str | Path, presets: Mapping[str, Kind] = PRESETS) -> Kind:  # type: ignore[assignment]  # as above
    """Return the contract of a preset's name or of a JSON or YAML file, on this machine or at a URL.

    Either may be followed by fields that differ: "yolox,colour=rgb,range=0-1,mean=0.485/0.456/0.406".
    Raises :class:`ModelError` if it is neither, cannot be parsed, or states a bad contract.
    """
    text = str(name_or_path)
    if text in presets:
        return preset(text, presets)
    path = fetched_file(name_or_path)
    if path.is_file():
        return parse_contract(read_mapping(path), f"file {path.name}", presets)
    base, *further = text.split(",")
    if further and all("=" in part for part in further):
        return _completed(load_contract(base, presets), dict(map(_typed, further)), f"--contract {base},...")
    raise ModelError(
        f"contract = {text!r}: must be a file or one of the presets {', '.join(map(repr, presets))}"
    )


def _completed(base: Kind, fields: Mapping[str, Any], source: str) -> Kind:
    """``base`` with what ``source`` states. Raises :class:`ModelError` for another key and a bad value."""
    values: dict[str, Any] = {}
    try:
        for name, value in fields.items():
            field = SHORT_NAMES.get(name, name)
            if field in values:
                raise ValueError(f"{field} is set twice")
            known("key", field, [*base.names(), "sources"])
            values[field] = value
        values["sources"] = {**base.sources, **dict.fromkeys(values, source)}
        return replace(base, **values)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{source}: {error}") from None


def _typed(part: str) -> tuple[str, object]:
    """A field as it is typed: range=0-1, mean=0.485/0.456/0.406, size=416x640, iou=none."""
    short, _, text = (side.strip() for side in part.partition("="))
    name = SHORT_NAMES.get(short, short)
    if name == "classes":
        return name, text if text in ("coco80", "coco91") else text.split("/")
    if name == "outputs":
        return name, text
    separator = {"mean": "/", "std": "/", "input_size_px": "x"}.get(name)
    values = [_value(item) for item in text.split(separator)] if separator else [_value(text)]
    return name, values if len(values) > 1 else values[0]


def _value(text: str) -> object:
    for number in (int, float):
        with suppress(ValueError):
            return number(text)
    return None if text == "none" else text


def contract_option(contract: Contract) -> str | None:
    """The contract as ``--contract`` takes it: its family, and what differs from that preset.

    None for one that only a file can hold, because of its names of classes or of a head with anchors.
    """
    parts = [contract.family]
    for name in contract.names():
        # A filter is doubted unless it is stated, also if it is the preset's.
        stated = name == "resize_filter" and contract.states(name)
        if (value := getattr(contract, name)) != getattr(PRESETS[contract.family], name) or stated:
            value = value.replace(", ", "/") if name == "outputs" and value else value
            entries = value if isinstance(value, tuple) else ("none" if value is None else value,)
            parts.append(f"{name}=" + ("x" if name == "input_size_px" else "/").join(map(str, entries)))
    typed = ",".join(parts)
    try:
        return shlex.quote(typed) if load_contract(typed) == contract else None
    except ModelError:
        return None


def contract_document(contract: Contract) -> dict[str, Any]:
    """The content of a contract file: all fields but the sources, and a resize filter that nobody stated, since no
    picture can confirm it. The classes of COCO have their short name."""
    short = {COCO80: "coco80", COCO91: "coco91"}
    document = contract.to_dict() | {"classes": short.get(contract.classes, list(contract.classes))}
    del document["sources"]
    if not contract.states("resize_filter"):
        del document["resize_filter"]
    return document
