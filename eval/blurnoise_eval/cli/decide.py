"""``blurnoise decide``: the answers of a sweep from fewer pictures, by a search."""

from __future__ import annotations

from blurnoise_eval.cli._options import Folder, Json, settings
from blurnoise_eval.cli.sweep import computed
from blurnoise_eval.plan.files import PlanFile


@settings(
    PlanFile, "model", "images", "labels", "camera", "*", "grey_anchor", "picture_tone", "keep", "threads",
    template=False,
)  # fmt: skip
def decide(*, config: PlanFile, output: Folder, as_json: Json = False) -> None:
    """Find the exposures that work under each light and at each speed, with fewer pictures than a sweep.

      blurnoise decide --model a.onnx --coco instances.json -o run
      blurnoise decide --images DIR --lux 5:200 --dx 0,150,400 -o run

    Conditions with the same lux x seconds and the same blur in px give the same picture. The search uses this: it
    computes at most about 80 conditions for all lights and speeds. 'blurnoise sweep' computes the whole grid of
    exposures, lights and speeds.

    The whole grid is computed if conditions cannot be shared in this way: with dark current, several directions or
    gains, a trajectory, or ego-motion. It is also computed if it has fewer conditions. The output gives the reason.

    An interrupted search continues when you run the same command again. A search with more lights or speeds in the
    same folder starts from the conditions that are already there. 'blurnoise sweep --save-plan' writes a file for
    --plan.
    """
    computed(config, output, as_json, "search")
