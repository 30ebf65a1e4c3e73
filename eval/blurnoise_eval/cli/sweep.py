"""``blurnoise sweep``: models x conditions x pictures, then the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from blurnoise_eval.cli import given as given_by
from blurnoise_eval.cli._options import Folder, Json, Location, settings
from blurnoise_eval.cli.report import print_run
from blurnoise_eval.grid.plan_file import Enough, PlanFile

if TYPE_CHECKING:
    from blurnoise_eval.evaluation import Evaluation


@settings(
    PlanFile, "model", "contract", "images", "labels", "target", "limit", "camera", "*", "keep",
    "score", "engine", "threads", "part",
)  # fmt: skip
def sweep(*, given: PlanFile, output: Folder, as_json: Json = False) -> None:
    """Run detectors or text recognisers over exposures x lights x speeds x pictures; write curves, pictures,
    tables and a page that answers with the exposure to use.

      blurnoise sweep -o run                           rendered stop signs
      blurnoise sweep --model a.onnx --coco instances.json -o run
      blurnoise sweep --model a.onnx --model b.onnx --images DIR -o run
      blurnoise sweep --moves all,targets,background -o run
      blurnoise sweep --save-plan plan.yaml            every setting, to edit
      blurnoise sweep --plan plan.yaml --lux 1,10 -o run

    Without pictures: stop signs of 100, 50 and 32 px, rendered before 20 backgrounds, and the built-in detector. The
    default conditions are those of a camera on a vehicle: exposures that 30 frames/s leave, light from a night street
    to daylight, and the image speeds at 0, 50 and 100 km/h of a sign 5 m beside the camera and 12.5 m ahead. A sweep
    that was stopped goes on where it was when the same command is given again.
    """
    from blurnoise_eval.evaluation import evaluate

    computed(evaluate, given, output, as_json, part=given.part, refine=given.refine)


def computed(
    compute: Callable[..., Evaluation], given: PlanFile, output: Location, as_json: bool, **further: Any
) -> None:
    """Compute a plan into a run, and print its answers."""
    from blurnoise_eval.sweep.engines import engine_of
    from blurnoise_eval.system.working_folder import written_run

    workers = given.threads if given.address else given_by.threads(given.threads)
    models, pictures = given_by.subject(given)  # before a folder is made
    plan = given.sweep_plan()
    camera, about_camera = given_by.camera_of_run(given, pictures)
    with written_run(output) as folder:
        done = compute(
            models,
            pictures,
            camera,
            plan,
            folder,
            **{name: getattr(given, name) for name in Enough.names()},
            engine=engine_of(given.engine, workers, given.address) if given.address else given.engine,
            threads=workers,
            progress=True,
            command=given_by.command(),
            **further,
        )
        print_run(done, as_json=as_json, about_camera=about_camera)
