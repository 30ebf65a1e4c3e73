"""``blurnoise motion``: road speed to px/s and blur length."""

from __future__ import annotations

from typing import Annotated, Literal

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import CameraName, Json
from blurnoise_eval.cli.console import print_facts


def motion(
    *,
    speed_kmh: Annotated[float, Option(metavar="KMH", help="across the line of sight, km/h")],
    distance_m: Annotated[float, Option(metavar="M", help="from camera to target, m")],
    target_width_m: Annotated[float, Option(metavar="M", help="of the target, along its motion, m")],
    exposure_ms: Annotated[float, Option(metavar="MS", help="exposure time, ms")],
    camera: CameraName = None,
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
    """Tell how fast something on a road moves in the picture, and how long its motion blur is.

      blurnoise motion --speed-kmh 100 --distance-m 50 --target-width-m 4.9 \\
          --exposure-ms 30 --width-px 4096 --hfov-deg 99.32

    The px/s are --dx of a sweep. This one prints 39.3502 px: row 8 of Table 2 in Lin et al. 2024.
    """
    from blurnoise.motion.ego import blur_pixels, velocity_px_s

    if camera is not None:
        taker = given.camera(camera)
        width_px = taker.width_px if width_px is None else width_px
        hfov_deg = taker.hfov_deg if hfov_deg is None else hfov_deg
    if width_px is None or hfov_deg is None:
        needed = {"--width-px": width_px, "--hfov-deg": hfov_deg}
        missing = [name for name, value in needed.items() if value is None]
        raise ValueError(f"{', '.join(missing)}: needed, unless --camera has it")
    velocity = velocity_px_s(
        speed_kmh / 3.6,
        distance_m,
        width_px=width_px,
        hfov_deg=hfov_deg,
        target_width_m=target_width_m,
        lens=lens,
    )
    length = blur_pixels(
        speed_kmh / 3.6, distance_m, exposure_ms / 1e3,
        width_px=width_px, hfov_deg=hfov_deg, target_width_m=target_width_m, lens=lens,
    )  # fmt: skip
    print_facts({"lens": lens, "velocity_px_s": velocity, "blur_px": length}, as_json)
