"""Contracts of text networks, which their graphs do not state: how a picture enters, and what the answers mean.

As with :class:`blurnoise_eval.detectors.contract.Contract`, every field carries where it came from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from annotated_types import Ge, Le

from blurnoise._core.checks import Characters, check_fields
from blurnoise_eval.detectors.contract import (
    METADATA_KEY,
    Colour,
    Contract,
    ModelError,
    PerChannel,
    Sourced,
    Spread,
    completed,
    contract_file,
    metadata_mapping,
    read_mapping,
    stated_values,
)

_Count = Annotated[int, Ge(1), Le(1 << 16), "must be an integer >= 1 and <= 65536"]
_NonNegative = Annotated[float, Ge(0)]
_Share = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True)
class _Stated(Sourced):
    """Fields with their sources, and the picture's colours: x of 0-1 enters as (x - mean) / std."""

    FAMILY: ClassVar[str]

    family: str
    colour: Colour = "bgr"
    mean: PerChannel = (0.5, 0.5, 0.5)
    std: Spread = (0.5, 0.5, 0.5)
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        check_fields(self)
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

    family: Literal["ppocr"] = "ppocr"
    height_px: _Count = 48
    min_width_px: _Count = 320
    max_width_px: _Count = 3200
    margin: _NonNegative = 0.1
    dictionary: Annotated[Characters | None, "must be the name of a file, or nothing"] = None
    output: Literal["probabilities", "logits"] = "probabilities"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_width_px < self.min_width_px:
            raise ValueError(
                f"max_width_px = {self.max_width_px}: must be >= min_width_px, {self.min_width_px}"
            )


@dataclass(frozen=True)
class RegionContract(_Stated):
    """How a picture becomes a text detector's input, and its map of probabilities boxes.

    family: "db" (differentiable binarisation). colour, mean, std: as in :class:`TextContract`. min_side_px:
    what a smaller picture's shorter side is enlarged to; max_side_px: what a larger one's longer side is
    reduced to. threshold: probability from which a pixel is text. box_threshold: least mean probability of
    a region, its score. unclip: the outline moves outwards by unclip · area / circumference.
    """

    FAMILY = "db"

    family: Literal["db"] = "db"
    min_side_px: _Count = 736
    max_side_px: _Count = 2000
    threshold: _Share = 0.3
    box_threshold: _Share = 0.5
    unclip: _NonNegative = 1.6

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_side_px < self.min_side_px:
            raise ValueError(f"max_side_px = {self.max_side_px}: must be >= min_side_px, {self.min_side_px}")


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


def _parse(kind: type[Kind], stated: object, source: str) -> Kind:
    names = kind.names()
    values = stated_values(stated, names, source, "{'height_px': 32}")
    return completed(kind(sources=dict.fromkeys(names, f"preset {kind.FAMILY}")), values, source)
