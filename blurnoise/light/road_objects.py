"""Road objects: the size of targets by class, how high they stand, and the sheeting that covers them.

Domain: m; classes as COCO and BDD100K name them. A class that is not in the table has no known size, so that nothing
says how far away its targets are. Sizes and sources: ``data/road_objects.csv``.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from types import MappingProxyType
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le

from blurnoise._core.checks import shown
from blurnoise._core.fields import Figure, check_fields
from blurnoise.light.sheeting import SHEETINGS, Sheeting

_ANGLES_DEG = (0.2, 0.5, 2.0)
NO_SHEETING = "none"
_MUST = f"must be {', '.join(SHEETINGS)}, {NO_SHEETING}, or three numbers, R_A at .2, .5 and 2 degrees"


@dataclass(frozen=True)
class RoadObject:
    """What is known of the targets of a class: a width or a height, or both, and their sheeting.

    base_m: height of the lower edge above the road; None: the picture says it, for a camera whose pitch is known.
    sheeting: a name of ``SHEETINGS``, or three numbers "70,30,5", the coefficient of retroreflection at observation
    angles of .2, .5 and 2 degrees, cd/(lx m2); None: matt. Raises ``TypeError`` or ``ValueError`` naming the field
    and what is allowed.

    >>> road_object("Stop_Sign")
    RoadObject(width_m=0.762, height_m=0.762, base_m=1.8, sheeting='III')
    >>> RoadObject(width_m=0.6, sheeting="150,60,5").material.at(0.1).round().item()
    150.0
    """

    width_m: Annotated[Figure | None, Gt(0), Le(100)] = None
    height_m: Annotated[Figure | None, Gt(0), Le(100)] = None
    base_m: Annotated[Figure | None, Ge(0), Le(100)] = 0.0
    sheeting: str | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.width_m is None and self.height_m is None:
            raise ValueError("needs width_m or height_m")
        _ = self.material

    @property
    def material(self) -> Sheeting | None:
        """The sheeting itself; None of a matt target."""
        return sheeting_of(self.sheeting)


def sheeting_of(text: str | None) -> Sheeting | None:
    """The sheeting of a name or of three numbers; None without, and for "none". Raises ``ValueError``.

    >>> sheeting_of("III") == SHEETINGS["III"], sheeting_of("none")
    (True, None)
    """
    if text is None or text == NO_SHEETING:
        return None
    if text in SHEETINGS:
        return SHEETINGS[text]
    try:
        values = tuple(float(part) for part in text.split(","))
        if len(values) != len(_ANGLES_DEG) or not all(0 < value < math.inf for value in values):
            raise ValueError
    except ValueError:
        raise ValueError(f"sheeting = {shown(text)}: {_MUST}") from None
    return Sheeting(text, _ANGLES_DEG, values)


def road_object(label: str, own: Mapping[str, RoadObject] = MappingProxyType({})) -> RoadObject | None:
    """What is known of a class; None of one that is neither in ``own``, by its plain name, nor in the table.

    Capitals do not matter, nor whether words are parted by spaces, hyphens or low lines.

    >>> road_object("Person").height_m, road_object("pizza")
    (1.7, None)
    """
    name = plain_name(label)
    return own.get(name) or road_objects().get(name)


def plain_name(label: str) -> str:
    """A class as the table has it.

    >>> plain_name("Stop_Sign")
    'stop sign'
    """
    return " ".join(label.lower().replace("_", " ").replace("-", " ").split())


@lru_cache(maxsize=1)
def road_objects() -> Mapping[str, RoadObject]:
    """The table, by each of the classes' names.

    >>> road_objects()["licence plate"] == road_objects()["number plate"]
    True
    """
    text = (resources.files("blurnoise.light") / "data" / "road_objects.csv").read_text("utf-8")
    found: dict[str, RoadObject] = {}
    for row in csv.DictReader(text.splitlines()):
        sizes: dict[str, Any] = {
            name: float(row[name]) for name in ("width_m", "height_m", "base_m") if row[name]
        }
        matt = row["sheeting"] == NO_SHEETING
        each = RoadObject(**sizes, sheeting=None if matt else row["sheeting"])
        found |= dict.fromkeys(map(plain_name, row["names"].split(";")), each)
    return MappingProxyType(found)
