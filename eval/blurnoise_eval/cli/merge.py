"""``blurnoise merge``: runs of parts joined to one run."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Annotated

from typer import Argument

from blurnoise_eval.cli._options import Folder, Location, place
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say


def merge(
    runs: Annotated[
        list[Location], Argument(parser=place, metavar="RUN...", help="folders or URLs of parts")
    ],
    *,
    output: Folder,
) -> None:
    """Join the runs of a sweep's parts to the run of the whole, every cell once.

      blurnoise sweep --coco FILE --part 1/4 -o part1        on one machine; 2/4, 3/4 and 4/4 on others
      blurnoise merge part1 part2 part3 part4 -o run         their run, as if one machine had computed it
      blurnoise report run

    Parts of another sweep are refused, with what differs.
    """
    from blurnoise_eval.sweep.merging import merge as joined
    from blurnoise_eval.system.urls import listing
    from blurnoise_eval.system.working_folder import read_run, written_run

    if not isinstance(output, Path):
        with suppress(FileNotFoundError):
            if listing(output):
                raise ValueError(f"output = {str(output)!r}: is not empty; choose another folder")
    with ExitStack() as opened:
        folders = [opened.enter_context(read_run(run)).path for run in runs]
        whole = opened.enter_context(written_run(output))
        command = " ".join(["blurnoise merge", *map(str, runs), "-o", str(output)])
        advance = opened.enter_context(ProgressBar("merge", len(set(folders))))
        done = joined(folders, whole.path, command, advance)
    say(f"{done.cells} rows of cells of {done.pictures} pictures", f"blurnoise report {output}")
    say(
        "the sweep's command without --part, with -o this folder, refines ends of windows, where its plan does"
    )
