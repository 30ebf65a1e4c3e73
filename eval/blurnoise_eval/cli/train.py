"""``blurnoise train``: the stop-sign detector, trained and written as ONNX."""

from __future__ import annotations

from typing import Annotated, Literal

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import Json, NewFolder, Threads
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.progress import ProgressBar


def train(
    *,
    output: NewFolder,
    arm: Annotated[
        Literal["none", "kornia", "exposure"],
        Option(help="what happens to the pictures: nothing; Kornia's motion blur and noise; RandomExposure"),
    ] = "exposure",
    pictures: Annotated[int, Option(metavar="N", help="seen")] = 80_000,
    scenes: Annotated[int, Option(metavar="N", min=1, help="to see; 0.3 MB each")] = 16_000,
    size: Annotated[int, Option(metavar="PX", help="of scenes and input, a multiple of 32")] = 320,
    seed: Annotated[int, Option(metavar="N", help="of weights, order and augmentation")] = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Train the stop-sign detector on rendered scenes and write it as ONNX, with its contract inside.

      blurnoise train -o trained                       like the built-in detector: under an hour on two cores
      blurnoise train -o trained --arm none            without the exposure augmentation, to compare
      blurnoise sweep --model trained/stop_sign.onnx -o run       what it is worth

    The scenes are drawn once and stay in DIR/pool. A training that was stopped goes on where it was when the
    same command is given again, to the same weights: DIR/training.checkpoint. Losses: DIR/training.csv.
    """
    from blurnoise_models import training
    from blurnoise_models.export import write_onnx
    from blurnoise_models.mixes import mix_facts

    from blurnoise_eval.system.files import write_whole

    workers = given.threads(threads)
    training.check(pictures, seed)  # before the scenes are drawn
    with ProgressBar("draw scenes", scenes) as advance:
        pool = training.pool(output / "pool", scenes, size_px=size, progress=advance)
    checkpoint = output / "training.checkpoint"
    steps: list[training.Step] = []
    with ProgressBar("train", pictures) as advance:

        def progress(step: training.Step) -> None:
            advance(step.pictures - (steps[-1].pictures if steps else 0))
            steps.append(step)

        network = training.train(
            pool, arm, pictures=pictures, seed=seed, threads=workers, checkpoint=checkpoint, progress=progress
        )
    facts = {"arm": arm, "seed": seed, "scenes": scenes, "pictures": pictures, **mix_facts(arm)}
    path = write_onnx(network, output / "stop_sign.onnx", input_px=size, facts=facts)
    rows = "".join(f"{step.pictures},{step.loss:.6g}\n" for step in steps)
    write_whole(output / "training.csv", f"pictures,loss\n{rows}".encode())
    checkpoint.unlink(missing_ok=True)
    print_facts({"model": str(path), **facts, "loss": steps[-1].loss}, as_json)
