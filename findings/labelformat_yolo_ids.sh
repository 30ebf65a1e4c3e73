#!/usr/bin/env bash
# labelformat 0.1.17: labels in COCO's form become YOLO labels that it cannot read back.
# Expected: classes numbered 0 to n - 1 in the YOLO files, as the format asks.
# Seen: COCO's own numbers stay: categories 3 and 7 give `nc: 2`, names {3, 7} and lines that begin with 3 and 7; reading
# the folder again is a KeyError: 0.
# Hurt: who trains on subsets of COCO or on sets numbered from 1 (a trainer sees class 7 of 2).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check labelformat==0.1.17 pillow==13.0.0
cd "$folder"
venv/bin/python - <<'PY'
import json
import subprocess
from pathlib import Path

from PIL import Image

Path("yolo/images").mkdir(parents=True)
Image.new("RGB", (100, 100)).save("yolo/images/a.jpg")
labels = {
    "images": [{"id": 1, "file_name": "a.jpg", "width": 100, "height": 100}],
    "categories": [{"id": 3, "name": "sign"}, {"id": 7, "name": "car"}],
    "annotations": [
        {"id": i, "image_id": 1, "category_id": c, "bbox": [10, 10, 20, 20], "area": 400, "iscrowd": 0}
        for i, c in ((1, 3), (2, 7))
    ],
}
Path("labels.json").write_text(json.dumps(labels))


def convert(*options):
    command = ["venv/bin/labelformat", "convert", "--task", "object-detection", *options]
    return subprocess.run(command, capture_output=True, text=True)


written = convert(
    *("--input-format", "coco", "--input-file", "labels.json"),
    *("--output-format", "yolov8", "--output-file", "yolo/data.yaml", "--output-split", "train"),
)
assert written.returncode == 0, written.stderr
print(Path("yolo/data.yaml").read_text(), Path("yolo/labels/a.txt").read_text(), sep="\n")
assert "nc: 2" in Path("yolo/data.yaml").read_text()
assert [line.split()[0] for line in Path("yolo/labels/a.txt").read_text().splitlines()] == ["3", "7"]
read = convert(
    *("--input-format", "yolov8", "--input-file", "yolo/data.yaml", "--input-split", "train"),
    *("--output-format", "coco", "--output-file", "back.json"),
)
print(read.stderr.strip().splitlines()[-1])
assert read.returncode != 0 and "KeyError: 0" in read.stderr
PY
