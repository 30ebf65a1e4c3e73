"""``blurnoise simulate``: simulate how a camera takes a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import Json, PictureWritten, settings
from blurnoise_eval.cli.console import print_facts, print_stages
from blurnoise_eval.plan.files import SceneFile
from blurnoise_eval.system.terminal import say_wrapped


@settings(
    SceneFile, "*", "trajectory", "object", "camera", "grey_anchor", "picture_tone", "hdr", "bit_depth", "seed",
    file="scene",
)  # fmt: skip
def simulate(
    image: Annotated[
        Path,
        Argument(
            metavar="IMAGE",
            help="8- or 16-bit picture, grey or colour; float values with --picture-tone linear",
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
      blurnoise simulate --save-scene scene.yaml     all settings, to edit

    --lux is the illuminance of the scene. A white pixel of the picture reflects all of the light, other pixels their
    share. The brightness of a photograph depends on its exposure; with --grey-anchor mean the mean of the picture
    reflects 18 %. --picture-tone names the tone curve of the photograph, which is removed first. 'blurnoise cameras
    fit --tone' measures the tone curve of a camera.
    """
    from dataclasses import asdict

    from blurnoise_eval.datasets import picture_doubts, write_picture
    from blurnoise_eval.default_camera import camera_text, is_grey_light
    from blurnoise_eval.simulation.light import light
    from blurnoise_eval.simulation.taking import take

    config.at()
    scene = light(image, config)
    colour = not is_grey_light(scene)
    taken = take(config, inputs.camera(config.camera, config.cfa, colour=colour), scene)
    for place, picture in enumerate(taken.pictures, 1):
        suffix = "" if place == 1 else f"_{place}"
        write_picture(output.with_name(f"{output.stem}{suffix}{output.suffix}"), picture)
    facts = {"output": str(output), **taken.figures}
    if explain and as_json:
        facts["stages"] = [asdict(stage) for stage in taken.plan.stages]
    print_facts(facts, as_json)
    doubts = picture_doubts(image.parent, [image.name])
    for about in filter(
        None,
        [camera_text(taken.camera, colour=colour), inputs.about_lux(config.camera, taken.camera), *doubts],
    ):
        say_wrapped(about, hanging=2, error=True)
    if explain and not as_json:
        print_stages(taken.plan, config.fidelity)
