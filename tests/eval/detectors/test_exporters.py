"""Detectors as many exporters write them: all that the network finds is found, with outputs that nobody stated.

The truth is what the network itself says of a picture before an exporter's code writes it.
"""

import numpy as np
import onnx
import pytest
import torch
from blurnoise_eval.contracts.comparison import compared, output_problems
from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.contract_files import (
    contract_document,
    contract_option,
    load_contract,
    parse_contract,
)
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.outputs import parsed, written
from blurnoise_eval.detectors.records import Detections
from constant_graphs import answering_graph
from exporters import EXPORTERS, UNKNOWN, WHWH, separate, with_nothing
from made_exporters import exported, pictures
from onnx import numpy_helper, parser

PICTURES = pictures(4)


def found_by(detector, image):
    """Boxes, px, with their classes, from a score of 0.5 on, from left to right."""
    found = detector.detect(image, min_score=0.5)
    rows = [
        (*np.round(box).tolist(), number)
        for box, number in zip(found.boxes_xyxy, found.class_ids, strict=True)
    ]
    return sorted(rows)


def in_them(boxes, classes):
    return sorted((*box, number) for box, number in zip(boxes.tolist(), classes.tolist(), strict=True))


@pytest.mark.parametrize("name", [*EXPORTERS, *UNKNOWN])
def test_outputs_that_nobody_stated_are_read_right_or_doubted(name, tmp_path):
    family, write, names, fed = (EXPORTERS | UNKNOWN)[name]
    detector = Detector(exported(tmp_path / "m.onnx", write, names, **fed))
    assert detector.contract.family == family or not family
    comparison = compared(detector, [(image, None) for image, *_ in PICTURES])
    contract = comparison.contract
    assert contract.outputs == name or family
    assert not [doubt for doubt in comparison.doubts if "outputs" in doubt]
    detector = detector.with_contract(contract)
    for image, boxes, classes in PICTURES:
        assert found_by(detector, image) == in_them(boxes, classes)


@pytest.mark.parametrize("name", ["YOLO-NAS flat", "xyxy, class, score", "xyxy; scores"])
def test_stated_outputs_are_read_as_stated(name, tmp_path):
    _, write, names, fed = (EXPORTERS | UNKNOWN)[name]
    path = exported(tmp_path / "m.onnx", write, names, **fed)
    outputs = "picture, xyxy, score, class" if name == "YOLO-NAS flat" else name
    stated = {"outputs": outputs, "classes": "coco80", "value_range": fed.get("value_range", "0-1")}
    detector = Detector(path, contract=stated)
    assert detector.contract.family == "columns"
    assert detector.contract.sources["outputs"] == "given"
    for image, boxes, classes in PICTURES:
        assert found_by(detector, image) == in_them(boxes, classes)


def test_stated_outputs_that_the_values_refute_are_doubted_and_kept(tmp_path):
    _, write, names, fed = EXPORTERS["YOLO-NAS flat"]
    path = exported(tmp_path / "m.onnx", write, names, **fed)
    detector = Detector(path, contract="yolov7")
    found = compared(detector, [(image, None) for image, *_ in PICTURES])
    assert found.contract.outputs == "picture, xyxy, class, score"
    (doubt,) = [doubt for doubt in found.doubts if doubt.startswith("outputs may be wrong")]
    assert (
        "the column read as class holds fractions; set outputs in the contract: 'picture, xyxy, sc" in doubt
    )


def test_labels_decide_whether_the_picture_is_turned(tmp_path):
    """The same answer for every picture, which a mirrored one says nothing of: its boxes fit as xyxy and as yxyx."""
    rows = np.array([[[10, 20, 60, 70, 0.9, 2], [70, 5, 90, 60, 0.8, 11]]], np.float32)
    path = answering_graph(tmp_path / "m.onnx", {"out": (rows, None)}, [1, 3, 96, 96])
    for turn, outputs in (([0, 1, 2, 3], "xyxy, score, class"), ([1, 0, 3, 2], "yxyx, score, class")):
        labels = Detections(rows[0][:, turn], np.ones(2), rows[0][:, 5])
        shown = [(np.full((96, 96, 3), value, np.uint8), labels) for value in range(0, 200, 25)]
        assert compared(Detector(path), shown).contract.outputs == outputs
    unlabelled = compared(Detector(path), [(image, None) for image, _ in shown])
    assert unlabelled.contract.outputs == "xyxy, score, class"
    assert unlabelled.doubts == (
        "the model finds the same in each of 8 pictures, so they confirm no contract",
    )
    assert unlabelled.contract.sources["outputs"].startswith("assumed")
    (note,) = output_problems(Detector(path), shown[0][0])
    assert "leaves open whether they are 'xyxy, score, class' or 'yxyx, score, class'" in note


@pytest.mark.parametrize("how", ["from 1", "background first"])
def test_labels_show_that_classes_are_shifted(how, tmp_path):
    """Boxes agree in all views; the right contract is not doubted."""

    def write(boxes, scores):
        if how == "from 1":
            return separate(boxes, scores, first=1)
        every = torch.softmax(with_nothing(scores), dim=1)
        return (boxes / WHWH)[None], torch.cat([every[:, -1:], every[:, :-1]], dim=1)[None]

    names = ["boxes", "labels", "scores"] if how == "from 1" else ["boxes", "scores"]
    path = exported(tmp_path / "m.onnx", write, names)
    right = "xyxy in shares; class from 1; score" if how == "from 1" else "xyxy in shares; background, scores"
    wrong = right.replace(" from 1", "").replace("background, scores", "scores, background")
    shown = [(image, Detections(boxes, np.ones(3), classes)) for image, boxes, classes in PICTURES]
    for outputs, doubted in ((right, False), (wrong, True)):
        contract = {"outputs": outputs, "classes": "coco80", "value_range": "0-1"}
        doubts = compared(Detector(path, contract=contract), shown).doubts
        assert (
            any("12 of 12 labelled objects are found as the class after" in each for each in doubts)
            is doubted
        )


# --- own classes ---


@pytest.mark.parametrize("count", [2, 3, 4])
def test_the_last_column_of_rf_detr_with_own_classes_is_the_background(count, tmp_path):
    logits = np.full((1, 5, count + 1), -6.0, np.float32)
    logits[0, 1, 1], logits[0, 2, count] = 2, 5
    boxes = np.full((1, 5, 4), 0.5, np.float32)
    outputs = {"dets": (boxes, None), "labels": (logits, None)}
    path = answering_graph(tmp_path / "m.onnx", outputs, [1, 3, 64, 64])
    names = [f"class {number}" for number in range(count)]
    detector = Detector(path, contract={"family": "rfdetr", "classes": names})
    assert "scores by sigmoid, background" in detector.contract.outputs
    assert (
        f"the last of {count + 1} columns of scores is the background" in detector.contract.sources["outputs"]
    )
    found = detector.detect(np.zeros((64, 64, 3), np.uint8), min_score=0.1)
    assert (found.class_ids.tolist(), found.scores.tolist()) == ([1], [pytest.approx(0.8808, abs=1e-4)])
    every = Detector(path, contract={"family": "rfdetr", "classes": [*names, "background"]})
    assert every.detect(np.zeros((64, 64, 3), np.uint8), min_score=0.1).class_ids.tolist() == [count, 1]


def test_class_numbers_from_1(tmp_path):
    rows = np.array([[[10, 20, 60, 70, 0.9, 1], [70, 5, 90, 60, 0.8, 2]]], np.float32)
    path = answering_graph(tmp_path / "m.onnx", {"out": (rows, None)}, [1, 3, 96, 96])
    detector = Detector(path, contract={"outputs": "xyxy, score, class from 1", "classes": ["a", "b"]})
    assert detector.detect(np.zeros((96, 96, 3), np.uint8)).class_ids.tolist() == [0, 1]


# --- a graph that declares another shape than it gives ---


def false_graph(path, rows, declared):
    """It declares another shape than that of ``rows``, which it computes while it runs."""
    model = parser.parse_model(
        f"""<ir_version: 8, opset_import: ["" : 17]>
        g (float[1,3,64,64] images) => (float[{",".join(map(str, declared))}] out)
        <int64[3] once = {{1, 1, 1}}, float zero = {{0.0}}> {{
            mean = ReduceMean<keepdims = 0>(images)
            none = Mul(mean, zero)
            nought = Cast<to = 7>(none)
            times = Add(once, nought)
            out = Tile(rows, times)
        }}"""
    )
    model.graph.initializer.append(numpy_helper.from_array(rows, "rows"))
    onnx.save(model, path)
    return path


@pytest.mark.parametrize("declared", [[1, 100, 6], [1, 84, 85]])
def test_the_shape_that_an_output_has_is_used_and_said(declared, tmp_path):
    rows = np.array([[[10, 20, 60, 62, 0.9, 1], [40, 5, 60, 60, 0.8, 2]]], np.float32)
    detector = Detector(false_graph(tmp_path / "m.onnx", rows, declared))
    image = np.zeros((64, 64, 3), np.uint8)
    assert len(detector.detect(image)) == 2
    said = f"output 'out' gives [1, 2, 6] where the graph declares {declared}; the former is used"
    assert said in output_problems(detector, image)
    assert said in compared(detector, [(image, None)]).doubts


def test_a_false_shape_is_named_where_the_outputs_fit_nothing(tmp_path):
    path = false_graph(tmp_path / "m.onnx", np.ones((1, 336, 85), np.float32), [1, 84, 85])
    for contract in (None, "yolox"):
        with pytest.raises(ModelError, match=r"gives \[1, 336, 85\] where the graph declares \[1, 84, 85\]"):
            Detector(path, contract=contract)


# --- the notation ---


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("xyxy, score, klass", "column 'klass' is unknown; must be one of xyxy, yxyx, "),
        ("xyxy, score by shares", "after 'score' must come 'by sigmoid' or 'by softmax'"),
        ("xyxy, class", "must have a box .*, score or scores, and each column once"),
        ("xyxy, cxcywh, score", "must have a box"),
        ("xyxy, scores, class", "must have class or scores, not both"),
        ("count, xyxy, score", "count must be an output of its own"),
        (5, "outputs = 5: must be text, such as"),
    ],
)
def test_bad_outputs_say_what_is_wrong(text, message):
    with pytest.raises(ModelError, match=message) as caught:
        parse_contract({"classes": ["a"], "outputs": text}, "file x")
    assert "\n" not in str(caught.value)


def test_outputs_in_files_and_typed():
    text = "count; boxes: xyxy in shares; s: score by sigmoid; class from 1"
    assert written(parsed("count;boxes: xyxy  in shares; s: score by sigmoid ; class from 1")) == text
    contract = Contract("yolov7", ("a", "b"), outputs=text)
    assert parse_contract(contract_document(contract), "file x") == contract
    typed = load_contract("yolov7,outputs=picture/xyxy/score/class")
    assert typed.outputs == "picture, xyxy, score, class"
    assert contract_option(typed) == "yolov7,outputs=picture/xyxy/score/class"
