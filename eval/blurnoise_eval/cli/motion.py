"""``blurnoise motion``: road speed to px/s and blur length."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from typer import Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import Json
from blurnoise_eval.cli.console import print_facts


def motion(
    *,
    speed_kmh: Annotated[float, Option(metavar="KMH", min=0, help="speed across the line of sight, km/h")],
    distance_m: Annotated[float, Option(metavar="M", help="distance from camera to target, m")],
    target_width_m: Annotated[float, Option(metavar="M", help="width of the target along its motion, m")],
    exposure_ms: Annotated[float, Option(metavar="MS", min=0, help="exposure time, ms")],
    camera: Annotated[
        str, Option(metavar="NAME|FILE", help="camera with the default width and field of view")
    ] = "ar0132at",
    width_px: Annotated[
        float | None, Option(metavar="PX", help="width of the picture, px (default: the camera's)")
    ] = None,
    hfov_deg: Annotated[
        float | None, Option(metavar="DEG", help="horizontal field of view, degrees (default: the camera's)")
    ] = None,
    lens: Annotated[
        Literal["f-theta", "rectilinear"],
        Option(
            help="projection; f-theta: constant px per degree, as in Lin et al. 2024; rectilinear: pinhole"
        ),
    ] = "f-theta",
    as_json: Json = False,
) -> None:
    """Compute the speed of a road user in the picture, in px/s, and the length of its motion blur, in px.

      blurnoise motion --speed-kmh 100 --distance-m 50 --target-width-m 4.9 \\
          --exposure-ms 30 --width-px 4096 --hfov-deg 99.32

    Use the speed in px/s as --dx of other commands. The example prints a blur of 39.3502 px, as in row 8 of Table 2
    in Lin et al. 2024.
    """
    from blurnoise.motion.ego import blur_pixels, velocity_px_s

    taken_by = inputs.camera(camera)
    seen: Any = {
        "target_width_m": target_width_m,
        "width_px": taken_by.sensor.width_px if width_px is None else width_px,
        "hfov_deg": taken_by.lens.hfov_deg if hfov_deg is None else hfov_deg,
        "lens": lens,
    }
    velocity = velocity_px_s(speed_kmh / 3.6, distance_m, **seen)
    length = blur_pixels(speed_kmh / 3.6, distance_m, exposure_ms / 1e3, **seen)
    print_facts({"lens": lens, "velocity_px_s": velocity, "blur_px": length}, as_json)
