"""``blurnoise cameras``: the presets, or the values of one camera and their sources."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import new_file
from blurnoise_eval.system.terminal import say, show


def cameras(
    camera: Annotated[
        str | None,
        Argument(metavar="NAME|FILE", help="a preset or a camera file (default: list all presets)"),
    ] = None,
    *,
    save: Annotated[
        Path | None,
        Option(parser=new_file, metavar="OUT.yaml", help="write the camera to a file (YAML or JSON)"),
    ] = None,
) -> None:
    """List the camera presets, or show the values of one camera with their sources.

      blurnoise cameras                            all presets
      blurnoise cameras imx250 --save mine.yaml    a file to edit
      blurnoise cameras fit frames/ -o mine.yaml   from dark and flat frames
      blurnoise sweep --camera mine.yaml -o run    a sweep with your camera

    A camera file may consist of 'base: imx250' and the fields that differ.
    """
    from blurnoise.camera import PRESETS
    from blurnoise_eval import cameras as tables

    if camera is None:
        if save:
            raise ValueError(
                "save: needs the name of a camera, as in 'blurnoise cameras imx250 --save mine.yaml'"
            )
        show(tables.overview(list(PRESETS.values())))
        return
    found = tables.find(camera)
    if save:
        found.save(save)
    show(tables.figures(found))
    say(*filter(None, [save]))
