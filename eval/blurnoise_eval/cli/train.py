"""``blurnoise train``: the stop-sign detector, trained and written as ONNX."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import Json, NewFolder, Threads
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.progress import ProgressBar


def train(
    *,
    output: NewFolder,
    pictures: Annotated[int, Option(metavar="N", help="seen")] = 80_000,
    size: Annotated[int, Option(metavar="PX", help="of scenes and input, a multiple of 32")] = 320,
    seed: Annotated[int, Option(metavar="N", help="of weights, order and augmentation")] = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Train the stop-sign detector on rendered scenes and write it as ONNX, with its contract inside.

      blurnoise train -o trained                       the built-in detector again: twenty minutes on two cores
      blurnoise sweep --model trained/stop_sign.onnx -o run       what it is worth

    A training that was stopped goes on where it was when the same command is given again, to the same weights:
    DIR/training.checkpoint. Losses: DIR/training.csv.
    """
    from blurnoise_models import training
    from blurnoise_models.augmentation import MIX, exposures
    from blurnoise_models.export import write_onnx

    from blurnoise_eval.system.files import write_whole

    workers = given.threads(threads)
    checkpoint = output / "training.checkpoint"
    steps: list[tuple[int, float]] = []
    with ProgressBar("train", pictures) as advance:

        def progress(seen: int, loss: float) -> None:
            advance(seen - (steps[-1][0] if steps else 0))
            steps.append((seen, loss))

        network = training.train(
            exposures(), pictures=pictures, size_px=size, seed=seed, threads=workers, facts={"mix": MIX},
            checkpoint=checkpoint, progress=progress,
        )  # fmt: skip
    facts = {"mix": MIX, "seed": seed, "pictures": pictures}
    path = write_onnx(network, output / "stop_sign.onnx", input_px=size, facts=facts)
    rows = "".join(f"{seen},{loss:.6g}\n" for seen, loss in steps)
    write_whole(output / "training.csv", f"pictures,loss\n{rows}".encode())
    checkpoint.unlink(missing_ok=True)
    print_facts({"model": str(path), **facts, "loss": steps[-1][1]}, as_json)
