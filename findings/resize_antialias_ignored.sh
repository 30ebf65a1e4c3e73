#!/usr/bin/env bash
# OpenVINO 2026.4.1 and OpenCV 5.0.0: a Resize node with antialias=1 (ONNX opset 18) is computed without it.
# Expected: a wide filter, as ONNX Runtime 1.31.1, or a refusal of the model.
# Seen: the plain bilinear value of the four nearest pixels, in both, without a word: at half size the noise of a picture is
# .50 of what it was, not .31.
# Hurt: who puts the resize of training (Pillow's, torchvision's) into the model and then changes the runtime.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check opencv-python-headless==5.0.0.93 openvino==2026.4.1 onnx==1.23.2 onnxruntime==1.31.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import cv2
import numpy as np
import onnxruntime
import openvino
from onnx import TensorProto, helper

picture = np.random.default_rng(0).random((1, 1, 64, 64)).astype(np.float32)


def model(antialias):
    node = helper.make_node("Resize", ["x", "", "s"], ["y"], mode="linear", antialias=antialias)
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 1, s, s]) for n, s in (("x", 64), ("y", 32))]
    scales = helper.make_tensor("s", TensorProto.FLOAT, [4], [1, 1, 0.5, 0.5])
    graph = helper.make_graph([node], "g", ends[:1], ends[1:], [scales])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10).SerializeToString()


def by_onnxruntime(content):
    return onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"]).run(None, {"x": picture})[0]


def by_openvino(content):
    core = openvino.Core()
    return core.compile_model(core.read_model(content, b""), "CPU", {"INFERENCE_PRECISION_HINT": "f32"})([picture])[0]


def by_opencv(content):
    net = cv2.dnn.readNetFromONNX(np.frombuffer(content, np.uint8))
    net.setInput(picture)
    return net.forward()


wide, plain = by_onnxruntime(model(1)), by_onnxruntime(model(0))
print("noise kept: wide", wide.std() / picture.std(), "plain", plain.std() / picture.std())
for run in (by_openvino, by_opencv):
    seen = run(model(1))
    print(run.__name__, "from the wide filter", np.abs(seen - wide).max(), "from the plain one", np.abs(seen - plain).max())
    assert np.allclose(seen, plain, atol=1e-5) and np.abs(seen - wide).max() > 0.1
PY
