#!/usr/bin/env bash
# ONNX Runtime 1.31.1: its float16 converter makes a file that cannot be loaded where two Resize nodes share a constant.
# Expected: a valid model becomes a valid model, whoever holds the scales.
# Seen: scales in a Constant node that two Resize nodes read get two Cast nodes of one name and one output. The converter
# returns without a word; the session refuses the file. Scales as an initializer, or a constant for each node, work.
# Hurt: who converts a detector with two upsampling layers, as torch.onnx.export writes it: it shares equal constants.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check onnx==1.23.2 onnxruntime==1.31.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.transformers.float16 import convert_float_to_float16


def loads(names, constant):
    scales = [numpy_helper.from_array(np.array([1, 1, 2, 2], np.float32), name) for name in sorted({*names})]
    nodes = [helper.make_node("Constant", [], [each.name], value=each) for each in scales if constant]
    nodes += [
        helper.make_node("Resize", ["x", "", names[0]], ["a"], name="up1"),
        helper.make_node("Resize", ["a", "", names[1]], ["y"], name="up2"),
    ]
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 1, s, s]) for n, s in (("x", 2), ("y", 8))]
    graph = helper.make_graph(nodes, "g", ends[:1], ends[1:], [] if constant else scales)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    onnx.checker.check_model(model)
    onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    half = convert_float_to_float16(model)
    try:
        onnxruntime.InferenceSession(half.SerializeToString(), providers=["CPUExecutionProvider"])
    except Exception as error:
        print(names, "constant" if constant else "initializer", "->", str(error)[:120])
        return False
    print(names, "constant" if constant else "initializer", "-> loads")
    return True


assert loads(("s", "s"), constant=False)
assert loads(("s", "t"), constant=True)
assert not loads(("s", "s"), constant=True)
PY
