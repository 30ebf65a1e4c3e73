"""``blurnoise quality``: every metric of simulated charts against exposure, light and motion."""

from __future__ import annotations

from blurnoise_eval.cli import given as given_by
from blurnoise_eval.cli._options import Json, NewFolder, settings
from blurnoise_eval.grid.plan_file import PlanFile
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json

USUAL = {
    "exposure_ms": "0.5,1,2,5,10,15,20,30,45,60,90",
    "lux": "5,50,500",
    "dx": "0,200,500,1000",
    "gain": "0",
}


@settings(PlanFile, "camera", "*", template=False)
def quality(
    *,
    given: PlanFile,
    output: NewFolder,
    as_json: Json = False,
) -> None:
    """What exposure, light and motion do to a camera's picture, in numbers: on simulated charts MTF50, edge SNR,
    CNR, patch SNR, information capacity, NEQ, SNRI, Michelson contrast, CDP, PSNR and SSIM, with intervals.

      blurnoise quality -o quality                     5, 50 and 500 lux
      blurnoise quality -o quality --camera mine.yaml --lux 20 --dx 0,100

    Unless told otherwise, exposures of 0.5 to 90 ms, 5, 50 and 500 lux, 0 to 1000 px/s, gain 0 and two noise
    fields per chart. Writes DIR/quality.csv (a row per condition and metric), DIR/quality.json, and per light a
    picture in DIR/figures: every metric against exposure, a line per speed. Where a number is not available
    (saturated, lost in noise, blurred beyond its chart) the flags say why.
    """
    camera = given_by.camera(given.camera, given.cfa, colour=False)
    workers = given_by.threads(given.threads)
    from blurnoise_eval.quality import figures as quality_figures
    from blurnoise_eval.quality import measure as quality

    plan = given.sweep_plan(USUAL, repeats=2)
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
