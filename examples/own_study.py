"""A study from Python: pictures, camera, detector, conditions, tables for pandas and a figure."""

import matplotlib.pyplot as plt
import pandas as pd
from blurnoise_eval import STOP_SIGN, Detector, SweepPlan, datasets, evaluate

from blurnoise import Camera

# Data. Your own: datasets.coco("instances.json"), datasets.yolo("data.yaml") or datasets.image_folder("photos").
pictures = datasets.rendered_signs((50, 32), count=8)

# Camera. Your own: Camera.load("mine.yaml").
camera = Camera.preset("imx250c")

# Detector: the path of an ONNX file, or a function of your own. This one calls the built-in detector.
network = Detector(STOP_SIGN)


def find(picture):
    """Boxes (N, 4) as left, top, right, bottom in px, scores (N,) and class names (N,) of an RGB picture."""
    found = network.detect(picture)
    return found.boxes_xyxy, found.scores, ["stop sign"] * len(found)


# Conditions in SI units. The gain is automatic.
grid = {"exposure_s": (0.001, 0.003, 0.01, 0.03), "illuminance_lux": (1, 20), "velocity_x_px_s": (0, 1000)}
study = evaluate(find, pictures, camera, SweepPlan({**grid, "gain_db": ("auto",)}), output="study")

answers, scores = pd.DataFrame(study.answers), pd.DataFrame(study.scores)
columns = ["group", "illuminance_lux", "velocity_x_px_s", "verdict", "recommended_s"]
print(answers[columns].to_string())

figure, axes = plt.subplots()
for (lux, speed), line in scores[scores["clean"] == 0].groupby(["illuminance_lux", "velocity_x_px_s"]):
    line = line.sort_values("exposure_s")
    axes.semilogx(line["exposure_s"], line["target_confidence"], "o-", label=f"{lux:g} lux, {speed:g} px/s")
axes.set(xlabel="exposure / s", ylabel="mean confidence")
axes.legend()
figure.savefig("study.png")
print(study.report())  # the page, and all tables and figures, in the folder "study"
