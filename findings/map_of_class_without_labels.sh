#!/usr/bin/env bash
# mean-average-precision 2024.1.5.0: a class that the pictures do not contain halves the score of a perfect detector.
# Expected: such a class is left out of the mean, as in pycocotools and in Pascal VOC's toolkit.
# Seen: its AP is 0 and counts: two classes, one labelled and found perfectly: mAP .5, with or without false positives of the
# other. Also, boxes count with a pixel more in both directions: 10 x 4.6 in 10 x 10 has an overlap of .51 and is found.
# Hurt: who scores subsets (night pictures, one scene) with the classes of the whole set.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check mean-average-precision==2024.1.5.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
from mean_average_precision import MetricBuilder


def score(labels, found, classes):
    metric = MetricBuilder.build_evaluation_metric("map_2d", async_mode=False, num_classes=classes)
    metric.add(np.array(found, float), np.array(labels, float))
    return float(metric.value(iou_thresholds=0.5)["mAP"])


sign = [10, 10, 20, 20, 0, 0, 0]
perfect, false = [10, 10, 20, 20, 0, 0.9], [40, 40, 50, 50, 1, 0.9]
one, two, three = score([sign], [perfect], 1), score([sign], [perfect], 2), score([sign], [perfect, false], 2)
low = score([[0, 0, 10, 10, 0, 0, 0]], [[0, 0, 10, 4.6, 0, 0.9]], 1)
print("one class", one, "two", two, "two, one false", three, "overlap of .46", low)
assert (one, two, three, low) == (1.0, 0.5, 0.5, 1.0)
PY
