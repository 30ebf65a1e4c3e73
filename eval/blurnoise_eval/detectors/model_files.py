"""Files of a model: its own, and what belongs to it beside it. One at a URL is fetched together with these."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import onnx

from blurnoise._core.files import read_document
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.system.files import check_regular
from blurnoise_eval.system.urls import Location, local_file, location, version


def fetched(path: str | Location) -> Path:
    """The model's file on this machine, beside it its contract, external weights and dictionary, if it has them.

    A file of this machine is what it is. Raises :class:`ModelError` for an object that cannot be fetched.
    """
    found = location(path)
    return found if isinstance(found, Path) else _with_company(found)


def _with_company(model: Location) -> Path:
    try:
        known = version(model)
        contracts = [f"{model.stem}.contract.{end}" for end in ("json", "yaml", "yml")]
        with_contract = local_file(model, contracts, known)
        beside = [*contracts, *external_files(with_contract), *_dictionary(with_contract)]
        return local_file(model, beside, known) if len(beside) > len(contracts) else with_contract
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def fetched_file(path: str | Location) -> Path:
    """A single file, as :func:`fetched`."""
    try:
        return local_file(location(path))
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


def external_files(path: Path) -> list[str]:
    """Names of the files, beside a model's own, that hold tensors of it, in branches and functions, too.

    None of a file that is no model, which opening it says.
    """
    try:
        model = onnx.load(str(path), load_external_data=False)
    except Exception:  # protobuf's DecodeError; a format of onnxruntime's own, which is a single file
        return []
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


def _dictionary(path: Path) -> list[str]:
    stated = contract_file(path)
    values = None if stated is None else read_mapping(stated)
    name = values.get("dictionary") if isinstance(values, dict) else None
    return [name] if isinstance(name, str) else []


def contract_file(model_path: Path, contract: object = None) -> Path | None:
    """Return the caller's file, else ``model.contract.json``, ``.yaml`` or ``.yml`` beside it, else None."""
    if isinstance(contract, (str, Path)):
        return stated if (stated := fetched_file(contract)).is_file() else None
    beside = (model_path.with_name(f"{model_path.stem}.contract.{end}") for end in ("json", "yaml", "yml"))
    return next((path for path in beside if path.is_file()), None)


def read_mapping(path: Path) -> object:
    """Return what a JSON or YAML file holds. Raises :class:`ModelError` if it cannot be read."""
    try:
        return read_document(path)
    except (OSError, ValueError) as error:
        raise ModelError(f"contract file {path.name}: cannot be read: {error}") from None


def model_sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a model's file; where its weights are in files beside it, of all of them."""
    own, beside = file_sha256(path), external_files(path)
    if not beside:
        return own
    parts = [own, *(f"{name} {file_sha256(path.parent / name)}" for name in beside)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def file_sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file, read a block at a time. Raises ``OSError``."""
    check_regular(path)
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
