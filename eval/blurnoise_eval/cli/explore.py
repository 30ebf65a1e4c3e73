"""``blurnoise explore``: a picture, or a run, in a page of sliders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import (
    MODEL_TIMEOUT_S,
    CameraName,
    Grid,
    Json,
    ModelTimeout,
    axis_options,
    new_file,
)
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.system.terminal import say

if TYPE_CHECKING:
    from blurnoise_eval.explorer.shelf import Shelf
    from blurnoise_eval.explorer.state import State

_EXTRA = 'explore: needs NiceGUI: pip install "blurnoise[explore]"; with -o it writes the picture without'


@axis_options(
    exposure_s="20", illuminance_lux="2", velocity_x_px_s="1000", velocity_y_px_s="0", gain_db="auto"
)
def explore(
    *,
    where: Annotated[
        Path | None,
        Argument(
            metavar="IMAGE|RUN", help="a picture, or the folder of a sweep (default: rendered stop signs)"
        ),
    ] = None,
    sign: Annotated[int | None, Option(metavar="N", help="which of the rendered pictures, from 1 on")] = None,
    cell: Annotated[
        str | None, Option(metavar="ID", help="of a run: a cell of results.csv, computed anew")
    ] = None,
    picture: Annotated[str | None, Option(metavar="NAME", help="of a run: one of its pictures")] = None,
    images: Annotated[
        Path | None, Option(metavar="DIR", help="of a run over a folder: where its pictures are")
    ] = None,
    trust: Annotated[
        bool, Option("--trust", help="of a run of your own: open pictures and models where it says they are")
    ] = False,
    model: Annotated[
        str | None,
        Option(
            metavar="M.onnx|built-in|none",
            help="a detector or text recogniser (default: the built-in detector, or the run's first)",
        ),
    ] = None,
    model_timeout_s: ModelTimeout = MODEL_TIMEOUT_S,
    camera: CameraName = None,
    figure: Annotated[
        list[str] | None,
        Option(metavar="NAME=NUMBER", help="of the camera, in place of its own: read_noise_e=12"),
    ] = None,
    grid: Grid,
    seed: Annotated[int, Option(metavar="N", help="of the noise")] = 0,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            parser=new_file,
            metavar="OUT.png",
            help="write this picture and what is told of it; no page",
        ),
    ] = None,
    host: Annotated[
        str, Option(metavar="ADDRESS", help="where the page is served; 0.0.0.0 for everybody")
    ] = "127.0.0.1",
    port: Annotated[int, Option(metavar="N", help="0: any that is free", min=0, max=65535)] = 0,
    browser: Annotated[bool, Option("--browser/--no-browser", help="open the page in the browser")] = True,
    as_json: Json = False,
) -> None:
    """Explore what exposure, light, motion, gain and camera do to a picture, and to
    what a detector finds in it, in a page of sliders on this machine.

      blurnoise explore
      blurnoise explore photo.jpg --model detector.onnx
      blurnoise explore run
      blurnoise explore photo.jpg --exposure-ms 20 --lux 5 --dx 800 -o seen.png

    "Copy as command" on the page gives a line like the last, which writes the same
    picture bit for bit.
    """
    if output is None and not _installed():
        raise ValueError(_EXTRA)
    shelf, state = _asked(
        where, sign, cell, picture, images, trust, model, model_timeout_s, camera, figure or [], grid, seed
    )
    if output is not None:
        _write(shelf, state, output, as_json)
        return
    from blurnoise_eval.explorer.server import serve

    serve(
        shelf,
        state,
        host=host,
        port=port,
        browser=browser,
        say=lambda url: say(f"explorer: {url}  (Ctrl-C ends it)"),
    )


def _installed() -> bool:
    from importlib.util import find_spec

    return find_spec("nicegui") is not None


def _asked(
    where: Path | None,
    sign: int | None,
    cell: str | None,
    picture: str | None,
    images: Path | None,
    trust: bool,
    model: str | None,
    timeout_s: float,
    camera: str | None,
    figures: list[str],
    grid: Grid,
    seed: int,
) -> tuple[Shelf, State]:
    """What there is to look at, and where one begins. Raises ``ValueError``."""
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise.optics.camera import PRESETS
    from blurnoise_eval.explorer.runs import Run
    from blurnoise_eval.explorer.shelf import Shelf, cell_state
    from blurnoise_eval.explorer.state import BUILT_IN, NO_MODEL, OF_RUN, State, figure
    from blurnoise_eval.grid.axes import AXES
    from blurnoise_eval.grid.conditions import Conditions
    from blurnoise_eval.system.files import RUN_FILE

    for axis in AXES:
        if len(grid.get(axis.name, ())) > 1:
            raise ValueError(f"{axis.option}: must be one value here; a sweep takes several")
    is_run = where is not None and (where.is_dir() or where.name == RUN_FILE)
    run = None
    if is_run and where is not None:
        run = Run(where if where.is_dir() else where.parent, images, trusted=trust)
    of_run = {"cell": cell, "picture": picture, "images": images, "trust": trust or None}
    for name, value in of_run.items():
        if value is not None and run is None:
            raise ValueError(f"{name}: goes with a run")
    if sign is not None and where is not None:
        raise ValueError("sign: goes without a picture or a run")
    opened = model not in (None, NO_MODEL, BUILT_IN)
    shelf = Shelf(
        STOP_SIGN,
        image=None if is_run else where,
        run=run,
        model=Path(str(model)) if opened else None,
        timeout_s=timeout_s,
    )
    shown: dict[str, Any] = {"picture": "given-picture" if where else f"sign-{1 if sign is None else sign}"}
    shown["model"] = "given-model" if opened else model or BUILT_IN
    if run is not None:
        shown |= {"picture": f"{OF_RUN}/{picture or run.pictures[0]}", "camera": camera or OF_RUN}
        shown |= {} if model else {"model": f"{OF_RUN}/{run.models[0]}"}
    else:
        shown["camera"] = camera or _default(shelf, State(picture=shown["picture"]), shown["model"])
    if camera and camera not in PRESETS:
        shown["camera"] = shelf.place_camera(Path(camera))
    values = {name: values[0] for name, values in grid.items()}
    state = State(**shown, at=Conditions(**values), figures=tuple(sorted(map(figure, figures))), seed=seed)
    if cell is not None:
        state = cell_state(shelf, cell, state)
    elif run is not None and picture is None and not camera:
        state = _first_cell(shelf, state)
    shelf.camera(state)
    shelf.subject(state)
    return shelf, state


def _default(shelf: Shelf, state: State, model: str) -> str:
    """The name of the camera that a sweep would take."""
    from blurnoise_eval.explorer.state import BUILT_IN
    from blurnoise_eval.sweep.default_camera import default_camera, is_grey

    built_in = model == BUILT_IN
    colour = built_in or not is_grey(shelf.subject(state).scene.image8)
    return default_camera(colour=colour, built_in=built_in).name


def _first_cell(shelf: Shelf, state: State) -> State:
    """The run's cell in the middle of its map."""
    from blurnoise_eval.explorer.shelf import cell_state

    run = shelf.run
    if run is None:
        return state
    found = run.heat_map(run.models[0])
    at = {axis.name: value for axis, value in found.fixed} | {
        found.across.name: found.columns[len(found.columns) // 2]
    }
    at |= {found.down.name: found.rows[len(found.rows) // 2]} if found.down else {}
    return cell_state(shelf, run.cell_at(at, run.pictures[0]), state)


def _write(shelf: Shelf, state: State, output: Path, as_json: bool) -> None:
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.explorer.looking import seen

    model = shelf.model(state)
    found = seen(
        state, shelf.subject(state), shelf.camera(state), model, criterion=shelf.criterion(state, model)
    )
    write_picture(output, found.image)
    facts: dict[str, Any] = {"output": str(output), "camera": found.camera.name}
    facts |= {each.name: each.value for each in found.numbers}
    if found.sight is not None:
        facts["confidence"] = found.confidence
        facts["confidences"] = [float(row["confidence"]) for row in found.sight.targets]
    print_facts(facts, as_json)
