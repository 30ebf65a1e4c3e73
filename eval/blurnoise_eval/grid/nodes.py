"""Plans of conditions that a search has chosen, beside the grid of :class:`SweepPlan`: a run computes either.

A search asks for a few nodes at a time, so that a run is several plans, one after the other; what makes them one run
is all but the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from blurnoise._core import rng
from blurnoise._core.checks import integer
from blurnoise.scene.metering import USUAL, AutoExposure, GreyAnchor
from blurnoise_eval.grid.axes import AUTOMATIC, FURTHER, MOVES, setting_of
from blurnoise_eval.grid.conditions import MOST_REPEATS, Conditions, SweepPlan
from blurnoise_eval.grid.objects import USUAL_OBJECTS, Objects

_EXAMPLES = 12  # conditions whose pictures are kept


@dataclass(frozen=True)
class NodePlan:
    """The conditions ``nodes`` for every picture, ``repeats`` noise fields each; the other fields as of SweepPlan.

    further: where the other axes stand in every node, by name; those left out stand where the camera has them.
    direction: unit vector of the motion of all nodes that move. Raises ``ValueError`` for another axis, or a node
    elsewhere.
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

    def __post_init__(self) -> None:
        if self.grey_anchor is not None:
            object.__setattr__(self, "grey_anchor", str(GreyAnchor.parse(self.grey_anchor)))
        integer("repeats", self.repeats, 1, MOST_REPEATS)
        integer("seed", self.seed, 0, rng.LAST_SEED)
        self.objects.check_used(self.cuts)
        if unknown := sorted(set(self.further) - set(FURTHER)):
            raise ValueError(f"further = {unknown}: must be of {', '.join(FURTHER)}")
        for node in self.nodes:
            if any(node[name] != self.further.get(name) for name in FURTHER):
                raise ValueError(f"nodes: {node!r}: must stand at {dict(self.further)}")

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
        return sorted(set(self.nodes), key=lambda at: (at.blurs_as, at.exposure_s, setting_of(at)))

    def example_conditions(self) -> set[Conditions]:
        """A few conditions whose pictures are kept: from no blur to much."""
        by_blur = sorted(set(self.nodes), key=lambda at: (at.blur_px, at.exposure_s * at.illuminance_lux))
        return set(by_blur[:: -(-len(by_blur) // _EXAMPLES)]) if by_blur else set()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, of what all plans of a run share: not the nodes, nor whether examples are kept."""
        values: dict[str, Any] = {"further": dict(self.further), "direction": self.direction}
        values |= {"repeats": self.repeats, "seed": self.seed}
        if self.grey_anchor is not None:
            values |= {"grey_anchor": self.grey_anchor}
        if AUTOMATIC in self.further.values():
            values |= {"auto_exposure": vars(self.auto_exposure)}
        if own := self.objects.to_dict():
            values |= {"objects": own}
        return values


Plan = SweepPlan | NodePlan
