"""What onnxruntime executes: int8 convolutions, nodes that shift or draw, hot pixels under dynamic quantization."""

import platform

import numpy as np
import onnx
import pytest
from blurnoise_eval import STOP_SIGN
from blurnoise_eval.detectors.executed_graph import executed_graph, hot_pixel_text
from blurnoise_eval.detectors.model import OnnxModel
from blurnoise_eval.detectors.records import Detections
from onnx import helper
from onnxruntime.quantization import CalibrationDataReader, QuantType, quantize_dynamic, quantize_static

FLOAT = onnx.TensorProto.FLOAT


class Noise(CalibrationDataReader):
    """One picture of noise, for the ranges of a quantiser."""

    def __init__(self):
        picture = np.random.default_rng(0).random((1, 3, 320, 320), np.float32)
        self.feeds = iter([{"images": picture}])

    def get_next(self):
        return next(self.feeds, None)


def runs_of(path, nodes, size=8, opset=18, constants=()):
    """What runs of a graph of these nodes, from "x" to "y"."""
    picture = [
        helper.make_tensor_value_info(name, FLOAT, shape)
        for name, shape in (("x", [1, 3, size, size]), ("y", None))
    ]
    graph = helper.make_graph(nodes, "graph", picture[:1], picture[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    onnx.save(model, path)
    return executed_graph(OnnxModel(path))


@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason="other processors compute signed int8"
)
def test_convolutions_with_signed_activations_run_in_floating_point(tmp_path):
    quantize_static(STOP_SIGN, tmp_path / "int8.onnx", Noise(), op_types_to_quantize=["Conv"])
    runs = executed_graph(OnnxModel(tmp_path / "int8.onnx"))
    assert runs.text == "static quantization; 17 of 29 convolutions run in int8 on this processor"
    assert runs.warnings[0].startswith(
        "12 of 29 quantized convolutions run in floating point: quantize with unsigned"
    )


def test_convolutions_with_unsigned_activations_run_in_int8(tmp_path):
    unsigned = {"activation_type": QuantType.QUInt8}
    quantize_static(STOP_SIGN, tmp_path / "int8.onnx", Noise(), op_types_to_quantize=["Conv"], **unsigned)
    runs = executed_graph(OnnxModel(tmp_path / "int8.onnx"))
    assert (runs.in_int8, runs.convolutions, runs.warnings) == (29, 29, ())


def test_dynamic_quantization_is_told_from_static(tmp_path):
    quantize_dynamic(STOP_SIGN, tmp_path / "int8.onnx", weight_type=QuantType.QUInt8)
    runs = executed_graph(OnnxModel(tmp_path / "int8.onnx"))
    assert (runs.quantization, runs.in_int8) == ("dynamic", 29)


@pytest.mark.parametrize(
    "stated", [{}, {"coordinate_transformation_mode": "asymmetric"}], ids=("unstated", "stated")
)
def test_a_converted_resize_without_a_coordinate_mode_is_warned_of(tmp_path, stated):
    sizes = [
        helper.make_tensor("_v_5", FLOAT, [8], [0.0] * 4 + [1.0] * 4),
        helper.make_tensor("s", FLOAT, [4], [1, 1, 2, 2]),
    ]
    resize = helper.make_node("Resize", ["x", "_v_5", "s"], ["y"], mode="linear", **stated)
    runs = runs_of(tmp_path / "m.onnx", [resize], constants=sizes)
    assert [text[:43] for text in runs.warnings] == (
        [] if stated else ["1 Resize: converted from opset 9 or 10 with"]
    )


def test_nodes_that_draw_random_numbers_are_warned_of_in_branches_too(tmp_path):
    draw = helper.make_node("RandomNormalLike", ["x"], ["drawn"])
    branches = {
        f"{name}_branch": helper.make_graph(
            [draw], name, [], [helper.make_tensor_value_info("drawn", FLOAT, None)]
        )
        for name in ("then", "else")
    }
    nodes = [helper.make_node("If", ["yes"], ["y"], **branches)]
    runs = runs_of(
        tmp_path / "m.onnx", nodes, constants=[helper.make_tensor("yes", onnx.TensorProto.BOOL, [], [True])]
    )
    assert runs.warnings[0].startswith("RandomNormalLike: nodes that draw")


def test_what_other_runtimes_compute_otherwise_is_listed(tmp_path):
    sizes = [helper.make_tensor("s", FLOAT, [4], [1, 1, 0.5, 0.5])]
    nodes = [
        helper.make_node("Resize", ["x", "", "s"], ["small"], mode="linear", antialias=1),
        helper.make_node(
            "MaxPool", ["small"], ["y"], kernel_shape=[3, 3], strides=[2, 2], auto_pad="SAME_UPPER"
        ),
    ]
    runs = runs_of(tmp_path / "m.onnx", nodes, constants=sizes)
    assert [text.split(" (")[0] for text in runs.elsewhere] == [
        "1 Resize with antialias",
        "1 strided with the padding SAME_UPPER",
    ]


class Coarse:
    """A detector whose scores are rounded in steps of a share of the brightest pixel, as whole-tensor scales do."""

    def __init__(self, share):
        self.share = share

    def detect(self, image):
        step = max(self.share * image.max() / 255, 1e-6)
        score = np.float32(np.round(0.4 / step) * step)
        boxes = np.array([[40.0, 40, 60, 60], [0, 0, 5, 5]], np.float32)
        # The second box sees the hot pixel itself.
        return Detections(boxes, np.array([score, image[0, 0, 0] / 255], np.float32), np.array([0, 0]))


@pytest.mark.parametrize(("share", "text"), [(0.25, "by up to 0.10"), (0.0, None)])
def test_a_hot_pixel_that_moves_scores_elsewhere_is_measured(share, text):
    found = hot_pixel_text(Coarse(share), np.full((80, 80, 3), 100, np.uint8))
    assert (text in found) if text else found is None
