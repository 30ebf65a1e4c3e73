"""The commands that run models and tell what came of it."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from blurnoise_eval.cli import given
from blurnoise_eval.cli.console import print_answers, print_assumptions, print_models
from blurnoise_eval.system.progress import ProgressBar

if TYPE_CHECKING:
    from blurnoise_eval.sweep.evaluation import Evaluation


def sweep(options: argparse.Namespace) -> int:
    """Models x exposures x lights x speeds x pictures, then the report."""
    camera = given.camera(options)
    from blurnoise._core.checks import in_range
    from blurnoise_eval.grid.conditions import Plan
    from blurnoise_eval.sweep.evaluation import evaluate, usual_repeats

    in_range("threshold", options.threshold, 0.0, 1.0)
    threads = given.threads(options)
    models = given.models(options)  # before a folder is made
    pictures = given.pictures(options, reads=given.read(models))
    plan = Plan(
        exposures_s=tuple(value / 1e3 for value in options.exposure_ms),
        illuminances_lux=tuple(options.lux),
        velocities_x_px_s=tuple(options.dx),
        velocities_y_px_s=tuple(options.dy),
        repeats=options.repeats if options.repeats is not None else usual_repeats(pictures),
        seed=options.seed,
        temperature_c=options.temperature_c,
    )
    for model in models if options.model else ():
        print_assumptions(model.contract, model.path)
    done = evaluate(
        models,
        pictures,
        camera,
        plan,
        options.output,
        threshold=options.threshold,
        engine=options.engine,
        threads=threads,
        progress=True,
        command=" ".join(["blurnoise", *sys.argv[1:]]),
    )
    return _tell(done, as_json=options.json)


def report(options: argparse.Namespace) -> int:
    """Tables, figures and page of a run again."""
    from blurnoise_eval.sweep.evaluation import Evaluation

    return _tell(Evaluation(options.run, options.threshold, progress=True), as_json=options.json)


def detections(options: argparse.Namespace) -> int:
    """What a run's models found, as COCO's results files."""
    from blurnoise_eval.scoring.per_condition import CONDITIONS
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.coco_export import write_detections

    with Store(options.run) as store:
        folder = options.output or options.run / "coco"
        with ProgressBar("write", store.count_different(*CONDITIONS, "model", "repeat")) as advance:
            written = write_detections(store, folder, advance)
    if options.json:
        print(json.dumps([str(path) for path in written]))
    else:
        print(f"{len(written)} files in {folder}, each to compare with the instances.json beside it")
    return 0


def _tell(done: Evaluation, *, as_json: bool) -> int:
    """Write tables, figures and page; the answer in the terminal."""
    page = done.report()
    for entry in done.skipped:
        print(f"skipped: {entry['reason']}", file=sys.stderr)
    if as_json:
        print(json.dumps(done.summary))
        return 0
    print_answers(done.answers, done.threshold)
    print_models(done.models)
    took = f" in {done.outcome.wall_s:.1f} s" if done.outcome is not None else ""
    print(f"{done.summary['cells']} cells{took}, pictures skipped: {len(done.skipped)}")
    print(f"open {page}")
    return 0
