"""``blurnoise decide``: the same answers as a sweep's from a fraction of its pictures, by a search."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import (
    ENGINE_NAMES,
    Address,
    CacheGb,
    CameraName,
    GreyAnchor,
    Grid,
    Json,
    RunWritten,
    StatedPath,
    Workers,
    axis_options,
    one_of,
    options_of,
)
from blurnoise_eval.cli.report import Cluster, Keep, Score, Threshold, tell
from blurnoise_eval.cli.sweep import sweep
from blurnoise_eval.grid.axes import EGO, VELOCITY

_stops = partial(Option, rich_help_panel="When it is enough")
_SUBJECT = (
    "model", "contract", "ocr", "dictionary", "text_detector", "model_timeout_s", "images", "coco", "yolo",
    "split", "bdd", "text", "target", "keep_empty", "limit", "max_megapixels",
)  # fmt: skip
_VEHICLE = ("height_m", "pitch_deg", "heading_deg", "plane_m", "hfov_deg", "lens", "yaw_deg_s")


@axis_options(ranges=True, also={VELOCITY[0]: "--speed"})
@options_of(sweep, *_SUBJECT, *_VEHICLE)
def decide(
    *,
    shared: dict[str, Any],
    grid: Grid,
    threshold: Threshold = None,
    keep: Keep = None,
    score: Score = None,
    cluster: Cluster = None,
    regret: Annotated[
        float | None,
        _stops(
            metavar="R", help="take pictures until no recommended exposure loses more, at 95 %, than this"
        ),
    ] = None,
    edge_stops: Annotated[
        float | None,
        _stops(metavar="STOPS", help="take pictures until no window's end has a wider 95 % interval"),
    ] = None,
    most_nodes: Annotated[
        int,
        _stops(
            metavar="N",
            help="conditions from which on no more are searched for; those that check the answers come on top",
        ),
    ] = 72,
    repeats: Annotated[int, Option(metavar="N", help="noise fields per picture")] = 1,
    seed: Annotated[int, Option(metavar="N", help="of the noise, and of the pictures' order")] = 0,
    grey_anchor: GreyAnchor = None,
    trajectory: StatedPath = None,
    camera: CameraName = None,
    engine: Annotated[
        str,
        Option(
            metavar="threads|processes|ray",
            help="who computes, as of 'blurnoise sweep'",
            autocompletion=one_of(ENGINE_NAMES),
        ),
    ] = "threads",
    threads: Workers = None,
    address: Address = None,
    cache_gb: CacheGb = None,
    output: RunWritten,
    as_json: Json = False,
) -> None:
    """Say which exposure works, and how sure that is, under every light and at every speed, from few conditions.

      blurnoise decide --model a.onnx --coco instances.json -o run     the lights and speeds of 'blurnoise sweep'
      blurnoise decide --model a.onnx --images DIR --lux 5:200 --speed 0,150,400 --keep 0.8 -o run
      blurnoise decide --model a.onnx --images DIR --regret 0.01 -o run        no more pictures than that takes

    Conditions with the same lux x seconds and the same motion in px are one experiment. So a search asks on that
    plane, at most about 80 conditions for all lights and speeds, where 'blurnoise sweep' computes a grid over
    exposure, light and speed. Where the plane does not hold (dark current, several directions or gains, a trajectory,
    a camera that drives), or where the grid has fewer conditions, it is that grid, and the answer says why.
    Stopped, it goes on when the same command is given again; a wider question in the same folder begins with what is
    there.
    """
    given.cache(cache_gb)
    from blurnoise_eval.deciding.deciding import Precision, decided
    from blurnoise_eval.deciding.question import Question
    from blurnoise_eval.system.working_folder import written_run

    ego = given.vehicle(drives=EGO.name in grid, **{name: shared.pop(name) for name in _VEHICLE})
    question = Question.of_grid(grid)
    workers = threads if address else given.threads(threads)
    models, pictures = given.subject(**shared)
    seen_by, of_camera = given.camera_of_run(camera, models, pictures)
    with written_run(output) as folder:
        done = decided(
            models,
            pictures,
            seen_by,
            question,
            folder,
            threshold=threshold,
            keep=keep,
            score=score,
            cluster=cluster,
            precision=Precision(regret, edge_stops, most_nodes),
            repeats=repeats,
            seed=seed,
            grey_anchor=grey_anchor,
            trajectory=trajectory,
            ego=ego,
            engine=engine,
            threads=workers,
            address=address,
            progress=True,
            command=given.command(),
        )
        tell(done, as_json=as_json, first=done.how(), last=of_camera)
