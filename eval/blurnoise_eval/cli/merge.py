"""``blurnoise merge``: join the runs of parts into one run."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Annotated

from typer import Argument

from blurnoise_eval.cli._options import Folder, Location, place
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say


def merge(
    runs: Annotated[
        list[Location], Argument(parser=place, metavar="RUN...", help="folders or URLs of the runs to join")
    ],
    *,
    output: Folder,
) -> None:
    """Join the runs of the parts of a sweep into one run. The result is the same as from one machine.

      blurnoise sweep --coco FILE --part 1/2 -o part1    on one machine
      blurnoise sweep --coco FILE --part 2/2 -o part2    on another machine
      blurnoise merge part1 part2 -o run
      blurnoise report run

    The parts must belong to the same sweep. If they do not, the error names the difference. The same command again,
    or with more parts, goes on in the folder.
    """
    from blurnoise_eval.run.merging import merge as joined
    from blurnoise_eval.system.working_folder import read_run, written_run

    with ExitStack() as opened:
        folders = [opened.enter_context(read_run(run)).path for run in runs]
        whole = opened.enter_context(written_run(output))
        command = " ".join(["blurnoise merge", *map(str, runs), "-o", str(output)])
        advance = opened.enter_context(ProgressBar("merge", len(set(folders))))
        done = joined(folders, whole.path, command, advance)
    say(f"{done.cells} cells of {done.pictures} pictures", f"next: blurnoise report {output}")
    say("for refinement, run the sweep's command again without --part and with this folder as -o")
