"""``blurnoise quality``: measure simulated charts over exposure, light and motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import Json, NewFolder, settings
from blurnoise_eval.plan.axes import AXES, EGO, MOVES
from blurnoise_eval.plan.files import PlanFile
from blurnoise_eval.plan.plan import SweepPlan, with_defaults
from blurnoise_eval.plan.settings import Text, nested, setting
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json

_AXES = with_defaults(
    [  # a camera has no single mean of all charts to meter
        replace(each, automatic=False, about=each.about.partition("; auto")[0]) for each in AXES
    ],
    exposure_s=[ms / 1e3 for ms in (0.5, 1, 2, 5, 10, 15, 20, 30, 45, 60, 90)],
    illuminance_lux=(5, 50, 500),
    velocity_x_px_s=(0, 200, 500, 1000),
    velocity_y_px_s=(0,),
    gain_db=(0,),
)


@dataclass(frozen=True, kw_only=True)
class ChartPlan(SweepPlan):
    """A plan with this command's defaults of axes and repeats."""

    AXES = _AXES

    repeats: int = setting(2, "number of repeats with other noise (default: 1; 2 for charts)")


@dataclass(frozen=True)
class ChartFile(PlanFile):
    """A plan's file with the defaults of this command."""

    plan: ChartPlan = nested(ChartPlan)
    camera: Text | None = setting(None, "a preset or a camera file (default: imx250m)", "NAME|FILE")


@settings(
    ChartFile,
    "camera",
    *(each.key for each in _AXES if each.name not in (MOVES.name, EGO.name)),
    template=False,
)
def quality(*, config: ChartFile, output: NewFolder, as_json: Json = False) -> None:
    """Measure image quality of simulated charts over exposure, light and motion. The metrics are MTF50, edge SNR,
    CNR, patch SNR, information capacity, NEQ, SNRI, Michelson contrast, CDP, PSNR and SSIM, with intervals.

      blurnoise quality -o quality             5, 50 and 500 lux
      blurnoise quality -o quality --camera mine.yaml --lux 20 --dx 0,100

    Each chart is simulated with two noise fields, or with as many as 'repeats' of the plan says. The command writes
    DIR/quality.csv (one row per condition and metric) and DIR/quality.json. For each light it draws a figure in
    DIR/figures: the metrics against exposure, one line per speed. Where a value is not available (saturated, lost in
    noise, blurred beyond the chart), its flags give the reason.
    """
    camera = inputs.camera(config.camera, config.cfa, colour=False)
    workers = inputs.threads(config.threads)
    from blurnoise_eval.measure import charts as quality
    from blurnoise_eval.measure import figures as quality_figures
    from blurnoise_eval.system.files import check_outputs

    plan = config.plan
    quality.check(camera, plan)
    check_outputs(output, "quality.csv", "quality.json", "figures/exposure-*.png")
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
    say(f"figures: {', '.join(map(str, figures))}")
