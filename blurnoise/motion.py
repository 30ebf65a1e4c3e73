"""Motion: from a road scene to pixels per second and to the length of a blur.

Convention: every function says which lens it assumes. "f-theta": a constant number of pixels per degree, as
in Lin et al., Sensors 2024, 24, 5135, eq. 14. "rectilinear": a pinhole, focal length in pixels on the axis.
"""

from __future__ import annotations

import math
from typing import Literal

from blurnoise._core.checks import one_of
from blurnoise._core.limits import limited

Lens = Literal["f-theta", "rectilinear"]


def velocity_px_s(
    speed_m_s: float,
    distance_m: float,
    *,
    target_width_m: float,
    width_px: float,
    hfov_deg: float,
    lens: Lens = "f-theta",
) -> float:
    """Speed in the image, px/s, of a target that crosses the optical axis at ``speed_m_s``.

    speed_m_s >= 0, across the line of sight; distance_m, target_width_m > 0; width_px and hfov_deg are the
    camera's. The target's image is ``Size_px`` wide and moves Size_px / target_width_m pixels per metre:

    * f-theta: Size_px = 2 atan(w / 2d) [deg] * width_px / hfov_deg (Lin et al. 2024, eq. 14);
    * rectilinear: Size_px = f w / d with f = (width_px / 2) / tan(hfov / 2).

    Raises ``ValueError`` for values outside these ranges (a rectilinear lens needs hfov_deg < 180).
    """
    speed, distance = limited("speed_m_s", speed_m_s), limited("distance_m", distance_m)
    target, width = limited("target_width_m", target_width_m), limited("width_px", width_px)
    hfov = limited("hfov_deg", hfov_deg)
    one_of("lens", lens, ("f-theta", "rectilinear"))
    if lens == "f-theta":
        size_px = math.degrees(2 * math.atan(target / (2 * distance))) * width / hfov
    else:
        if hfov >= 180:
            raise ValueError(f"hfov_deg = {hfov_deg!r}: must be < 180 for a rectilinear lens")
        size_px = width / 2 / math.tan(math.radians(hfov) / 2) * target / distance
    return size_px * speed / target


def blur_pixels(
    speed_m_s: float,
    distance_m: float,
    exposure_s: float,
    *,
    target_width_m: float,
    width_px: float,
    hfov_deg: float,
    lens: Lens = "f-theta",
) -> float:
    """Length of the motion blur in px: ``velocity_px_s`` times the exposure in s (>= 0)."""
    exposure = limited("exposure_s", exposure_s)
    return exposure * velocity_px_s(
        speed_m_s,
        distance_m,
        target_width_m=target_width_m,
        width_px=width_px,
        hfov_deg=hfov_deg,
        lens=lens,
    )
