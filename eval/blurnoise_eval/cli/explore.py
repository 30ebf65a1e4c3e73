"""``blurnoise explore``: a page with sliders for a picture or a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import Json, ModelTimeout, Trust, new_file
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.plan.files import MODEL_TIMEOUT_S
from blurnoise_eval.system.terminal import say

if TYPE_CHECKING:
    from blurnoise_eval.explorer.catalogue import Catalogue
    from blurnoise_eval.explorer.state import State

_EXTRA = (
    'explore: the page needs Starlette and Uvicorn: pip install "blurnoise[explore]"; '
    "-o OUT.png works without it"
)


def explore(
    *,
    where: Annotated[
        Path | None,
        Argument(
            metavar="IMAGE|RUN", help="a picture, or the folder of a run (default: rendered stop signs)"
        ),
    ] = None,
    at: Annotated[
        str | None,
        Option(
            metavar="QUERY",
            help="initial settings, as in the address of the page, joined by &: exposure-ms=20, lux=5, "
            "read_noise_e=12, picture=sign-3, seed=1",
        ),
    ] = None,
    cell: Annotated[
        str | None, Option(metavar="ID", help="cell_id of a run's results.csv; the cell is computed again")
    ] = None,
    images: Annotated[Path | None, Option(metavar="DIR", help="folder of the pictures of a run")] = None,
    trust: Trust = False,
    model: Annotated[
        str | None,
        Option(
            metavar="M.onnx|built-in|none",
            help="detector (default: the first of the run, or the built-in detector)",
        ),
    ] = None,
    model_timeout_s: ModelTimeout = MODEL_TIMEOUT_S,
    camera: Annotated[
        str | None, Option(metavar="NAME|FILE", help="a preset or a camera file (default: as for a sweep)")
    ] = None,
    grey_anchor: Annotated[
        str | None,
        Option(
            metavar="mean|pNN|x0,y0,x1,y1",
            help="part of the picture that reflects 18 %: its mean, a percentile, or a region in px (default: none; "
            "brightness is used as reflectance)",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            parser=new_file,
            metavar="OUT.png",
            help="write the picture instead of serving the page",
        ),
    ] = None,
    port: Annotated[
        int, Option(metavar="N", help="port of the page on this machine; 0: any free port", min=0, max=65535)
    ] = 0,
    browser: Annotated[bool, Option("--browser/--no-browser", help="open the page in the browser")] = True,
    as_json: Json = False,
) -> None:
    """Open a page with sliders for exposure, light, motion, gain and camera. The page shows the simulated picture
    and the detections in it.

      blurnoise explore
      blurnoise explore photo.jpg --model detector.onnx
      blurnoise explore run
      blurnoise explore photo.jpg --at 'exposure-ms=20&lux=5' -o out.png

    The page is served to this machine only. To see it on another one, start it with --port 8080 and run
    ssh -L 8080:127.0.0.1:8080 HOST there. "Copy as Command" on the page gives a command like the last example, which
    writes the same picture bit for bit.
    """
    from importlib.util import find_spec

    from blurnoise_eval.explorer.catalogue import Catalogue
    from blurnoise_eval.plan.reading import anchor_of

    if output is None and None in map(find_spec, ("starlette", "uvicorn")):
        raise ValueError(_EXTRA)
    catalogue = Catalogue(
        where,
        images=images,
        trust=trust,
        model=model,
        camera=camera,
        grey_anchor=anchor_of(grey_anchor),
        timeout_s=model_timeout_s,
    )
    state = catalogue.start(at, cell=cell)
    if output is not None:
        _write(catalogue, state, output, as_json)
        return
    from blurnoise_eval.explorer.server import serve

    catalogue.subject(state)

    def started(url: str) -> None:
        say(f"explorer: {url}  (Ctrl-C ends it)")

    serve(catalogue, state, port=port, browser=browser, say=started)


def _write(catalogue: Catalogue, state: State, output: Path, as_json: bool) -> None:
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.explorer.state import GIVEN
    from blurnoise_eval.explorer.verdict import mean_confidence
    from blurnoise_eval.plan.axes import HEADLAMP
    from blurnoise_eval.plan.conditions import reflectance_text

    rendered = catalogue.render(state)
    write_picture(output, rendered.frame.image)
    facts: dict[str, Any] = {"output": str(output), "camera": rendered.exposure.camera.name}
    facts |= {name: value for name, (_, value, _) in rendered.numbers.items()}
    if state.at[HEADLAMP.name] and HEADLAMP.name not in catalogue.controls(state):
        facts["headlamps"] = "light nothing, as the picture has no labelled targets"
    if state.picture == GIVEN:
        facts["reflectance"] = reflectance_text(catalogue.grey_anchor, "--grey-anchor")
    if rendered.scored is not None:
        counted = rendered.scored.counted
        facts["confidence"] = mean_confidence(counted) if counted.targets else None
        facts["confidences"] = [row.confidence for row in counted.targets]
    print_facts(facts, as_json)
