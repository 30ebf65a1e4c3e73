#!/usr/bin/env bash
# onnxslim 0.1.98: a model that adds noise gives the same "noise" on every call once it is slimmed.
# Expected: nodes that draw (RandomNormal, RandomNormalLike, Bernoulli, Dropout in training) stay, as onnxsim 0.8.1 leaves them.
# Seen: each whose inputs are constants is computed once and stored as a constant; the slimmed model is a single Add.
# Hurt: who puts sensor noise or augmentation into an exported graph, or draws several samples of one network.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check onnxslim==0.1.98 onnxsim==0.8.1 onnx==1.23.2 onnxruntime==1.31.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import copy

import numpy as np
import onnxruntime
import onnxsim
import onnxslim
from onnx import TensorProto, helper

constants = [
    helper.make_tensor("half", TensorProto.FLOAT, [1, 64], [0.5] * 64),
    helper.make_tensor("ratio", TensorProto.FLOAT, [], [0.5]),
    helper.make_tensor("training", TensorProto.BOOL, [], [True]),
]
draws = {
    "RandomNormal": helper.make_node("RandomNormal", [], ["noise"], shape=[1, 64]),
    "RandomNormalLike": helper.make_node("RandomNormalLike", ["half"], ["noise"]),
    "Bernoulli": helper.make_node("Bernoulli", ["half"], ["noise"]),
    "Dropout": helper.make_node("Dropout", ["half", "ratio", "training"], ["noise"]),
}


def model(draw):
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 64]) for n in ("x", "y")]
    used = [c for c in constants if c.name in draw.input]
    graph = helper.make_graph([draw, helper.make_node("Add", ["x", "noise"], ["y"])], "g", ends[:1], ends[1:], used)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)


def differ(made):
    session = onnxruntime.InferenceSession(made.SerializeToString(), providers=["CPUExecutionProvider"])
    one, other = (session.run(None, {"x": np.zeros((1, 64), np.float32)})[0] for _ in range(2))
    return not np.array_equal(one, other)


for name, draw in draws.items():
    slim, simple = onnxslim.slim(copy.deepcopy(model(draw))), onnxsim.simplify(copy.deepcopy(model(draw)))[0]
    kinds = [node.op_type for node in slim.graph.node]
    print(name, "two calls differ:", differ(model(draw)), "onnxsim", differ(simple), "onnxslim", differ(slim), kinds)
    assert differ(model(draw)) and differ(simple)
    assert kinds == ["Add"] and not differ(slim)
PY
