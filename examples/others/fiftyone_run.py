"""Show a run in the FiftyOne App: its simulated pictures with targets, detections and conditions.

  blurnoise sweep -o run
  blurnoise report run --coco   # the detections, run/coco/MODEL.json
  python examples/others/fiftyone_run.py run

A sample is a picture under one condition. Each target has the confidence that the model gives it.
"""

import argparse
import json
import re
from collections import defaultdict
from pathlib import Path

import fiftyone
from blurnoise_eval import AXES, Run, datasets

PICTURES = 20
LEAST_SCORE = 0.05
COLUMNS = [axis.name for axis in AXES if not axis.automatic]


def detection(label: str, box: list[float], size: tuple[int, int], **values: object) -> fiftyone.Detection:
    """box: left, top, width and height in px of a picture of this height and width; FiftyOne has shares of them."""
    height, width = size
    x, y, w, h = box
    return fiftyone.Detection(
        label=label, bounding_box=[x / width, y / height, w / width, h / height], **values
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument(
        "--no-app", action="store_true", help="make the data set 'blurnoise', but do not show it"
    )
    options = parser.parse_args()

    run = Run.open(options.run, trust=True)
    pictures = options.run / "fiftyone"
    pictures.mkdir(exist_ok=True)
    targets, detections = defaultdict(list), defaultdict(list)
    for row in run.targets:
        targets[row["model"], row["cell_id"]].append(row)
    for model in run.models:
        truth = json.loads((options.run / "coco" / f"{model['model']}-instances.json").read_text())
        names = {category["id"]: category["name"] for category in truth["categories"]}
        for row in json.loads((options.run / "coco" / f"{model['model']}.json").read_text()):
            if row["score"] >= LEAST_SCORE:
                detections[model["model"], row["cell_id"]].append((names[row["category_id"]], row))

    samples: dict[str, fiftyone.Sample] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for cell in run.cells:
        name, shown = cell["cell_id"], list(run.pictures)[:PICTURES]
        if cell["image"] not in shown or cell["repeat"]:
            continue
        if name not in samples:  # the first model of several
            pixels = run.picture(cell["image"]).load() if cell["clean"] else run.simulate(name)
            datasets.write_picture(pictures / f"{name}.png", datasets.eight_bit(pixels))
            values = {column: cell[column] for column in (*COLUMNS, "blur_px", "applied_gain_db", "snr_db")}
            conditions = {column: value for column, value in values.items() if value is not None}
            tags = ["original" if cell["clean"] else "simulated"]
            file = str((pictures / f"{name}.png").resolve())
            samples[name] = fiftyone.Sample(
                file, tags=tags, picture=cell["image"], cell_id=name, **conditions
            )
            sizes[name] = pixels.shape[:2]
        field = re.sub(r"\W", "_", cell["model"])
        samples[name][f"targets_{field}"] = fiftyone.Detections(
            detections=[
                detection(
                    row["label"],
                    [row["x0"], row["y0"], row["width_px"], row["height_px"]],
                    sizes[name],
                    confidence=row["confidence"],
                    group=row["group"],
                )
                for row in targets[cell["model"], name]
            ]
        )
        samples[name][f"detections_{field}"] = fiftyone.Detections(
            detections=[
                detection(label, row["bbox"], sizes[name], confidence=row["score"])
                for label, row in detections[cell["model"], name]
            ]
        )

    dataset = fiftyone.Dataset("blurnoise", overwrite=True)
    dataset.add_samples(samples.values())
    print(dataset)
    if not options.no_app:
        fiftyone.launch_app(view=dataset.group_by("picture", order_by="exposure_s")).wait()
