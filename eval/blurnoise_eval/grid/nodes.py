"""Plans of conditions that a search has chosen, beside the grid of :class:`SweepPlan`: a run computes either.

A search asks for a few nodes at a time, so that a run is several plans, one after the other; what makes them one run
is all but the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from blurnoise.scene.metering import USUAL, AutoExposure
from blurnoise_eval.grid.axes import AUTOMATIC, MOVES
from blurnoise_eval.grid.conditions import Conditions, SweepPlan, by_blur, shared_values
from blurnoise_eval.grid.objects import USUAL_OBJECTS, Objects

_EXAMPLES = 12  # conditions whose pictures are kept


@dataclass(frozen=True)
class NodePlan:
    """The conditions ``nodes`` for every picture, ``repeats`` noise fields each; the other fields as of SweepPlan.

    further: where the other axes stand in every node, by name; those left out stand where the camera has them.
    direction: unit vector of the motion of all nodes that move.
    """

    nodes: tuple[Conditions, ...] = ()
    further: Mapping[str, float] = field(default_factory=dict)
    direction: tuple[float, float] = (1.0, 0.0)
    repeats: int = 1
    seed: int = 0
    examples: bool = True
    grey_anchor: str | None = None
    auto_exposure: AutoExposure = USUAL
    objects: Objects = USUAL_OBJECTS

    @property
    def path(self) -> None:
        """Nothing moves along a path: it would see another part of that in every exposure."""

    @property
    def ego(self) -> None:
        """Nothing drives: the plane of lux-seconds and pixels has one motion for a picture."""

    @property
    def cuts(self) -> bool:
        """Whether anything moves but all of a picture."""
        return bool(self.further.get(MOVES.name))

    def conditions(self) -> list[Conditions]:
        """The nodes, each once; those that share a blur stand next to each other, in them those of one exposure."""
        return by_blur(set(self.nodes))

    def example_conditions(self) -> set[Conditions]:
        """A few conditions whose pictures are kept: from no blur to much."""
        nodes = sorted(set(self.nodes), key=lambda at: (at.blur_px, at.exposure_s * at.illuminance_lux))
        return set(nodes[:: -(-len(nodes) // _EXAMPLES)]) if nodes else set()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, of what all plans of a run share: not the nodes, nor whether examples are kept."""
        shared = shared_values(self, AUTOMATIC in self.further.values())
        return {"further": dict(self.further), "direction": self.direction, **shared}


Plan = SweepPlan | NodePlan
