"""Graphs that answer the same to every picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper


def constant_graph(path: Path, outputs: list[NDArray[np.float32]], size_px: tuple[int, int]) -> Path:
    """Write a graph that takes one RGB picture (height, width) and gives ``outputs``, out0, out1, ..."""
    nodes = [
        helper.make_node("ReduceMean", ["images"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "none"], ["zero"]),
    ]
    held = [numpy_helper.from_array(np.float32(0), "none")]
    infos = []
    for number, values in enumerate(outputs):
        nodes.append(helper.make_node("Add", [f"held{number}", "zero"], [f"out{number}"]))
        held.append(numpy_helper.from_array(values, f"held{number}"))
        infos.append(helper.make_tensor_value_info(f"out{number}", TensorProto.FLOAT, values.shape))
    taken = [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, *size_px])]
    made = helper.make_graph(nodes, "constant", taken, infos, held)
    onnx.save(helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path
