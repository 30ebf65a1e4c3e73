"""Contracts of text networks, which their graphs do not state: how a picture enters, and what the answers mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le

from blurnoise._core.checks import Characters
from blurnoise_eval.detectors.contract import Colour, Contract, PerChannel, Sourced, Spread

_Count = Annotated[int, Ge(1), Le(1 << 16), "must be an integer >= 1 and <= 65536"]
_NonNegative = Annotated[float, Ge(0)]
_Share = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True)
class _TextNetwork(Sourced):
    """The picture's colours: x of 0-1 enters as (x - mean) / std."""

    EXAMPLE = "{'height_px': 32}"

    family: str
    colour: Colour = "bgr"
    mean: PerChannel = (0.5, 0.5, 0.5)
    std: Spread = (0.5, 0.5, 0.5)

    def stretched(self) -> Contract:
        """The colours as a contract for laying a picture in, stretched to the input's size."""
        return Contract(self.family, ("text",), self.colour, mean=self.mean, std=self.std, resize="stretch")


@dataclass(frozen=True)
class TextContract(_TextNetwork):
    """How a crop becomes a recogniser's input, and what its classes are. Defaults are those of PP-OCR.

    family: "ppocr". colour: "rgb" or "bgr". mean, std: per channel in the network's order, of values 0-1.
    height_px: the input's; the crop keeps its aspect, and is padded with zeros on the right to min_width_px, but
    never wider than max_width_px. margin: what is read around a known box, in heights of that box. dictionary: a file
    with a character a line, relative to the contract's folder; None for the graph's metadata ``character``.
    output: "probabilities", or "logits", to which softmax is applied. Raises ``ValueError`` or ``TypeError``
    naming field, value and what is allowed.
    """

    family: Literal["ppocr"] = "ppocr"
    height_px: _Count = 48
    min_width_px: _Count = 320
    max_width_px: _Count = 3200
    margin: _NonNegative = 0.1
    dictionary: Annotated[Characters | None, "must be the name of a file, or nothing"] = None
    output: Literal["probabilities", "logits"] = "probabilities"


@dataclass(frozen=True)
class RegionContract(_TextNetwork):
    """How a picture becomes a text detector's input, and its map of probabilities boxes.

    family: "db" (differentiable binarisation). colour, mean, std: as in :class:`TextContract`. min_side_px:
    what a smaller picture's shorter side is enlarged to; max_side_px: what a larger one's longer side is
    reduced to. threshold: probability from which a pixel is text. box_threshold: least mean probability of
    a region, its score. unclip: the outline moves outwards by unclip · area / circumference.
    """

    family: Literal["db"] = "db"
    min_side_px: _Count = 736
    max_side_px: _Count = 2000
    threshold: _Share = 0.3
    box_threshold: _Share = 0.5
    unclip: _NonNegative = 1.6


@dataclass(frozen=True)
class SpottingContract:
    """The contracts of both networks; names and sources have "regions." or "text." before them."""

    regions: RegionContract
    text: TextContract

    @property
    def assumptions(self) -> list[str]:
        """One sentence per field that nothing stated."""
        return [*self.regions.assumptions, *self.text.assumptions]

    def to_dict(self) -> dict[str, Any]:
        """Every field in JSON's types, and ``sources``."""
        found: dict[str, Any] = {}
        sources: dict[str, str] = {}
        for part, contract in (("regions", self.regions), ("text", self.text)):
            values = contract.to_dict()
            sources |= {f"{part}.{name}": source for name, source in values.pop("sources").items()}
            found |= {f"{part}.{name}": value for name, value in values.items()}
        return {**found, "sources": sources}


TEXT_PRESETS = {"ppocr": TextContract()}
REGION_PRESETS = {"db": RegionContract()}
