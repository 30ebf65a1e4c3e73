"""An output family: what shows it in a graph, how its answers become boxes, and how its own code feeds it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.formats.candidates import Candidates
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.records import FloatArray

BAKED = "the score threshold and the overlap that are baked into the graph: weaker answers never leave it"
"""What families that suppress double answers themselves leave unsaid."""
BACKGROUND_FIRST = (
    f"{BAKED}; whether 'classes' begins with a name for 0, which its numbers keep for the background"
)
"""The same of those that count classes from 1."""


@dataclass(frozen=True)
class Family:
    """One output layout.

    preset: pre-processing and non-maximum suppression as in the family's own repository, with COCO's classes; its
    input size is for graphs of dynamic size. describe: how the family reads a graph's outputs, None if they do not
    have its layout. decode: from the layout's outputs, in its order, the input's (height, width) and the least
    score, the candidates that reach it, boxes in px of the input. unknown: what neither the graph nor a preset
    tells. several_classes: whether the family's own evaluator counts a box with every class that reaches its
    threshold. takes_head: whether the contract states anchors. fixed_resize: how pictures enter a graph of one size
    where the preset lets them enter at their own.
    """

    preset: Contract
    describe: Callable[[Signature], Layout | None]
    decode: Callable[[Sequence[FloatArray], tuple[int, int], float], Candidates]
    unknown: str = ""
    several_classes: bool = False
    takes_head: bool = False
    fixed_resize: Literal["stretch", "letterbox-top-left"] = "letterbox-top-left"

    @property
    def name(self) -> str:
        """Of the family and its preset."""
        return self.preset.family
