#!/usr/bin/env bash
# faster-coco-eval 1.8.0: labels without "area" all count as small objects.
# Expected: an error, as in pycocotools, or width times height, as hotcoco 1.3.0 does.
# Seen: the area is taken as 0, without a word: a perfect detection of a box of 200 x 200 has AP small 1 and AP large -1.
# Hurt: who reads AP by size of labels from tools that leave the optional field out.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check faster-coco-eval==1.8.0 hotcoco==1.3.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import contextlib
import io
import json

import hotcoco
from faster_coco_eval import COCO, COCOeval_faster

labels = {
    "images": [{"id": 1, "file_name": "a.png", "width": 640, "height": 480}],
    "categories": [{"id": 1, "name": "sign"}],
    "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [10, 10, 200, 200], "iscrowd": 0}],
}
found = [{"image_id": 1, "category_id": 1, "bbox": [10, 10, 200, 200], "score": 0.9}]
for name, content in (("labels.json", labels), ("found.json", found)):
    with open(name, "w") as file:
        json.dump(content, file)
sizes = {}
with contextlib.redirect_stdout(io.StringIO()):
    for name, reader, judge, load in (
        ("faster-coco-eval", COCO, COCOeval_faster, "loadRes"),
        ("hotcoco", hotcoco.COCO, hotcoco.COCOeval, "load_res"),
    ):
        truth = reader("labels.json")
        evaluation = judge(truth, getattr(truth, load)("found.json"), "bbox")
        evaluation.evaluate(), evaluation.accumulate(), evaluation.summarize()
        sizes[name] = [round(float(s), 6) for s in list(evaluation.stats)[3:6]]
print("AP of small, medium, large:", sizes)
assert sizes == {"faster-coco-eval": [1.0, -1.0, -1.0], "hotcoco": [-1.0, -1.0, 1.0]}
PY
