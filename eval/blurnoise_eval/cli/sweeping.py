"""The commands that run models and tell what came of it."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from blurnoise_eval.cli import given
from blurnoise_eval.cli.console import ProgressBar, print_answers, print_assumptions, print_models

if TYPE_CHECKING:
    from blurnoise_eval.datasets import PictureSet
    from blurnoise_eval.scoring.on_picture import Model
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.run import Outcome

_SUSPECTED_PICTURES = 8  # by which a model's contract is questioned


def sweep(options: argparse.Namespace) -> int:
    """Models x exposures x lights x speeds x pictures, then the report."""
    from blurnoise._core.checks import in_range
    from blurnoise_eval.cli.arguments_axes import grid
    from blurnoise_eval.drawing.photon_transfer import find
    from blurnoise_eval.grid.conditions import SweepPlan
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep import run as sweep
    from blurnoise_eval.sweep import run_folder as results

    camera = find(options.camera)
    in_range("threshold", options.threshold, 0.0, 1.0)
    threads = given.threads(options)
    models = given.models(options)  # before a folder is made
    pictures = given.pictures(options, reads=given.read(models))
    repeats = options.repeats if options.repeats is not None else (3 if pictures.kind == "rendered" else 1)
    plan = SweepPlan(grid(options), repeats=repeats, seed=options.seed)
    with Store(options.output, create=True) as store:
        for model in models if options.model else ():
            print_assumptions(model.contract, model.path)
        facts = {"command": " ".join(["blurnoise", *sys.argv[1:]]), "threads": threads}
        results.open_run(store, models, camera, pictures, plan, facts)
        with ProgressBar("sweep", sweep.count_cells(pictures, plan)) as advance:
            outcome = sweep.run(models, camera, pictures, plan, store, threads=threads, progress=advance)
        if outcome.skipped and len(outcome.skipped) == len(pictures):
            raise ValueError(f"images: none could be read (first: {next(iter(outcome.skipped.values()))})")
        _note(store, models, pictures, outcome)
        return _finish(store, options, outcome)


def report(options: argparse.Namespace) -> int:
    """Tables, figures and page of a run again."""
    from blurnoise._core.checks import in_range
    from blurnoise_eval.store.store import Store

    in_range("threshold", options.threshold, 0.0, 1.0)
    with Store(options.run) as store:
        return _finish(store, options, None)


def detections(options: argparse.Namespace) -> int:
    """What a run's models found, as COCO's results files."""
    from blurnoise_eval.store.queries import count_conditions
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.coco_export import write_detections

    with Store(options.run) as store:
        folder = options.output or options.run / "coco"
        with ProgressBar("write", count_conditions(store, "model", "repeat")) as advance:
            written = write_detections(store, folder, advance)
    if options.json:
        print(json.dumps([str(path) for path in written]))
    else:
        print(f"{len(written)} files in {folder}, each to compare with the instances.json beside it")
    return 0


def _note(store: Store, models: Sequence[Model], pictures: PictureSet, outcome: Outcome) -> None:
    """Add to the run's manifest what is only known afterwards: seconds, each model's latency and oddities."""
    from blurnoise_eval.datasets import sample
    from blurnoise_eval.detectors.contract_checks import common_suspicions
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.sweep import latency

    manifest = store.about("manifest")
    manifest["wall_s"] = manifest.get("wall_s", 0.0) + outcome.wall_s
    for model, about in zip(models, manifest["models"], strict=True):
        about["latency"] = latency.measure(model, pictures)
        about["non_finite_values"] = model.non_finite_values
        if isinstance(model, Detector):
            some = [image for _, image in sample(pictures, _SUSPECTED_PICTURES)]
            about["suspicions"] = common_suspicions(model, some)
    store.set_about("manifest", manifest)


def _finish(store: Store, options: argparse.Namespace, outcome: Outcome | None) -> int:
    """Tables, figures and page of a run; the answer in the terminal."""
    from blurnoise_eval import report
    from blurnoise_eval.store.queries import count_conditions
    from blurnoise_eval.sweep import run_folder as results
    from blurnoise_eval.system.files import write_whole

    store.export()
    with ProgressBar("score", count_conditions(store, "model")) as advance:
        data = results.read_run(store, threshold=options.threshold, progress=advance)
    results.write_tables(data, store.folder)
    cells = data.manifest["n_cells"]
    summary: dict[str, Any] = {
        "run": str(store.folder),
        "report": str(store.folder / "report.html"),
        "cells": cells,
        "skipped": data.skipped,
        "threshold": options.threshold,
        "models": data.models,
        "answers": data.answers,
    }
    if outcome is not None:
        summary |= {"computed": outcome.computed, "resumed": outcome.resumed, "wall_s": outcome.wall_s}
    write_whole(store.folder / "summary.json", json.dumps(summary, indent=1).encode("utf-8"))
    report.write_report(data, store.folder)
    for entry in data.skipped:
        print(f"skipped: {entry['reason']}", file=sys.stderr)
    if options.json:
        print(json.dumps(summary))
        return 0
    print_answers(data.answers, options.threshold)
    print_models(data.models)
    took = f" in {outcome.wall_s:.1f} s" if outcome is not None else ""
    print(f"{cells} cells{took}, pictures skipped: {len(data.skipped)}")
    print(f"open {summary['report']}")
    return 0
