"""``blurnoise motion``: road speed to px/s and blur length; a map of the exposures that a moving camera may use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from blurnoise_eval.cli import given, vehicle
from blurnoise_eval.cli._options import CAMERAS, Json, new_file, numbers, one_of
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.terminal import say, say_json, say_wrapped

if TYPE_CHECKING:
    from blurnoise.motion.ego import Lens
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
    camera: Annotated[
        str | None,
        Option(
            metavar="NAME|FILE",
            help="whose size and field of view hold where they are not stated; with --map imx250 if none is",
            autocompletion=one_of(CAMERAS),
        ),
    ] = None,
    width_px: Annotated[float | None, Option(metavar="PX", help="of the picture")] = None,
    hfov_deg: Annotated[float | None, vehicle.hfov_deg()] = None,
    lens: Annotated[vehicle.LensKind, vehicle.lens()] = "f-theta",
    map_: Annotated[
        Path | None,
        Option(
            "--map",
            parser=new_file,
            metavar="OUT.png|OUT.svg|OUT.pdf",
            help="draw the longest exposure that keeps blur within --max-blur-px, at every pixel",
            rich_help_panel=_MAP,
        ),
    ] = None,
    max_blur_px: Annotated[
        float | None, Option(metavar="PX", help="default: 1", rich_help_panel=_MAP)
    ] = None,
    yaw_deg_s: Annotated[
        float | None, Option(metavar="DEG_S", help="turn to the right, default: 0", rich_help_panel=_MAP)
    ] = None,
    height_m: Annotated[float | None, vehicle.height_m(_MAP)] = None,
    pitch_deg: Annotated[float | None, vehicle.pitch_deg(_MAP)] = None,
    heading_deg: Annotated[float | None, vehicle.heading_deg(_MAP)] = None,
    planes_m: Annotated[
        object,
        Option(
            parser=numbers,
            metavar="LIST",
            help="distances of frontal planes before the road, m, a map each; default: 10,30",
            rich_help_panel=_MAP,
        ),
    ] = None,
    height_px: Annotated[
        int | None,
        Option(metavar="PX", help="of the picture (default: in the camera's ratio)", rich_help_panel=_MAP),
    ] = None,
    values: Annotated[
        Path | None,
        Option(
            parser=new_file,
            metavar="OUT.csv|OUT.npy",
            help="the maps' values too: a table of 33 points along a side, or ms at every pixel",
            rich_help_panel=_MAP,
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Tell how fast something on a road moves in the picture, and how long its motion blur is.

      blurnoise motion --speed-kmh 100 --distance-m 50 --target-width-m 4.9 \\
          --exposure-ms 30 --width-px 4096 --hfov-deg 99.32

    The px/s are --dx of a sweep. This one prints 39.3502 px: row 8 of Table 2 in Lin et al. 2024.

      blurnoise motion --map map.png --speed-kmh 50 --yaw-deg-s 10 --camera imx250 \\
          --lens rectilinear --hfov-deg 60 --height-m 1.5 --pitch-deg 2

    A camera that drives: the longest exposure that keeps blur within 1 px, over a flat road with the sky above, and
    for planes ahead that fill the picture. Things that move by themselves are not in it.
    """
    mapped = {
        "max_blur_px": max_blur_px,
        "yaw_deg_s": yaw_deg_s,
        "height_m": height_m,
        "pitch_deg": pitch_deg,
        "heading_deg": heading_deg,
        "planes_m": planes_m,
        "height_px": height_px,
        "values": values,
    }
    crossing = {"distance_m": distance_m, "target_width_m": target_width_m}
    for name, value in (crossing if map_ else mapped).items():
        if value is not None:
            raise ValueError(f"{name.replace('_', '-')}: goes with{'out' if map_ else ''} --map")
    speed_m_s, exposure_s = speed_kmh / 3.6, None if exposure_ms is None else exposure_ms / 1e3
    if map_ is not None:
        stated: dict[str, Any] = {name: value for name, value in mapped.items() if value is not None}
        taker = given.camera(camera or "imx250")
        _draw_map(taker, map_, speed_m_s, exposure_s, width_px, hfov_deg, lens, as_json, **stated)
        return
    if camera is not None:
        taker = given.camera(camera)
        width_px = taker.width_px if width_px is None else width_px
        hfov_deg = taker.hfov_deg if hfov_deg is None else hfov_deg
    needed = {**crossing, "exposure_ms": exposure_ms, "width_px": width_px, "hfov_deg": hfov_deg}
    missing = [f"--{name.replace('_', '-')}" for name, value in needed.items() if value is None]
    if missing:
        raise ValueError(f"{', '.join(missing)}: needed, unless --map draws every distance")
    from blurnoise.motion.ego import blur_pixels, velocity_px_s

    seen: Any = {"target_width_m": target_width_m, "width_px": width_px, "hfov_deg": hfov_deg, "lens": lens}
    velocity = velocity_px_s(speed_m_s, distance_m, **seen)  # type: ignore[arg-type]
    length = blur_pixels(speed_m_s, distance_m, exposure_s, **seen)  # type: ignore[arg-type]
    print_facts({"lens": lens, "velocity_px_s": velocity, "blur_px": length}, as_json)


def _draw_map(
    camera: Camera,
    path: Path,
    speed_m_s: float,
    exposure_s: float | None,
    width_px: float | None,
    hfov_deg: float | None,
    lens: Lens,
    as_json: bool,
    *,
    max_blur_px: float = 1.0,
    yaw_deg_s: float = 0.0,
    height_m: float = 1.5,
    pitch_deg: float = 0.0,
    heading_deg: float = 0.0,
    planes_m: tuple[float, ...] = (10.0, 30.0),
    height_px: int | None = None,
    values: Path | None = None,
) -> None:
    """Draw the map, write its values, and say what it answers."""
    from blurnoise._core.checks import limited
    from blurnoise.motion.ego import Mount, View
    from blurnoise_eval.drawing import motion_map
    from blurnoise_eval.drawing.photon_transfer import plot_suffix

    plot_suffix(path)  # before anything is computed
    limited("max_blur_px", max_blur_px, "blur_px")
    if exposure_s is not None:
        limited("exposure_s", exposure_s)
    if len(planes_m) > motion_map.MOST_PLANES:
        raise ValueError(f"planes-m: at most {motion_map.MOST_PLANES} of them, got {len(planes_m)}")
    wide = camera.width_px if width_px is None else round(limited("width_px", width_px))
    high = round(camera.height_px * wide / camera.width_px) if height_px is None else height_px
    view = View(wide, high, camera.hfov_deg if hfov_deg is None else hfov_deg, lens)
    mount = Mount(height_m, pitch_deg, heading_deg)
    moving = mount.driving(speed_m_s, yaw_deg_s)
    maps = motion_map.maps_of(view, mount, moving, planes_m, blur_px=max_blur_px)
    if values is not None:
        motion_map.write_values(values, view, mount, moving, planes_m, max_blur_px)
    pinhole = "pinhole" if lens == "rectilinear" else lens
    turning = f", turning {'left' if yaw_deg_s < 0 else 'right'} at {abs(yaw_deg_s):g} degrees/s"
    title = (
        f"{camera.name}, {wide} x {high} px, {view.hfov_deg:g} degrees, {pinhole}; {height_m:g} m above the road, "
        f"{pitch_deg:g} degrees down{f', {heading_deg:g} to the right' if heading_deg else ''}; "
        f"{3.6 * speed_m_s:g} km/h{turning if yaw_deg_s else ''}"
    )
    motion_map.write(maps, view, mount, max_blur_px, title, path)
    written = [str(each) for each in (path, values) if each is not None]
    if as_json:
        say_json({
            "camera": camera.name, "width_px": wide, "height_px": high, "hfov_deg": view.hfov_deg, "lens": lens,
            "speed_m_s": speed_m_s, "yaw_deg_s": yaw_deg_s, "max_blur_px": max_blur_px,
            "maps": [motion_map.facts(found, exposure_s) for found in maps], "files": written,
        })  # fmt: skip
        return
    say_wrapped(title)
    for sentence in motion_map.sentences(maps, max_blur_px, exposure_s):
        say_wrapped(sentence, hanging=2)
    say(f"open {', '.join(written)}")
