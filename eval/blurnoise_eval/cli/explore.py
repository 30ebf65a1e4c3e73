"""``blurnoise explore``: a picture, or a run, in a page of sliders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import Json, ModelTimeout, new_file
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.grid.plan_file import MODEL_TIMEOUT_S
from blurnoise_eval.system.terminal import say

if TYPE_CHECKING:
    from blurnoise_eval.explorer.catalogue import Catalogue
    from blurnoise_eval.explorer.state import State

_EXTRA = 'explore: needs NiceGUI: pip install "blurnoise[explore]"; with -o it writes the picture without'


def explore(
    *,
    where: Annotated[
        Path | None,
        Argument(
            metavar="IMAGE|RUN", help="a picture, or the folder of a sweep (default: rendered stop signs)"
        ),
    ] = None,
    at: Annotated[
        str | None,
        Option(
            metavar="QUERY",
            help="where to begin, as in the page's address: exposure-ms=20&lux=5&dx=800, read_noise_e=12, "
            "picture=sign-3, seed=1",
        ),
    ] = None,
    cell: Annotated[
        str | None, Option(metavar="ID", help="of a run: a cell of results.csv, computed anew")
    ] = None,
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
            help="a detector (default: the built-in detector, or the run's first)",
        ),
    ] = None,
    model_timeout_s: ModelTimeout = MODEL_TIMEOUT_S,
    camera: Annotated[
        str | None, Option(metavar="NAME|FILE", help="a preset, or a camera's file (default: as a sweep)")
    ] = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", parser=new_file, metavar="OUT.png", help="write the picture; no page"),
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
      blurnoise explore photo.jpg --at 'exposure-ms=20&lux=5&dx=800' -o seen.png

    "Copy as command" on the page gives a line like the last, which writes the same
    picture bit for bit.
    """
    from importlib.util import find_spec

    from blurnoise_eval.explorer.catalogue import Catalogue

    if output is None and find_spec("nicegui") is None:
        raise ValueError(_EXTRA)
    catalogue = Catalogue(
        where, images=images, trust=trust, model=model, camera=camera, timeout_s=model_timeout_s
    )
    query = at if cell is None else "&".join(filter(None, (at, f"cell={cell}")))
    state = catalogue.start(query)
    if output is not None:
        _write(catalogue, state, output, as_json)
        return
    from blurnoise_eval.explorer.server import serve

    catalogue.subject(state)

    def started(url: str) -> None:
        say(f"explorer: {url}  (Ctrl-C ends it)")

    serve(catalogue, state, host=host, port=port, browser=browser, say=started)


def _write(catalogue: Catalogue, state: State, output: Path, as_json: bool) -> None:
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.explorer.rendered import mean_confidence

    found = catalogue.render(state)
    write_picture(output, found.frame.image)
    facts: dict[str, Any] = {"output": str(output), "camera": found.exposure.camera.name}
    facts |= {name: value for name, (_, value, _) in found.numbers.items()}
    if found.sight is not None:
        facts["confidence"] = mean_confidence(found.sight) if found.sight.targets else None
        facts["confidences"] = [float(row["confidence"]) for row in found.sight.targets]
    print_facts(facts, as_json)
