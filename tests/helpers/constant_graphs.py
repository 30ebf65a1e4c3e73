"""Graphs with known answers: the same for every picture, or such that grow with its brightness."""

from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

Values = NDArray[Any]


def answering_graph(
    path,
    outputs,
    taken,
    *,
    takes=TensorProto.FLOAT,
    dtype=TensorProto.FLOAT,
    white=1.0,
    shapes=None,
    extras=(),
    metadata=None,
    opset=17,
):
    """Write a graph that takes a picture of the form ``taken``, "images", and gives ``outputs`` by their names.

    outputs: values for a black picture, in ``dtype`` unless they are integers, and what one whose mean is ``white``
    adds to them, None for nothing. takes: the picture's type. shapes: of outputs, as the graph states them. extras:
    further inputs, which change nothing.
    """
    kind = helper.tensor_dtype_to_np_dtype(dtype)
    held = [
        numpy_helper.from_array(np.array([1, 1, -1, 1], np.int64), "line"),
        numpy_helper.from_array(np.array([1], np.int64), "one"),
        numpy_helper.from_array(np.array(1 / white, np.float32), "scale"),
    ]
    nodes = [
        helper.make_node("Cast", ["images"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("Reshape", ["numbers", "line"], ["row"]),
        helper.make_node("GlobalAveragePool", ["row"], ["mean"]),
        helper.make_node("Mul", ["mean", "scale"], ["share"]),
        helper.make_node("Reshape", ["share", "one"], ["flat"]),
        helper.make_node("Cast", ["flat"], ["brightness"], to=dtype),
    ]
    infos = []
    for name, (base, gain) in outputs.items():
        integral = base.dtype.kind == "i"
        held.append(numpy_helper.from_array(base if integral else base.astype(kind), f"{name}_base"))
        if gain is None:
            nodes.append(helper.make_node("Identity", [f"{name}_base"], [name]))
        else:
            held.append(numpy_helper.from_array(gain.astype(kind), f"{name}_gain"))
            nodes.append(helper.make_node("Mul", ["brightness", f"{name}_gain"], [f"{name}_part"]))
            nodes.append(helper.make_node("Add", [f"{name}_base", f"{name}_part"], [name]))
        stated = helper.np_dtype_to_tensor_dtype(base.dtype) if integral else dtype
        infos.append(helper.make_tensor_value_info(name, stated, (shapes or {}).get(name, base.shape)))
    inputs = [helper.make_tensor_value_info("images", takes, taken)]
    for name, kind_of, shape in extras:
        inputs.insert(0, helper.make_tensor_value_info(name, kind_of, shape))
        nodes.append(helper.make_node("Identity", [name], [f"{name}_seen"]))
    made = helper.make_graph(nodes, "answers", inputs, infos, held)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    helper.set_model_props(model, dict(metadata or {}))
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return path


def constant_graph(path, outputs, size_px):
    """Write a graph that takes one RGB picture (height, width) and gives ``outputs``, out0, out1, ..."""
    named = {f"out{number}": (values, None) for number, values in enumerate(outputs)}
    return answering_graph(path, named, [1, 3, *size_px])
