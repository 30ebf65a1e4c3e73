"""``blurnoise cameras``: the presets, or one camera's figures and where they come from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import new_file
from blurnoise_eval.system.terminal import say, show


def cameras(
    camera: Annotated[
        str | None, Argument(metavar="NAME|FILE", help="one camera (default: all presets)")
    ] = None,
    *,
    save: Annotated[
        Path | None, Option(parser=new_file, metavar="OUT.yaml", help="write it, to edit; or OUT.json")
    ] = None,
) -> None:
    """List the camera presets, or show every figure of one camera and its source.

      blurnoise cameras                              the presets, a line each
      blurnoise cameras imx250 --save mine.yaml      a starting point for your own
      blurnoise cameras fit frames/ -o mine.yaml     your own, from dark and flat frames
      blurnoise sweep --camera mine.yaml -o run      the answer for it

    A file may hold 'base: imx250' and only the fields that differ.
    """
    from blurnoise.optics.camera import PRESETS
    from blurnoise_eval import cameras as tables

    if camera is None:
        if save:
            raise ValueError("save: needs a camera, as in 'blurnoise cameras imx250 --save mine.yaml'")
        show(tables.overview(list(PRESETS.values())))
        return
    found = tables.find(camera)
    if save:
        found.save(save)
    show(tables.figures(found))
    say(*filter(None, [save]))
