"""``blurnoise simulate``: one picture as a camera would take it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from blurnoise_eval.cli import _options, given, vehicle
from blurnoise_eval.cli._options import CameraName, Cfa, FNumber, FrameRate, GreyAnchor, Json, Mains
from blurnoise_eval.cli.console import print_camera, print_facts, print_stages
from blurnoise_eval.grid.axes import AUTOMATIC

if TYPE_CHECKING:
    from torch import Tensor

    from blurnoise.optics.camera import Camera, Capture
    from blurnoise.scene.cutting import Cut
    from blurnoise.scene.hdr import Flicker


_EGO = "With --ego: the camera on the vehicle"


def simulate(
    image: Annotated[
        Path,
        Argument(metavar="IMAGE", help="8- or 16-bit, grey or colour; or floats, with --encoding linear"),
    ],
    *,
    output: _options.PictureWritten,
    exposure_ms: Annotated[
        float,
        Option(
            parser=_options.or_auto,
            metavar="MS|auto",
            help="exposure time, ms; auto: as the camera sets it, then its gain",
        ),
    ] = 10.0,
    lux: Annotated[float, Option(metavar="LUX", help="light on the scene, lux")] = 100.0,
    dx: Annotated[float, Option(metavar="PX_S", help="motion to the right, px/s")] = 0.0,
    dy: Annotated[float, Option(metavar="PX_S", help="motion down, px/s")] = 0.0,
    trajectory: Annotated[
        str | None,
        Option(
            metavar="FILE.csv|shake:PX|sine:PX,HZ",
            help="a path beside that: places or rates of rotation over time, a shake of --seed, a vibration[,DEG]",
        ),
    ] = None,
    line_time_us: Annotated[
        float | None,
        Option(
            metavar="US", help="rolling shutter: from row to row (default: the camera's); 0: a global shutter"
        ),
    ] = None,
    ego: Annotated[
        str | None,
        Option(
            metavar="KMH[,DEG_S[,DEG_S]]",
            help="the camera drives over a flat road, turns right, and up",
            rich_help_panel=_EGO,
        ),
    ] = None,
    height_m: Annotated[float | None, vehicle.height_m(_EGO)] = None,
    pitch_deg: Annotated[float | None, vehicle.pitch_deg(_EGO)] = None,
    heading_deg: Annotated[float | None, vehicle.heading_deg(_EGO)] = None,
    plane_m: Annotated[float | None, vehicle.plane_m(_EGO)] = None,
    hfov_deg: Annotated[float | None, vehicle.hfov_deg(_EGO)] = None,
    lens: Annotated[vehicle.LensKind | None, vehicle.lens(_EGO)] = None,
    temperature_c: Annotated[float, Option(metavar="C", help="of the sensor, degC")] = 25.0,
    gain_db: Annotated[
        float,
        Option(
            "--gain",
            parser=_options.or_auto,
            metavar="DB|auto",
            help="analogue as far as the camera goes, then digital, which native numbers are before; auto: to 18 %",
        ),
    ] = 0.0,
    frame_rate: FrameRate = 30.0,
    mains: Mains = "0",
    illuminant: Annotated[
        str,
        Option(
            metavar="NAME|FILE.csv",
            help="the light's spectrum: D50, D55, D65, D75, planck:2856 or a file of nm and power",
        ),
    ] = "D55",
    seed: Annotated[int, Option(metavar="N", help="of the noise")] = 0,
    fidelity: Annotated[
        Literal["auto", "full"],
        Option(help="auto: leave out what changes less than the tolerance; full: model everything"),
    ] = "auto",
    tolerance_dn: Annotated[float, Option(metavar="DN", help="what auto may leave out, DN RMS")] = 0.1,
    explain: Annotated[
        bool, Option("--explain", help="print what each stage contributes, and what is done about it")
    ] = False,
    bit_depth: Annotated[
        Literal["8", "native"],
        Option(help="8: the sRGB picture to look at; native: the camera's digital numbers in a 16-bit PNG"),
    ] = "8",
    encoding: Annotated[
        Literal["srgb", "linear"],
        Option(
            help="of the picture; linear: light, 1 is white and more is allowed (.hdr, float .tiff, 16 bits)"
        ),
    ] = "srgb",
    emitters: Annotated[
        str | None,
        Option(
            metavar="MASK.png:FACTOR",
            help="what sends out light: so many times the picture's where it is white",
        ),
    ] = None,
    hdr: Annotated[
        str | None,
        Option(
            metavar="RATIO,...",
            help="more captures, shorter by these ratios, each after the last, fused (default: the camera's)",
        ),
    ] = None,
    hdr_white: Annotated[
        float, Option(metavar="TIMES", help="the light that is white in a fused picture, times white")
    ] = 1.0,
    pwm: Annotated[
        str | None,
        Option(
            metavar="HZ,DUTY[,PHASE]",
            help="a lamp of pulses; its phase, 0-1, is drawn from --seed if not given",
        ),
    ] = None,
    pwm_mask: Annotated[
        Path | None, Option(metavar="MASK.png", help="where that lamp is, white alone (default: everywhere)")
    ] = None,
    cut: Annotated[
        str | None,
        Option(
            "--object",
            metavar="MASK.png|X,Y,W,H",
            help="what moves for itself: white in a mask, or a rectangle in px",
        ),
    ] = None,
    object_dx: Annotated[
        float, Option(metavar="PX_S", help="its motion to the right, px/s; --dx is the rest's")
    ] = 0.0,
    object_dy: Annotated[float, Option(metavar="PX_S", help="its motion down, px/s")] = 0.0,
    object_kmh: Annotated[
        float | None, Option(metavar="KMH", help="... or as fast as it crosses the view to the right")
    ] = None,
    object_m: Annotated[
        float | None, Option(metavar="M", help="how far it is, with --hfov-deg and --lens")
    ] = None,
    object_width_m: Annotated[
        float | None, Option(metavar="M", help="or how wide, whatever the lens")
    ] = None,
    plate: Annotated[
        Path | None,
        Option(metavar="PLATE.png", help="the scene without it (default: invented from around it)"),
    ] = None,
    grey_anchor: GreyAnchor = None,
    camera: CameraName = None,
    cfa: Cfa = None,
    f_number: FNumber = None,
    as_json: Json = False,
) -> None:
    """One picture as a camera would take it.

      blurnoise simulate photo.jpg -o seen.png --exposure-ms 30 --lux 50 --dx 1000
      blurnoise simulate photo.jpg -o seen.png --exposure-ms 10 --lux 50 --dx 900 --explain
      blurnoise simulate photo.jpg -o seen.png --trajectory shake:12 --line-time-us 20
      blurnoise simulate road.jpg -o seen.png --ego 80,10 --hfov-deg 60 --lens rectilinear --explain
      blurnoise simulate photo.jpg -o seen.png --exposure-ms auto --lux 5 --mains 50
      blurnoise simulate photo.jpg -o seen.png --exposure-ms 20 --object 300,120,64,64 --object-dx 1500
      blurnoise simulate photo.jpg -o seen.png --object car.png --object-kmh 50 --object-width-m 4.5
      blurnoise simulate street.png -o seen.png --hdr 16 --emitters lamps.png:40 --pwm 90,0.1 --pwm-mask lamps.png

    --lux is the light on the scene: what is white in the picture sends all of it back, the rest its share. A
    photograph's brightness is no reflectance; --grey-anchor mean takes its mean for 18 %, however it was exposed.
    """
    from dataclasses import asdict

    import torch

    from blurnoise import AutoExposure, ExposedScene, plan
    from blurnoise._core.checks import in_range, integer, limited
    from blurnoise._core.rng import LAST_SEED
    from blurnoise.blur.layers import object_motion
    from blurnoise.light.conditions import middle_of
    from blurnoise.optics.radiometry import dark_electrons, filter_electrons, photoelectrons
    from blurnoise.picture.develop import develop_8bit, in_channels
    from blurnoise.scene.hdr import captured, developed, fuse
    from blurnoise.scene.metering import mean_luma
    from blurnoise.sensor.mosaic import outside_share
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.grid.reflectance import reflectance_text, share_above_white
    from blurnoise_eval.sweep.default_camera import is_grey_light

    integer("seed", seed, 0, LAST_SEED)
    for name, px_s in (("dx", dx), ("dy", dy), ("object_dx", object_dx), ("object_dy", object_dy)):
        limited(name, px_s, "velocity_px_s")
    lit_by = given.illuminant(illuminant)
    auto = AutoExposure(frame_rate_hz=frame_rate, mains_hz=float(mains))
    scene = given.light(image, encoding, grey_anchor, emitters)
    colour = not is_grey_light(scene)
    taker = given.rolling(line_time_us, given.camera(camera, f_number, cfa, colour=colour))
    moving = _object(cut, plate, scene, (object_dx, object_dy), encoding, grey_anchor or emitters)
    crossing = {"away_m": object_m, "width_m": object_width_m}
    if object_kmh is not None:
        limited("velocity_m_s", object_kmh / 3.6)
        seen_through = {} if ego else {"hfov_deg": hfov_deg, "lens": lens}
        moving = _crossing(moving, (object_dx, object_dy), object_kmh, taker, **crossing, **seen_through)
        hfov_deg, lens = (hfov_deg, lens) if ego else (None, None)
    elif any(value is not None for value in crossing.values()):
        raise ValueError("object-m, object-width-m: go with --object-kmh")
    layers = moving.layers if moving else ()
    exposure_s = exposure_ms / 1e3
    if exposure_ms == AUTOMATIC and gain_db not in (0.0, AUTOMATIC):
        raise ValueError(
            f"gain = {gain_db:g}: goes with a stated exposure; with an automatic one it is set, too"
        )
    if AUTOMATIC in (exposure_ms, gain_db):
        metered: dict[str, Any] = {
            "mean_light": float(mean_luma(scene, taker, lit_by)[0]),
            "illuminance_lux": lux,
        }
        metered |= {"temperature_c": temperature_c, "illuminant": lit_by}
        given_s = None if exposure_ms == AUTOMATIC else exposure_s
        exposure_s, gain_db, _ = auto.setting(taker, exposure_s=given_s, **metered)
    taker, digital_db = taker.at_gain(gain_db)
    captures, lamp = given.captures(hdr, taker), given.flicker(pwm, pwm_mask, scene, seed)
    moves = given.trajectory(trajectory, taker, scene, exposure_s, seed)
    seen_by = {"height_m": height_m, "pitch_deg": pitch_deg, "heading_deg": heading_deg, "plane_m": plane_m}
    flow = _flow(ego, taker, scene, (dx, dy), **seen_by, hfov_deg=hfov_deg, lens=lens)
    motion_px = torch.tensor([dx, dy], dtype=torch.float64) * exposure_s
    varies_px = 0.0
    if flow is not None:
        middle, farthest = middle_of(flow[None] * exposure_s)
        motion_px, varies_px = middle[0], float(farthest)
    exposed = ExposedScene(
        moving.background if moving else scene,
        illuminant=lit_by,
        fidelity=fidelity,
        tolerance_dn=tolerance_dn,
        layers=layers,
    )
    frames = captured(
        exposed,
        taker,
        captures,
        exposure_s=exposure_s,
        illuminance_lux=lux,
        velocity_px_s=(dx, dy) if flow is None else flow,
        trajectory=moves,
        temperature_c=temperature_c,
        generator=[seed],
        flicker=lamp,
    )
    dn = frames[0]
    first = taker.at_gain(captures[0].gain_db).camera
    white_e = photoelectrons(taker, lux, exposure_s, lit_by)
    if bit_depth == "native":
        outputs = [each.to(torch.int32).numpy().astype("uint16") for each in frames]
    else:
        if len(captures) == 1:
            seen = develop_8bit(dn, taker, digital_db, lit_by)
        else:
            shown_e = max(
                1e-9, white_e * in_range("hdr_white", hdr_white, 1e-6, 1e6) / 10 ** (digital_db / 20)
            )
            picture = developed(fuse(frames, taker, captures), taker, white_e=shown_e, illuminant=lit_by)
            seen = picture.mul(255.0).round().to(torch.uint8)
        outputs = [in_channels(seen, max(seen.shape[1], scene.shape[1])).numpy()]
    for place, out in enumerate(outputs, 1):
        path = output if place == 1 else output.with_name(f"{output.stem}_{place}{output.suffix}")
        write_picture(path, out[0, 0] if len(out[0]) == 1 else out[0].transpose(1, 2, 0))
    size = (scene.shape[-2], scene.shape[-1])
    needs = plan(
        taker,
        exposure_s=exposure_s,
        illuminance_lux=lux,
        displacement_px=(float(motion_px[0]), float(motion_px[1])),
        variation_px=varies_px,
        trajectory=moves,
        temperature_c=temperature_c,
        illuminant=lit_by,
        tolerance_dn=tolerance_dn,
        objects=tuple(object_motion(layer, exposure_s, size) for layer in layers),
        size=size,
    )
    speed_px_s = (dx**2 + dy**2) ** 0.5 if flow is None else float(flow.square().sum(0).sqrt().median())
    facts: dict[str, Any] = {
        "output": str(output),
        "camera": taker.name,
        "exposure_ms": 1e3 * exposure_s,
        "gain_db": gain_db,
        "white_electrons": white_e,
        "saturation_electrons": first.saturation_e,
        "blur_px": speed_px_s * exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": taker.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(first.saturated_dn)).float().mean()),
    }
    if flow is not None:
        facts["longest_blur_px"] = float(flow.square().sum(0).max().sqrt()) * exposure_s
    if moves is not None:
        left, top, right, bottom = moves.seen(exposure_s, (dx, dy)).box
        facts |= {"path_width_px": right - left, "path_height_px": bottom - top}
    if taker.row_time_s:
        facts["readout_ms"] = 1e3 * taker.row_time_s * size[0] / taker.field.per_sensor_px(size)
    if taker.cfa != "none":
        facts["cfa"] = taker.cfa
        per_lux_s = filter_electrons(taker, lit_by)
        facts |= {f"white_electrons_{each}": e * lux * exposure_s for each, e in per_lux_s.items() if each}
        if taker.ccm is not None:
            facts["outside_gamut_percent"] = 100 * outside_share(scene, taker)
    if grey_anchor is not None or emitters is not None or encoding == "linear":
        facts["above_white_percent"] = 100 * share_above_white(scene)
    dark_e = dark_electrons(taker, exposure_s, temperature_c)
    facts |= (
        _of_captures(taker, captures, frames[-1], exposure_s, speed_px_s, dark_e) if len(captures) > 1 else {}
    )
    facts |= _of_object(moving, (dx, dy), flow, exposure_s) if moving else {}
    facts |= _of_lamp(lamp, captures, exposure_s) if lamp else {}
    facts["reflectance"] = reflectance_text(grey_anchor)
    if explain and as_json:
        facts["stages"] = [asdict(stage) for stage in needs.stages]
    print_facts(facts, as_json)
    print_camera(taker, colour=colour)
    if explain and not as_json:
        print_stages(needs, fidelity)


def _flow(
    ego: str | None,
    taker: Camera,
    scene: Tensor,
    velocity_px_s: tuple[float, float],
    **seen_by: Any,
) -> Tensor | None:
    """What --ego says, px/s. Raises ``ValueError`` for options that go with it, or do not."""
    stated = {name: value for name, value in seen_by.items() if value is not None}
    if ego is None:
        for name in stated:
            raise ValueError(f"{name.replace('_', '-')}: goes with --ego")
        return None
    if any(velocity_px_s):
        raise ValueError("ego: goes without --dx and --dy, which move all of a picture alike")
    drive = vehicle.Drive.parse(ego)
    size = (scene.shape[-2], scene.shape[-1])
    camera_on = vehicle.stated(**stated, yaw_deg_s=drive.yaw_deg_s, pitch_deg_s=drive.pitch_deg_s)
    return None if camera_on is None else camera_on.flow_px_s(taker, size, drive.speed_m_s)


def _of_captures(
    taker: Camera,
    captures: tuple[Capture, ...],
    last: Tensor,
    exposure_s: float,
    speed_px_s: float,
    dark_e: float,
) -> dict[str, Any]:
    """What fusing gains and costs: range, SNR where the second capture takes over, the last one's displacement."""
    from blurnoise.optics.camera import windows
    from blurnoise.scene import hdr

    ends_e = hdr.saturations_e(taker, captures)
    last_s = windows(captures, exposure_s)[-1]
    end = last.new_tensor(taker.at_gain(captures[-1].gain_db).camera.saturated_dn)
    return {
        "captures": len(captures),
        "fused_saturation_electrons": ends_e[-1],
        "fused_clipped_percent": 100 * float((last >= end).float().mean()),
        "dynamic_range_db": hdr.dynamic_range_db(taker, captures),
        "snr_db_before_switch": hdr.snr_db(taker, captures[:1], ends_e[0], dark_e=dark_e),
        "snr_db_after_switch": hdr.snr_db(taker, captures, ends_e[0], dark_e=dark_e),
        "ghost_px": speed_px_s * (last_s[0] + last_s[1] / 2 - exposure_s / 2),
    }


def _object(
    where: str | None,
    plate: Path | None,
    scene: Tensor,
    velocity_px_s: tuple[float, float],
    encoding: Literal["srgb", "linear"],
    rescaled: str | None,
) -> Cut | None:
    """What --object says. Raises ``ValueError`` for options that go with it and stand alone."""
    if where is None:
        if any(velocity_px_s) or plate is not None:
            raise ValueError("object-dx, object-dy, plate: go with --object, which says what moves")
        return None
    if plate is not None and rescaled is not None:
        raise ValueError(
            "plate: goes with neither --grey-anchor nor --emitters, which change its picture's light alone"
        )
    return given.cut_out(where, plate, scene, velocity_px_s, encoding)


def _crossing(
    moving: Cut | None, velocity_px_s: tuple[float, float], speed_kmh: float, taker: Camera, **seen_by: Any
) -> Cut:
    """The object at what --object-kmh says. Raises ``ValueError`` for options that do not go with it."""
    from dataclasses import replace

    from blurnoise_eval.grid.objects import Crossing

    if moving is None or any(velocity_px_s):
        raise ValueError("object-kmh: goes with --object, without --object-dx and --object-dy")
    (layer,), size = moving.layers, (moving.background.shape[-2], moving.background.shape[-1])
    velocity = vehicle.crossing_px_s(layer, Crossing(speed_kmh, **seen_by), taker, size)
    return moving._replace(layers=(replace(layer, velocity_px_s=velocity),))


def _of_object(
    moving: Cut, velocity_px_s: tuple[float, float], flow_px_s: Tensor | None, exposure_s: float
) -> dict[str, Any]:
    """How far it moves, and how much of what is seen in its place was invented."""
    from math import hypot

    from blurnoise.blur.layers import seen_behind

    (layer,) = moving.layers
    x, y = (float(own) for own in layer.velocity_px_s)
    if flow_px_s is not None:  # as it is on average behind the object
        left, top = layer.place_px
        behind = flow_px_s[:, max(0, top) :, max(0, left) :][..., : len(layer.alpha), : layer.alpha.shape[1]]
        velocity_px_s = (float(behind[0].mean()), float(behind[1].mean()))
    apart = [(own - rest) * exposure_s for own, rest in zip((x, y), velocity_px_s, strict=True)]
    size = (moving.background.shape[-2], moving.background.shape[-1])
    invented = seen_behind(layer, [(layer, apart)], size) if moving.invented.any() else 0.0
    return {"object_blur_px": hypot(x, y) * exposure_s, "invented_percent": 100 * invented}


def _of_lamp(lamp: Flicker, captures: tuple[Capture, ...], exposure_s: float) -> dict[str, Any]:
    """Of each capture: the light it got of the lamp's mean, the least and most it may get, how often none."""
    from blurnoise.optics.camera import windows

    facts: dict[str, Any] = {"pwm_phase": lamp.pwm.phase}
    for place, (start_s, taken_s) in enumerate(windows(captures, exposure_s), 1):
        least, most = lamp.pwm.extremes(taken_s)
        suffix = "" if place == 1 else f"_{place}"
        facts |= {
            f"pwm_light{suffix}": float(lamp.pwm.factor(taken_s, start_s)),
            f"pwm_light_least{suffix}": least,
            f"pwm_light_most{suffix}": most,
            f"pwm_dark_percent{suffix}": 100 * lamp.pwm.dark_probability(taken_s),
        }
    return facts
