#!/usr/bin/env bash
# labelformat 0.1.17 meets evaluators: COCO labels that it has passed through are no longer labels to them.
# Expected: COCO to COCO keeps what the format needs: a number, an area and whether it is a crowd.
# Seen: annotations keep picture, category and box only. pycocotools 2.0.11 ends with KeyError('id'); hotcoco 1.3.0 reads on
# with a warning, every annotation numbered 0, so perfect detections score .11.
# Hurt: who converts or filters labels before an evaluation.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check labelformat==0.1.17 pycocotools==2.0.11 hotcoco==1.3.0 pillow==13.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import contextlib
import io
import json
import subprocess
from pathlib import Path

import hotcoco
from pycocotools.coco import COCO

labels = {
    "images": [{"id": 1, "file_name": "a.jpg", "width": 400, "height": 400}],
    "categories": [{"id": 1, "name": "sign"}],
    "annotations": [
        {"id": i, "image_id": 1, "category_id": 1, "bbox": [80 * i, 10, 50, 50], "area": 2500, "iscrowd": 0}
        for i in (1, 2, 3)
    ],
}
Path("labels.json").write_text(json.dumps(labels))
command = "venv/bin/labelformat convert --task object-detection --input-format coco --input-file labels.json"
command += " --output-format coco --output-file passed.json"
subprocess.run(command.split(), check=True, capture_output=True)
passed = json.loads(Path("passed.json").read_text())["annotations"]
Path("found.json").write_text(json.dumps([a | {"score": 0.9} for a in passed]))
try:
    COCO("passed.json")
except KeyError as error:
    refused = error
scores = {}
for name in ("labels.json", "passed.json"):
    with contextlib.redirect_stdout(io.StringIO()):
        truth = hotcoco.COCO(name)
        evaluation = hotcoco.COCOeval(truth, truth.load_res("found.json"), "bbox")
        evaluation.evaluate(), evaluation.accumulate(), evaluation.summarize()
    scores[name] = float(list(evaluation.stats)[0])
print(passed[0], "pycocotools:", repr(refused), "hotcoco:", scores)
assert set(passed[0]) == {"image_id", "category_id", "bbox"} and refused.args == ("id",)
assert scores["labels.json"] == 1.0 and scores["passed.json"] < 0.3
PY
