"""``blurnoise bench``: what this machine and these methods do, measured."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import FAMILIES, Json, Threads, new_folder, one_of
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json, show

What = Literal[
    "simulate",
    "sweep",
    "scale",
    "blur",
    "motion",
    "noise",
    "metrics",
    "edges",
    "intervals",
    "decide",
    "augment",
    "training",
]
# Of 'bench training': scenes to train on, pictures seen, seeds per arm, held-out scenes.
TRAINING = {"scenes": 9_000, "pictures": 18_000, "seeds": 3, "held_out": 120}
TRAINING_QUICK = {"scenes": 96, "pictures": 480, "seeds": 2, "held_out": 8}
HEAVY_INPUT_PX = 960  # at which the matched filter takes 0.15 s per picture on one core
HELD_OUT_SEED = 2  # training scenes have blurnoise_models.training.POOL_SEED
_training = partial(Option, rich_help_panel="For training")


def _sized(name: str, about: str) -> Any:
    """The option of one of ``TRAINING``."""
    usual = f"{about} (default: {TRAINING[name]}; {TRAINING_QUICK[name]} with --quick)"
    return _training(metavar="N", help=usual)


def bench(
    what: Annotated[What, Argument(metavar="WHAT", help="see above")],
    *,
    model: Annotated[
        Path | None, Option(metavar="M.onnx", help="for sweep and decide (default: the built-in one)")
    ] = None,
    contract: Annotated[
        str | None,
        Option(
            metavar="FILE|PRESET[,FIELD=VALUE...]", help="how to read it", autocompletion=one_of(FAMILIES)
        ),
    ] = None,
    heavy: Annotated[
        bool,
        Option("--heavy", help="for sweep: a network of 0.15 s per picture instead of --model"),
    ] = False,
    images: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="for sweep (default: rendered signs); for decide and training: the folder of --coco's photographs",
        ),
    ] = None,
    threads: Threads = None,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            parser=new_folder,
            metavar="DIR",
            help="for all but sweep: tables, JSON and charts (default: bench-simulate, bench-blur, ...)",
        ),
    ] = None,
    quick: Annotated[bool, Option("--quick", help="for all but sweep: less, in seconds or minutes")] = False,
    pictures: Annotated[
        int | None, _sized("pictures", "pictures that each network sees in its training")
    ] = None,
    scenes: Annotated[
        int | None,
        _sized("scenes", "rendered scenes that these are drawn from, 0.3 MB each on disk"),
    ] = None,
    seeds: Annotated[
        int | None,
        _sized(
            "seeds",
            "networks per arm; with one, intervals say nothing about other trainings; of edges, pictures of each",
        ),
    ] = None,
    held_out: Annotated[
        int | None, _sized("held_out", "rendered scenes to judge by, which no network has seen")
    ] = None,
    coco: Annotated[
        Path | None,
        _training(
            metavar="FILE",
            help="photographs to judge by, too: COCO instances with the category 'stop sign'; all pictures count, "
            "those without a sign by what is found in them; for decide: in place of rendered signs",
        ),
    ] = None,
    replications: Annotated[
        int | None,
        Option(metavar="N", help="for intervals: samples of each number of pictures (default: 600)"),
    ] = None,
    seed: Annotated[
        int | None, Option(metavar="N", help="for intervals: of the samples (default: 0)")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure on this machine.

      simulate   the whole chain and its stages, beside other libraries
      blur       every way to blur by motion, time beside error
      motion     every way to move an object, a picture, its rows or its road, time beside error
      noise      every way to draw noise, time beside distance from the exact law
      metrics    every way to measure a slanted edge, time beside error
      edges      edges that deceive, and honest ones: how many of them are withheld or flagged
      intervals  how often intervals hold the truth, in populations made for it
      decide     how many conditions a search for windows asks, beside grids and bisection, and how far off it is
      sweep      a sweep against bare onnxruntime
      scale      cells/s, memory and overhead of every engine over workers, and on paper to 1000 cores
      augment    what the augmentations cost beside a training step
      training   whether training with the exposure augmentation helps

      blurnoise bench training -o proof --quick      the whole of it in a few minutes, too small to tell anything
      blurnoise bench training -o proof              hours: train 3 arms x 3 seeds, judge them on held-out scenes
      blurnoise bench training -o proof --coco instances.json --images photos     ... and on photographs

    training: one small stop-sign network is trained without photometric augmentation (none), with Kornia's motion
    blur and noise (kornia), and with blurnoise's RandomExposure (exposure). All see the same scenes, clean and
    under a grid of exposures, lights and speeds. Open DIR/training.md and DIR/training.png; the networks stay as
    DIR/models/ARM-SEED.onnx. The same command goes on where it was stopped.
    """
    from blurnoise._core.checks import integer
    from blurnoise._core.rng import LAST_SEED

    asked: dict[str, tuple[object, tuple[str, ...]]] = {
        "model": (model, ("sweep", "decide")),
        "contract": (contract, ("sweep", "decide")),
        "heavy": (heavy, ("sweep",)),
        "images": (images, ("sweep", "decide", "training")),
        "pictures": (pictures, ("training",)),
        "scenes": (scenes, ("training",)),
        "seeds": (seeds, ("edges", "training")),
        "held-out": (held_out, ("training",)),
        "coco": (coco, ("decide", "training")),
        "replications": (replications, ("intervals",)),
        "seed": (seed, ("intervals",)),
    }
    for name, (value, rooms) in asked.items():
        if value is not None and value is not False and what not in rooms:
            raise ValueError(f"{name}: goes with 'bench {' and '.join(rooms)}'")
    for name, count in (("seeds", seeds), ("held-out", held_out), ("replications", replications)):
        if count is not None:
            integer(name, count, 1, 10_000_000)
    if seed is not None:
        integer("seed", seed, 0, LAST_SEED)
    workers = given.threads(threads)
    folder = output or new_folder(f"bench-{what}")
    if what == "sweep":
        _sweep(model, contract, images, workers, heavy=heavy, as_json=as_json)
    elif what == "augment":
        _augment(workers, quick=quick, as_json=as_json)
    elif what == "decide":
        _decide(folder, model, contract, coco, images, workers, quick=quick, as_json=as_json)
    elif what == "training":
        asked_for = {"scenes": scenes, "pictures": pictures, "seeds": seeds, "held_out": held_out}
        usual = TRAINING_QUICK if quick else TRAINING
        sizes = {name: usual[name] if size is None else size for name, size in asked_for.items()}
        _train(folder, sizes, coco, images, workers, quick=quick, as_json=as_json)
    else:
        extent = {"replications": replications, "seed": seed, "pictures": seeds}
        stated = {name: size for name, size in extent.items() if size is not None}
        _room(what, folder, workers, stated, quick=quick, as_json=as_json)


def _sweep(
    model: Path | None, contract: str | None, images: Path | None, threads: int, *, heavy: bool, as_json: bool
) -> None:
    """A sweep against bare inference."""
    import tempfile
    from dataclasses import replace

    from blurnoise_eval.bench.sweeps import sweep_speed
    from blurnoise_eval.datasets import image_folder, rendered_signs

    if heavy and model:
        raise ValueError("heavy: brings its own model; leave out --model")
    with tempfile.TemporaryDirectory() as folder:
        if heavy:
            from blurnoise_models import matched_filter

            model = matched_filter.build(Path(folder) / "heavy.onnx", input_px=HEAVY_INPUT_PX)
        pictures = image_folder(images) if images else rendered_signs(count=3)
        if heavy:
            pictures = replace(pictures, pictures=pictures.pictures[:1])
        facts = sweep_speed(given.detector(model, contract), pictures, threads, Path(folder))
    print_facts(facts, as_json)


def _room(
    what: str, folder: Path, threads: int, stated: dict[str, int], *, quick: bool, as_json: bool
) -> None:
    """One room of methods side by side: tables, JSON, charts. stated: what replaces the usual extent."""
    from dataclasses import replace

    from blurnoise_eval.bench import (
        blur,
        blur_view,
        chain,
        chain_view,
        edges,
        edges_view,
        intervals,
        intervals_view,
        metrics,
        metrics_view,
        motion,
        motion_view,
        noise,
        noise_view,
        scale,
        scale_view,
    )

    rooms = {
        "blur": (blur, blur_view),
        "edges": (edges, edges_view),
        "intervals": (intervals, intervals_view),
        "metrics": (metrics, metrics_view),
        "motion": (motion, motion_view),
        "noise": (noise, noise_view),
        "scale": (scale, scale_view),
        "simulate": (chain, chain_view),
    }
    room: Any
    view: Any
    room, view = rooms[what]
    extent = replace(room.QUICK if quick else room.FULL, **stated)
    folder.mkdir(parents=True, exist_ok=True)
    with ProgressBar("bench", room.steps(extent)) as advance:
        bench = room.measure(extent, threads, advance)
    room.write(bench, folder)
    view.write(bench, folder)
    if as_json:
        say_json(bench.document())
        return
    show(*view.tables(bench))
    for line in bench.losses():
        say(line)
    say(f"open {folder / f'{what}.png'}")


def _decide(
    folder: Path,
    model: Path | None,
    contract: str | None,
    coco: Path | None,
    images: Path | None,
    threads: int,
    *,
    quick: bool,
    as_json: bool,
) -> None:
    """Searches replayed on dense planes of a detector, which are made where the folder does not hold them."""
    from blurnoise_eval import datasets
    from blurnoise_eval.bench import decide, decide_planes, decide_view

    if images and not coco:
        raise ValueError("images: goes with --coco, whose photographs it holds")
    extent = decide.QUICK if quick else decide.FULL
    detector = given.detector(model, contract)
    pictures = datasets.coco(coco, images=images) if coco else datasets.rendered_signs(count=extent.pictures)
    folder.mkdir(parents=True, exist_ok=True)
    places = decide.nodes_of(extent)
    with ProgressBar("ask", len(decide_planes.GAINS) * len(pictures)) as advance:
        planes = decide_planes.kept(folder, detector, pictures, given.camera("imx250"), places, advance)
    with ProgressBar("bench", decide.steps(planes, extent)) as advance:
        bench = decide.measure(planes, extent, threads, advance)
    decide.write(bench, folder)
    decide_view.write(bench, folder)
    if as_json:
        say_json(bench.document())
        return
    show(*decide_view.tables(bench))
    for line in bench.losses():
        say(line)
    say(f"open {folder / 'decide.png'}")


def _augment(threads: int, *, quick: bool, as_json: bool) -> None:
    """What the augmentations cost in a training loop, each in several shares of the pictures."""
    import tempfile

    import numpy as np
    from blurnoise_models import training
    from blurnoise_models.mixes import blur_and_noise

    from blurnoise import RandomExposure
    from blurnoise_eval.bench.steps import step_cost

    with tempfile.TemporaryDirectory() as folder:
        pictures, boxes = training.batch(
            training.pool(Path(folder), training.BATCH), np.arange(training.BATCH)
        )
    steps = {
        name: partial(training.learn, *training.beginner(), pictures, boxes, bfloat16=name == "bfloat16")
        for name in ("float32", *(["bfloat16"] if training.has_bfloat16() else []))
    }
    ours: Any = RandomExposure  # of Kornia's classes, which mypy does not follow
    changes: dict[str, Any] = {}
    for p in (0.5, 0.8, 1.0):
        changes[f"kornia, p = {p:g}"] = partial(blur_and_noise(p), pictures)
        changes[f"exposure, p = {p:g}"] = partial(ours(p=p), pictures)
    turns = 3 if quick else 15
    with ProgressBar("bench", len(steps) + len(changes)) as advance:
        facts = step_cost(steps, changes, len(pictures), threads, advance, turns=turns)
    print_facts(facts, as_json)


def _train(
    folder: Path,
    sizes: dict[str, int],
    coco: Path | None,
    images: Path | None,
    threads: int,
    *,
    quick: bool,
    as_json: bool,
) -> None:
    """Train the networks that are missing, then judge them all."""
    from blurnoise_models import arms
    from blurnoise_models.scenes import write_coco
    from blurnoise_models.training import pool

    from blurnoise_eval import datasets
    from blurnoise_eval.bench import training, training_view

    held_out = sizes.pop("held_out")
    if images and not coco:
        raise ValueError("images: goes with --coco, whose photographs it holds")
    photographs = None
    if coco:  # before the hours of training
        photographs = datasets.coco(coco, images=images, labels=[training.LABEL], keep_empty=True)
    recipes = arms.recipes(folder / "models", **sizes)
    missing = [recipe for recipe in recipes if not recipe.is_ready()]
    listing = write_coco(folder / "held-out", HELD_OUT_SEED, held_out)
    if missing:
        with ProgressBar("draw scenes", sizes["scenes"]) as advance:
            pool(folder / "pool", sizes["scenes"], progress=advance)
        with ProgressBar(f"train {len(missing)} networks", len(missing) * sizes["pictures"]) as advance:
            arms.train_all(missing, folder / "pool", processes=threads, progress=advance)
    unseen = datasets.coco(listing, labels=[training.LABEL], keep_empty=True)
    plans = (training.QUICK,) * 2 if quick else (training.SCENES, training.PHOTOGRAPHS)
    parts = [training.Part("scenes", unseen, plans[0])]
    if photographs is not None:
        parts.append(training.Part("photographs", photographs, plans[1]))
    models = [training.Model(recipe.arm, recipe.seed, recipe.path) for recipe in recipes]
    with ProgressBar("judge", training.steps(models, parts)) as advance:
        bench = training.measure(models, parts, folder, threads=threads, progress=advance)
    training.write(bench, folder)
    charts = training_view.write(bench, folder)
    if as_json:
        say_json(bench.document())
        return
    show(*training_view.tables(bench))
    for verdict in bench.verdicts():
        say(verdict)
    say(f"open {folder / 'training.md'} and {', '.join(map(str, charts))}")
