"""Vehicles as the command line is told of them: the camera's own (``motion --map``, ``simulate --ego``, ``sweep
--ego-kmh``), and one that crosses its view (``simulate --object-kmh``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from typer import Option

if TYPE_CHECKING:
    from blurnoise.blur.layers import Layer
    from blurnoise.motion.ego import Vehicle
    from blurnoise.optics.camera import Camera
    from blurnoise_eval.grid.objects import Crossing

LensKind = Literal["f-theta", "rectilinear"]


def height_m(panel: str) -> Any:
    """--height-m."""
    return Option(metavar="M", help="of the camera above the road, default: 1.5", rich_help_panel=panel)


def pitch_deg(panel: str) -> Any:
    """--pitch-deg."""
    return Option(metavar="DEG", help="the camera looks down by, default: 0", rich_help_panel=panel)


def heading_deg(panel: str) -> Any:
    """--heading-deg."""
    return Option(metavar="DEG", help="... and to the right of the way by, default: 0", rich_help_panel=panel)


def plane_m(panel: str) -> Any:
    """--plane-m."""
    return Option(metavar="M", help="a wall at this distance", rich_help_panel=panel)


def hfov_deg(panel: str | None = None) -> Any:
    """--hfov-deg."""
    return Option(metavar="DEG", help="horizontal field of view", rich_help_panel=panel)


def lens(panel: str | None = None) -> Any:
    """--lens."""
    return Option(
        help="f-theta: the same px per degree everywhere, as in Lin et al. 2024; rectilinear: pinhole"
        + ("; default: the camera's where its file has a distortion, else f-theta" if panel else ""),
        rich_help_panel=panel,
    )


class Drive(NamedTuple):
    """Speed ahead, m/s, and rotation of the camera, degrees/s: to the right, and up."""

    speed_m_s: float
    yaw_deg_s: float = 0.0
    pitch_deg_s: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Drive:
        """Of "KMH[,YAW_DEG_S[,PITCH_DEG_S]]". Raises ``ValueError``."""
        try:
            speed_kmh, *turns = (float(part) for part in text.split(","))
        except ValueError:
            turns = [math.nan] * 3
        if len(turns) > 2:
            raise ValueError(f"ego = {text!r}: must be KMH[,YAW_DEG_S[,PITCH_DEG_S]], such as 50 or 50,10")
        return cls(speed_kmh / 3.6, *turns)


def crossing_px_s(
    layer: Layer, crossing: Crossing, camera: Camera, size: tuple[int, int]
) -> tuple[float, float]:
    """Velocity (x, y), px/s, of an object that crosses a camera's view, in a picture (H, W): its matte is its box."""
    left, top = layer.place_px
    high, wide = layer.alpha.shape
    return crossing.velocity_px_s((left, top, left + wide, top + high), camera, size)


def stated(**fields: Any) -> Vehicle | None:
    """A :class:`blurnoise.motion.ego.Vehicle` of the fields that are not None; None where all are.

    Raises ``ValueError`` naming the field.
    """
    from blurnoise.motion.ego import Vehicle

    given = {name: value for name, value in fields.items() if value is not None}
    return Vehicle(**given) if given else None
