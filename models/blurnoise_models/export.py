"""Export of a trained network: an ONNX file that says how it wants to be fed."""

from __future__ import annotations

import json
import logging
import warnings
from pathlib import Path
from typing import Any

import onnx
import torch
from onnx import helper

from blurnoise._core.writing import write_whole
from blurnoise_models.network import Decoded, SignNet

OPSET = 18


def contract(input_px: int) -> dict[str, Any]:
    """What pictures the file expects and what its outputs mean, as ``blurnoise inspect`` prints it.

    >>> contract(320)["family"], contract(320)["input_size_px"]
    ('yolov8', [320, 320])
    """
    return {
        "family": "yolov8",
        "classes": ["stop sign"],
        "colour": "rgb",
        "value_range": "0-1",
        "resize": "letterbox",
        "pad_value": 114,
        "input_size_px": [input_px, input_px],
        "nms_iou": 0.5,
    }


def write_onnx(
    network: SignNet, path: Path, *, input_px: int = 320, facts: dict[str, Any] | None = None
) -> Path:
    """Write ``network`` for pictures of ``input_px`` squared, and return ``path``.

    Input "images" (1, 3, input_px, input_px): RGB, sRGB-coded, [0, 1], letterboxed. Output "output0"
    (1, 5, A) as YOLOv8's: boxes (centre x, centre y, width, height) in px of the input, then the score in
    [0, 1], which was trained to be the IoU to be expected; A = (input_px / 8)² cells, without suppression of
    double answers. The contract, and ``facts`` about the training, travel in the metadata. The file appears
    whole or not at all. Raises ``ValueError`` for a suffix other than .onnx.

    >>> write_onnx(SignNet(), Path("signs.pt"))
    Traceback (most recent call last):
        ...
    ValueError: path = 'signs.pt': must end in .onnx
    """
    if path.suffix != ".onnx":
        raise ValueError(f"path = {str(path)!r}: must end in .onnx")
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # no remarks about the exporter's insides
    with warnings.catch_warnings(action="ignore", category=FutureWarning):
        program = torch.onnx.export(
            Decoded(network).eval(),
            (torch.zeros(1, 3, input_px, input_px),),
            input_names=["images"],
            output_names=["output0"],
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    if program is None:
        raise RuntimeError("torch.onnx.export returned nothing")
    model = program.model_proto
    _forget_origins(model)
    properties = {"blurnoise.contract": json.dumps(contract(input_px))}
    if facts:
        properties["blurnoise.training"] = json.dumps(facts)
    helper.set_model_props(model, properties)
    onnx.checker.check_model(model)
    write_whole(path, model.SerializeToString())
    return path


def _forget_origins(model: onnx.ModelProto) -> None:
    """Drop the exporter's notes on every node and value: they hold the source's place on the machine it ran on."""
    graph = model.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer):
        part.ClearField("metadata_props")
