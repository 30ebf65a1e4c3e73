"""``blurnoise detections``: what a run's models found, as COCO's results files."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from blurnoise_eval.cli._options import Json, RunRead, new_place
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.storage import Location
from blurnoise_eval.system.terminal import say, say_json


def detections(
    run: RunRead,
    *,
    output: Annotated[
        Location | None,
        Option(
            "-o",
            "--output",
            parser=new_place,
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
    from blurnoise_eval.store.checked import check_rows
    from blurnoise_eval.store.schema import CONDITIONS
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.coco_export import write_detections
    from blurnoise_eval.system.files import path_within
    from blurnoise_eval.system.working_folder import output_folder, read_run

    target = new_place(run / "coco") if output is None else output
    with read_run(run) as read, Store(read.path) as store, output_folder(target) as folder:
        check_rows(store)
        path_within(read.path, "coco")
        steps = store.count_different(*CONDITIONS, "model", "repeat")
        with ProgressBar("write", steps) as advance:
            written = write_detections(store, folder.path, advance)
    if as_json:
        say_json([folder.told(path) for path in written])
    else:
        say(f"{len(written)} files in {target}, each to compare with the instances.json beside it")
