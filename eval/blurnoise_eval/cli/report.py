"""``blurnoise report``: a run's figures, tables and page again; and the end of every sweep."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import Json
from blurnoise_eval.cli.console import ProgressBar, print_answers, print_models

if TYPE_CHECKING:
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.run import Outcome

Threshold = Annotated[float, Option(metavar="C", help="confidence that is enough")]


def report(
    run: Annotated[Path, Argument(metavar="RUN", help="the folder of a sweep")],
    *,
    threshold: Threshold = 0.6,
    as_json: Json = False,
) -> None:
    """Write a run's figures, tables and page again.

      blurnoise report run --threshold 0.5

    The sweep itself is not repeated.
    """
    from blurnoise._core.checks import in_range
    from blurnoise_eval.store.store import Store

    in_range("threshold", threshold, 0.0, 1.0)
    with Store(run) as store:
        finish(store, threshold, None, as_json=as_json)


def finish(store: Store, threshold: float, outcome: Outcome | None, *, as_json: bool) -> None:
    """Tables, figures and page of a run; the answer in the terminal. outcome: of the sweep that just ended."""
    from blurnoise_eval import report
    from blurnoise_eval.scoring.per_condition import CONDITIONS
    from blurnoise_eval.sweep import run_folder as results
    from blurnoise_eval.system.files import write_whole

    store.export()
    with ProgressBar("score", store.count_different(*CONDITIONS, "model")) as advance:
        data = results.read_run(store, threshold=threshold, progress=advance)
    results.write_tables(data, store.folder)
    cells = data.manifest["n_cells"]
    summary: dict[str, Any] = {
        "run": str(store.folder),
        "report": str(store.folder / "report.html"),
        "cells": cells,
        "skipped": data.skipped,
        "threshold": threshold,
        "models": data.models,
        "answers": data.answers,
    }
    if outcome is not None:
        summary |= {"computed": outcome.computed, "resumed": outcome.resumed, "wall_s": outcome.wall_s}
    write_whole(store.folder / "summary.json", json.dumps(summary, indent=1).encode("utf-8"))
    report.write_report(data, store.folder)
    for entry in data.skipped:
        print(f"skipped: {entry['reason']}", file=sys.stderr)
    if as_json:
        print(json.dumps(summary))
        return
    print_answers(data.answers, threshold)
    print_models(data.models)
    took = f" in {outcome.wall_s:.1f} s" if outcome is not None else ""
    print(f"{cells} cells{took}, pictures skipped: {len(data.skipped)}")
    print(f"open {summary['report']}")
