"""``blurnoise report``: a run's figures, tables and page again; and the end of every sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from blurnoise_eval.cli._options import SCORES, Json, RunRead, new_place, one_of
from blurnoise_eval.cli.console import print_opening
from blurnoise_eval.system.storage import Location
from blurnoise_eval.system.terminal import say, say_json, say_wrapped

if TYPE_CHECKING:
    from blurnoise_eval.sweep.evaluation import Evaluation

_MOST_LABELS = 8
_enough = partial(Option, rich_help_panel="What is enough")
Keep = Annotated[
    float | None,
    _enough(
        metavar="SHARE",
        help="of what the same model reaches on the untouched pictures (default on pictures of your own: 0.9)",
    ),
]
Threshold = Annotated[
    float | None, _enough(metavar="C", help="of the score itself (default on rendered pictures: 0.6)")
]
Score = Annotated[
    str | None,
    _enough(
        metavar="NAME",
        help="target_confidence; detection_rate; recall@0.1, at the confidence that gives 0.1 false alarms per "
        "untouched picture; ap50; ap; of text exact_match (default: target_confidence, of texts of your own "
        "exact_match)",
        autocompletion=one_of(SCORES),
    ),
]
Cluster = Annotated[
    str | None,
    Option(
        metavar="REGEX",
        help="pictures in whose names this finds the same count as one in every interval, such as the frames of "
        "one drive: its first group, or else all that it matches (default: each picture for itself)",
    ),
]


Parquet = Annotated[
    bool,
    Option(
        "--parquet",
        help="results.csv and targets.csv as Parquet, too: folders by model and shard of pictures (needs pyarrow)",
    ),
]


def report(
    run: RunRead,
    *,
    keep: Keep = None,
    threshold: Threshold = None,
    score: Score = None,
    cluster: Cluster = None,
    output: Annotated[
        Location | None,
        Option("-o", "--output", parser=new_place, metavar="DIR", help="where to write them (default: RUN)"),
    ] = None,
    parquet: Parquet = False,
    as_json: Json = False,
) -> None:
    """Write a run's figures, tables and page again.

      blurnoise report run --keep 0.8              the share of the untouched pictures' confidence that is enough
      blurnoise report run --score ap50 --threshold 0.3
      blurnoise report /media/disc/run -o here     a run that can only be read

    The sweep itself is not repeated.
    """
    from blurnoise_eval.deciding.decision import Decision
    from blurnoise_eval.store.exports import check_parquet
    from blurnoise_eval.system.working_folder import output_folder, read_run

    if parquet:
        check_parquet()
    enough: dict[str, Any] = {"threshold": threshold, "keep": keep, "score": score}
    if output is None and isinstance(run, Path) and run.is_dir():
        new_place(run)
    with read_run(run) as folder, nullcontext() if output is None else output_folder(output) as written:
        done = Decision(folder, **enough, cluster=cluster, output=written, progress=True)
        tell(done, as_json=as_json, first=done.how(), parquet=parquet)


def tell(
    done: Evaluation,
    *,
    as_json: bool,
    first: Sequence[str] = (),
    last: str | None = None,
    parquet: bool = False,
) -> None:
    """Write a run's tables, figures and page, with ``parquet`` its rows as that, too; the answer in the terminal,
    with the lines ``first`` after it and ``last`` before the page's path."""
    from blurnoise_eval.report.findings import alarms
    from blurnoise_eval.report.words import counted

    if parquet:
        done.parquet()
    done.report()
    for entry in done.skipped:
        say(f"skipped: {entry['reason']}", error=True)
    if as_json:
        say_json(done.summary)
        return
    for alarm in alarms(done.data):
        say_wrapped(f"Warning: {alarm}")
    for name, labels in done.summary["targets_found"].items():
        say_wrapped(f"{name}: {_found_text(labels)}", hanging=2)
    print_opening(done.data)
    for line in first:
        say_wrapped(line)
    for each in done.summary["withheld"]:
        say_wrapped(
            f"No answer for {each['model']}, {each['group']}: almost nothing of it is found in the originals"
        )
    took = f" in {done.outcome.wall_s:.0f} s" if done.outcome is not None else ""
    skipped = f", {counted(len(done.skipped), 'picture')} skipped" if done.skipped else ""
    if last:
        say_wrapped(last, hanging=2)
    say(f"{done.summary['cells']} cells{took}{skipped}. Details: {done.summary['report']}")


def _found_text(labels: Mapping[str, int]) -> str:
    """What is taken for targets where nothing is labelled: "63 targets: sports ball 61, person 2"."""
    named = [f"{label} {count}" for label, count in islice(labels.items(), _MOST_LABELS)]
    more = len(labels) - len(named)
    named += [f"{more} more classes"] if more else []
    return f"{sum(labels.values())} targets, as found in the original pictures: {', '.join(named)}"
