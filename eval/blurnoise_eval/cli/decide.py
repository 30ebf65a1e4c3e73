"""``blurnoise decide``: the same answers as a sweep's from a fraction of its pictures, by a search."""

from __future__ import annotations

from blurnoise_eval.cli._options import Folder, Json, settings
from blurnoise_eval.cli.sweep import computed
from blurnoise_eval.grid.plan_file import PlanFile


@settings(
    PlanFile, "model", "images", "labels", "camera", "*", "picture_tone", "keep", "threads", template=False
)
def decide(*, given: PlanFile, output: Folder, as_json: Json = False) -> None:
    """Say which exposure works, and how sure that is, under every light and at every speed, from few conditions.

      blurnoise decide --model a.onnx --coco instances.json -o run
      blurnoise decide --images DIR --lux 5:200 --dx 0,150,400 -o run

    Conditions with the same lux x seconds and the same motion in px are one experiment. So a search asks on that
    plane, at most about 80 conditions for all lights and speeds, where 'blurnoise sweep' computes a grid over
    exposure, light and speed. Where the plane does not hold (dark current, several directions or gains, a trajectory,
    a camera that drives), or where the grid has fewer conditions, it is that grid, and the answer says why.
    Stopped, it goes on when the same command is given again; a wider question in the same folder begins with what is
    there. A plan is that of 'blurnoise sweep --save-plan'.
    """
    from blurnoise_eval.deciding.decision import decided

    computed(decided, given, output, as_json)
