"""``blurnoise motion``: road speed to px/s and blur length."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import Json
from blurnoise_eval.cli.console import print_facts


def motion(
    *,
    speed_kmh: Annotated[float, Option(metavar="KMH", min=0, help="across the line of sight, km/h")],
    distance_m: Annotated[float, Option(metavar="M", help="from camera to target, m")],
    target_width_m: Annotated[float, Option(metavar="M", help="of the target, along its motion, m")],
    exposure_ms: Annotated[float, Option(metavar="MS", min=0, help="exposure time, ms")],
    camera: Annotated[
        str, Option(metavar="NAME|FILE", help="whose width and field of view are the defaults")
    ] = "ar0132at",
    width_px: Annotated[
        float | None, Option(metavar="PX", help="of the picture (default: the camera's)")
    ] = None,
    hfov_deg: Annotated[
        float | None, Option(metavar="DEG", help="horizontal field of view (default: the camera's)")
    ] = None,
    lens: Annotated[
        Literal["f-theta", "rectilinear"],
        Option(
            help="f-theta: the same px per degree everywhere, as in Lin et al. 2024; rectilinear: pinhole"
        ),
    ] = "f-theta",
    as_json: Json = False,
) -> None:
    """Compute how fast something on a road moves in the picture, and how long its motion blur is.

      blurnoise motion --speed-kmh 100 --distance-m 50 --target-width-m 4.9 \\
          --exposure-ms 30 --width-px 4096 --hfov-deg 99.32

    The px/s are --dx of a sweep. This one prints 39.3502 px: row 8 of Table 2 in Lin et al. 2024.
    """
    from blurnoise.motion.ego import blur_pixels, velocity_px_s

    taken_by = given.camera(camera)
    seen: Any = {
        "target_width_m": target_width_m,
        "width_px": taken_by.width_px if width_px is None else width_px,
        "hfov_deg": taken_by.hfov_deg if hfov_deg is None else hfov_deg,
        "lens": lens,
    }
    velocity = velocity_px_s(speed_kmh / 3.6, distance_m, **seen)
    length = blur_pixels(speed_kmh / 3.6, distance_m, exposure_ms / 1e3, **seen)
    print_facts({"lens": lens, "velocity_px_s": velocity, "blur_px": length}, as_json)
