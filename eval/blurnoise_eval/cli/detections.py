"""``blurnoise detections``: what a run's models found, as COCO's results files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import Json
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json


def detections(
    run: Annotated[Path, Argument(metavar="RUN", help="the folder of a sweep")],
    *,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            metavar="DIR",
            help="a folder per model: instances.json and a file per condition and repeat (default: RUN/coco)",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write what a run's models found as COCO results files.

      blurnoise detections run

    pycocotools reads them.
    """
    from blurnoise_eval.store.schema import CONDITIONS
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.coco_export import write_detections

    with Store(run) as store:
        folder = output or run / "coco"
        with ProgressBar("write", store.count_different(*CONDITIONS, "model", "repeat")) as advance:
            written = write_detections(store, folder, advance)
    if as_json:
        say_json([str(path) for path in written])
    else:
        say(f"{len(written)} files in {folder}, each to compare with the instances.json beside it")
