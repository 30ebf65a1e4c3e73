"""``blurnoise merge``: runs of parts joined to one run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say


def merge(
    runs: Annotated[list[Path], Argument(metavar="RUN...", help="folders of sweeps")],
    *,
    output: Annotated[Path, Option("-o", "--output", metavar="DIR", help="a new folder for the joined run")],
) -> None:
    """Join runs that differ in pictures, repeats or conditions alone, every cell once.

      blurnoise sweep --coco FILE --part 1/4 -o part1        on one machine; 2/4, 3/4 and 4/4 on others
      blurnoise merge part1 part2 part3 part4 -o run         their run, as if one machine had computed it
      blurnoise report run

    The same models, camera and seed are needed: what differs is named.
    """
    from blurnoise_eval.sweep.merging import merge as joined

    with ProgressBar("merge", len(set(runs))) as advance:
        done = joined(runs, output, advance)
    held = f", {done.repeated} more than once" if done.repeated else ""
    say(f"{done.cells} rows of cells of {done.pictures} pictures{held}", f"blurnoise report {output}")
