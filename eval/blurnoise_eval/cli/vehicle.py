"""Vehicles as the command line is told of them: the camera's own (``motion --map``, ``simulate --ego``, ``sweep
--ego-kmh``), and one that crosses its view (``simulate --object-kmh``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from typer import Option

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise.driving import Vehicle
    from blurnoise.layers import Layer

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
        + ("; default: f-theta" if panel else ""),
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
    layer: Layer,
    speed_kmh: float,
    camera: Camera,
    size: tuple[int, int],
    *,
    distance_m: float | None = None,
    width_m: float | None = None,
    hfov_deg: float | None = None,
    lens: LensKind | None = None,
) -> tuple[float, float]:
    """Velocity (x, y), px/s, of an object that crosses a camera's view to the right, in a picture (H, W).

    width_m: the object's, which is as wide as its matte; else distance_m: its depth along the optical axis, its
    middle as a point there. Raises ``ValueError`` unless it is one of the two.
    """
    import numpy as np

    from blurnoise._core.limits import limited
    from blurnoise.ego_motion import EgoMotion, range_of_depth_m

    speed_m_s = speed_kmh / 3.6
    if width_m is not None and distance_m is None:
        if hfov_deg is not None or lens is not None:
            raise ValueError("hfov-deg, lens: go with --object-m; --object-width-m needs neither")
        limited("object-width-m", width_m, "target_width_m")
        return speed_m_s * layer.alpha.shape[1] / width_m, 0.0
    if distance_m is None or width_m is not None:
        raise ValueError("object-kmh: needs --object-m, how far it is, or --object-width-m, how wide")
    limited("object-m", distance_m, "depth_m")
    fields = {"hfov_deg": hfov_deg, "lens": lens}
    view = (stated(**fields) or stated(height_m=1.5)).view(camera, size)  # type: ignore[union-attr]
    left, top = layer.place_px
    high, wide = layer.alpha.shape
    middle = np.array([left + (wide - 1) / 2, top + (high - 1) / 2])
    away_m = range_of_depth_m(view.rays(middle), distance_m)
    x, y = view.flow_px_s(middle, away_m, EgoMotion((-speed_m_s, 0.0, 0.0))).tolist()
    return x, y


def stated(**fields: Any) -> Vehicle | None:
    """A :class:`blurnoise.driving.Vehicle` of the fields that are not None; None where all are.

    Raises ``ValueError`` naming the field.
    """
    from blurnoise.driving import Vehicle

    given = {name: value for name, value in fields.items() if value is not None}
    return Vehicle(**given) if given else None
