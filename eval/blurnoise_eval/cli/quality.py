"""``blurnoise quality``: every metric of simulated charts against exposure, light and motion."""

from __future__ import annotations

import argparse
import json

from blurnoise_eval.cli import given
from blurnoise_eval.cli.arguments_axes import grid
from blurnoise_eval.cli.arguments_quality import USUAL
from blurnoise_eval.cli.console import ProgressBar


def quality(options: argparse.Namespace) -> int:
    """Measure charts under every condition; tables, figures, and the exposure that tells most."""
    from blurnoise_eval.drawing.photon_transfer import find

    camera = find(options.camera)
    threads = given.threads(options)
    from blurnoise_eval.grid.conditions import SweepPlan
    from blurnoise_eval.quality import figures as quality_figures
    from blurnoise_eval.quality import measure as quality
    from blurnoise_eval.quality import table as quality_table

    plan = SweepPlan(grid(options, USUAL), repeats=options.repeats, seed=options.seed)
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
