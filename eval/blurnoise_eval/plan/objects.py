"""Objects of a plan: how fast they move, and which of their boxes are the truth. Boxes are (x0, y0, x1, y1), px."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le

from blurnoise._core.fields import Figure, check_fields


@dataclass(frozen=True)
class ObjectSettings:
    """How objects move where not all of a picture does. Raises ``ValueError``.

    speeds: by class, a multiple of the velocity on the axes ``--dx`` and ``--dy``; 0: it stands. boxes: "object",
    where objects are at mid-exposure, or "swept", all that they pass.

    >>> ObjectSettings(speeds={"person": 0.3}).speed_of("car")
    1.0
    """

    speeds: Mapping[str, Annotated[Figure, Ge(-100), Le(100)]] = field(default_factory=dict)
    boxes: Literal["object", "swept"] = "object"

    def __post_init__(self) -> None:
        check_fields(self)

    def speed_of(self, label: str) -> float:
        """The speed of a class, 1 by default."""
        return self.speeds.get(label, 1.0)

    def to_dict(self) -> dict[str, Any]:
        """The fields that are not the usual ones, as plain values for JSON."""
        usual = asdict(type(self)())
        return {name: value for name, value in asdict(self).items() if value != usual[name]}


USUAL_OBJECTS = ObjectSettings()
