"""Suspicions: networks whose answers are known in closed form, with contracts that are right and wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from blurnoise_eval.detectors.contract import EXPORTER, FIELDS, Contract, preset
from blurnoise_eval.detectors.contract_checks import common_suspicions, suspicions
from blurnoise_eval.detectors.detector import Detector
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

SHARED = Path(__file__).resolve().parents[3].parent / "shared" / "real"


def red_detector(
    path: Path,
    *,
    answer: str = "clipped",
    gain: float = 1.0,
    bias: float = 0.0,
    channels: str = "nchw",
    **contract: object,
) -> Detector:
    """A YOLOX of one class on 64 x 96 px: the score of a cell is the mean of the first channel, times ``gain``.

    ``answer``: scores "clipped" at 0 and 1, "free", through a "sigmoid", or a "log" that no range saturates.
    Boxes are the cells. ``channels`` "nhwc": takes bytes.
    """
    taken, shape = (
        (TensorProto.UINT8, [1, 64, 96, 3]) if channels == "nhwc" else (TensorProto.FLOAT, [1, 3, 64, 96])
    )
    nodes = [helper.make_node("Cast", ["images"], ["numbers"], to=TensorProto.FLOAT)]
    if channels == "nhwc":
        nodes.append(helper.make_node("Transpose", ["numbers"], ["planes"], perm=[0, 3, 1, 2]))
    constants = [numpy_helper.from_array(np.array([1, 6, -1], np.int64), "flat")]
    parts = []
    for stride in (8, 16, 32):
        weight = np.zeros((6, 3, stride, stride), np.float32)
        weight[5, 0] = gain / stride**2
        offsets = np.array([0.5, 0.5, 0, 0, 99 if answer == "sigmoid" else 1, bias], np.float32)
        constants += [
            numpy_helper.from_array(weight, f"w{stride}"),
            numpy_helper.from_array(offsets, f"b{stride}"),
        ]
        inputs = ["planes" if channels == "nhwc" else "numbers", f"w{stride}", f"b{stride}"]
        nodes.append(helper.make_node("Conv", inputs, [f"c{stride}"], strides=[stride, stride]))
        nodes.append(helper.make_node("Reshape", [f"c{stride}", "flat"], [f"r{stride}"]))
        parts.append(f"r{stride}")
    nodes.append(helper.make_node("Concat", parts, ["columns"], axis=2))
    nodes.append(helper.make_node("Transpose", ["columns"], ["rows"], perm=[0, 2, 1]))
    constants += [numpy_helper.from_array(np.array(end, np.float32), f"end{end}") for end in (0, 1)]
    if answer == "log":  # 0.08 ln(1 + 255 x): 0.40 for x = 0.6, and 0.85 for 255 times that
        scale = np.array([0, 0, 0, 0, 0, 255], np.float32)
        constants += [
            numpy_helper.from_array(scale, "scale"),
            numpy_helper.from_array(np.array([0, 0, 0, 0, 1 / 0.08, 0], np.float32), "objectness"),
            numpy_helper.from_array(np.float32([0.08]), "steepness"),
        ]
        for node, inputs, output in (
            ("Mul", ["rows", "scale"], "x"), ("Add", ["x", "end1"], "above"), ("Log", ["above"], "log"),
            ("Add", ["log", "objectness"], "steep"), ("Mul", ["steep", "steepness"], "answer"),
        ):  # fmt: skip
            nodes.append(helper.make_node(node, inputs, [output]))
    else:
        clip = ["Clip", ["rows", "end0", "end1"]]
        last = {"clipped": clip, "free": ["Identity", ["rows"]], "sigmoid": ["Sigmoid", ["rows"]]}[answer]
        nodes.append(helper.make_node(*last, ["answer"]))
    graph = helper.make_graph(
        nodes,
        "red",
        [helper.make_tensor_value_info("images", taken, shape)],
        [helper.make_tensor_value_info("answer", TensorProto.FLOAT, [1, 126, 6])],
        constants,
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    if channels == "nhwc":
        contract["value_range"] = "0-255"
    return Detector(path, contract=Contract("yolox", ("red",), resize="stretch", **contract))  # type: ignore[arg-type]


def reddish() -> NDArray[np.uint8]:
    """Red squares of 8 px among dark ones; blue is dark everywhere."""
    image = np.full((64, 96, 3), 6, np.uint8)
    for top, left in ((0, 0), (16, 48), (32, 24), (40, 80)):
        image[top : top + 8, left : left + 8, 0] = 150
    return image


def test_right_contracts_raise_none(tmp_path: Path) -> None:
    assert suspicions(red_detector(tmp_path / "a.onnx"), reddish()) == []
    bytes_in = red_detector(tmp_path / "b.onnx", gain=1 / 255, channels="nhwc")
    assert suspicions(bytes_in, reddish()) == []


@pytest.mark.parametrize("channels", ["nchw", "nhwc"])
def test_swapped_colours(tmp_path: Path, channels: str) -> None:
    gain = 1 / 255 if channels == "nhwc" else 1
    detector = red_detector(tmp_path / "m.onnx", gain=gain, channels=channels, colour="bgr")
    (found,) = suspicions(detector, reddish())
    assert "colour = 'bgr' (given): with 'rgb'" in found
    assert "has 4 answers" in found
    assert "instead of 0" in found


def test_values_too_small(tmp_path: Path) -> None:
    (found,) = suspicions(red_detector(tmp_path / "m.onnx", gain=1 / 255), reddish())
    assert "value_range = '0-1' (given): with '0-255'" in found


def test_values_too_large_saturate(tmp_path: Path) -> None:
    """150 instead of 0.59, and 6 instead of 0.02, all end at 1: certain of everything is no better."""
    (found,) = suspicions(red_detector(tmp_path / "m.onnx", value_range="0-255"), reddish())
    assert "value_range = '0-255' (given): with '0-1'" in found
    assert "has 4 answers" in found


def test_scores_above_one(tmp_path: Path) -> None:
    (found,) = suspicions(red_detector(tmp_path / "m.onnx", gain=3, answer="free"), reddish())
    assert "score 1.76471 > 1" in found


def test_scores_that_are_all_zero_and_values_that_are_no_numbers(tmp_path: Path) -> None:
    black = np.zeros((64, 96, 3), np.uint8)
    (found,) = suspicions(red_detector(tmp_path / "m.onnx"), black)
    assert "every score is exactly 0" in found
    assert (
        suspicions(red_detector(tmp_path / "quiet.onnx", nms_iou=None), black) == []
    )  # it may answer nothing
    nan = red_detector(tmp_path / "nan.onnx", bias=np.nan)
    (found,) = suspicions(nan, black)
    assert "126 values that are NaN" in found
    assert nan.non_finite_values == 0  # the caller's pictures are counted, not these


def one_square() -> NDArray[np.uint8]:
    image = np.zeros((64, 96, 3), np.uint8)
    image[16:24, 48:56, 0] = 200
    return image


@pytest.mark.parametrize(
    ("answer", "gain", "bias", "image"),
    [("sigmoid", 6.0, -3.0, one_square()), ("log", 1.0, 0.0, np.where(reddish() > 6, reddish(), 0))],
)
def test_a_network_that_scores_larger_values_higher_is_no_evidence_for_them(
    answer: str, gain: float, bias: float, image: NDArray[np.uint8], tmp_path: Path
) -> None:
    """It sees with 0-1, hence takes these. Values 255 times as large make it surer of more, three times in all."""
    made = {"answer": answer, "gain": gain, "bias": bias}
    right = red_detector(tmp_path / "right.onnx", **made)
    larger = red_detector(tmp_path / "larger.onnx", value_range="0-255", **made)
    assert (
        larger.detect(image, min_score=0.25).scores.sum()
        > 3 * right.detect(image, min_score=0.25).scores.sum()
    )
    assert suspicions(right, image) == []
    if answer == "sigmoid":  # certain of all that it finds: overdriven
        assert "value_range = '0-255' (given): with '0-1'" in suspicions(larger, image)[0]


def test_what_an_exporter_s_code_fixes_is_not_doubted(tmp_path: Path) -> None:
    dim = red_detector(tmp_path / "m.onnx", gain=1 / 255)
    assert suspicions(dim, reddish())
    exported = f"preset yolov8 ({EXPORTER})"
    known = replace(dim.contract, sources=dict.fromkeys(FIELDS, exported))
    assert suspicions(Detector(tmp_path / "m.onnx", contract=known), reddish()) == []


def photographs() -> list[NDArray[np.uint8]]:
    paths = sorted((SHARED / "photos").glob("*.jpg"))
    return [np.ascontiguousarray(cv2.imread(str(path))[..., ::-1]) for path in paths]


REAL = (
    pytest.mark.skipif(not SHARED.is_dir(), reason="needs the shared models and photos"),
    pytest.mark.parametrize(
        ("file", "family"), [("yolox_nano", "yolox"), ("fastestdet_upstream", "fastestdet")]
    ),
)


@pytest.mark.slow
@REAL[0]
@REAL[1]
def test_real_models_with_a_wrong_range(file: str, family: str) -> None:
    right = preset(family)
    wrong = replace(right, value_range="0-1" if family == "yolox" else "0-255")
    detector = Detector(SHARED / "models" / f"{file}.onnx", contract=wrong)
    (found,) = common_suspicions(detector, photographs()[:8])
    assert found.startswith(f"8 of 8 pictures: value_range = '{wrong.value_range}'")


@REAL[0]
@REAL[1]
@pytest.mark.slow
def test_real_models_with_right_contracts(file: str, family: str) -> None:
    detector = Detector(SHARED / "models" / f"{file}.onnx", contract=preset(family))
    assert [suspicions(detector, image) for image in photographs()] == [[]] * 35


def test_of_several_pictures_only_what_half_of_them_raise_counts(tmp_path: Path) -> None:
    dim = red_detector(tmp_path / "m.onnx", gain=1 / 255)
    grey = np.full_like(reddish(), 90)
    assert suspicions(dim, reddish())
    raised = common_suspicions(dim, [reddish(), grey, reddish(), reddish()])
    assert len(raised) == 1
    assert raised[0].startswith(f"{3 if not suspicions(dim, grey) else 4} of 4 pictures: value_range")
    assert common_suspicions(dim, [reddish(), *[np.zeros_like(grey) + 20] * 3]) == []
    right = red_detector(tmp_path / "right.onnx")
    assert common_suspicions(right, [reddish()] * 3) == common_suspicions(right, []) == []
