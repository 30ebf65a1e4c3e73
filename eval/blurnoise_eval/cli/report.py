"""``blurnoise report``: a run's figures, tables and page again; and the end of every sweep."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import Json
from blurnoise_eval.cli.console import print_models, print_opening
from blurnoise_eval.system.terminal import say, say_json

if TYPE_CHECKING:
    from blurnoise_eval.sweep.evaluation import Evaluation

Threshold = Annotated[float, Option(metavar="C", help="confidence that is enough")]
Cluster = Annotated[
    str | None,
    Option(
        metavar="REGEX",
        help="pictures in whose names this finds the same count as one in every interval, such as the frames of "
        "one drive: its first group, or else all that it matches (default: each picture for itself)",
    ),
]


def report(
    run: Annotated[Path, Argument(metavar="RUN", help="the folder of a sweep")],
    *,
    threshold: Threshold = 0.6,
    cluster: Cluster = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="DIR", help="where to write them (default: RUN)"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a run's figures, tables and page again.

      blurnoise report run --threshold 0.5
      blurnoise report /media/disc/run -o here     a run that can only be read

    The sweep itself is not repeated.
    """
    from blurnoise_eval.sweep.evaluation import Evaluation

    tell(Evaluation(run, threshold, cluster=cluster, output=output, progress=True), as_json=as_json)


def tell(done: Evaluation, *, as_json: bool) -> None:
    """Write a run's tables, figures and page; the answer in the terminal."""
    from blurnoise_eval.report.findings import missing_text

    page = done.report()
    for entry in done.skipped:
        say(f"skipped: {entry['reason']}", error=True)
    if as_json:
        say_json(done.summary)
        return
    print_opening(done.data)
    print_models(done.models)
    took = f" in {done.outcome.wall_s:.1f} s" if done.outcome is not None else ""
    say(f"{done.summary['cells']} cells{took}, pictures skipped: {len(done.skipped)}")
    if missing := missing_text(done.summary["missing_cells"]):
        say(missing)
    if meant := done.summary["reflectance"]:
        say(f"lux: {meant}")
    say(f"open {page}")
