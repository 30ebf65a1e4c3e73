"""``blurnoise report``: write the figures, tables and page of a run again; every sweep ends with this, too."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from blurnoise_eval.cli._options import Json, Location, RunRead, Trust, new_place, settings
from blurnoise_eval.cli.console import print_opening
from blurnoise_eval.plan.question import Question
from blurnoise_eval.system.terminal import say, say_json, say_wrapped

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from blurnoise_eval.run.run import Run
    from blurnoise_eval.system.working_folder import WorkingFolder

_MOST_LABELS = 8


@settings(Question, *Question.settings(), file="")
def report(
    run: RunRead,
    *,
    config: Question,
    output: Annotated[
        Location | None,
        Option(
            "-o",
            "--output",
            parser=new_place,
            metavar="DIR",
            help="folder or URL for the report (default: RUN)",
        ),
    ] = None,
    coco: Annotated[
        bool,
        Option(
            "--coco",
            help="also write the detections as COCO results, coco/MODEL.json with the cell_id of results.csv, and "
            "the targets as coco/MODEL-instances.json",
        ),
    ] = False,
    images: Annotated[
        Path | None,
        Option(
            metavar="DIR", help="folder of the original pictures, if it is not where the sweep found them"
        ),
    ] = None,
    trust: Trust = False,
    as_json: Json = False,
) -> None:
    """Write the figures, tables and page of a run again. No model is evaluated again.

      blurnoise report run --keep 0.8
      blurnoise report run --score ap50 --threshold 0.3
      blurnoise report run --coco           also the detections, as COCO
      blurnoise report run -o other         into another folder

    Settings that no option changes are those of the sweep.
    """
    from blurnoise_eval.run.run import Run
    from blurnoise_eval.system.working_folder import output_folder, read_run

    if output is None and isinstance(run, Path) and run.is_dir():
        try:
            new_place(run)
        except OSError as error:
            raise OSError(error.errno, f"{error.strerror}, as in -o DIR", error.filename) from None
    with read_run(run) as folder, nullcontext(folder) if output is None else output_folder(output) as written:
        done = Run.open(folder, config, trust=trust, images=images, progress=True)
        print_run(done, written, coco=coco, as_json=as_json)
        if coco:
            folder_text = written.with_url(written.path / "coco")
            say(f"{folder_text}: detections in MODEL.json, targets in MODEL-instances.json", error=True)


def print_run(
    done: Run,
    written: WorkingFolder | None = None,
    *,
    coco: bool = False,
    as_json: bool = False,
    about: Sequence[str | None] = (),
) -> None:
    """Print a run's answers; write its tables, figures and page, and print where the page is.

    written: the folder of these, by default the run's. coco: also write COCO's files. about: further lines.
    """
    from blurnoise_eval.report.words import counted

    if as_json:
        done.report(written, coco=coco)
        summary = done.summary(written)
        _say_skipped(summary)
        say_json(summary)
        return
    summary = done.summary(written)
    # The answers need no figure, and drawing these takes longer than finding those.
    done.report(written, coco=coco, before=lambda: _unless_gone(_print_answers, done, summary, about))
    took = f" in {done.outcome.wall_s:.0f} s" if done.outcome is not None else ""
    n_skipped = len(summary["skipped"])
    skipped = f", {counted(n_skipped, 'picture')} skipped" if n_skipped else ""
    say(f"{summary['cells']} cells{took}{skipped}. Details: {summary['report']}")


def _unless_gone(print_them: Callable[..., None], *about: Any) -> None:
    """Print, unless whoever read the output has gone, as 'head' does: the files are written all the same."""
    try:
        print_them(*about)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say_skipped(summary: Mapping[str, Any]) -> None:
    for entry in summary["skipped"]:
        say(f"skipped: {entry['reason']}", error=True)


def _print_answers(done: Run, summary: Mapping[str, Any], about: Sequence[str | None]) -> None:
    from blurnoise_eval.report.findings import alarms, reflectance
    from blurnoise_eval.report.words import counted

    _say_skipped(summary)
    for alarm in alarms(done.tables):
        say_wrapped(f"Warning: {alarm}")
    for name, labels in summary["targets_found"].items():
        classes = [f"{label} {count}" for label, count in labels.items()]
        more = [f"{len(classes) - _MOST_LABELS} more classes"] if len(classes) > _MOST_LABELS else []
        found = f"{counted(sum(labels.values()), 'target')}, detected in the original pictures"
        say_wrapped(f"{name}: {found}: {', '.join(classes[:_MOST_LABELS] + more)}", hanging=2)
    print_opening(done.tables, str(summary["run"]))
    for line in done.strategy_sentences():
        say_wrapped(line)
    for group in summary["withheld"]:
        say_wrapped(
            f"No answer for {group['model']}, {group['group']}: almost no target is found in the original pictures"
        )
    if about_light := reflectance(done.tables):
        say_wrapped(f"lux: {about_light}", hanging=2)
    for line in filter(None, about):
        say_wrapped(line, hanging=2)
