"""``blurnoise sweep``: models x conditions x pictures, then the report."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

from typer import Option

from blurnoise_eval.cli import given, vehicle
from blurnoise_eval.cli._options import (
    ENGINE_NAMES,
    FAMILIES,
    MODEL_TIMEOUT_S,
    Address,
    Boxes,
    CacheGb,
    CameraName,
    Cfa,
    FrameRate,
    GreyAnchor,
    Grid,
    Json,
    Mains,
    Mattes,
    ModelTimeout,
    ObjectKmh,
    ObjectM,
    ObjectSpeed,
    ObjectWidthM,
    Plates,
    RunWritten,
    StatedPath,
    Workers,
    axis_options,
    classes,
    one_of,
)
from blurnoise_eval.cli.report import Cluster, Keep, Parquet, Score, Threshold, tell
from blurnoise_eval.grid.axes import EGO
from blurnoise_eval.system.storage import Location, location
from blurnoise_eval.system.terminal import say

_EGO = "With --ego-kmh: the camera on the vehicle"
_what = partial(Option, rich_help_panel="What to run")


@axis_options()
def sweep(
    *,
    model: Annotated[
        list[Location] | None,
        _what(
            parser=location,
            metavar="M.onnx",
            help="a detector or a text recogniser; 'blurnoise inspect M.onnx' says what it is taken for; several, "
            "each with its own --model, stand side by side (default: the built-in detector)",
        ),
    ] = None,
    contract: Annotated[
        list[str] | None,
        _what(
            metavar="FILE|PRESET[,FIELD=VALUE...]",
            help="how pictures enter the model and what its classes are: a JSON or YAML file, or a preset, and what "
            "differs; see 'blurnoise inspect --help' (default: MODEL.contract.json beside the model, then its "
            "metadata, then its shape); one for all models, or one for each in their order",
            autocompletion=one_of(FAMILIES),
        ),
    ] = None,
    ocr: Annotated[
        Literal["crop", "find"] | None,
        _what(
            metavar="[crop|find]",
            help="read text with PP-OCR of the installed package rapidocr: in known boxes (crop, the default), or "
            "found by its text detector first (find)",
        ),
    ] = None,
    dictionary: Annotated[
        Location | None,
        _what(parser=location, metavar="FILE", help="a recogniser's characters, a line each"),
    ] = None,
    text_detector: Annotated[
        Location | None,
        _what(
            parser=location,
            metavar="D.onnx",
            help="find text with this (PP-OCR's) before it is read; without it the known boxes are read",
        ),
    ] = None,
    model_timeout_s: ModelTimeout = MODEL_TIMEOUT_S,
    images: Annotated[
        Location | None,
        _what(
            parser=location,
            metavar="DIR",
            help="a folder; targets: what is found when clean. With one of the files below: their folder",
        ),
    ] = None,
    coco: Annotated[Location | None, _what(parser=location, metavar="FILE", help="COCO instances")] = None,
    yolo: Annotated[
        Location | None, _what(parser=location, metavar="DATA.yaml|DIR", help="YOLO's text labels")
    ] = None,
    split: Annotated[
        str | None,
        _what(metavar="NAME", help="of DATA.yaml (default val, else train)"),
    ] = None,
    bdd: Annotated[
        Location | None, _what(parser=location, metavar="FILE", help="BDD100K detection labels")
    ] = None,
    text: Annotated[
        Location | None,
        _what(parser=location, metavar="FILE", help="PP-OCR labels: texts, or texts and places"),
    ] = None,
    target: Annotated[
        list[str] | None,
        _what(metavar="CLASS", help="only this class, and pictures with it", autocompletion=classes),
    ] = None,
    keep_empty: Annotated[
        bool,
        _what(
            "--keep-empty",
            help="with --target: pictures without it count by what is found in them",
        ),
    ] = False,
    limit: Annotated[int | None, _what(metavar="N", help="only the first N pictures")] = None,
    max_megapixels: Annotated[
        float, _what(metavar="N", help="larger pictures are skipped, and named; up to 178")
    ] = 100.0,
    grid: Grid,
    mattes: Mattes = "auto",
    plates: Plates = None,
    object_speed: ObjectSpeed = None,
    object_kmh: ObjectKmh = None,
    object_m: ObjectM = None,
    object_width_m: ObjectWidthM = None,
    boxes: Boxes = "object",
    height_m: Annotated[float | None, vehicle.height_m(_EGO)] = None,
    pitch_deg: Annotated[float | None, vehicle.pitch_deg(_EGO)] = None,
    heading_deg: Annotated[float | None, vehicle.heading_deg(_EGO)] = None,
    plane_m: Annotated[float | None, vehicle.plane_m(_EGO)] = None,
    hfov_deg: Annotated[float | None, vehicle.hfov_deg(_EGO)] = None,
    lens: Annotated[vehicle.LensKind | None, vehicle.lens(_EGO)] = None,
    yaw_deg_s: Annotated[
        float | None, Option(metavar="DEG_S", help="it turns to the right, default: 0", rich_help_panel=_EGO)
    ] = None,
    frame_rate: FrameRate = 30.0,
    mains: Mains = "0",
    repeats: Annotated[int, Option(metavar="N", help="noise fields per picture")] = 1,
    seed: Annotated[int, Option(metavar="N", help="of the noise")] = 0,
    grey_anchor: GreyAnchor = None,
    trajectory: StatedPath = None,
    camera: CameraName = None,
    cfa: Cfa = None,
    keep: Keep = None,
    threshold: Threshold = None,
    score: Score = None,
    cluster: Cluster = None,
    engine: Annotated[
        str,
        Option(
            metavar="threads|processes|ray",
            help="who computes: threads over one session of each model; processes, each with its own; or actors of "
            "Ray, on this machine or a cluster",
            autocompletion=one_of(ENGINE_NAMES),
        ),
    ] = "threads",
    threads: Workers = None,
    address: Address = None,
    part: Annotated[
        str | None,
        Option(
            metavar="K/N",
            help="only the Kth of N parts of the pictures, by their names; 'blurnoise merge' joins the runs",
        ),
    ] = None,
    refine: Annotated[
        bool,
        Option(
            "--refine/--no-refine",
            help="compute more exposures about ends of windows and the exposure to use; a part refines nothing",
        ),
    ] = True,
    parquet: Parquet = False,
    cache_gb: CacheGb = None,
    output: RunWritten,
    as_json: Json = False,
) -> None:
    """Run detectors or text recognisers over exposures x lights x speeds x pictures; write curves, pictures,
    tables and a page that answers with the exposure to use.

      blurnoise sweep -o run                                             rendered stop signs, the built-in detector
      blurnoise sweep --model a.onnx --coco instances.json -o run        boxes from COCO: AP and all that
      blurnoise sweep --model a.onnx --model b.onnx --images DIR -o run  side by side; targets: found when clean
      blurnoise sweep --ocr -o run                                       the rendered STOP, read
      blurnoise sweep --moves all,targets,background -o run              signs that move, a camera that tracks them
      blurnoise sweep --ego-kmh 0,50,100 --hfov-deg 60 -o run            a camera that drives over a road

    Without pictures: stop signs of 100, 50 and 32 px, rendered before 20 backgrounds. A sweep that was stopped
    goes on where it was when the same command is given again.
    """
    given.cache(cache_gb)
    from blurnoise import AutoExposure
    from blurnoise_eval.grid.conditions import SweepPlan
    from blurnoise_eval.grid.parts import Part
    from blurnoise_eval.scoring.clusters import cluster_of
    from blurnoise_eval.store.exports import check_parquet
    from blurnoise_eval.sweep.evaluation import evaluate
    from blurnoise_eval.system.working_folder import written_run

    cluster_of("", cluster)
    if parquet:
        check_parquet()
    if part is not None:
        Part.parse(part)
    workers = threads if address else given.threads(threads)
    models = given.models(  # before a folder is made
        model or (),
        contract or (),
        ocr=ocr,
        dictionary=dictionary,
        text_detector=text_detector,
        timeout_s=model_timeout_s,
    )
    pictures = given.pictures(
        images=images,
        coco=coco,
        yolo=yolo,
        split=split,
        bdd=bdd,
        text=text,
        targets=target or (),
        keep_empty=keep_empty,
        limit=limit,
        max_megapixels=max_megapixels,
        reads=given.read(models),
    )
    auto = AutoExposure(frame_rate_hz=frame_rate, mains_hz=float(mains))
    seen_by: Any = {"hfov_deg": hfov_deg, "lens": lens}
    objects = given.objects(
        mattes,
        plates,
        object_speed or (),
        boxes,
        kmh=object_kmh or (),
        away_m=object_m or (),
        width_m=object_width_m or (),
        **(seen_by if object_m else {}),
    )
    stated: Any = {"repeats": repeats, "seed": seed, "grey_anchor": grey_anchor, "trajectory": trajectory}
    stated["ego"] = given.vehicle(
        drives=EGO.name in grid,
        height_m=height_m,
        pitch_deg=pitch_deg,
        heading_deg=heading_deg,
        plane_m=plane_m,
        **({} if object_m else seen_by),
        yaw_deg_s=yaw_deg_s,
    )
    plan = SweepPlan(grid, **stated, auto_exposure=auto, objects=objects)
    exposed_by, of_camera = given.camera_of_run(camera, models, pictures, cfa)
    with written_run(output) as folder:
        done = evaluate(
            models,
            pictures,
            exposed_by,
            plan,
            folder,
            threshold=threshold,
            keep=keep,
            score=score,
            cluster=cluster,
            engine=engine,
            threads=workers,
            address=address,
            part=part,
            refine=refine,
            progress=True,
            command=given.command(),
        )
        tell(done, as_json=as_json, parquet=parquet, last=of_camera)
    if refine and part is not None:
        say(
            "ends of windows are not refined in a part: merge the parts, then sweep on in the merged run",
            error=True,
        )
