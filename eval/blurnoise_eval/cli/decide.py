"""``blurnoise decide``: the exposures that a sweep recommends, from fewer conditions, by a search."""

from __future__ import annotations

from blurnoise_eval.cli._options import Folder, Json, settings
from blurnoise_eval.cli.sweep import computed
from blurnoise_eval.plan.files import PlanFile


@settings(
    PlanFile, "model", "images", "labels", "limit", "camera", "*", "grey_anchor", "picture_tone", "keep", "threads",
    template=False,
)  # fmt: skip
def decide(*, config: PlanFile, output: Folder, as_json: Json = False) -> None:
    """Find the exposure to use under each light and at each speed, from fewer conditions than a sweep.

      blurnoise decide --model a.onnx --coco instances.json -o run
      blurnoise decide --images DIR --lux 5:200 --dx 0,150,400 -o run

    The search computes a few conditions of the grid of exposures, lights and speeds at a time. It goes on where
    another exposure may gain most, and stops when none promises more than 0.03. A sweep computes the whole grid, and
    also finds where exposures cease to work. 'blurnoise sweep' in the same folder continues with what is there.

    A large grid is searched in another way where conditions with the same lux x seconds and the same blur in px give
    the same picture: at most about 80 conditions for all lights and speeds, and predictions between them.

    An interrupted search continues when you run the same command again. 'blurnoise sweep --save-plan' writes a file
    for --plan.
    """
    computed(config, output, as_json, "search")
