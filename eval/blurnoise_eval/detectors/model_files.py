"""Files of a model: its own, and what belongs to it beside it. One at a URL is fetched together with these."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import onnx

from blurnoise_eval.detectors.contract import ModelError, contract_file, read_mapping
from blurnoise_eval.system.storage import Location, Url, local_file, location

_FETCHED: dict[Path, Url] = {}


def fetched(path: str | Location) -> Path:
    """The model's file on this machine, beside it its contract, external weights and dictionary, if it has them.

    A file of this machine is what it is. Raises :class:`ModelError` for an object that cannot be fetched.
    """
    found = location(path)
    if isinstance(found, Path):
        return found
    local = _with_company(found)
    _FETCHED[local] = found
    return local


def shown(file: Path) -> str:
    """The model's file as it was named: the URL where this process has fetched it from one."""
    return str(_FETCHED.get(file, file))


def _with_company(url: Url) -> Path:
    try:
        model = url.stamped()
        contracts = [f"{model.stem}.contract.{end}" for end in ("json", "yaml", "yml")]
        with_contract = local_file(model, contracts)
        beside = [*contracts, *_external(with_contract), *_dictionary(with_contract)]
        return local_file(model, beside) if len(beside) > len(contracts) else with_contract
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def fetched_file(path: str | Location) -> Path:
    """A single file, as :func:`fetched`."""
    try:
        return local_file(path)
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


@contextmanager
def named_as(path: str | Location, local: Path) -> Iterator[None]:
    """A :class:`ModelError` that names the fetched file names where it came from."""
    try:
        yield
    except ModelError as error:
        if str(local) == str(path):
            raise
        raise ModelError(str(error).replace(str(local), str(location(path)))) from None


def external_files(model: onnx.ModelProto) -> list[str]:
    """Names of the files, beside the model's own, that hold tensors of it, in branches and functions, too."""
    found: set[str] = set()
    nodes = [*model.graph.node, *(node for function in model.functions for node in function.node)]
    tensors = list(model.graph.initializer)
    for node in nodes:  # grows while it is read
        for attribute in node.attribute:
            tensors += [attribute.t, *attribute.tensors]
            for graph in (attribute.g, *attribute.graphs):
                nodes += graph.node
                tensors += graph.initializer
    for tensor in tensors:
        found |= {entry.value for entry in tensor.external_data if entry.key == "location"}
    return sorted(found)


def _external(path: Path) -> list[str]:
    try:
        return external_files(onnx.load(str(path), load_external_data=False))
    except Exception:  # protobuf's DecodeError: no model, which is told where it is opened
        return []


def _dictionary(path: Path) -> list[str]:
    stated = contract_file(path)
    values = None if stated is None else read_mapping(stated)
    name = values.get("dictionary") if isinstance(values, dict) else None
    return [name] if isinstance(name, str) else []
