"""``blurnoise decide``: the same answers as a sweep's from a fraction of its pictures, by a search."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

from typer import Context, Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import (
    ENGINE_NAMES,
    Address,
    CacheGb,
    CameraName,
    GreyAnchor,
    Json,
    Range,
    RunWritten,
    StatedPath,
    Workers,
    left_out,
    one_of,
    options_of,
    or_auto,
    range_or_list,
    spread,
)
from blurnoise_eval.cli.report import Cluster, Keep, Score, Threshold, tell
from blurnoise_eval.cli.sweep import sweep
from blurnoise_eval.grid.axes import EGO, EXPOSURE

_asked = partial(Option, rich_help_panel="What is asked; LIST is 1,5,10 or start:stop:step, RANGE low:high")
_stops = partial(Option, rich_help_panel="When it is enough")
_SUBJECT = (
    "model", "contract", "ocr", "dictionary", "text_detector", "model_timeout_s", "images", "coco", "yolo",
    "split", "bdd", "text", "target", "keep_empty", "limit", "max_megapixels",
)  # fmt: skip
_VEHICLE = ("height_m", "pitch_deg", "heading_deg", "plane_m", "hfov_deg", "lens", "yaw_deg_s")


@options_of(sweep, *_SUBJECT, *_VEHICLE)
def decide(
    *,
    context: Context,
    shared: dict[str, Any],
    exposure_ms: Annotated[
        object,
        _asked("--exposure-ms", parser=range_or_list, metavar="RANGE|LIST", help="exposure times, ms"),
    ] = "1:90",
    lux: Annotated[
        object, _asked("--lux", parser=spread, metavar="RANGE|LIST", help="light on the scene, lux")
    ] = "1:1000",
    dx: Annotated[
        object,
        _asked("--dx", "--speed", parser=spread, metavar="RANGE|LIST", help="motion to the right, px/s"),
    ] = "0:1000",
    dy: Annotated[
        object, _asked("--dy", parser=spread, metavar="RANGE|LIST", help="motion down, px/s")
    ] = "0",
    temperature_c: Annotated[
        float | None, _asked(metavar="T", help="of the sensor, degC (default: 25)")
    ] = None,
    f_number: Annotated[
        float | None, _asked(metavar="N", help="of the lens, in place of the camera's")
    ] = None,
    defocus_px: Annotated[
        float | None, _asked(metavar="PX", help="radius of the disc of confusion, in place of the camera's")
    ] = None,
    gain: Annotated[
        object,
        _asked(parser=or_auto, metavar="auto|DB", help="dB; auto: what brings each picture's mean to 18 %"),
    ] = "auto",
    moves: Annotated[
        Literal["all", "targets", "background"], _asked(help="what moves, as of 'blurnoise sweep'")
    ] = "all",
    ego_kmh: Annotated[
        float | None,
        _asked(metavar="KMH", help="the camera drives, in place of --dx, as of 'blurnoise sweep'"),
    ] = None,
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

      blurnoise decide --model a.onnx --coco instances.json -o run     1 to 1000 lux, 0 to 1000 px/s
      blurnoise decide --model a.onnx --images DIR --lux 5:200 --speed 0,150,400 --keep 0.8 -o run
      blurnoise decide --model a.onnx --images DIR --regret 0.01 -o run        no more pictures than that takes

    Conditions with the same lux x seconds and the same motion in px are one experiment. So a search asks on that
    plane, about 40 conditions for all lights and speeds, where 'blurnoise sweep' computes a grid over exposure,
    light and speed. Where the plane does not hold (dark current, several directions, a trajectory, a camera that
    drives), or where the grid has fewer conditions, it is that grid, and the answer says why. A range
    stands for its ends and 1, 3, 10, 30 ... between them.
    Stopped, it goes on when the same command is given again; a wider question in the same folder begins with what is
    there.
    """
    given.cache(cache_gb)
    from blurnoise_eval.deciding.deciding import Precision, decided
    from blurnoise_eval.deciding.question import Question
    from blurnoise_eval.system.working_folder import written_run

    further = {
        "temperature_c": temperature_c,
        "f_number": f_number,
        "defocus_radius_px": defocus_px,
        "gain_db": gain,
        "moves": None if moves == "all" else moves,
        EGO.name: None if ego_kmh is None else EGO.of_option(ego_kmh),
    }
    if ego_kmh is not None and left_out(context, "dx"):
        dx = (0.0,)
    ego = given.vehicle(drives=ego_kmh is not None, **{name: shared.pop(name) for name in _VEHICLE})
    values: dict[str, Any] = {"illuminance_lux": lux, "velocity_x_px_s": dx, "velocity_y_px_s": dy}
    values |= {name: (value,) for name, value in further.items() if value is not None}
    exposures: Any = exposure_ms
    tested = () if isinstance(exposures, Range) else tuple(map(EXPOSURE.of_option, sorted(set(exposures))))
    ends = (
        (exposures.low / 1e3, exposures.high / 1e3)
        if isinstance(exposures, Range)
        else (tested[0], tested[-1])
    )
    question = Question(ends, values, tested)
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
