"""``python -m blurnoise_eval.bench``: benchmarks of speed and error on this machine."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from blurnoise_eval.cli import inputs, run_alone
from blurnoise_eval.cli._options import Contract, Json, Threads, new_folder
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json

if TYPE_CHECKING:
    from blurnoise_eval.bench.contest import Contest

What = Literal[
    "blur", "motion", "glare", "denoise", "sweep", "parts", "scale",
    "chain", "augment", "lengths", "loaders", "laws",
]  # fmt: skip

_OF_DETECTORS = ("sweep", "parts")


def bench(
    what: Annotated[What, Argument(metavar="WHAT", help="benchmark, see above")],
    *,
    model: Annotated[
        Path | None,
        Option(metavar="M.onnx", help="detector for sweep and parts (default: the built-in detector)"),
    ] = None,
    contract: Contract = None,
    images: Annotated[
        Path | None, Option(metavar="DIR", help="pictures for sweep and parts (default: rendered signs)")
    ] = None,
    peers: Annotated[
        Path | None,
        Option(metavar="DIR", help="for lengths: folder of other packages, of 'pip install --target'"),
    ] = None,
    threads: Threads = None,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            parser=new_folder,
            metavar="DIR",
            help="folder for table, JSON and chart (default: bench-WHAT)",
        ),
    ] = None,
    quick: Annotated[bool, Option("--quick", help="run fewer cases, in seconds or minutes")] = False,
    as_json: Json = False,
) -> None:
    """Benchmark methods for the same task on this machine: time and error of each.

      blur     straight motion blur; also Kornia and OpenCV
      motion   blur by camera shake, and by ego-motion on a road
      glare    halos around lamps
      denoise  noise reduction; also OpenCV and Kornia
      sweep    a sweep and plain onnxruntime
      parts    where the CPU time of a sweep's cell goes
      scale    store and report of a run, by its number of cells
      chain    simulate beside as many random numbers
      augment  the augmentation, a training step, Kornia, and albumentations and nrtk if installed
      lengths  the augmentations over the length of their blur; also AlbumentationsX of --peers
      loaders  the augmentations in a DataLoader with workers
      laws     what an augmentation must do, tried on all libraries of augmentations that are installed

      python -m blurnoise_eval.bench motion --quick          half a minute
      python -m blurnoise_eval.bench sweep --model m.onnx    your own network

    DIR/WHAT.png is a chart of time and error; down and left is better. DIR/WHAT.csv has a row per method and case.
    For parts, scale and laws, there is no chart.
    """  # fmt: skip
    for name, value in (("model", model), ("contract", contract), ("images", images)):
        if value is not None and what not in _OF_DETECTORS:
            raise ValueError(f"{name}: is for 'sweep' and 'parts' only")
    if peers is not None and what != "lengths":
        raise ValueError("peers: is for 'lengths' only")
    workers = inputs.threads(threads)
    folder = output or new_folder(f"bench-{what}")

    from blurnoise_eval import datasets
    from blurnoise_eval.bench import (
        augmentations,
        chain,
        contest,
        denoise,
        glare,
        laws,
        motion,
        parts,
        programs,
        scale,
    )
    from blurnoise_eval.system.files import check_outputs

    check_outputs(folder, f"{what}.*")
    contests: dict[str, Any] = {
        "blur": motion.blur,
        "motion": motion.motion,
        "glare": glare.glare,
        "denoise": denoise.denoise,
        "chain": chain.chain,
        "augment": augmentations.augment,
        "lengths": partial(augmentations.lengths, peers),
        "loaders": augmentations.loaders,
    }
    result: contest.Result | laws.LawTable | parts.PartsTable | scale.SizeTable
    if what in _OF_DETECTORS:
        pictures = datasets.image_folder(images) if images else datasets.rendered_signs(count=20)
        detector = inputs.detector(model, contract)
        contests["sweep"] = partial(programs.sweep, detector, pictures, workers)
    if what == "laws":
        result = laws.run()
    elif what == "parts":
        result = parts.parts(detector, pictures, quick=quick)
    elif what == "scale":
        with ProgressBar("bench", len(scale.copies(quick=quick))) as advance:
            result = scale.scale(quick=quick, progress=advance)
    else:
        chosen: Contest = contests[what](quick=quick)
        with ProgressBar("bench", len(chosen.cases)) as advance:
            result = contest.run(chosen, quick=quick, threads=workers, progress=advance)
    folder.mkdir(parents=True, exist_ok=True)
    result.write(folder)
    if as_json:
        say_json(result.document())
        return
    say(*result.table())
    charted = what in contests
    say(f"chart: {folder / f'{what}.png'}" if charted else f"table: {folder / f'{what}.csv'}")


if __name__ == "__main__":
    sys.exit(run_alone(bench, "python -m blurnoise_eval.bench", sys.argv[1:]))
