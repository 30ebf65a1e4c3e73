"""Targets in the light of headlamps, as a plan states them: sizes and sheeting of classes, distance, background.

Domain: m; classes as the labels of pictures have them (:mod:`blurnoise.light.road_objects`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Ge, Le
from pydantic import BeforeValidator

from blurnoise_eval.plan.settings import Settings, Text, setting

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise.light.headlit import RoadView
    from blurnoise.light.road_objects import RoadObject
    from blurnoise.motion.ego import Vehicle


def road_objects_of(given: Any) -> Any:
    """Classes of a file, each a mapping of fields, as :class:`RoadObject` by plain name. Raises ``ValueError``.

    >>> road_objects_of({"Speed_Limit": {"width_m": 0.6, "sheeting": "III"}})["speed limit"].width_m
    0.6
    """
    from blurnoise._core.checks import known
    from blurnoise.light.road_objects import RoadObject, plain_name

    fields = ("width_m", "height_m", "base_m", "sheeting")
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ValueError("must be a mapping of classes, each to width_m or height_m, base_m and sheeting")
    found: dict[str, RoadObject] = {}
    for label, stated in given.items():
        if isinstance(stated, RoadObject):
            found[plain_name(str(label))] = stated
            continue
        try:
            if not isinstance(stated, Mapping):
                raise ValueError(f"must be a mapping of {', '.join(fields)}")
            for name in stated:
                known("field", name, fields)
            sheeting = stated.get("sheeting")
            text = ",".join(map(str, sheeting)) if isinstance(sheeting, list | tuple) else sheeting
            found[plain_name(str(label))] = RoadObject(**{**stated, "sheeting": text})
        except (TypeError, ValueError) as error:
            raise ValueError(f"road_objects: {label}: {error}") from None
    return found


def _sheeting(given: Any) -> Any:
    from blurnoise.light.road_objects import sheeting_of

    text = ",".join(map(str, given)) if isinstance(given, list | tuple) else given
    sheeting_of(text)
    return text


if TYPE_CHECKING:
    RoadObjects = Mapping[str, RoadObject]
else:
    RoadObjects = Annotated[Any, BeforeValidator(road_objects_of)]


@dataclass(frozen=True)
class LitTargets(Settings):
    """What is stated of targets in headlamps; the rest follows from their classes. Raises ``ValueError``.

    >>> LitTargets(sheeting="XI", distance_m=40.0).to_dict()
    {'sheeting': 'XI', 'distance_m': 40.0}
    """

    sheeting: Annotated[Text | None, BeforeValidator(_sheeting)] = setting(
        None,
        "sheeting of signs in headlamps: I, III, XI, vest or worn, none for matt, or three numbers, cd/(lx m2) at "
        ".2, .5 and 2 degrees (default: that of the class)",
        "NAME|A,B,C",
    )
    road_objects: RoadObjects = setting(
        None,
        "classes that headlamps light, beside those of the table: width_m or height_m, base_m and sheeting of each",
    )
    distance_m: Annotated[float | None, Ge(1.0), Le(1e5)] = setting(
        None, "distance of all targets that headlamps light, m (default: by their size in the picture)", "M"
    )
    background: Literal["dark", "lit"] = setting(
        "dark",
        "what headlamps do to the background; dark: nothing; lit: as to a wall at the distance of the median target "
        "(default: dark)",
        "dark|lit",
    )

    def view(self, camera: Camera, vehicle: Vehicle | None) -> RoadView:
        """How a camera on a vehicle sees the targets."""
        from blurnoise.light.headlit import RoadView
        from blurnoise.motion.ego import USUAL_VEHICLE

        stated = self.road_objects, self.sheeting, self.distance_m, self.background
        return RoadView(camera, vehicle or USUAL_VEHICLE, *stated)

    def to_dict(self) -> dict[str, Any]:
        """The fields that are not the usual ones, as plain values for JSON."""
        usual = LitTargets()
        values = {name: value for name, value in vars(self).items() if value != getattr(usual, name)}
        if "road_objects" in values:
            values["road_objects"] = {name: asdict(each) for name, each in self.road_objects.items()}
        return values
