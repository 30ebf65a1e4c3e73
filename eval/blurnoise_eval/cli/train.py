"""``blurnoise train``: train the stop-sign detector and write it as ONNX."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import Json, NewFolder, Threads
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.progress import ProgressBar


def train(
    *,
    output: NewFolder,
    pictures: Annotated[int, Option(metavar="N", help="number of training pictures")] = 80_000,
    size: Annotated[
        int, Option(metavar="PX", help="side of scenes and network input, px; a multiple of 32")
    ] = 320,
    seed: Annotated[int, Option(metavar="N", help="seed of weights, order and augmentation")] = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Train the stop-sign detector on rendered scenes and write it as ONNX, with its contract inside the file.

      blurnoise train -o trained
      blurnoise sweep --model trained/stop_sign.onnx -o run

    The defaults reproduce the built-in detector in about twenty minutes on two cores. An interrupted training
    continues from DIR/training.checkpoint when you run the same command again, and ends with the same weights. The
    losses are written to DIR/training.csv.
    """
    from blurnoise_models import training
    from blurnoise_models.augmentation import MIX, exposures
    from blurnoise_models.export import write_onnx

    from blurnoise._core.checks import integer
    from blurnoise_eval.system.files import check_outputs, remove, write_whole
    from blurnoise_eval.system.interrupts import keeps

    workers = inputs.threads(threads)
    integer("pictures", pictures, training.FEWEST_PICTURES, 10**9)
    checkpoint = output / "training.checkpoint"
    check_outputs(output, "stop_sign.onnx", "training.csv", checkpoint.name)
    keeps(checkpoint.is_file)
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
    remove(checkpoint)
    print_facts({"model": str(path), **facts, "loss": steps[-1][1]}, as_json)
