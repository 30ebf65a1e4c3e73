"""ONNX graphs of YOLOv8's form whose answer, or whose loading, never ends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZE_PX = 640
_INPUT = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, SIZE_PX, SIZE_PX])
_OUTPUT = helper.make_tensor_value_info("output0", TensorProto.FLOAT, [1, 84, 8400])
_ZEROS = numpy_helper.from_array(np.zeros((1, 84, 8400), np.float32), "zeros")


def endless_below(path: Path, mean: float) -> Path:
    """A loop that never ends for inputs whose mean is below this one, and answers zeros else."""
    goes_on = helper.make_tensor_value_info("on", TensorProto.BOOL, [])
    body = helper.make_graph(
        [helper.make_node("Identity", ["on"], ["on_out"]), helper.make_node("Identity", ["x"], ["x_out"])],
        "body",
        [helper.make_tensor_value_info("turn", TensorProto.INT64, []), goes_on, _like_output("x")],
        [helper.make_tensor_value_info("on_out", TensorProto.BOOL, []), _like_output("x_out")],
    )
    nodes = [
        helper.make_node("ReduceMean", ["images"], ["mean"], keepdims=0),
        helper.make_node("Less", ["mean", "limit"], ["below"]),
        helper.make_node("Loop", ["", "below", "zeros"], ["output0"], body=body),
    ]
    return _saved(path, nodes, [numpy_helper.from_array(np.float32(mean), "limit")])


def endless_loading(path: Path) -> Path:
    """Products of large constants, which onnxruntime computes while it loads the graph: minutes of it."""
    size = numpy_helper.from_array(np.array([3000, 3000]), "size")
    nodes = [helper.make_node("ConstantOfShape", ["size"], ["a0"])]
    nodes += [helper.make_node("MatMul", ["a0", f"a{n}"], [f"a{n + 1}"]) for n in range(200)]
    nodes += [
        helper.make_node("ReduceMean", ["a200"], ["folded"], keepdims=0),
        helper.make_node("ReduceMean", ["images"], ["mean"], keepdims=0),
        helper.make_node("Add", ["folded", "mean"], ["both"]),
        helper.make_node("Add", ["zeros", "both"], ["output0"]),
    ]
    return _saved(path, nodes, [size])


def _like_output(name: str) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 84, 8400])


def _saved(path: Path, nodes: list[onnx.NodeProto], constants: list[onnx.TensorProto]) -> Path:
    graph = helper.make_graph(nodes, "graph", [_INPUT], [_OUTPUT], [_ZEROS, *constants])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    return path
