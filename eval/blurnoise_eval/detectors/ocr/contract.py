"""Contracts of text networks, which their graphs do not state: how a picture enters, and what the answers mean.

As with :class:`blurnoise_eval.detectors.contract.Contract`, every field carries where it came from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from blurnoise._core import checks
from blurnoise_eval.detectors.contract import METADATA_KEY, Contract, ModelError, Sourced, read_mapping


@dataclass(frozen=True)
class _Stated(Sourced):
    """Fields with their sources, and the picture's colours: x of 0-1 enters as (x - mean) / std."""

    FAMILY: ClassVar[str]

    family: str
    colour: str = "bgr"
    mean: tuple[float, float, float] = (0.5, 0.5, 0.5)
    std: tuple[float, float, float] = (0.5, 0.5, 0.5)
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        checks.one_of("family", self.family, (self.FAMILY,))
        stretched = self.stretched()  # checks the colours
        object.__setattr__(self, "mean", stretched.mean)
        object.__setattr__(self, "std", stretched.std)
        sources = {name: self.sources.get(name, "given") for name in self.names()}
        object.__setattr__(self, "sources", sources)

    @classmethod
    def names(cls) -> list[str]:
        """The fields that a contract can state."""
        return [entry.name for entry in fields(cls) if entry.name != "sources"]

    def stretched(self) -> Contract:
        """The colours as a contract for laying a picture in, stretched to the input's size."""
        return Contract(
            self.family, ("text",), colour=self.colour, mean=self.mean, std=self.std, resize="stretch"
        )


@dataclass(frozen=True)
class TextContract(_Stated):
    """How a crop becomes a recogniser's input, and what its classes are. Defaults are those of PP-OCR.

    family: "ppocr". colour: "rgb" or "bgr". mean, std: per channel in the network's order, of values 0-1.
    height_px: the input's; the crop keeps its aspect, up to max_width_px, and is padded with zeros on the
    right to min_width_px. margin: what is read around a known box, in heights of that box. dictionary: a file
    with a character a line, relative to the contract's folder; None for the graph's metadata ``character``.
    output: "probabilities", or "logits", to which softmax is applied. Raises ``ValueError`` or ``TypeError``
    naming field, value and what is allowed.
    """

    FAMILY = "ppocr"

    family: str = "ppocr"
    height_px: int = 48
    min_width_px: int = 320
    max_width_px: int = 3200
    margin: float = 0.1
    dictionary: str | None = None
    output: str = "probabilities"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("height_px", "min_width_px", "max_width_px"):
            _count(name, getattr(self, name))
        if self.max_width_px < self.min_width_px:
            raise ValueError(
                f"max_width_px = {self.max_width_px}: must be >= min_width_px, {self.min_width_px}"
            )
        checks.non_negative("margin", self.margin)
        if self.dictionary is not None and not isinstance(self.dictionary, str):
            raise TypeError(f"dictionary = {self.dictionary!r}: must be the name of a file, or nothing")
        checks.one_of("output", self.output, ("probabilities", "logits"))


@dataclass(frozen=True)
class RegionContract(_Stated):
    """How a picture becomes a text detector's input, and its map of probabilities boxes.

    family: "db" (differentiable binarisation). colour, mean, std: as in :class:`TextContract`. min_side_px:
    what a smaller picture's shorter side is enlarged to; max_side_px: what a larger one's longer side is
    reduced to. threshold: probability from which a pixel is text. box_threshold: least mean probability of
    a region, its score. unclip: the outline moves outwards by unclip · area / circumference.
    """

    FAMILY = "db"

    family: str = "db"
    min_side_px: int = 736
    max_side_px: int = 2000
    threshold: float = 0.3
    box_threshold: float = 0.5
    unclip: float = 1.6

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("min_side_px", "max_side_px"):
            _count(name, getattr(self, name))
        if self.max_side_px < self.min_side_px:
            raise ValueError(f"max_side_px = {self.max_side_px}: must be >= min_side_px, {self.min_side_px}")
        checks.in_range("threshold", self.threshold, 0, 1)
        checks.in_range("box_threshold", self.box_threshold, 0, 1)
        checks.non_negative("unclip", self.unclip)


Kind = TypeVar("Kind", TextContract, RegionContract)
Given = str | Path | Mapping[str, Any]


def stated_contract(
    kind: type[Kind], model_path: Path, metadata: Mapping[str, str], contract: Kind | Given | None
) -> Kind | None:
    """Return the contract somebody stated, or None: the caller's, else the file beside the model, else the
    graph's metadata under ``blurnoise.contract``.

    The caller's may be a contract, a mapping, a file, or the family's name. Fields that it leaves out follow
    the family's preset. The file beside ``model.onnx`` is ``model.contract.json``, ``.yaml`` or ``.yml``.
    Raises :class:`ModelError` for a file that cannot be read, an unknown key or a bad value.
    """
    if isinstance(contract, kind):
        return contract
    if isinstance(contract, Mapping):
        return _parse(kind, contract, "given")
    if isinstance(contract, (str, Path)):
        if str(contract) == kind.FAMILY:
            return kind(sources=dict.fromkeys(kind.names(), f"preset {kind.FAMILY}"))
        if not Path(contract).is_file():
            raise ModelError(f"contract {str(contract)!r}: neither a file nor the preset {kind.FAMILY!r}")
    elif contract is not None:
        raise TypeError(f"contract: must be a {kind.__name__}, a mapping, a file or {kind.FAMILY!r}")
    if (path := contract_file(model_path, contract)) is not None:
        return _parse(kind, read_mapping(path), f"file {path.name}")
    if METADATA_KEY in metadata:
        return _parse(kind, metadata_mapping(metadata), f"metadata {METADATA_KEY}")
    return None


def contract_file(model_path: Path, contract: object = None) -> Path | None:
    """Return the caller's file, else the one that lies beside the model, else None."""
    if isinstance(contract, (str, Path)):
        return Path(contract) if Path(contract).is_file() else None
    beside = (model_path.with_name(f"{model_path.stem}.contract.{end}") for end in ("json", "yaml", "yml"))
    return next((path for path in beside if path.is_file()), None)


def metadata_mapping(metadata: Mapping[str, str]) -> object:
    """Return what the metadata states, None for nothing. Raises :class:`ModelError` if it is no JSON."""
    try:
        return json.loads(metadata.get(METADATA_KEY, "null"))
    except (ValueError, RecursionError) as error:
        raise ModelError(f"metadata {METADATA_KEY}: not JSON: {error}") from None


def _parse(kind: type[Kind], stated: object, source: str) -> Kind:
    if not isinstance(stated, Mapping):
        raise ModelError(f"{source}: must map contract fields to values, for example {{'height_px': 32}}")
    values = {name: value for name, value in stated.items() if name != "sources"}
    known = kind.names()
    if unknown := [repr(name) for name in values if name not in known]:
        raise ModelError(f"{source}: unknown key {', '.join(unknown)}; known are {', '.join(known)}")
    sources = dict.fromkeys(known, f"preset {kind.FAMILY}") | dict.fromkeys(values, source)
    try:
        return replace(kind(), **values, sources=sources)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{source}: {error}") from None


def _count(name: str, value: object) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise ValueError(f"{name} = {value!r}: must be an integer >= 1")
