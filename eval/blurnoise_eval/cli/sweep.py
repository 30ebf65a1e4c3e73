"""``blurnoise sweep``: evaluate models on pictures under all conditions, and write the report."""

from __future__ import annotations

from dataclasses import replace

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import Folder, Json, Location, settings
from blurnoise_eval.cli.report import print_run
from blurnoise_eval.plan.files import PlanFile


@settings(
    PlanFile, "model", "contract", "images", "labels", "target", "limit", "camera", "*", "infrared", "grey_anchor",
    "keep", "score", "engine", "threads", "part",
)  # fmt: skip
def sweep(*, config: PlanFile, output: Folder, as_json: Json = False) -> None:
    """Evaluate detectors or text recognisers on simulated pictures, over a grid of exposures, lights and speeds.

      blurnoise sweep -o run                   built-in model and signs
      blurnoise sweep --model a.onnx --coco instances.json -o run
      blurnoise sweep --model a.onnx --model b.onnx --images DIR -o run
      blurnoise sweep --moves all,targets,background -o run
      blurnoise sweep --save-plan plan.yaml    all settings, to edit
      blurnoise sweep --plan plan.yaml --lux 1,10 -o run

    The folder of the run holds a page, report.html, that names the exposure to use, with tables and figures.

    Without --images and --labels, the pictures are rendered stop signs of 100, 50 and 32 px in front of 20
    backgrounds. Without --model, the built-in stop-sign detector is evaluated. The default conditions are those of
    a camera on a vehicle: light from a street at night, in low beam, to daylight, exposure times at 30 frames/s, and
    the speeds in the picture of a sign 5 m beside and 12.5 m ahead of the camera at 0, 50 and 100 km/h.

    An interrupted sweep continues when you run the same command again.
    """
    computed(config, output, as_json, "refine" if config.refine else "grid")


def computed(config: PlanFile, output: Location, as_json: bool, strategy: str) -> None:
    """Compute a plan by a strategy, write the run and print its answers."""
    from blurnoise_eval import default_tone
    from blurnoise_eval.measure.photographs import about_photographs
    from blurnoise_eval.run.engines import engine_of
    from blurnoise_eval.run.evaluation import evaluate
    from blurnoise_eval.system.working_folder import written_run

    workers = config.threads if config.address else inputs.threads(config.threads)
    engine = engine_of(config.engine, workers, config.address)
    models, pictures = inputs.subject(config)  # before a folder is made
    camera, about_camera = inputs.camera_of_run(config, pictures)
    with written_run(output) as folder:
        done = evaluate(
            models,
            pictures.part(config.part) if config.part else pictures,
            camera,
            config.plan,
            config.question,
            replace(folder, command=inputs.command()),
            strategy=strategy,
            engine=engine,
            progress=True,
        )
        about: list[str | None] = []
        if not as_json:
            tone, writer = default_tone.of_photographs(config.plan.picture_tone, camera)
            plan = replace(config.plan, picture_tone=tone)
            assumed = config.plan.picture_tone is None and pictures.kind != "rendered"
            about = [
                about_camera,
                about_photographs(pictures, writer, plan),
                default_tone.about(writer, "picture_tone: srgb in a plan") if assumed else None,
            ]
        print_run(done, as_json=as_json, about=about)
