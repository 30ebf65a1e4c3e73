"""``blurnoise quality``: every metric of simulated charts against exposure, light and motion."""

from __future__ import annotations

import argparse
import json

from blurnoise_eval.cli import given
from blurnoise_eval.system.progress import ProgressBar


def quality(options: argparse.Namespace) -> int:
    """Measure charts under every condition; tables, figures, and the exposure that tells most."""
    camera = given.camera(options)
    threads = given.threads(options)
    from blurnoise_eval.grid.conditions import Plan
    from blurnoise_eval.quality import figures as quality_figures
    from blurnoise_eval.quality import measure as quality
    from blurnoise_eval.quality import table as quality_table

    plan = Plan(
        exposures_s=tuple(value / 1e3 for value in options.exposure_ms),
        illuminances_lux=tuple(options.lux),
        velocities_x_px_s=tuple(options.dx),
        velocities_y_px_s=tuple(options.dy),
        repeats=options.repeats,
        seed=options.seed,
        temperature_c=options.temperature_c,
    )
    options.output.mkdir(parents=True, exist_ok=True)
    with ProgressBar("quality", len(plan.conditions())) as advance:
        rows = quality.measure(camera, plan, threads=threads, progress=advance)
    quality_table.write(rows, camera, plan, options.output)
    figures = quality_figures.write(rows, camera.name, options.output / "figures")
    best = quality_table.most_information(rows)
    if options.json:
        told = {"rows": len(rows), "figures": [str(path) for path in figures], "most_information": best}
        print(json.dumps({"output": str(options.output), **told}))
        return 0
    from rich.console import Console

    Console().print(quality_figures.table(best))
    print(f"open {', '.join(map(str, figures))}")
    return 0
