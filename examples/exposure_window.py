"""The exposure window of one's own detector: from which exposure to which does it work, and which should be used?

    python examples/exposure_window.py [MODEL.onnx] [instances.json]

Without arguments: the built-in stop-sign detector, before rendered signs.
"""

import sys
import tempfile

from blurnoise_eval import SweepPlan, datasets, evaluate

model, labels = (*sys.argv[1:], None, None)[:2]
plan = SweepPlan(
    {
        "exposure_s": (0.001, 0.003, 0.01, 0.03, 0.09),
        "illuminance_lux": (0.5,),
        "velocity_x_px_s": (0.0, 1000.0),
    }
)
with tempfile.TemporaryDirectory() as folder:
    pictures = datasets.coco(labels) if labels else None
    answers = evaluate(model, pictures, camera="imx250", plan=plan, output=folder).answers

for answer in answers:
    told = f"{answer['group']}, {answer['velocity_x_px_s']:g} px/s: {answer['verdict']}"
    for begins_s, ends_s in answer["windows_s"]:
        told += f", {1e3 * begins_s:.3g} to {1e3 * ends_s:.3g} ms"
    if answer["verdict"] == "works":
        told += f": use {1e3 * answer['recommended_s']:.3g} ms"
    print(told)
