"""``blurnoise motion``: road speed to px/s and blur length; a map of the exposures that a moving camera may use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import CameraName, Json, new_file
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.grid.values import numbers
from blurnoise_eval.system.terminal import say, say_json, say_wrapped

if TYPE_CHECKING:
    from blurnoise.motion.ego import Vehicle
    from blurnoise.optics.camera import Camera

_MAP = "With --map: the camera on the vehicle, and what it sees"


def motion(
    *,
    speed_kmh: Annotated[
        float, Option(metavar="KMH", help="across the line of sight, km/h; with --map the vehicle's")
    ],
    distance_m: Annotated[float | None, Option(metavar="M", help="from camera to target, m")] = None,
    target_width_m: Annotated[
        float | None, Option(metavar="M", help="of the target, along its motion, m")
    ] = None,
    exposure_ms: Annotated[
        float | None,
        Option(metavar="MS", help="exposure time, ms; with --map, tells how much of the picture it serves"),
    ] = None,
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
    map_: Annotated[
        list[Path] | None,
        Option(
            "--map",
            parser=new_file,
            metavar="OUT.png|OUT.csv|OUT.npy",
            help="draw the longest exposure that keeps blur within --max-blur-px, at every pixel (or .svg, .pdf), or "
            "write it as a table of 33 points along a side, or as an array of ms; may be given several times",
            rich_help_panel=_MAP,
        ),
    ] = None,
    max_blur_px: Annotated[
        float, Option(metavar="PX", help="the blur that is allowed", rich_help_panel=_MAP)
    ] = 1.0,
    yaw_deg_s: Annotated[
        float, Option(metavar="DEG_S", help="turn to the right", rich_help_panel=_MAP)
    ] = 0.0,
    mount: Annotated[
        str,
        Option(
            metavar="M[,DEG[,DEG]]",
            help="of the camera: its height above the road, how far it looks down, and to the right of the way",
            rich_help_panel=_MAP,
        ),
    ] = "1.5",
    planes_m: Annotated[
        str,
        Option(
            metavar="LIST",
            help="distances of frontal planes before the road, m, a map each",
            rich_help_panel=_MAP,
        ),
    ] = "10,30",
    as_json: Json = False,
) -> None:
    """Tell how fast something on a road moves in the picture, and how long its motion blur is.

      blurnoise motion --speed-kmh 100 --distance-m 50 --target-width-m 4.9 \\
          --exposure-ms 30 --width-px 4096 --hfov-deg 99.32

    The px/s are --dx of a sweep. This one prints 39.3502 px: row 8 of Table 2 in Lin et al. 2024.

      blurnoise motion --map map.png --speed-kmh 50 --yaw-deg-s 10 \\
          --camera imx250 --lens rectilinear --hfov-deg 60 --mount 1.5,2

    A camera that drives: the longest exposure that keeps blur within 1 px, over a flat road with the sky above, and
    for planes ahead that fill the picture. Things that move by themselves are not in it.
    """
    speed_m_s, exposure_s = speed_kmh / 3.6, None if exposure_ms is None else exposure_ms / 1e3
    seen: dict[str, Any] = {"width_px": width_px, "hfov_deg": hfov_deg}
    if map_ or camera:
        taker = given.camera(camera or "imx250")
        usual = {"width_px": taker.width_px, "hfov_deg": taker.hfov_deg}
        seen = {name: usual[name] if value is None else value for name, value in seen.items()}
    crossing = {"distance_m": distance_m, "target_width_m": target_width_m}
    if map_:
        if lone := [f"--{name.replace('_', '-')}" for name, value in crossing.items() if value is not None]:
            raise ValueError(f"{', '.join(lone)}: go without --map")
        driving = _mount(mount), speed_m_s, yaw_deg_s
        _write_maps(map_, taker, driving, numbers(planes_m), max_blur_px, exposure_s, lens, as_json, **seen)
        return
    needed = {**crossing, "exposure_ms": exposure_ms, **seen}
    if missing := [f"--{name.replace('_', '-')}" for name, value in needed.items() if value is None]:
        raise ValueError(f"{', '.join(missing)}: needed, unless --map draws every distance")
    from blurnoise.motion.ego import blur_pixels, velocity_px_s

    seen |= {"target_width_m": target_width_m, "lens": lens}
    velocity = velocity_px_s(speed_m_s, distance_m, **seen)  # type: ignore[arg-type]
    length = blur_pixels(speed_m_s, distance_m, exposure_s, **seen)  # type: ignore[arg-type]
    print_facts({"lens": lens, "velocity_px_s": velocity, "blur_px": length}, as_json)


def _mount(text: str) -> Vehicle:
    from blurnoise.motion.ego import Vehicle

    try:
        figures = [float(part) for part in text.split(",")]
    except ValueError:
        figures = []
    if not 1 <= len(figures) <= 3:
        raise ValueError(f"mount = {text!r}: must be M[,DEG[,DEG]], such as 1.5,2")
    height_m, pitch_deg, heading_deg = (*figures, 0.0, 0.0)[:3]
    return Vehicle(height_m, pitch_deg, heading_deg)


def _write_maps(
    paths: list[Path],
    camera: Camera,
    driving: tuple[Vehicle, float, float],
    planes_m: tuple[float, ...],
    max_blur_px: float,
    exposure_s: float | None,
    lens: Literal["f-theta", "rectilinear"],
    as_json: bool,
    *,
    width_px: float,
    hfov_deg: float,
) -> None:
    """Draw the map, write its values, and say what it answers."""
    from blurnoise._core.checks import limited
    from blurnoise.motion.ego import View
    from blurnoise_eval.plots import motion_map
    from blurnoise_eval.system.files import plot_suffix, write_figure

    pictures = [path for path in paths if path.suffix not in (".csv", ".npy")]
    for path in pictures:
        plot_suffix(path)  # before anything is computed
    limited("max_blur_px", max_blur_px, "blur_px")
    if exposure_s is not None:
        limited("exposure_s", exposure_s)
    if len(planes_m) > motion_map.MOST_PLANES:
        raise ValueError(f"planes-m: at most {motion_map.MOST_PLANES} of them, got {len(planes_m)}")
    mount, speed_m_s, yaw_deg_s = driving
    wide = round(limited("width_px", width_px))
    view = View(wide, round(camera.height_px * wide / camera.width_px), hfov_deg, lens)
    moving = mount.driving(speed_m_s, yaw_deg_s)
    maps = motion_map.maps_of(view, mount, moving, planes_m, blur_px=max_blur_px)
    turning = f", turning {'left' if yaw_deg_s < 0 else 'right'} at {abs(yaw_deg_s):g} degrees/s"
    heading = f", {mount.heading_deg:g} to the right" if mount.heading_deg else ""
    title = (
        f"{camera.name}, {wide} x {view.height_px} px, {hfov_deg:g} degrees, "
        f"{'pinhole' if lens == 'rectilinear' else lens}; {mount.height_m:g} m above the road, "
        f"{mount.pitch_deg:g} degrees down{heading}; {3.6 * speed_m_s:g} km/h{turning if yaw_deg_s else ''}"
    )
    for path in paths:
        if path in pictures:
            write_figure(path, motion_map.draw(maps, view, max_blur_px, title), dpi=150)
        else:
            motion_map.write_values(path, view, mount, moving, planes_m, max_blur_px)
    written = list(map(str, paths))
    if as_json:
        say_json({
            "camera": camera.name, "width_px": wide, "height_px": view.height_px, "hfov_deg": hfov_deg, "lens": lens,
            "speed_m_s": speed_m_s, "yaw_deg_s": yaw_deg_s, "max_blur_px": max_blur_px,
            "maps": [found.facts(exposure_s) for found in maps], "files": written,
        })  # fmt: skip
        return
    say_wrapped(title)
    for found in maps:
        say_wrapped(found.sentence(max_blur_px, exposure_s), hanging=2)
    say(f"open {', '.join(written)}")
