"""Objects of a plan: how what moves for itself is told from the rest of a picture, how fast it is, where it counts.

Convention: of speeds, multiples of the velocity on the axes ``--dx`` and ``--dy``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from blurnoise._core.checks import in_range, one_of

MATTES = ("auto", "segmentation", "grabcut", "box")
BOXES = ("object", "half", "swept")
_FASTEST = 100.0


@dataclass(frozen=True)
class Objects:
    """mattes: how targets are told from the rest, of ``MATTES``; speeds: by class, a multiple of the velocity.

    "auto": by an annotation's segmentation where it has one, else as "grabcut", which cuts the object from its box,
    or takes all of it (:func:`blurnoise.mattes.of_object_in`); "segmentation": that alone; "box". A speed of 0: it
    stands. plates: a folder with pictures of the same names, without the objects. boxes: which are the truth, see
    :func:`blurnoise.layers.boxes_in_motion`. Raises ``ValueError`` naming the field.
    """

    mattes: str = "auto"
    speeds: Mapping[str, float] | Iterable[tuple[str, float]] = ()
    plates: str | None = None
    boxes: str = "object"

    def __post_init__(self) -> None:
        one_of("mattes", self.mattes, MATTES)
        one_of("boxes", self.boxes, BOXES)
        given = self.speeds.items() if isinstance(self.speeds, Mapping) else self.speeds
        checked = {
            str(label): in_range(f"object-speed: {label}", speed, -_FASTEST, _FASTEST)
            for label, speed in given
        }
        object.__setattr__(self, "speeds", tuple(sorted(checked.items())))

    def check_used(self, cuts: bool) -> None:
        """Raise ``ValueError`` where something is stated of what moves for itself and nothing does, ``cuts``."""
        stated = [name for name in self.to_dict() if name != "boxes"]
        if stated and not cuts:
            raise ValueError(
                f"{', '.join(stated)}: of what moves for itself; goes with moves targets or background"
            )

    def speed_of(self, label: str) -> float:
        """That of a class, 1 unless stated."""
        return dict(self.speeds).get(label, 1.0)

    def to_dict(self) -> dict[str, Any]:
        """What is not as usual, as plain values for JSON."""
        return {
            each.name: value for each in fields(self) if (value := asdict(self)[each.name]) != each.default
        }


USUAL_OBJECTS = Objects()
