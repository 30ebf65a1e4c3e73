"""``blurnoise simulate``: simulate how a camera takes a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import Json, PictureWritten, settings
from blurnoise_eval.cli.console import print_facts, print_stages
from blurnoise_eval.plan.files import NOT_TAKEN, SceneFile
from blurnoise_eval.system.terminal import say_wrapped


@settings(
    SceneFile, "*", "distance_m", "sheeting", "trajectory", "object", "camera",
    "infrared", "grey_anchor", "picture_tone", "taken", "hdr", "bit_depth", "seed",
    file="scene",
)  # fmt: skip
def simulate(
    image: Annotated[
        Path,
        Argument(
            metavar="IMAGE",
            help="8- or 16-bit picture, grey or colour; float values (.hdr, .exr, .tiff) are linear light",
        ),
    ],
    *,
    config: SceneFile,
    output: PictureWritten,
    explain: Annotated[
        bool, Option("--explain", help="print the contribution of each stage, and which stages are left out")
    ] = False,
    as_json: Json = False,
) -> None:
    """Simulate how a camera takes a picture.

      blurnoise simulate photo.jpg -o out.png --exposure-ms 30 --lux 50
      blurnoise simulate photo.jpg -o out.png --dx 900 --explain
      blurnoise simulate photo.jpg -o out.png --exposure-ms auto --lux 5
      blurnoise simulate photo.jpg -o out.png --trajectory shake:12
      blurnoise simulate road.jpg -o out.png --ego-kmh 80 --explain
      blurnoise simulate car.jpg -o out.png --object 300,120,64,64 \\
          --moves targets --dx 1500
      blurnoise simulate sign.jpg -o out.png --object 300,120,32,32 --lux 1 \\
          --headlamp low --distance-m 50 --sheeting III
      blurnoise simulate --save-scene scene.yaml     all settings, to edit

    --lux is the illuminance of the scene. Without it, a photograph with time, ISO and f-number in its EXIF, or in
    --taken, has the light by which it was taken; without --camera, it is taken again by a camera of that f-number
    and ISO. A white pixel of the picture reflects all of the light, other pixels their
    share. The brightness of a photograph depends on its exposure; with --grey-anchor mean the mean of the picture
    reflects 18 %. --picture-tone names the tone curve of the picture, which is removed first; srgb for a rendered
    one. 'blurnoise cameras fit --tone' measures the tone curve of a camera.
    """
    from dataclasses import asdict, replace

    from blurnoise import TakeOptions, plan, take
    from blurnoise.light.lights import light_text
    from blurnoise_eval import default_tone
    from blurnoise_eval.datasets import Coded, picture_doubts, write_picture
    from blurnoise_eval.datasets.taken import Taken
    from blurnoise_eval.default_camera import camera_text, is_grey_light
    from blurnoise_eval.plan.axes import GAIN, LIGHT, LIT, axis
    from blurnoise_eval.plan.conditions import reflectance_text
    from blurnoise_eval.simulation.figures import figures, headlit_figures
    from blurnoise_eval.simulation.scene_file import light_of, opened

    config.at()
    tone, assumed = config.picture_tone, config.picture_tone is None
    if tone is None:
        config = replace(config, picture_tone="typical")
    taken = None
    if config.taken is None:
        taken = Taken.of_file(image)
    elif config.taken != NOT_TAKEN:
        taken = Taken.parse(config.taken)
    incomplete = Taken.missing(image) if taken is None and config.taken is None else ""
    if taken is not None:
        lux = taken.lux(config.picture_tone or "srgb")
        config = replace(config, grid={**config.grid, LIGHT.name: (lux,)})
    light = light_of(image, config)
    colour, native = not is_grey_light(light), config.bit_depth == "native"
    _, by = default_tone.of_photographs(tone, inputs.camera(config.camera, config.cfa, colour=colour))
    if taken is not None and config.camera is None:  # in the place of the one that took it
        by, gain_db = taken.camera(by, lux)
        if GAIN.name not in config.grid:
            config = replace(config, grid={**config.grid, GAIN.name: (gain_db,)})
    scene, exposure, cut, headlit = opened(config, light, by)
    options = TakeOptions(
        wanted=("raw",) if native else ("raw", "8 bit"),
        fidelity=config.fidelity,
        tolerance_dn=config.tolerance_dn,
        white=config.hdr_white,
    )
    frames = take(scene, exposure, options)
    pictures: list[Coded] = [*frames.native_images()] if native else [*frames.images()]
    for number, picture in enumerate(pictures, 1):
        suffix = "" if number == 1 else f"_{number}"
        write_picture(output.with_name(f"{output.stem}{suffix}{output.suffix}"), picture)
    facts = {"output": str(output), **figures(scene, exposure, frames.raw[0], cut)}
    if taken is not None:
        facts["taken"] = f"{taken.text}: in {lux:.3g} lux, by ISO 12232"
    if config.light:
        illuminant, headlamp = (axis(name).choice(config.at()[name]) for name in LIT)
        facts["light"] = light_text(config.light[0].name, config.light[0].lux, illuminant, headlamp)
    if headlit is not None:
        facts |= headlit_figures(headlit, exposure)
    elif config.beams:
        facts["headlamps"] = "light nothing, as no distance is known (--object with --distance-m)"
    if config.grey_anchor is not None or config.emitters is not None or float(light.max()) > 1:
        facts["above_white_percent"] = 100 * float((light.amax(1) > 1).double().mean())
    facts["reflectance"] = reflectance_text(config.grey_anchor, "--grey-anchor")
    needed = plan(exposure, scene, tolerance_dn=config.tolerance_dn) if explain else None
    if needed and as_json:
        facts["stages"] = [asdict(stage) for stage in needed.stages]
    print_facts(facts, as_json)
    doubts = picture_doubts(image.parent, [image.name])
    if assumed:
        doubts = [default_tone.about(exposure.camera), *doubts]
    if incomplete:
        lux = config.at()[LIGHT.name]
        doubts = [
            f"{image.name}: {incomplete}, so the light is assumed: {lux:g} lux; set --taken or --lux",
            *doubts,
        ]
    camera = exposure.camera
    for about in filter(
        None, [camera_text(camera, colour=colour), inputs.about_lux(config.camera, camera), *doubts]
    ):
        say_wrapped(about, hanging=2, error=True)
    if needed and not as_json:
        print_stages(needed, config.fidelity)
