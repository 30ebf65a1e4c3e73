"""Objects of a plan: how fast they move, which boxes are the truth.

Convention: speeds are multiples of the velocity on the axes ``--dx`` and ``--dy``; of classes that cross the view at
a road speed, km/h, to the right. Boxes are (x0, y0, x1, y1), px.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le

from blurnoise._core.checks import Figure, check_fields, within
from blurnoise.scene.scene import Exposure


@dataclass(frozen=True)
class Crossing:
    """An object of width_m that crosses the view to the right at kmh; its box has its width."""

    kmh: Annotated[Figure, Ge(-360), Le(360)]
    width_m: Annotated[Figure, within("target_width_m")]

    def __post_init__(self) -> None:
        check_fields(self)

    def velocity_px_s(self, box_xyxy: Iterable[float]) -> tuple[float, float]:
        """Of an object in that box, x right and y down."""
        left, _, right, _ = box_xyxy
        return self.kmh / 3.6 * (right - left) / self.width_m, 0.0


def _crossing(label: str, stated: Any) -> Crossing:
    try:
        return stated if isinstance(stated, Crossing) else Crossing(**stated)
    except TypeError:
        raise ValueError(f"crossings: {label}: must be {{kmh: ..., width_m: ...}}") from None
    except ValueError as error:
        raise ValueError(f"crossings: {label}: {error}") from None


@dataclass(frozen=True)
class Objects:
    """How objects move. speeds: by class, a multiple of the velocity, 0: it stands.

    crossings: by class, the road speed at which it crosses the view, whatever that velocity is: before a camera at
    rest where targets move, relative to the background where the camera tracks others.
    boxes: which are the truth: where objects are at mid-exposure, where they are for half of it or more, or all that
    they pass. Raises ``ValueError``.
    """

    speeds: Mapping[str, Annotated[Figure, Ge(-100), Le(100)]] = field(default_factory=dict)
    boxes: Literal["object", "half", "swept"] = "object"
    crossings: Mapping[str, Crossing] = field(default_factory=dict)

    def __post_init__(self) -> None:
        crossings = {label: _crossing(label, each) for label, each in dict(self.crossings).items()}
        object.__setattr__(self, "crossings", crossings)
        check_fields(self)
        for label in self.speeds.keys() & crossings:
            raise ValueError(f"speeds: {label}: must be in speeds or in crossings, not in both")

    def speed_of(self, label: str) -> float:
        """The speed of a class, 1 by default; 0 if it crosses the view at a road speed."""
        return 0.0 if label in self.crossings else self.speeds.get(label, 1.0)

    def own_px_s(self, label: str, box_xyxy: Iterable[float]) -> tuple[float, float]:
        """Velocity (x, y), px/s, of an object in this box, if its class crosses the view; else 0."""
        crossing = self.crossings.get(label)
        return (0.0, 0.0) if crossing is None else crossing.velocity_px_s(box_xyxy)

    def check_crossing(self, label: str, own_px_s: tuple[float, float], taken: Exposure) -> None:
        """Raise ``ValueError`` naming the class where one of that velocity moves too far during an exposure."""
        try:
            taken.of_targets(0.0, own_px_s)
        except ValueError as error:
            crossing = self.crossings[label]
            raise ValueError(
                f"crossings: {label}: kmh = {crossing.kmh:g} with width_m = {crossing.width_m:g}: {error}"
            ) from None

    def stands(self, label: str) -> bool:
        """Whether objects of a class never move."""
        return self.speed_of(label) == 0 and not self.crosses(label)

    def crosses(self, label: str | None = None) -> bool:
        """Whether a class, or any, crosses the view at a speed of its own."""
        return any(each.kmh for name, each in self.crossings.items() if label in (None, name))

    def to_dict(self) -> dict[str, Any]:
        """The fields that are not the usual ones, as plain values for JSON."""
        usual = asdict(type(self)())
        return {name: value for name, value in asdict(self).items() if value != usual[name]}


USUAL_OBJECTS = Objects()
