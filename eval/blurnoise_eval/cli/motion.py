"""``blurnoise motion``: road speed to px/s and blur length; a map of the exposures that a moving camera may use."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import CameraName, Json, new_file
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.grid.values import numbers
from blurnoise_eval.system.terminal import say, say_json, say_wrapped

if TYPE_CHECKING:
    from blurnoise.motion.ego import Vehicle, View

_map = partial(Option, rich_help_panel="With --map: the camera on the vehicle, and what it sees")


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
        _map(
            "--map",
            parser=new_file,
            metavar="OUT.png|OUT.csv|OUT.npy",
            help="draw the longest exposure that keeps blur within --max-blur-px, at every pixel (or .svg, .pdf), or "
            "write it as a table of 33 points along a side, or as an array of ms; may be given several times",
        ),
    ] = None,
    max_blur_px: Annotated[float, _map(metavar="PX", help="the blur that is allowed")] = 1.0,
    yaw_deg_s: Annotated[float, _map(metavar="DEG_S", help="turn to the right")] = 0.0,
    mount: Annotated[
        str,
        _map(
            metavar="M[,DEG[,DEG]]",
            help="of the camera: its height above the road, how far it looks down, and to the right of the way",
        ),
    ] = "1.5",
    planes_m: Annotated[
        str, _map(metavar="LIST", help="distances of frontal planes before the road, m, a map each")
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
    from blurnoise.motion.ego import View, blur_pixels, velocity_px_s

    speed_m_s, exposure_s = speed_kmh / 3.6, None if exposure_ms is None else exposure_ms / 1e3
    taker = given.camera(camera or "imx250")
    if map_ or camera:
        width_px = taker.width_px if width_px is None else width_px
        hfov_deg = taker.hfov_deg if hfov_deg is None else hfov_deg
    crossing = {"--distance-m": distance_m, "--target-width-m": target_width_m}
    if map_ and width_px is not None and hfov_deg is not None:
        if lone := [name for name, value in crossing.items() if value is not None]:
            raise ValueError(f"{', '.join(lone)}: go without --map")
        from blurnoise._core.checks import limited

        wide = round(limited("width_px", width_px))
        view = View(wide, round(taker.height_px * wide / taker.width_px), hfov_deg, lens)
        driving = _mount(mount), speed_m_s, yaw_deg_s
        facts = _write_maps(map_, taker.name, view, driving, numbers(planes_m), max_blur_px, exposure_s)
        if as_json:
            say_json(facts)
            return
        say_wrapped(facts["title"])
        for sentence in facts["sentences"]:
            say_wrapped(sentence, hanging=2)
        say(f"open {', '.join(facts['files'])}")
        return
    needed = {**crossing, "--exposure-ms": exposure_s, "--width-px": width_px, "--hfov-deg": hfov_deg}
    if missing := [name for name, value in needed.items() if value is None]:
        raise ValueError(f"{', '.join(missing)}: needed, unless --map draws every distance")
    seen: Any = {
        "width_px": width_px, "hfov_deg": hfov_deg, "target_width_m": target_width_m, "lens": lens,
    }  # fmt: skip
    away_m: Any = distance_m
    velocity = velocity_px_s(speed_m_s, away_m, **seen)
    length = blur_pixels(speed_m_s, away_m, exposure_s or 0.0, **seen)
    print_facts({"lens": lens, "velocity_px_s": velocity, "blur_px": length}, as_json)


def _mount(text: str) -> Vehicle:
    from blurnoise.motion.ego import Vehicle

    try:
        height_m, pitch_deg, heading_deg = (*map(float, text.split(",")), *[0.0] * (2 - text.count(",")))
    except ValueError:
        raise ValueError(f"mount = {text!r}: must be M[,DEG[,DEG]], such as 1.5,2") from None
    return Vehicle(height_m, pitch_deg, heading_deg)


def _write_maps(
    paths: list[Path],
    camera: str,
    view: View,
    driving: tuple[Vehicle, float, float],
    planes_m: tuple[float, ...],
    max_blur_px: float,
    exposure_s: float | None,
) -> dict[str, Any]:
    """Draw the map, write its values; what it answers, by name."""
    from blurnoise._core.checks import limited
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
    moving = mount.driving(speed_m_s, yaw_deg_s)
    maps = motion_map.maps_of(view, mount, moving, planes_m, blur_px=max_blur_px)
    turning = f", turning {'left' if yaw_deg_s < 0 else 'right'} at {abs(yaw_deg_s):g} degrees/s"
    title = (
        f"{camera}, {view.width_px} x {view.height_px} px, {view.hfov_deg:g} degrees, {view.lens}; "
        f"{mount.height_m:g} m above the road, {mount.pitch_deg:g} degrees down, {mount.heading_deg:g} to the "
        f"right; {3.6 * speed_m_s:g} km/h{turning if yaw_deg_s else ''}"
    )
    for path in paths:
        if path in pictures:
            write_figure(path, motion_map.draw(maps, view, max_blur_px, title), dpi=150)
        else:
            motion_map.write_values(path, view, mount, moving, planes_m, max_blur_px)
    return {
        "title": title, "camera": camera, "width_px": view.width_px, "lens": view.lens,
        "maps": [found.facts(exposure_s) for found in maps],
        "sentences": [found.sentence(max_blur_px, exposure_s) for found in maps],
        "files": list(map(str, paths)),
    }  # fmt: skip
