"""The commands that look at pictures, cameras and detectors."""

from __future__ import annotations

import argparse
import json

from blurnoise_eval.cli import given
from blurnoise_eval.cli.console import print_facts, print_stages


def simulate(options: argparse.Namespace) -> int:
    """One picture as a camera would take it."""
    camera = given.camera(options)
    from dataclasses import asdict

    import torch

    from blurnoise._core.checks import non_negative
    from blurnoise.error_budget import plan
    from blurnoise.picture.develop import develop_8bit
    from blurnoise.radiometry import photoelectrons
    from blurnoise.simulation import simulate
    from blurnoise_eval.datasets import decode, write_picture

    non_negative("seed", options.seed)
    exposure_s = options.exposure_ms / 1e3
    picture = decode(options.image)
    scene = torch.from_numpy(picture.astype("float32") / float(2 ** (8 * picture.itemsize) - 1))
    scene = scene[None, None] if scene.ndim == 2 else scene.permute(2, 0, 1)[None].contiguous()
    dn = simulate(
        scene,
        camera,
        exposure_s=exposure_s,
        illuminance_lux=options.lux,
        velocity_px_s=(options.dx, options.dy),
        temperature_c=options.temperature_c,
        generator=[options.seed],
        fidelity=options.fidelity,
        tolerance_dn=options.tolerance_dn,
    )
    native = options.bit_depth == "native"
    out = dn.to(torch.int32).numpy().astype("uint16") if native else develop_8bit(dn, camera).numpy()
    write_picture(options.output, out[0, 0] if len(out[0]) == 1 else out[0].transpose(1, 2, 0))
    needs = plan(
        camera,
        exposure_s=exposure_s,
        illuminance_lux=options.lux,
        displacement_px=(options.dx * exposure_s, options.dy * exposure_s),
        temperature_c=options.temperature_c,
        tolerance_dn=options.tolerance_dn,
    )
    facts = {
        "output": str(options.output),
        "camera": camera.name,
        "white_electrons": photoelectrons(camera, options.lux, exposure_s),
        "saturation_electrons": camera.saturation_e,
        "blur_px": (options.dx**2 + options.dy**2) ** 0.5 * exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": camera.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(camera.clip_dn)).float().mean()),
    }
    if options.explain and options.json:
        facts["stages"] = [asdict(stage) for stage in needs.stages]
    print_facts(facts, options.json)
    if options.explain and not options.json:
        print_stages(needs, options.fidelity)
    return 0


def gallery(options: argparse.Namespace) -> int:
    """What ranges of conditions do to a picture."""
    from blurnoise._core.checks import in_range
    from blurnoise.augment import ExposureRanges
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.drawing import gallery
    from blurnoise_eval.drawing.photon_transfer import find, plot_suffix

    plot_suffix(options.output)
    in_range("size", options.size, 16, 1 << 14)
    low_ms, high_ms = options.exposure_ms
    ranges = ExposureRanges(
        [find(name) for name in options.camera.split(",")],
        exposure_s=(low_ms / 1e3, high_ms / 1e3),
        illuminance_lux=options.lux,
        speed_px_s=options.speed,
    )
    scene = gallery.scene(decode(options.image), options.size)
    tiles = gallery.tiles(scene, ranges, options.count, options.seed)
    gallery.write(gallery.draw(scene, tiles), options.output)
    if options.json:
        print(json.dumps({"output": str(options.output), "tiles": [tile.facts() for tile in tiles]}))
    else:
        print(options.output)
    return 0


def cameras(options: argparse.Namespace) -> int:
    """The presets, or one camera's figures."""
    from rich.console import Console

    from blurnoise.camera import PRESETS
    from blurnoise_eval.drawing import photon_transfer as cameras

    if options.camera is None:
        if options.save or options.plot:
            raise ValueError("save, plot: need a camera, as in 'blurnoise cameras imx250 --save mine.yaml'")
        found = list(PRESETS.values())
        if options.json:
            print(json.dumps([cameras.facts(camera) for camera in found]))
            return 0
        Console().print(cameras.overview(found))
        return 0
    camera = cameras.find(options.camera)
    if options.plot:
        cameras.plot_suffix(options.plot)  # before a file is made
    if options.save:
        camera.save(options.save)
    if options.plot:
        cameras.write(camera, options.plot)
    if options.json:
        print(json.dumps(cameras.facts(camera)))
        return 0
    Console().print(cameras.figures(camera))
    for path in (options.save, options.plot):
        if path:
            print(path)
    return 0


def motion(options: argparse.Namespace) -> int:
    """Road speed to px/s and blur length."""
    from blurnoise.motion import blur_pixels, velocity_px_s

    speed_m_s = options.speed_kmh / 3.6
    camera = {"width_px": options.width_px, "hfov_deg": options.hfov_deg, "lens": options.lens}
    target = {"target_width_m": options.target_width_m}
    velocity = velocity_px_s(speed_m_s, options.distance_m, **target, **camera)
    length = blur_pixels(speed_m_s, options.distance_m, options.exposure_ms / 1e3, **target, **camera)
    print_facts({"lens": options.lens, "velocity_px_s": velocity, "blur_px": length}, options.json)
    return 0


def chart(options: argparse.Namespace) -> int:
    """A rendered test target."""
    from blurnoise import charts
    from blurnoise.encoding import srgb_from_linear
    from blurnoise_eval.datasets import write_picture

    angle = options.angle if options.angle is not None else (5.0 if options.kind == "slanted-edge" else 0.0)
    size = {"height_px": options.height, "width_px": options.width}
    if options.kind == "slanted-edge":
        linear = charts.slanted_edge(options.height, options.width, angle_deg=angle)
    elif options.kind == "siemens-star":
        linear = charts.siemens_star(options.size, **size, angle_deg=angle)
    elif options.kind == "stop-sign":
        linear = charts.stop_sign(options.size, **size, angle_deg=angle)
    else:
        linear = charts.flat_patch(options.height, options.width)
    full_scale, dtype = (255, "uint8") if options.bit_depth == "8" else (65535, "uint16")
    coded = (
        srgb_from_linear(linear.double()).mul(full_scale).round()[0].permute(1, 2, 0).numpy().astype(dtype)
    )
    write_picture(options.output, coded[..., 0] if coded.shape[2] == 1 else coded)
    print(options.output)
    return 0
