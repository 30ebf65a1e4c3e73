"""Contracts from wherever they are stated: presets, files, what is typed after a preset, a graph's metadata.

The same for every kind of contract: detectors' (:class:`~blurnoise_eval.detectors.contract.Contract`), text
recognisers' and text detectors'. ``presets``: those of a kind, by the name of their family.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from typing_extensions import TypeVar

from blurnoise._core.checks import shown
from blurnoise._core.files import json_of
from blurnoise_eval.detectors.class_names import COCO80, COCO91
from blurnoise_eval.detectors.contract import METADATA_KEY, SHORT_NAMES, Contract, ModelError, Sourced
from blurnoise_eval.detectors.formats import PRESETS
from blurnoise_eval.detectors.model_files import contract_file, fetched_file, read_mapping

Kind = TypeVar("Kind", bound=Sourced, default=Contract)
Given = str | Path | Mapping[str, Any]
"""A contract as it may be given: a preset's name, a file, fields typed after one of these, or a mapping."""


def stated_contract(
    presets: Mapping[str, Kind],
    model_path: Path,
    metadata: Mapping[str, str],
    contract: Kind | Given | None,
) -> Kind | None:
    """Return the contract somebody stated, or None: the caller's, else the file beside the model, else the
    graph's metadata under ``blurnoise.contract``.

    The file beside ``model.onnx`` is ``model.contract.json``, ``.yaml`` or ``.yml``.
    Raises :class:`ModelError` as :func:`load_contract` does.
    """
    kind = _kind(presets)
    if isinstance(contract, kind):
        return contract
    if isinstance(contract, Mapping):
        return parse_contract(contract, "given", presets)
    if isinstance(contract, (str, Path)):
        return load_contract(contract, presets)
    if contract is not None:
        raise TypeError(
            f"contract: must be a {kind.__name__}, a mapping, a file or {' or '.join(map(repr, presets))}"
        )
    if (beside := contract_file(model_path)) is not None:
        return load_contract(beside, presets)
    if METADATA_KEY not in metadata:
        return None
    return parse_contract(metadata_mapping(metadata), f"metadata {METADATA_KEY}", presets)


def preset(name: str, presets: Mapping[str, Kind] = PRESETS) -> Kind:  # type: ignore[assignment]  # of Contract
    """Return the named family's contract. Raises :class:`ModelError` if there is none."""
    if not isinstance(name, str) or name not in presets:
        raise ModelError(f"family {shown(name)} is unknown: must be one of {', '.join(map(repr, presets))}")
    base = presets[name]
    return replace(base, sources=dict.fromkeys(base.names(), f"preset {name}"))


def parse_contract(stated: object, source: str, presets: Mapping[str, Kind] = PRESETS) -> Kind:  # type: ignore[assignment]  # as above
    """Return the contract a mapping states; fields it leaves out follow the preset of its family.

    A detector's ``family`` and ``classes`` (names by id, or "coco80") are required; ``base``, a family's name in
    place of ``family``, takes its classes, too. Other names of fields are those of ``SHORT_NAMES``. ``source`` names
    the mapping in messages and in ``sources``. Raises :class:`ModelError` for an unknown, missing or doubled key or a
    bad value.
    """
    kind = _kind(presets)
    if isinstance(stated, Mapping):
        named = [SHORT_NAMES.get(name, name) for name in stated]
        if twice := [name for name in stated if named.count(SHORT_NAMES.get(name, name)) > 1]:
            raise ModelError(f"{source}: {' and '.join(map(repr, twice))} are one field; state it once")
        based = "base" in stated
        stated = dict(zip(named, stated.values(), strict=True))
        if based and "classes" in kind.names():
            stated = {"classes": preset(stated["family"]).classes, **stated}
    values = _stated_values(stated, kind, source, kind.EXAMPLE)
    required = [entry.name for entry in fields(kind) if entry.default is entry.default_factory is MISSING]
    if missing := [repr(name) for name in required if name not in values]:
        raise ModelError(f"{source}: missing key {', '.join(missing)}; for example {kind.EXAMPLE}")
    return _completed(preset(values.get("family", next(iter(presets))), presets), values, source)


def load_contract(name_or_path: str | Path, presets: Mapping[str, Kind] = PRESETS) -> Kind:  # type: ignore[assignment]  # as above
    """Return the contract of a preset's name or of a JSON or YAML file, on this machine or at a URL.

    Either may be followed by fields that differ: "yolox,colour=rgb,range=0-1,mean=0.485/0.456/0.406".
    Raises :class:`ModelError` if it is neither, cannot be parsed, or states a bad contract.
    """
    if str(name_or_path) in presets:
        return preset(str(name_or_path), presets)
    path = fetched_file(name_or_path)
    if not path.is_file():
        base, *further = str(name_or_path).split(",")
        if further and all("=" in each for each in further):
            stated = dict(each.split("=", 1) for each in further)
            return _varied(load_contract(base, presets), stated, f"--contract {base},...")
        raise ModelError(
            f"contract {str(name_or_path)!r}: neither a file nor a preset ({', '.join(map(repr, presets))})"
        )
    return parse_contract(read_mapping(path), f"file {path.name}", presets)


def _kind(presets: Mapping[str, Kind]) -> type[Kind]:
    return type(next(iter(presets.values())))


def _stated_values(stated: object, kind: type[Sourced], source: str, example: str) -> dict[str, Any]:
    """What a mapping states of the fields. Raises :class:`ModelError` for another key."""
    if not isinstance(stated, Mapping):
        raise ModelError(f"{source}: must map contract fields to values, for example {example}")
    names = kind.names()
    values = {name: value for name, value in stated.items() if name != "sources"}
    if unknown := [name for name in values if name not in names]:
        near = get_close_matches(str(unknown[0])[:99], names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ModelError(f"{source}: unknown key {shown(unknown)[1:-1]}; known are {', '.join(names)}{hint}")
    return values


def _completed(base: Kind, values: Mapping[str, Any], source: str) -> Kind:
    """``base`` with ``values`` of ``source``. Raises :class:`ModelError` for a bad value."""
    try:
        return replace(base, **values, sources={**base.sources, **dict.fromkeys(values, source)})
    except (TypeError, ValueError) as error:
        raise ModelError(f"{source}: {error}") from None


def _varied(base: Kind, stated: Mapping[str, str], source: str) -> Kind:
    """The contract with fields as they are typed."""
    values: dict[str, Any] = {}
    for short, text in stated.items():
        name = SHORT_NAMES.get(short.strip(), short.strip())
        try:
            values[name] = _typed(name, text.strip())
        except ValueError:
            raise ModelError(
                f"{source}: {name} = {text!r}: must be typed as in {base.TYPED}; none where there is none"
            ) from None
    return _completed(base, _stated_values(values, type(base), source, base.TYPED), source)


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
    for number in (int, float):
        with suppress(ValueError):
            return number(text)
    return text


def contract_option(contract: Contract) -> str | None:
    """The contract as ``--contract`` takes it: its family, and what differs from that preset.

    None for one that only a file can hold, because of its names of classes or of a head with anchors.
    """
    base = PRESETS[contract.family]
    parts = []
    for name in contract.names():
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


def metadata_mapping(metadata: Mapping[str, str]) -> object:
    """Return what the metadata states, None for nothing. Raises :class:`ModelError` if it is no JSON."""
    try:
        return json_of(metadata.get(METADATA_KEY, "null"))
    except ValueError as error:
        raise ModelError(f"metadata {METADATA_KEY}: not JSON: {error}") from None
