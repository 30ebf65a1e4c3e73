"""``blurnoise simulate``: one picture as a camera would take it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import CameraName, FNumber, GreyAnchor, Json, or_auto
from blurnoise_eval.cli.console import print_facts, print_stages
from blurnoise_eval.grid.axes import AUTOMATIC


def simulate(
    image: Annotated[Path, Argument(metavar="IMAGE", help="8- or 16-bit, grey or colour, sRGB-coded")],
    *,
    output: Annotated[Path, Option("-o", "--output", metavar="OUT.png", help="the picture")],
    exposure_ms: Annotated[
        float,
        Option(
            parser=or_auto,
            metavar="MS|auto",
            help="exposure time, ms; auto: as the camera sets it, then its gain",
        ),
    ] = 10.0,
    lux: Annotated[float, Option(metavar="LUX", help="light on the scene, lux")] = 100.0,
    dx: Annotated[float, Option(metavar="PX_S", help="motion to the right, px/s")] = 0.0,
    dy: Annotated[float, Option(metavar="PX_S", help="motion down, px/s")] = 0.0,
    temperature_c: Annotated[float, Option(metavar="C", help="of the sensor, degC")] = 25.0,
    gain_db: Annotated[
        float,
        Option(
            "--gain",
            parser=or_auto,
            metavar="DB|auto",
            help="analogue as far as the camera goes, then digital, which native numbers are before; auto: to 18 %",
        ),
    ] = 0.0,
    frame_rate: Annotated[float, Option(metavar="HZ", help="bounds an automatic exposure")] = 30.0,
    mains: Annotated[
        Literal["0", "50", "60"], Option(help="Hz; automatic exposures of whole periods of its light, 0: any")
    ] = "0",
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
    grey_anchor: GreyAnchor = None,
    camera: CameraName = "imx250",
    f_number: FNumber = None,
    as_json: Json = False,
) -> None:
    """One picture as a camera would take it.

      blurnoise simulate photo.jpg -o seen.png --exposure-ms 30 --lux 50 --dx 1000
      blurnoise simulate photo.jpg -o seen.png --exposure-ms 10 --lux 50 --dx 900 --explain
      blurnoise simulate photo.jpg -o seen.png --exposure-ms auto --lux 5 --mains 50

    --lux is the light on the scene: what is white in the picture sends all of it back, the rest its share. A
    photograph's brightness is no reflectance; --grey-anchor mean takes its mean for 18 %, however it was exposed.
    """
    taker = given.camera(camera, f_number)
    from dataclasses import asdict

    import torch

    from blurnoise import AutoExposure, plan
    from blurnoise._core.checks import integer
    from blurnoise._core.rng import LAST_SEED
    from blurnoise.auto_exposure import mean_luma
    from blurnoise.exposure import anchored, scene_reflectance
    from blurnoise.grey_anchor import reflectance_text, share_above_white
    from blurnoise.picture.develop import develop_8bit, in_channels
    from blurnoise.radiometry import filter_electrons, photoelectrons
    from blurnoise.sensor.mosaic import outside_share
    from blurnoise.simulation import simulate
    from blurnoise_eval.datasets import decode, write_picture

    integer("seed", seed, 0, LAST_SEED)
    auto = AutoExposure(frame_rate_hz=frame_rate, mains_hz=float(mains))
    picture = decode(image)
    scene = torch.from_numpy(picture.astype("float32") / float(2 ** (8 * picture.itemsize) - 1))
    scene = scene[None, None] if scene.ndim == 2 else scene.permute(2, 0, 1)[None].contiguous()
    exposure_s = exposure_ms / 1e3
    if AUTOMATIC in (exposure_ms, gain_db):
        light = anchored(scene_reflectance(scene, "srgb"), grey_anchor)
        metered: dict[str, Any] = {"mean_light": float(mean_luma(light, taker)[0]), "illuminance_lux": lux}
        metered["temperature_c"] = temperature_c
        if exposure_ms == AUTOMATIC:
            exposure_s = auto.setting(taker, **metered).exposure_s
        if gain_db == AUTOMATIC or exposure_ms == AUTOMATIC:
            gain_db = auto.gain_db(taker, exposure_s=exposure_s, **metered)
    taker, digital_db = taker.at_gain(gain_db)
    dn = simulate(
        scene,
        taker,
        exposure_s=exposure_s,
        illuminance_lux=lux,
        velocity_px_s=(dx, dy),
        temperature_c=temperature_c,
        generator=[seed],
        fidelity=fidelity,
        tolerance_dn=tolerance_dn,
        grey_anchor=grey_anchor,
    )
    native = bit_depth == "native"
    if native:
        out = dn.to(torch.int32).numpy().astype("uint16")
    else:
        seen = develop_8bit(dn, taker, digital_db)
        out = in_channels(seen, max(seen.shape[1], scene.shape[1])).numpy()
    write_picture(output, out[0, 0] if len(out[0]) == 1 else out[0].transpose(1, 2, 0))
    needs = plan(
        taker,
        exposure_s=exposure_s,
        illuminance_lux=lux,
        displacement_px=(dx * exposure_s, dy * exposure_s),
        temperature_c=temperature_c,
        tolerance_dn=tolerance_dn,
    )
    facts: dict[str, Any] = {
        "output": str(output),
        "camera": taker.name,
        "exposure_ms": 1e3 * exposure_s,
        "gain_db": gain_db,
        "white_electrons": photoelectrons(taker, lux, exposure_s),
        "saturation_electrons": taker.saturation_e,
        "blur_px": (dx**2 + dy**2) ** 0.5 * exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": taker.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(taker.saturated_dn)).float().mean()),
    }
    if taker.cfa != "none":
        facts["cfa"] = taker.cfa
        per_lux_s = filter_electrons(taker)
        facts |= {f"white_electrons_{each}": e * lux * exposure_s for each, e in per_lux_s.items() if each}
        if taker.ccm is not None:
            light = anchored(scene_reflectance(scene, "srgb"), grey_anchor)
            facts["outside_gamut_percent"] = 100 * outside_share(light, taker)
    if grey_anchor is not None:
        light = anchored(scene_reflectance(scene, "srgb"), grey_anchor)
        facts["above_white_percent"] = 100 * share_above_white(light)
    facts["reflectance"] = reflectance_text(grey_anchor)
    if explain and as_json:
        facts["stages"] = [asdict(stage) for stage in needs.stages]
    print_facts(facts, as_json)
    if explain and not as_json:
        print_stages(needs, fidelity)
