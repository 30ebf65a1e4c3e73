"""A recogniser that reads the colours of bands: a graph made by hand, so that every answer is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

LETTERS = "b\ng\nr"  # by the channels of a network that takes blue, green, red
COLOURS = {"r": (255, 0, 0), "g": (0, 255, 0), "b": (0, 0, 255), "-": (0, 0, 0)}


def band_reader(
    path: Path,
    *,
    shape: tuple[int | str, int | str, int | str] = ("N", 48, "W"),
    height: int = 48,
    dtype: int = TensorProto.FLOAT,
    softmax: bool = True,
    metadata: dict[str, str] | None = None,
) -> Path:
    """Write a recogniser that answers, every 8 px, with the brightest channel: classes blank, b, g, r, space.

    Logits: 20 times a channel's mean over 8 columns, 10 for the blank, so that dark (-1) and zero (0) are blank.
    """
    numpy_type = helper.tensor_dtype_to_np_dtype(dtype)
    weight = np.zeros((5, 3, height, 8), numpy_type)
    weight[1:4] = np.eye(3)[:, :, None, None] * 20 / (8 * height)
    bias = np.array([10, 0, 0, 0, -10], numpy_type)
    nodes = [
        helper.make_node("Conv", ["x", "weight", "bias"], ["columns"], strides=[height, 8]),
        helper.make_node("Squeeze", ["columns", "axis"], ["flat"]),
        helper.make_node("Transpose", ["flat"], ["logits"], perm=[0, 2, 1]),
    ]
    nodes += [helper.make_node("Softmax", ["logits"], ["answer"], axis=-1)] if softmax else []
    answer = "answer" if softmax else "logits"
    graph = helper.make_graph(
        nodes,
        "bands",
        [helper.make_tensor_value_info("x", dtype, [shape[0], 3, *shape[1:]])],
        [helper.make_tensor_value_info(answer, dtype, [shape[0], "T", 5])],
        [
            numpy_helper.from_array(weight, "weight"),
            numpy_helper.from_array(bias, "bias"),
            numpy_helper.from_array(np.array([2]), "axis"),
        ],
    )
    return saved(graph, path, {"character": LETTERS} if metadata is None else metadata)


def constant_reader(path: Path, answer: NDArray[np.generic], metadata: dict[str, str] | None = None) -> Path:
    """Write a recogniser that gives the same answer to every picture."""
    kind = helper.np_dtype_to_tensor_dtype(answer.dtype)
    graph = helper.make_graph(
        [helper.make_node("Identity", ["rows"], ["answer"])],
        "constant",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 48, "W"])],
        [helper.make_tensor_value_info("answer", kind, answer.shape)],
        [numpy_helper.from_array(answer, "rows")],
    )
    return saved(graph, path, {"character": LETTERS} if metadata is None else metadata)


def saved(graph: onnx.GraphProto, path: Path, metadata: dict[str, str]) -> Path:
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    onnx.save(model, path)
    return path
