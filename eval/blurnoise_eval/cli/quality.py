"""``blurnoise quality``: every metric of simulated charts against exposure, light and motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

from blurnoise_eval.cli import given as given_by
from blurnoise_eval.cli._options import Json, NewFolder, settings
from blurnoise_eval.grid.axes import AXES, EGO, MOVES
from blurnoise_eval.grid.plan_file import LISTS, PlanFile, with_axes
from blurnoise_eval.grid.settings import setting
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json

USUAL = {
    "exposure_ms": "0.5,1,2,5,10,15,20,30,45,60,90",
    "lux": "5,50,500",
    "dx": "0,200,500,1000",
    "dy": "0",
    "gain": "0",
}
_AXES = tuple(  # charts have no one mean that a camera would meter
    replace(each, automatic=False, about=each.about.partition("; auto")[0]) for each in AXES
)


@dataclass(frozen=True)
class ChartPlan(with_axes(LISTS, "LIST", USUAL, _AXES), PlanFile):  # type: ignore[misc]  # its fields are the table's
    """A plan with this command's defaults for camera and axes."""

    camera: str | None = setting(None, "a preset or a file (default: imx250m)", "NAME|FILE")


@settings(
    ChartPlan,
    "camera",
    *(each.key for each in _AXES if each.name not in (MOVES.name, EGO.name)),
    template=False,
)
def quality(*, given: ChartPlan, output: NewFolder, as_json: Json = False) -> None:
    """What exposure, light and motion do to a camera's picture, in numbers: on simulated charts MTF50, edge SNR,
    CNR, patch SNR, information capacity, NEQ, SNRI, Michelson contrast, CDP, PSNR and SSIM, with intervals.

      blurnoise quality -o quality                     5, 50 and 500 lux
      blurnoise quality -o quality --camera mine.yaml --lux 20 --dx 0,100

    Each chart has two noise fields unless the plan states repeats. Writes DIR/quality.csv (a row per condition and
    metric), DIR/quality.json, and per light a picture in DIR/figures: every metric against exposure, a line per
    speed. Where a number is not available (saturated, lost in noise, blurred beyond its chart) the flags say why.
    """
    camera = given_by.camera(given.camera, given.cfa, colour=False)
    workers = given_by.threads(given.threads)
    from blurnoise_eval.quality import figures as quality_figures
    from blurnoise_eval.quality import measure as quality

    plan = given.sweep_plan(repeats=2)
    quality.check(camera, plan)
    output.mkdir(parents=True, exist_ok=True)
    with ProgressBar("quality", len(plan.conditions())) as advance:
        rows = quality.measure(
            camera, plan.conditions(), repeats=plan.repeats, seed=plan.seed, threads=workers, progress=advance
        )
    quality.write(rows, camera, plan, output)
    figures = quality_figures.write(rows, camera.name, output / "figures")
    if as_json:
        say_json({"output": str(output), "rows": len(rows), "figures": [str(path) for path in figures]})
        return
    say(f"open {', '.join(map(str, figures))}")
