#!/usr/bin/env bash
# OpenCV 5.0.0: a convolution with auto_pad SAME_UPPER and stride 2 is computed one pixel further up and left.
# Expected: what ONNX says and ONNX Runtime 1.31.1 computes: the odd row and column of padding go to the end.
# Seen: they go to the beginning, as in SAME_LOWER; the same with MaxPool and AveragePool, and without a warning. With
# stride 1 both agree.
# Hurt: who runs networks that came from TensorFlow by OpenCV: their strided layers are SAME_UPPER.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check opencv-python-headless==5.0.0.93 onnx==1.23.2 onnxruntime==1.31.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import cv2
import numpy as np
import onnxruntime
from onnx import TensorProto, helper

picture = np.random.default_rng(0).random((1, 1, 8, 8)).astype(np.float32)


def both(kind, padding, stride):
    size = 8 // stride
    weights = [helper.make_tensor("w", TensorProto.FLOAT, [1, 1, 3, 3], np.arange(9.0))] if kind == "Conv" else []
    node = helper.make_node(
        kind, ["x"] + ["w"] * len(weights), ["y"], kernel_shape=[3, 3], strides=[stride] * 2, auto_pad=padding
    )
    ends = [
        helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 1, s, s]) for n, s in (("x", 8), ("y", size))
    ]
    graph = helper.make_graph([node], "g", ends[:1], ends[1:], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10).SerializeToString()
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    net = cv2.dnn.readNetFromONNX(np.frombuffer(model, np.uint8))
    net.setInput(picture)
    return session.run(None, {"x": picture})[0], net.forward()


for kind in ("Conv", "MaxPool", "AveragePool"):
    for stride in (1, 2):
        right, seen = both(kind, "SAME_UPPER", stride)
        other, _ = both(kind, "SAME_LOWER", stride)
        print(kind, "stride", stride, "largest difference", np.abs(right - seen).max())
        if stride == 1:
            assert np.allclose(right, seen, atol=1e-4)
        else:
            assert not np.allclose(right, seen, atol=1e-2) and np.allclose(other, seen, atol=1e-4)
PY
