"""``python -m blurnoise_eval.scenes``: render road-sign scenes with labels in COCO format."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Option

from blurnoise_eval.cli import run_alone
from blurnoise_eval.cli._options import new_folder
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say


def scenes(
    *,
    output: Annotated[
        Path,
        Option(
            "-o",
            "--output",
            parser=new_folder,
            metavar="DIR",
            help="folder for the pictures and instances.json",
        ),
    ],
    count: Annotated[int, Option(metavar="N", help="number of scenes")] = 100,
    size: Annotated[int, Option(metavar="PX", help="width and height of a scene, px")] = 320,
    seed: Annotated[int, Option(metavar="N", help="seed of the scenes")] = 2,
) -> None:
    """Render road-sign scenes with labels in COCO format.

      python -m blurnoise_eval.scenes -o scenes --count 100
      blurnoise sweep --coco scenes/instances.json -o run

    The same seed gives the same scenes. The training uses seed 1, so scenes of the default seed are unseen.
    """
    from blurnoise_models.scenes import write_coco

    with ProgressBar("draw scenes", count) as advance:
        say(write_coco(output, seed, count, size_px=size, progress=advance))


if __name__ == "__main__":
    sys.exit(run_alone(scenes, "python -m blurnoise_eval.scenes", sys.argv[1:]))
