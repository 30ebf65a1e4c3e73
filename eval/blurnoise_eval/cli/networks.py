"""The commands that make the detector: rendered scenes, and a training on them."""

from __future__ import annotations

import argparse

from blurnoise_eval.cli import given
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.progress import ProgressBar


def train(options: argparse.Namespace) -> int:
    """Train the stop-sign detector and write it as ONNX."""
    from blurnoise_models import training
    from blurnoise_models.export import write_onnx

    from blurnoise_eval.system.files import write_whole

    folder, threads = options.output, given.threads(options)
    training.check(options.pictures, options.seed)  # before the scenes are drawn
    with ProgressBar("draw scenes", options.scenes) as advance:
        scenes = training.pool(folder / "pool", options.scenes, size_px=options.size, progress=advance)
    steps: list[training.Step] = []
    with ProgressBar("train", options.pictures) as advance:

        def progress(step: training.Step) -> None:
            advance(step.pictures - (steps[-1].pictures if steps else 0))
            steps.append(step)

        network = training.train(
            scenes,
            options.arm,
            pictures=options.pictures,
            seed=options.seed,
            threads=threads,
            progress=progress,
        )
    facts = {name: getattr(options, name) for name in ("arm", "seed", "scenes", "pictures")}
    path = write_onnx(network, folder / "stop_sign.onnx", input_px=options.size, facts=facts)
    rows = "".join(f"{step.pictures},{step.loss:.6g}\n" for step in steps)
    write_whole(folder / "training.csv", f"pictures,loss\n{rows}".encode())
    print_facts({"model": str(path), **facts, "loss": steps[-1].loss}, options.json)
    return 0


def scenes(options: argparse.Namespace) -> int:
    """Rendered road-sign scenes, as COCO."""
    from blurnoise_models.scenes import write_coco

    with ProgressBar("draw scenes", options.count) as advance:
        print(write_coco(options.output, options.seed, options.count, size_px=options.size, progress=advance))
    return 0
