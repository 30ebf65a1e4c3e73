"""Heads with anchors, in every form of their outputs, against plain loops over levels, cells and anchors."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.detectors.contract import COCO80, AnchorHead, ModelError
from blurnoise_eval.detectors.contract_files import preset
from blurnoise_eval.detectors.detector import Detector
from constant_graphs import constant_graph

SIZE_PX, NAMES = (64, 96), ("first", "second", "third", "fourth")
ANCHORS = (((10.0, 13.0), (16.0, 30.0)), ((30.0, 61.0), (62.0, 45.0)), ((59.0, 119.0), (116.0, 90.0)))
HEADS = {
    "yolov3": AnchorHead((8, 16, 32), ANCHORS, "yolov3"),
    "yolov4": AnchorHead((8, 16, 32), ANCHORS, "yolov4", xy_scales=(1.2, 1.1, 1.05)),
    "yolov5": AnchorHead((8, 16, 32), ANCHORS, "yolov5"),
    "activated": AnchorHead((32, 16, 8), ANCHORS, "yolov3", activated=True),  # the coarsest first, as darknet
}
FORMS = [
    "planes",
    "channels last",
    "anchors first",
    "anchors last",
    "rows by anchor",
    "rows by cell",
    "cells",
]


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


def raw(head, seed=0):
    """What a head answers, for each stride (rows, columns, anchors, 5 + classes)."""
    rng = np.random.default_rng(seed)
    values = []
    for stride in head.strides:
        shape = (SIZE_PX[0] // stride, SIZE_PX[1] // stride, head.per_cell, 5 + len(NAMES))
        level = rng.normal(0, 1.5, shape).astype(np.float32).astype(float)
        if head.activated:
            level[..., [0, 1, 4, 5, 6, 7, 8]] = 1 / (1 + np.exp(-level[..., [0, 1, 4, 5, 6, 7, 8]]))
        values.append(level)
    return values


def shaped(levels, form):
    """The levels as graphs give them."""
    rows, columns = ([level.shape[axis] for level in levels] for axis in (0, 1))
    whole = [level.reshape(*level.shape[:2], -1) for level in levels]
    if form == "planes":
        made = [level.transpose(2, 0, 1)[None] for level in whole]
    elif form == "channels last":
        made = [level[None] for level in whole]
    elif form == "anchors first":
        made = [level.transpose(2, 0, 1, 3)[None] for level in levels]
    elif form == "anchors last":
        made = [level[None] for level in levels]
    else:
        width = levels[0].shape[3]
        order = (2, 0, 1, 3) if form == "rows by anchor" else (0, 1, 2, 3)
        parts = [level.transpose(order).reshape(-1, width) for level in levels]
        if form == "cells":
            parts = [level.reshape(r * c, -1) for level, r, c in zip(whole, rows, columns, strict=True)]
        made = [np.concatenate(parts)[None]]
    return [np.ascontiguousarray(each, np.float32) for each in made]


def plain(head, levels, min_score):
    """Box by box: score, left, top, right, bottom, class of the largest score."""
    squash = (lambda x: x) if head.activated else sigmoid
    found = []
    for level, stride, anchors, scale in zip(levels, head.strides, head.anchors, head.scales, strict=True):
        for row in range(level.shape[0]):
            for column in range(level.shape[1]):
                for anchor, (width, height) in enumerate(anchors):
                    x, y, w, h, objectness, *classes = level[row, column, anchor]
                    scores = [squash(objectness) * squash(each) for each in classes]
                    if max(scores) < min_score:
                        continue
                    if head.boxes == "yolov5":
                        cx, cy = (2 * squash(x) - 0.5 + column) * stride, (2 * squash(y) - 0.5 + row) * stride
                        wide, high = (2 * squash(w)) ** 2 * width, (2 * squash(h)) ** 2 * height
                    else:
                        cx = (squash(x) * scale - 0.5 * (scale - 1) + column) * stride
                        cy = (squash(y) * scale - 0.5 * (scale - 1) + row) * stride
                        wide, high = math.exp(w) * width, math.exp(h) * height
                    box = (cx - wide / 2, cy - high / 2, cx + wide / 2, cy + high / 2)
                    found.append((max(scores), *box, scores.index(max(scores))))
    return sorted(found)


@pytest.mark.parametrize(
    ("kind", "form"),
    [*((list(HEADS)[place % len(HEADS)], form) for place, form in enumerate(FORMS)), ("yolov5", "cells")],
)
def test_every_form_is_decoded_as_plain_loops_do(kind, form, tmp_path):
    head = HEADS[kind]
    if form.startswith("rows"):
        head = replace(head, order=form.split()[-1])
    levels = raw(head)
    contract = replace(preset("anchors"), classes=NAMES, head=head, resize="stretch", input_size_px=None)
    outputs = shaped(levels, form)
    path = constant_graph(tmp_path / "m.onnx", outputs[::-1], SIZE_PX)  # levels are told by their sizes
    detector = Detector(path, contract=contract)
    assert detector.contract.family == "anchors"
    answer = detector.run(detector.prepare(np.zeros((*SIZE_PX, 3), np.uint8))[0])
    found = detector.family.decode(answer, SIZE_PX, 0.3)
    expected = plain(head, levels, 0.3)
    assert len(found) == len(expected) > 20
    order = np.argsort(found.scores)
    np.testing.assert_allclose(found.scores[order], [row[0] for row in expected], rtol=1e-5)
    np.testing.assert_allclose(found.boxes_xyxy[order], [row[1:5] for row in expected], rtol=1e-4, atol=1e-3)
    assert found.class_ids[order].tolist() == [row[5] for row in expected]


def fastest_v2(side_px, classes):
    """The two levels of a square input, cells by [12 box, 3 objectness, classes], and them in rows."""
    rng = np.random.default_rng(2)
    levels = []
    for stride in (16, 32):
        level = rng.uniform(0, 1, (side_px // stride, side_px // stride, 15 + classes)) ** 2
        level[..., 15:] /= level[..., 15:].sum(axis=-1, keepdims=True)
        levels.append(level.astype(np.float32))
    return levels, np.concatenate([level.reshape(-1, 15 + classes) for level in levels])


@pytest.mark.parametrize("form", ["rows", "rows with a batch", "levels"])
def test_yolo_fastest_v2_is_recognised_and_decoded_as_its_own_code_does(form, tmp_path):
    """605 = 22 x 22 + 11 x 11 rows of 95 = 12 + 3 + 80; the loops follow ``handel_preds`` and the deployed code."""
    levels, rows = fastest_v2(352, 80)
    outputs = {"rows": [rows], "rows with a batch": [rows[None]], "levels": [level[None] for level in levels]}
    made = [np.asarray(each, np.float32) for each in outputs[form]]
    assert form != "rows" or made[0].shape == (605, 95)
    detector = Detector(constant_graph(tmp_path / "m.onnx", made, (352, 352)))
    contract = detector.contract
    assert (contract.family, contract.colour, contract.nms_iou) == ("yolofastestv2", "bgr", 0.4)
    assert contract.classes == COCO80
    assert "head = " in " ".join(contract.assumptions)
    expected, start = [], 0
    anchors = [12.64, 19.39, 37.88, 51.48, 55.71, 138.31, 126.91, 78.23, 131.57, 214.55, 279.92, 258.87]
    for number, stride in enumerate((16, 32)):
        side = 352 // stride
        for cell in range(side * side):
            row = rows[start + cell]
            for q in range(3):
                width, height = anchors[6 * number + 2 * q : 6 * number + 2 * q + 2]
                cx = (row[4 * q] * 2 - 0.5 + cell % side) * stride
                cy = (row[4 * q + 1] * 2 - 0.5 + cell // side) * stride
                wide, high = (row[4 * q + 2] * 2) ** 2 * width, (row[4 * q + 3] * 2) ** 2 * height
                score = row[12 + q] * row[15:].max()
                box = (cx - wide / 2, cy - high / 2, cx + wide / 2, cy + high / 2)
                expected.append((score, *box, int(row[15:].argmax())))
        start += side * side
    answer = detector.run(detector.prepare(np.zeros((352, 352, 3), np.uint8))[0])
    found = detector.family.decode(answer, (352, 352), 0.02)
    strong = sorted(each for each in expected if each[0] >= 0.02)
    order = np.argsort(found.scores)
    assert len(found) == len(strong) > 50
    np.testing.assert_allclose(found.scores[order], [row[0] for row in strong], rtol=1e-5)
    np.testing.assert_allclose(found.boxes_xyxy[order], [row[1:5] for row in strong], rtol=1e-4, atol=1e-2)
    assert found.class_ids[order].tolist() == [row[5] for row in strong]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"head": None},
            "family 'anchors' needs the anchors of its head in the contract, for example .head.",
        ),
        ({"head": {"strides": [8], "anchors": [[1, 2, 3]]}}, "head: anchors = .*widths and heights in turn"),
        ({"head": {"strides": [8, 16], "anchors": [[1, 2]]}}, "head: anchors .*same number"),
        ({"head": {"strides": [8], "anchors": [[1, 2]], "boxes": "yolov2"}}, "head: boxes = 'yolov2'"),
        ({"family": "yolov8", "head": {"strides": [8], "anchors": [[1, 2]]}}, "head: is for the families"),
    ],
)
def test_bad_heads_say_what_is_wrong(change, message, tmp_path):
    path = constant_graph(tmp_path / "m.onnx", shaped(raw(HEADS["yolov5"]), "planes"), SIZE_PX)
    stated = {"family": "anchors", "classes": list(NAMES), **change}
    path.with_name("m.contract.json").write_text(json.dumps(stated))
    with pytest.raises(ModelError, match=message) as caught:
        Detector(path)
    assert "\n" not in str(caught.value)
