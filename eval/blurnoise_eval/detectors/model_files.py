"""Files of a model: its own, and what belongs to it beside it. One at a URL is fetched together with these."""

from __future__ import annotations

import hashlib
from pathlib import Path

import onnx
from onnx import external_data_helper as external

from blurnoise._core.files import check_regular, read_document
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.system.urls import Location, local_file, location, version

_CONTRACTS = ("json", "yaml", "yml")


def fetched(path: str | Location) -> Path:
    """The model's file on this machine, beside it its contract, external weights and dictionary, if it has them.

    A file of this machine is what it is. Raises :class:`ModelError` for an object that cannot be fetched.
    """
    model = location(path)
    if isinstance(model, Path):
        return model
    contracts = [f"{model.stem}.contract.{end}" for end in _CONTRACTS]
    try:
        known = version(model)
        copy = local_file(model, contracts, known)
        stated = contract_file(copy)
        values = None if stated is None else read_mapping(stated)
        dictionary = values.get("dictionary") if isinstance(values, dict) else None
        beside = [*external_files(copy), *([dictionary] if isinstance(dictionary, str) else [])]
        return local_file(model, [*contracts, *beside], known) if beside else copy
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def fetched_file(path: str | Location) -> Path:
    """A single file, as :func:`fetched`."""
    try:
        return local_file(location(path))
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def external_files(path: Path) -> list[str]:
    """Names of the files, beside a model's own, that hold tensors of it, in branches and functions, too.

    None of a file that is no model, which opening it says.
    """
    try:
        model = onnx.load(str(path), load_external_data=False)
    except Exception:  # protobuf's DecodeError; a format of onnxruntime's own, which is a single file
        return []
    tensors = filter(external.uses_external_data, external._get_all_tensors(model))
    return sorted({external.ExternalDataInfo(tensor).location for tensor in tensors})


def contract_file(model_path: Path) -> Path | None:
    """Return ``model.contract.json``, ``.yaml`` or ``.yml`` beside the model, else None."""
    beside = (model_path.with_name(f"{model_path.stem}.contract.{end}") for end in _CONTRACTS)
    return next((path for path in beside if path.is_file()), None)


def read_mapping(path: Path) -> object:
    """Return what a JSON or YAML file holds. Raises :class:`ModelError` if it cannot be read."""
    try:
        return read_document(path)
    except (OSError, ValueError) as error:
        raise ModelError(f"contract file {path.name}: cannot be read: {error}") from None


def model_sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a model's file; where its weights are in files beside it, of all of them."""
    own, beside = _file_sha256(path), external_files(path)
    if not beside:
        return own
    parts = [own, *(f"{name} {_file_sha256(path.parent / name)}" for name in beside)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _file_sha256(path: Path) -> str:
    check_regular(path)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
