"""Objects of a plan: how fast what moves for itself is, and where it counts.

Convention: of speeds, multiples of the velocity on the axes ``--dx`` and ``--dy``; of what crosses the view at a road
speed, km/h, to the right. Boxes are (x0, y0, x1, y1), px.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any

from blurnoise._core.checks import LIMITS, in_range, limited, one_of
from blurnoise.optics.camera import Camera
from blurnoise.scene.scene import Exposure

BOXES = ("object", "half", "swept")
_FASTEST, _FASTEST_KMH = 100.0, 360.0


@dataclass(frozen=True)
class Crossing:
    """What crosses the view to the right at kmh; it is width_m wide and as wide as its box."""

    kmh: float
    width_m: float

    def __post_init__(self) -> None:
        in_range("kmh", self.kmh, -_FASTEST_KMH, _FASTEST_KMH)
        limited("width_m", self.width_m, "target_width_m")

    def velocity_px_s(
        self, box_xyxy: Iterable[float], camera: Camera, size: tuple[int, int]
    ) -> tuple[float, float]:
        """Of an object in that box of a picture (H, W), x right and y down. Raises ``ValueError`` beyond limits."""
        left, _, right, _ = box_xyxy
        velocity = self.kmh / 3.6 * (right - left) / self.width_m
        most = LIMITS["velocity_px_s"].high
        if not abs(velocity) <= most:
            raise ValueError(f"kmh = {self}: {abs(velocity):g} px/s, must be <= {most:g} px/s")
        return velocity, 0.0

    def __str__(self) -> str:
        return f"{self.kmh:g} with width_m = {self.width_m:g}"


def _crossing(label: str, stated: Mapping[str, Any] | Crossing) -> Crossing:
    """Of a mapping. Raises ``ValueError`` naming the class."""
    if isinstance(stated, Crossing):
        return stated
    if not isinstance(stated, Mapping) or set(stated) != {"kmh", "width_m"}:
        raise ValueError(f"crossings: {label}: must be {{kmh: ..., width_m: ...}}")
    try:
        return Crossing(**stated)
    except (TypeError, ValueError) as error:
        raise ValueError(f"crossings: {label}: {error}") from None


@dataclass(frozen=True)
class Objects:
    """How objects move. speeds: by class, a multiple of the velocity, 0 where it stands.

    crossings: by class, what crosses the view at a road speed, whatever that velocity is: before a camera at rest
    where targets move, beside what the background does where the camera tracks others. boxes: which are the truth:
    where objects are at mid-exposure, where for half of it or more, or all that they pass. Raises ``ValueError``
    naming the field.
    """

    speeds: Mapping[str, float] | Iterable[tuple[str, float]] = ()
    boxes: str = "object"
    crossings: Mapping[str, Crossing] | Iterable[tuple[str, Crossing | Mapping[str, Any]]] = ()

    def __post_init__(self) -> None:
        one_of("boxes", self.boxes, BOXES)
        speeds = {
            str(label): in_range(f"speeds: {label}", speed, -_FASTEST, _FASTEST)
            for label, speed in dict(self.speeds).items()
        }
        crossings = {str(label): _crossing(label, each) for label, each in dict(self.crossings).items()}
        object.__setattr__(self, "speeds", tuple(sorted(speeds.items())))
        object.__setattr__(self, "crossings", tuple(sorted(crossings.items())))
        for label in speeds.keys() & crossings:
            raise ValueError(f"speeds: {label}: is one of crossings, too; must be one of them")

    def check_used(self, cuts: bool) -> None:
        """Raise ``ValueError`` where something is stated of what moves for itself and nothing does, ``cuts``."""
        stated = [name for name in self.to_dict() if name != "boxes"]
        if stated and not cuts:
            raise ValueError(
                f"{', '.join(stated)}: of what moves for itself; goes with moves targets or background"
            )

    def speed_of(self, label: str) -> float:
        """That of a class, 1 unless stated; 0 of one that crosses the view at a speed of its own."""
        return 0.0 if label in self.by_class else dict(self.speeds).get(label, 1.0)

    def own_px_s(
        self, label: str, box_xyxy: Iterable[float], camera: Camera, size: tuple[int, int]
    ) -> tuple[float, float]:
        """Velocity (x, y), px/s, of what is of a class that crosses, in that box of a picture (H, W); else 0."""
        crossing = self.by_class.get(label)
        try:
            return (0.0, 0.0) if crossing is None else crossing.velocity_px_s(box_xyxy, camera, size)
        except ValueError as error:
            raise ValueError(f"crossings: {label}: {error}") from None

    def check_crossing(self, label: str, own_px_s: tuple[float, float], taken: Exposure) -> None:
        """Raise ``ValueError`` naming the class where one of that velocity moves too far during an exposure."""
        try:
            taken.of_targets(0.0, own_px_s)
        except ValueError as error:
            raise ValueError(f"crossings: {label}: kmh = {self.by_class[label]}: {error}") from None

    def stands(self, label: str) -> bool:
        """Whether what is of a class never moves."""
        return self.speed_of(label) == 0 and not self.crosses(label)

    def crosses(self, label: str | None = None) -> bool:
        """Whether a class, or any, crosses the view at a speed of its own."""
        asked = self.by_class if label is None else {label} & self.by_class.keys()
        return any(self.by_class[each].kmh for each in asked)

    @cached_property
    def by_class(self) -> dict[str, Crossing]:
        """The crossings; asked for with every target of every frame."""
        return dict(self.crossings)  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, Any]:
        """What is not as usual, as plain values for JSON."""
        return {
            each.name: value for each in fields(self) if (value := asdict(self)[each.name]) != each.default
        }


USUAL_OBJECTS = Objects()
