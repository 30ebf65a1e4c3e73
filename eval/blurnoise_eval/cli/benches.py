"""``blurnoise bench``: what this machine and these methods do, measured."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from blurnoise_eval.cli import given
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.progress import ProgressBar

# Of 'bench training': scenes to train on, pictures seen, seeds per arm, held-out scenes.
TRAINING = {"scenes": 9_000, "pictures": 18_000, "seeds": 3, "held_out": 120}
TRAINING_QUICK = {"scenes": 96, "pictures": 480, "seeds": 2, "held_out": 8}
HEAVY_INPUT_PX = 960  # at which the matched filter takes 0.15 s per picture on one core
HELD_OUT_SEED = 2  # training scenes have blurnoise_models.training.POOL_SEED


def bench(options: argparse.Namespace) -> int:
    """Measure what the argument names."""
    threads = given.threads(options)
    if options.what == "training":
        return _bench_training(options, threads)
    if options.what == "augment":
        return _bench_augment(options, threads)
    if options.what != "sweep":
        return _bench_room(options, threads)
    import tempfile
    from dataclasses import replace

    from blurnoise_eval.bench.sweeps import sweep_speed
    from blurnoise_eval.datasets import image_folder, rendered_signs

    if options.heavy and options.model:
        raise ValueError("heavy: brings its own model; leave out --model")
    with tempfile.TemporaryDirectory() as folder:
        if options.heavy:
            from blurnoise_models import matched_filter

            options.model = matched_filter.build(Path(folder) / "heavy.onnx", input_px=HEAVY_INPUT_PX)
        pictures = image_folder(options.images) if options.images else rendered_signs()
        if options.heavy:
            pictures = replace(pictures, pictures=pictures.pictures[:1])
        facts = sweep_speed(given.detector(options), pictures, threads, Path(folder))
    print_facts(facts, options.json)
    return 0


def _bench_room(options: argparse.Namespace, threads: int) -> int:
    from rich.console import Console

    from blurnoise_eval.bench import (
        blur,
        blur_view,
        chain,
        chain_view,
        metrics,
        metrics_view,
        noise,
        noise_view,
    )

    rooms = {
        "blur": (blur, blur_view),
        "metrics": (metrics, metrics_view),
        "noise": (noise, noise_view),
        "simulate": (chain, chain_view),
    }
    room: Any
    view: Any
    room, view = rooms[options.what]
    extent = room.QUICK if options.quick else room.FULL
    folder = options.output or Path(f"bench-{options.what}")
    folder.mkdir(parents=True, exist_ok=True)
    with ProgressBar("bench", room.steps(extent)) as advance:
        bench = room.measure(extent, threads, advance)
    room.write(bench, folder)
    view.write(bench, folder)
    if options.json:
        print(json.dumps(bench.document()))
        return 0
    console = Console()
    for table in view.tables(bench):
        console.print(table)
    for line in bench.losses():
        print(line)
    print(f"open {folder / f'{options.what}.png'}")
    return 0


def _bench_augment(options: argparse.Namespace, threads: int) -> int:
    """What the augmentations cost in a training loop, each at the share of pictures that trainings use."""
    import tempfile
    from functools import partial

    import numpy as np
    from blurnoise_models import training

    from blurnoise_eval.bench.steps import step_cost

    with tempfile.TemporaryDirectory() as folder:
        pictures, boxes = training.batch(
            training.pool(Path(folder), training.BATCH), np.arange(training.BATCH)
        )
    steps = {
        name: partial(training.learn, *training.beginner(), pictures, boxes, bfloat16=name == "bfloat16")
        for name in ("float32", *(["bfloat16"] if training.has_bfloat16() else []))
    }
    changes = {
        f"{arm}, p = {share:g}": partial(training.augmentation(arm, share), pictures)
        for share in (0.5, training.SHARE, 1.0)
        for arm in ("kornia", "exposure")
    }
    turns = 3 if options.quick else 15
    with ProgressBar("bench", len(steps) + len(changes)) as advance:
        facts = step_cost(steps, changes, len(pictures), threads, advance, turns=turns)
    print_facts(facts, options.json)
    return 0


def _bench_training(options: argparse.Namespace, threads: int) -> int:
    """Train the networks that are missing, then judge them all."""
    from blurnoise_models import arms
    from blurnoise_models.scenes import write_coco
    from blurnoise_models.training import pool
    from rich.console import Console

    from blurnoise_eval import datasets
    from blurnoise_eval.bench import training, training_view

    folder = options.output or Path("bench-training")
    sizes = dict(TRAINING_QUICK if options.quick else TRAINING)
    sizes |= {name: given for name in sizes if (given := getattr(options, name)) is not None}
    held_out = sizes.pop("held_out")
    if options.images and not options.coco:
        raise ValueError("images: goes with --coco, whose photographs it holds")
    photographs = None
    if options.coco:  # before the hours of training
        photographs = datasets.coco(
            options.coco, images=options.images, labels=[training.LABEL], keep_empty=True
        )
    recipes = arms.recipes(folder / "models", **sizes)
    missing = [recipe for recipe in recipes if not recipe.is_ready()]
    listing = write_coco(folder / "held-out", HELD_OUT_SEED, held_out)
    if missing:
        with ProgressBar("draw scenes", sizes["scenes"]) as advance:
            pool(folder / "pool", sizes["scenes"], progress=advance)
        with ProgressBar(f"train {len(missing)} networks", len(missing) * sizes["pictures"]) as advance:
            arms.train_all(missing, folder / "pool", processes=threads, progress=advance)
    unseen = datasets.coco(listing, labels=[training.LABEL], keep_empty=True)
    plans = (training.QUICK,) * 2 if options.quick else (training.SCENES, training.PHOTOGRAPHS)
    parts = [training.Part("scenes", unseen, plans[0])]
    if photographs is not None:
        parts.append(training.Part("photographs", photographs, plans[1]))
    models = [training.Model(recipe.arm, recipe.seed, recipe.path) for recipe in recipes]
    with ProgressBar("judge", training.steps(models, parts)) as advance:
        bench = training.measure(models, parts, folder, threads=threads, progress=advance)
    training.write(bench, folder)
    charts = training_view.write(bench, folder)
    if options.json:
        print(json.dumps(bench.document()))
        return 0
    for table in training_view.tables(bench):
        Console().print(table)
    for verdict in bench.verdicts():
        print(verdict)
    print(f"open {folder / 'training.md'} and {', '.join(map(str, charts))}")
    return 0
