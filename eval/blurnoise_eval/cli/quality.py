"""``blurnoise quality``: every metric of simulated charts against exposure, light and motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from blurnoise_eval.cli import given
from blurnoise_eval.cli._options import CameraName, Grid, Json, axis_options, new_folder
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json, show


@axis_options(
    exposure_s="0.5,1,2,5,10,15,20,30,45,60,90",
    illuminance_lux="5,50,500",
    velocity_x_px_s="0,200,500,1000",
    gain_db="0",
)
def quality(
    *,
    grid: Grid,
    repeats: Annotated[int, Option(metavar="N", help="noise fields per chart")] = 2,
    seed: Annotated[int, Option(metavar="N", help="of the noise")] = 0,
    camera: CameraName = None,
    threads: Annotated[
        int | None, Option(metavar="N", help="conditions at a time (default: every core)")
    ] = None,
    output: Annotated[
        Path, Option("-o", "--output", parser=new_folder, metavar="DIR", help="for everything")
    ],
    as_json: Json = False,
) -> None:
    """What exposure, light and motion do to a camera's picture, in numbers: on simulated charts MTF50, edge SNR,
    CNR, patch SNR, information capacity, NEQ, SNRI, Michelson contrast, CDP, PSNR and SSIM, with intervals.

      blurnoise quality -o quality                                    the built-in camera at 5, 50 and 500 lux
      blurnoise quality -o quality --camera mine.yaml --lux 20 --dx 0,100

    Writes DIR/quality.csv (a row per condition and metric), DIR/quality.json, and per light two pictures in
    DIR/figures: every metric against exposure, a line per speed, and against blur, a line per exposure. Where a
    number cannot be told (saturated, lost in noise, blurred beyond its chart) there is none, and the flags say why.
    """
    exposed_by = given.camera(camera, colour=False)
    workers = given.threads(threads)
    from blurnoise_eval.grid.conditions import SweepPlan
    from blurnoise_eval.quality import figures as quality_figures
    from blurnoise_eval.quality import measure as quality
    from blurnoise_eval.quality import table as quality_table

    plan = SweepPlan(grid, repeats=repeats, seed=seed)
    quality.check(exposed_by, plan)
    output.mkdir(parents=True, exist_ok=True)
    with ProgressBar("quality", len(plan.conditions())) as advance:
        rows = quality.measure(exposed_by, plan, threads=workers, progress=advance)
    quality_table.write(rows, exposed_by, plan, output)
    figures = quality_figures.write(rows, exposed_by.name, output / "figures")
    best = quality_table.most_information(rows)
    if as_json:
        told = {"rows": len(rows), "figures": [str(path) for path in figures], "most_information": best}
        say_json({"output": str(output), **told})
        return
    show(quality_figures.table(best))
    say(f"open {', '.join(map(str, figures))}")
