"""Two real detectors on real photographs: the run's AP is that of a plain pycocotools evaluation."""

import csv
import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import commands
import numpy as np
import pytest
import torch
import torchvision_ops
from blurnoise_eval.detectors.contract import COCO91
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.recognition import drawn_picture
from coco_oracle import stats_of_cocos_tools

SHARED = Path(__file__).resolve().parents[4] / "shared" / "real"
LABELS = SHARED / "photos" / "instances.json"
shared = pytest.mark.skipif(not LABELS.is_file(), reason="the shared photographs are absent")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Both models on all photographs, untouched and under one condition; what was found, as COCO results."""
    folder = tmp_path_factory.mktemp("real") / "run"
    models = [f"--model={SHARED / 'models' / name}.onnx" for name in ("yolox_nano", "fastestdet_upstream")]
    conditions = ["--exposure-ms", "60", "--lux", "20", "--dx", "400", "--gain", "0", "--json"]
    with redirect_stdout(StringIO()):
        assert commands.main(["sweep", *models, "--coco", str(LABELS), *conditions, "-o", str(folder)]) == 0
        assert commands.main(["report", "--coco", str(folder)]) == 0
    return folder


@shared
@pytest.mark.slow
@pytest.mark.parametrize(("model", "clean"), [("yolox_nano", 0.299), ("fastestdet_upstream", 0.156)])
def test_average_precision_is_that_of_pycocotools_on_the_data_set_s_own_file(run, model, clean):
    with (run / "results.csv").open(newline="") as file:
        clean_cells = {row["cell_id"] for row in csv.DictReader(file) if row["clean"] == "True"}
    found: dict[bool, list[Any]] = {True: [], False: []}
    for each in json.loads((run / "coco" / f"{model}.json").read_text()):
        found[each["cell_id"] in clean_cells].append(each)
    scores = {is_clean: stats_of_cocos_tools(LABELS, results) for is_clean, results in found.items()}
    (row,) = (
        each for each in json.loads((run / "summary.json").read_text())["models"] if each["model"] == model
    )
    assert (row["p"], row["ap50"], row["ar100"]) == pytest.approx(scores[True][[0, 1, 8]], abs=1e-3)
    assert row["mpc"] == pytest.approx(scores[False][0], abs=1e-3)
    assert row["p"] == pytest.approx(clean, abs=0.002)  # as plain code around the same network gave it
    assert 0.2 < row["rpc"] < 0.9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "threshold"),
    [
        ("ssdlite320_mobilenet_v3_large", "score_thresh"),
        ("fasterrcnn_mobilenet_v3_large_320_fpn", "box_score_thresh"),
    ],
)
def test_torchvisions_detectors_answer_as_the_package_does(name, threshold, tmp_path):
    """Exported here, with random weights, each layer scaled so that its answer has a deviation of 1."""
    detectors, path, image = torchvision_ops.detectors(), tmp_path / "m.onnx", drawn_picture()
    picture = torch.from_numpy(image).permute(2, 0, 1).float() / 255

    def scaled(layer, _, answer):
        layer.weight.div_(answer.std())
        return answer / answer.std()

    with torch.random.fork_rng(), torch.no_grad():
        torch.default_generator.manual_seed(1)
        model = getattr(detectors, name)(weights=None, weights_backbone=None, **{threshold: 0.02}).eval()
        layers = [each for each in model.modules() if isinstance(each, (torch.nn.Conv2d, torch.nn.Linear))]
        hooks = [layer.register_forward_hook(scaled) for layer in layers]
        model([picture])
        for hook in hooks:
            hook.remove()
        (own,) = model([picture])
        torch.onnx.export(model, ([picture],), path, opset_version=17, dynamo=False, input_names=["image"])
    detector = Detector(path)
    assert (detector.contract.family, detector.contract.classes) == ("torchvision", COCO91)
    found = detector.detect(image, min_score=0.02)
    boxes, scores, labels = (own[key].numpy() for key in ("boxes", "scores", "labels"))
    assert len(found) == len(scores) >= 100
    for box, score, label in zip(boxes, scores, labels, strict=True):
        alike = (found.class_ids == label) & (np.abs(found.scores - score) < 1e-3)
        assert (np.abs(found.boxes_xyxy[alike] - box).max(axis=1) < 0.2).any()
