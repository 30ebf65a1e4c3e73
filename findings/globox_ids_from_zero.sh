#!/usr/bin/env bash
# globox 2.9.0 meets pycocotools 2.0.11: a data set in COCO's form whose perfect detections do not score 1.
# Expected: detections that are copies of the labels have AP 1.
# Seen: globox numbers annotations from 0; pycocotools takes a match with number 0 for no match: AP .25 of two boxes.
# hotcoco 1.3.0, said to be compatible, gives 1.0 of the same files.
# Hurt: who converts labels and compares models by small sets, or by both evaluators.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check globox==2.9.0 pycocotools==2.0.11 hotcoco==1.3.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import contextlib
import io
import json

import hotcoco
from globox import Annotation, AnnotationSet, BoundingBox
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

boxes = [BoundingBox.create(label="sign", coords=c) for c in ((10, 10, 60, 60), (100, 100, 180, 160))]
picture = Annotation("a.png", image_size=(200, 200), boxes=boxes)
AnnotationSet([picture]).save_coco("labels.json", auto_ids=True)
labels = json.load(open("labels.json"))
numbers = [a["id"] for a in labels["annotations"]]
found = [{k: a[k] for k in ("image_id", "category_id", "bbox")} | {"score": 0.9} for a in labels["annotations"]]
json.dump(found, open("found.json", "w"))
scores = {}
with contextlib.redirect_stdout(io.StringIO()):
    truth = COCO("labels.json")
    evaluation = COCOeval(truth, truth.loadRes("found.json"), "bbox")
    evaluation.evaluate(), evaluation.accumulate(), evaluation.summarize()
    scores["pycocotools"] = float(evaluation.stats[0])
    truth = hotcoco.COCO("labels.json")
    evaluation = hotcoco.COCOeval(truth, truth.load_res("found.json"), "bbox")
    evaluation.evaluate(), evaluation.accumulate(), evaluation.summarize()
    scores["hotcoco"] = float(evaluation.stats[0])
print("annotation numbers", numbers, "AP of perfect detections", scores)
assert numbers == [0, 1]
assert scores["hotcoco"] == 1.0 and scores["pycocotools"] < 0.6
PY
