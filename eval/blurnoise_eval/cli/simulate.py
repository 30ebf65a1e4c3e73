"""``blurnoise simulate``: one picture as a camera would take it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli import given as given_by
from blurnoise_eval.cli._options import Json, PictureWritten, settings
from blurnoise_eval.cli.console import print_facts, print_stages
from blurnoise_eval.grid.plan_file import SceneFile
from blurnoise_eval.system.terminal import say_wrapped


@settings(
    SceneFile, "*", "trajectory", "object", "camera", "grey_anchor", "picture_tone", "hdr", "bit_depth", "seed",
    file="scene",
)  # fmt: skip
def simulate(
    image: Annotated[
        Path,
        Argument(metavar="IMAGE", help="8- or 16-bit, grey or colour; or floats, with --picture-tone linear"),
    ],
    *,
    given: SceneFile,
    output: PictureWritten,
    explain: Annotated[
        bool, Option("--explain", help="print what each stage contributes, and what is done about it")
    ] = False,
    as_json: Json = False,
) -> None:
    """One picture as a camera would take it.

      blurnoise simulate photo.jpg -o seen.png --exposure-ms 30 --lux 50
      blurnoise simulate photo.jpg -o seen.png --dx 900 --explain
      blurnoise simulate photo.jpg -o seen.png --exposure-ms auto --lux 5
      blurnoise simulate photo.jpg -o seen.png --trajectory shake:12
      blurnoise simulate road.jpg -o seen.png --ego-kmh 80 --explain
      blurnoise simulate car.jpg -o seen.png --object 300,120,64,64 --moves targets --dx 1500
      blurnoise simulate --save-scene scene.yaml       lamps, a plate, a vehicle, and all the rest

    --lux is the light on the scene: what is white in the picture sends all of it back, the rest its share. A
    photograph's brightness is no reflectance; --grey-anchor mean takes its mean for 18 %, however it was exposed,
    and --picture-tone takes its own tone curve out, by default sRGB's: that of a file of 'cameras fit --tone'.
    """
    from dataclasses import asdict

    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.default_camera import camera_text, is_grey_light
    from blurnoise_eval.simulation.light import light
    from blurnoise_eval.simulation.taking import take

    given.at()
    if output.exists() and output.samefile(image):
        raise ValueError(f"output = {str(output)!r}: is the picture itself; must be another file")
    scene = light(image, given)
    colour = not is_grey_light(scene)
    taken = take(given, given_by.camera(given.camera, given.cfa, colour=colour), scene)
    for place, picture in enumerate(taken.pictures, 1):
        suffix = "" if place == 1 else f"_{place}"
        write_picture(output.with_name(f"{output.stem}{suffix}{output.suffix}"), picture)
    facts = {"output": str(output), **taken.figures}
    if explain and as_json:
        facts["stages"] = [asdict(stage) for stage in taken.plan.stages]
    print_facts(facts, as_json)
    for about in filter(
        None, [camera_text(taken.camera, colour=colour), given_by.about_lux(given, taken.camera)]
    ):
        say_wrapped(about, hanging=2, error=True)
    if explain and not as_json:
        print_stages(taken.plan, given.fidelity)
