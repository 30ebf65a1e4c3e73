"""Detectors that are no files: functions of pictures, and networks of torchvision's detection API."""

import pickle

import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import rendered_signs
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.python_models import PythonDetector, TorchvisionDetector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_models.detector import STOP_SIGN
from torch import nn

PLAN = SweepPlan({"exposure_s": (0.003, 0.03), "illuminance_lux": (30.0,)}, examples=False)
_built_in: list[Detector] = []


def signs(image):
    """The built-in detector as somebody's own function."""
    if not _built_in:
        _built_in.append(Detector(STOP_SIGN))
    found = _built_in[0].detect(image)
    return found.boxes_xyxy, found.scores, ["stop sign"] * len(found)


class Network(nn.Module):
    """As torchvision's: the brightest pixel is an object of 5 px whose score is a weight."""

    def __init__(self, score=0.5):
        super().__init__()
        self.score = nn.Parameter(torch.tensor([score]))

    def forward(self, pictures):
        found = []
        for picture in pictures:
            assert not self.training
            assert picture.max() <= 1
            y, x = divmod(int(picture.sum(0).argmax()), picture.shape[2])
            box = torch.tensor([[x - 2.0, y - 2.0, x + 3.0, y + 3.0]])
            found.append({"boxes": box, "scores": self.score, "labels": torch.tensor([1])})
        return found


@pytest.mark.slow
def test_a_function_gets_the_scores_of_the_file_that_it_calls(tmp_path):
    pictures = rendered_signs()
    done = evaluate([signs, STOP_SIGN], pictures, "imx250c", PLAN, output=tmp_path, strategy="grid")
    by_model = {
        name: [row["target_confidence"] for row in done.cells if row["model"] == name]
        for name in ("signs", "stop_sign")
    }
    assert len(by_model["signs"]) == 60
    assert by_model["signs"] == by_model["stop_sign"]


def test_a_network_of_torchvisions_api_finds_boxes():
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[7, 12] = 255
    network = TorchvisionDetector(Network(), ("background", "lamp"))
    found = network.detect(picture)
    assert found.boxes_xyxy.tolist() == [[10, 5, 15, 10]]
    assert found.class_ids.tolist() == [1]
    assert found.scores.tolist() == [0.5]
    assert network.sha256 != TorchvisionDetector(Network(0.6), ("background", "lamp")).sha256
    again = pickle.loads(pickle.dumps(network))
    assert again.sha256 == network.sha256
    assert again.detect(picture).boxes_xyxy.tolist() == [[10, 5, 15, 10]]


def test_processes_take_functions_of_modules(tmp_path):
    model = pickle.loads(pickle.dumps(PythonDetector(signs, ("stop sign",), name="mine", version="2")))
    assert (model.name, model.sha256) == ("mine", PythonDetector(signs, ("stop sign",), version="2").sha256)
    with pytest.raises(ValueError, match="models cannot be sent to another process"):
        evaluate(
            lambda image: signs(image), rendered_signs(), None, PLAN, output=tmp_path, engine="processes"
        )


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (([[0, 0, 5, 5]], [1.5], ["a"]), "score = 1.5"),
        (([[0, 0, 5, 5]], [np.nan], ["a"]), "finite"),
        (([[0, 0, 5, 5]], [0.5, 0.6], ["a"]), "must be equal"),
        (([[0, 0, 5, 5]], [0.5], [7]), "class = 7"),
        (None, "TypeError"),
    ],
)
def test_what_a_function_may_not_answer(answer, words):
    with pytest.raises(ModelError, match=words):
        PythonDetector(lambda image: answer, ("a", "b")).detect(np.zeros((8, 9, 3), np.uint8))


def test_other_names_are_dropped_and_what_must_be_wrapped_is_said(tmp_path):
    boxes = [[0, 0, 5, 5], [1, 1, 4, 4]]
    found = PythonDetector(lambda image: (boxes, [0.3, 0.9], ["b", "x"]), ("a", "b")).detect(
        np.zeros((8, 9, 3), np.uint8)
    )
    assert (found.class_ids.tolist(), found.boxes_xyxy.tolist()) == ([1], [[0, 0, 5, 5]])
    for model, words in ((Network(), "TorchvisionDetector"), (7, "must be a file")):
        with pytest.raises(TypeError, match=words):
            evaluate(model, rendered_signs(), None, PLAN, output=tmp_path)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="PythonDetector"):
        evaluate(signs, None, None, PLAN, output=tmp_path)
