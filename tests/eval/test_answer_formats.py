"""Families whose graphs give the answers themselves: generated graphs in exactly these layouts, known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from blurnoise_eval.contract import COCO80, COCO91, Contract, ModelError
from blurnoise_eval.onnx_model import Detector
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

SIZE_PX = (64, 96)
BOXES_XYXY = np.array([[10.0, 5.0, 40.0, 25.0], [12.0, 6.0, 42.0, 26.0], [50.0, 30.0, 90.0, 60.0]])
CLASSES = np.array([2, 2, 0])
SCORES = np.array([0.6, 0.5, 0.9])  # of a white picture; of a black one 0
FAMILIES = ("yolov10", "yolov7", "mmdeploy", "rfdetr")
NAMES = ("first", "second", "third")


def logit(score: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.log(score / (1 - score))


def tensors(family: str) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Each output's value for a black picture, and what white adds to it. int64 where nothing is added."""
    score, klass = SCORES[:, None], CLASSES[:, None].astype(float)
    none, boxes = np.zeros((3, 4)), BOXES_XYXY
    if family == "yolov10":
        padded = np.zeros((1, 5, 6))
        padded[0, :3] = np.hstack([boxes, 0 * score, klass])
        gain = np.zeros((1, 5, 6))
        gain[0, :3, 4] = SCORES
        return {"output0": (padded, gain)}
    if family == "yolov7":
        first = np.hstack([0 * score, boxes, klass, 0 * score])
        other = np.array([[1, 0, 0, 96, 64, 1, 0.99]])  # of another picture of the batch
        gain = np.vstack([np.hstack([np.zeros((3, 6)), score]), np.zeros((1, 7))])
        return {"output": (np.vstack([first, other]), gain)}
    if family == "mmdeploy":
        dets = np.hstack([boxes, 0 * score])[None], np.hstack([none, score])[None]
        return {"dets": dets, "labels": (CLASSES[None].astype(np.int64), np.zeros(0))}
    centres = np.hstack([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]])
    shares = centres / np.array([SIZE_PX[1], SIZE_PX[0]] * 2)
    base, gain = np.full((1, 3, 4), -20.0), np.zeros((1, 3, 4))  # four wide, as the boxes
    gain[0, np.arange(3), CLASSES] = logit(SCORES) + 20
    return {"labels": (base, gain), "dets": (shares[None], np.zeros_like(shares)[None])}


def graph(
    path: Path, family: str, *, opset: int = 17, dtype: int = TensorProto.FLOAT, batch: int | str = 1,
    size: tuple[int | str, int | str] = SIZE_PX, mean: float = 1.0,
) -> Path:  # fmt: skip
    """Write a detector whose scores grow with the picture's mean: 0 for 0, ``SCORES`` for ``mean``."""
    kind = helper.tensor_dtype_to_np_dtype(dtype)
    constants = [numpy_helper.from_array(np.full((1, 3, 1, 1), 1 / 3 / mean, kind), "third")]
    constants.append(numpy_helper.from_array(np.array([0], np.int64), "first"))
    constants.append(numpy_helper.from_array(np.array([1], np.int64), "second"))
    nodes = [
        helper.make_node("GlobalAveragePool", ["images"], ["means"]),
        helper.make_node("Conv", ["means", "third"], ["grey"]),
        helper.make_node("Slice", ["grey", "first", "second", "first"], ["one"]),
        helper.make_node("Reshape", ["one", "second"], ["brightness"]),
    ]
    outputs = []
    for name, (base, gain) in tensors(family).items():
        integral = base.dtype == np.int64
        constants.append(numpy_helper.from_array(base if integral else base.astype(kind), f"{name}_base"))
        if integral:
            nodes.append(helper.make_node("Identity", [f"{name}_base"], [name]))
        else:
            constants.append(numpy_helper.from_array(gain.astype(kind), f"{name}_gain"))
            nodes.append(helper.make_node("Mul", ["brightness", f"{name}_gain"], [f"{name}_part"]))
            nodes.append(helper.make_node("Add", [f"{name}_base", f"{name}_part"], [name]))
        shape = ["answers", 7] if family == "yolov7" else list(base.shape)
        outputs.append(helper.make_tensor_value_info(name, TensorProto.INT64 if integral else dtype, shape))
    images = helper.make_tensor_value_info("images", dtype, [batch, 3, *size])
    made = helper.make_graph(nodes, family, [images], outputs, constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return path


def stated(family: str) -> Contract:
    classes = (*NAMES, "background") if family == "rfdetr" else NAMES
    return Contract(family, classes, resize="stretch", input_size_px=SIZE_PX, nms_iou=None)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    "form",
    [
        {"opset": 13}, {"opset": 20}, {"dtype": TensorProto.FLOAT16},
        {"batch": "n"}, {"size": ("height", "width")}, {"batch": 2},
    ],
    ids=str,
)  # fmt: skip
def test_known_answers(family: str, form: dict[str, object], tmp_path: Path) -> None:
    detector = Detector(graph(tmp_path / "m.onnx", family, **form), contract=stated(family))  # type: ignore[arg-type]
    white = np.full((128, 192, 3), 255, np.uint8)  # twice the input
    found = detector.detect(white)
    order = [2, 0, 1]  # by score; the second overlaps the first and stays: the graph has answered
    half = form.get("dtype") == TensorProto.FLOAT16
    np.testing.assert_allclose(found.scores, SCORES[order], atol=5e-3 if half else 1e-5)
    np.testing.assert_allclose(found.boxes_xyxy, 2 * BOXES_XYXY[order], atol=0.2 if half else 1e-3)
    assert found.class_ids.tolist() == CLASSES[order].tolist()
    assert len(detector.detect(np.zeros_like(white))) == 0
    assert len(detector.detect(white, max_detections=2)) == 2


@pytest.mark.parametrize("family", FAMILIES)
def test_families_are_recognised_and_what_is_assumed_is_said(family: str, tmp_path: Path) -> None:
    path = graph(tmp_path / "m.onnx", family)
    if family == "rfdetr":
        with pytest.raises(ModelError, match="4 classes but nothing names them"):
            Detector(path)
        return
    contract = Detector(path).contract
    assert (contract.family, contract.nms_iou, contract.classes) == (family, None, COCO80)
    assert "does not show how many" in " ".join(contract.assumptions)


def test_a_class_without_a_name_is_an_error(tmp_path: Path) -> None:
    two = Contract("yolov10", NAMES[:2], resize="stretch", input_size_px=SIZE_PX, nms_iou=None)
    detector = Detector(graph(tmp_path / "m.onnx", "yolov10"), contract=two)
    with pytest.raises(ModelError, match=r"finds class 2, counted from 0, but the contract names 2"):
        detector.detect(np.full((64, 96, 3), 255, np.uint8))


def test_cocos_own_ids() -> None:
    assert len(COCO91) == 91
    at = {1: "person", 13: "stop sign", 44: "bottle", 90: "toothbrush"}
    assert {number: COCO91[number] for number in at} == at
    assert [name for name in COCO91 if not name.startswith("unused")] == list(COCO80)
    assert Contract("rfdetr", "coco91").classes == COCO91  # type: ignore[arg-type]
