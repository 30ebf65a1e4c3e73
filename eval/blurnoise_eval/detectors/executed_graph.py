"""The graph that onnxruntime executes on this processor: what of it runs in int8, and what others compute otherwise.

Domain: a model's file as it is, and the file that onnxruntime writes of it after its own optimisations.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import OnnxModel
from blurnoise_eval.detectors.records import Detections

_FLOAT = {
    "Conv",
    "ConvTranspose",
    "FusedConv",
    "NhwcFusedConv",
    "NchwcConv",
    "NhwcConv",
    "FusedConvTranspose",
}
_INT8 = {"QLinearConv", "ConvInteger", "NhwcQLinearConv"}
_DYNAMIC = {"DynamicQuantizeLinear", "ConvInteger", "MatMulInteger", "DynamicQuantizeMatMul"}
_STATIC = {"QuantizeLinear", "QLinearConv", "QLinearMatMul"}
_RANDOM = {
    "RandomNormal",
    "RandomNormalLike",
    "RandomUniform",
    "RandomUniformLike",
    "Bernoulli",
    "Multinomial",
}
_STRIDED = {"Conv", "ConvTranspose", "MaxPool", "AveragePool", "LpPool"}
_CONVERTED = re.compile(r"_v_\d+")
"""The names that onnx's version converter gives to inputs that it adds."""
_MOVES = 0.02
"""What a float model's scores move by is a tenth of it."""
_DARK = 0.04
_APART = 1.0 / 8  # of the picture's sides: what lies so near to the hot pixel may see it


@dataclass(frozen=True)
class ExecutedGraph:
    """What runs of a model.

    quantization: "none", "static", "dynamic" or "static and dynamic". convolutions: how many are executed, and
    in_int8 of them in int8; None where onnxruntime does not write the graph. warnings: sentences on results here.
    elsewhere: on what other runtimes compute otherwise.
    """

    quantization: str
    convolutions: int | None
    in_int8: int | None
    warnings: tuple[str, ...]
    elsewhere: tuple[str, ...]

    @property
    def text(self) -> str:
        """One line.

        >>> ExecutedGraph("static", 29, 17, (), ()).text
        'static quantization; 17 of 29 convolutions run in int8 on this processor'
        """
        kind = "no quantization" if self.quantization == "none" else f"{self.quantization} quantization"
        if not self.convolutions:
            return kind
        if self.quantization == "none" and not self.in_int8:
            return f"{kind}; {self.convolutions} convolutions run in floating point"
        return f"{kind}; {self.in_int8} of {self.convolutions} convolutions run in int8 on this processor"


def executed_graph(model: OnnxModel) -> ExecutedGraph | None:
    """What runs of a model's file; None for a file that onnx cannot read, such as one of onnxruntime's own format.

    It opens the model a second time. Raises ``TimeoutError``.

    >>> from blurnoise_eval import STOP_SIGN
    >>> executed_graph(OnnxModel(STOP_SIGN)).text
    'no quantization; 29 convolutions run in floating point'
    """
    try:
        stored = onnx.load(str(model.path), load_external_data=False)
    except Exception:  # of a protobuf library that may change
        return None
    nodes = list(_nodes(stored.graph)) + [node for function in stored.functions for node in function.node]
    kinds = {node.op_type for node in nodes}
    quantization = (
        " and ".join(name for name, of in (("static", _STATIC), ("dynamic", _DYNAMIC)) if kinds & of)
        or "none"
    )
    executed = _executed(model)
    of_type = [node.op_type for node in executed or ()]
    int8 = sum(name in _INT8 for name in of_type)
    convolutions = int8 + sum(name in _FLOAT for name in of_type)
    warnings = (
        [*_int8_warnings(stored, nodes, int8), *_resize_warnings(nodes)]
        if executed
        else _resize_warnings(nodes)
    )
    if drawn := sorted(kinds & _RANDOM):
        warnings.append(
            f"{', '.join(drawn)}: nodes that draw random numbers; the same picture gets other detections"
        )
    known = executed is not None
    return ExecutedGraph(
        quantization,
        convolutions if known else None,
        int8 if known else None,
        tuple(warnings),
        tuple(_elsewhere(nodes)),
    )


def hot_pixel_text(detector: Detector, picture: NDArray[np.uint8]) -> str | None:
    """What one hot pixel does to scores elsewhere in a dark copy of a picture (h, w, 3), where that is not nothing.

    With dynamic quantization the scales are those of whole tensors, so that one bright pixel coarsens all the rest.
    """
    dark = np.asarray(picture * _DARK, np.uint8)
    hot = dark.copy()
    hot[0, 0] = 255
    height, width = picture.shape[:2]
    moved = _largest_change(*(_beyond(detector.detect(image), width, height) for image in (dark, hot)))
    if moved < _MOVES:
        return None
    return (
        f"one hot pixel in the corner of a dark picture changes scores elsewhere by up to {moved:.2f}: dynamic "
        "quantization takes its scales from whole tensors"
    )


def _beyond(found: Detections, width: int, height: int) -> Detections:
    """The detections that do not reach the corner with the hot pixel."""
    apart = (found.boxes_xyxy[:, 0] > width * _APART) | (found.boxes_xyxy[:, 1] > height * _APART)
    return found[apart]


def _largest_change(one: Detections, two: Detections) -> float:
    """Of the best score of a class."""
    classes = {*one.class_ids.tolist(), *two.class_ids.tolist()}
    best = [
        [float(each.scores[each.class_ids == number].max(initial=0.0)) for number in classes]
        for each in (one, two)
    ]
    return float(np.abs(np.subtract(best[0], best[1])).max(initial=0.0))


def _executed(model: OnnxModel) -> list[Any] | None:
    """The nodes after onnxruntime's optimisations; None where it cannot write them, as beyond 2 GiB."""
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "executed.onnx"
        try:
            model.load(optimised=written)
            return list(_nodes(onnx.load(str(written), load_external_data=False).graph))
        except TimeoutError:
            raise
        except Exception:  # onnxruntime's and protobuf's exceptions share no base class
            return None


def _nodes(graph: Any) -> Iterator[Any]:
    """All nodes of a graph, those of branches and loops included."""
    for node in graph.node:
        yield node
        for attribute in node.attribute:
            for inner in (*([attribute.g] if attribute.HasField("g") else ()), *attribute.graphs):
                yield from _nodes(inner)


def _value(node: Any, name: str, default: Any) -> Any:
    found = (onnx.helper.get_attribute_value(each) for each in node.attribute if each.name == name)
    value = next(found, default)
    return value.decode() if isinstance(value, bytes) else value


def _int8_warnings(model: Any, nodes: list[Any], int8: int) -> list[str]:
    """Convolutions between quantized numbers that are computed in floating point nevertheless."""
    makers = {output: node for node in nodes for output in node.output}
    quantized = [
        node
        for node in nodes
        if node.op_type in _INT8
        or (node.op_type == "Conv" and all(_dequantized(makers, name) for name in node.input[:2]))
    ]
    if len(quantized) <= int8:
        return []
    zeros = {each.name: each.data_type for each in model.graph.initializer}
    signed = any(
        node.op_type == "QuantizeLinear"
        and zeros.get(node.input[2] if len(node.input) > 2 else "") == onnx.TensorProto.INT8
        for node in nodes
    )
    text = f"{len(quantized) - int8} of {len(quantized)} quantized convolutions run in floating point"
    return [
        f"{text}: quantize with unsigned activations (activation_type=QuantType.QUInt8)" if signed else text
    ]


def _dequantized(makers: dict[str, Any], name: str) -> bool:
    return name in makers and makers[name].op_type == "DequantizeLinear"


def _resize_warnings(nodes: list[Any]) -> list[str]:
    converted = [
        node
        for node in nodes
        if node.op_type == "Resize"
        and _value(node, "mode", "nearest") != "nearest"
        and not _value(node, "coordinate_transformation_mode", "")
        and any(map(_CONVERTED.fullmatch, node.input))
    ]
    if not converted:
        return []
    return [
        f"{len(converted)} Resize: converted from opset 9 or 10 without coordinate_transformation_mode, which shifts "
        "their maps by 0.25 to 0.5 px; export with opset 11 or later"
    ]


def _elsewhere(nodes: list[Any]) -> list[str]:
    antialiased = sum(node.op_type == "Resize" and bool(_value(node, "antialias", 0)) for node in nodes)
    uneven = sum(
        node.op_type in _STRIDED
        and _value(node, "auto_pad", "") == "SAME_UPPER"
        and max(_value(node, "strides", [1])) > 1
        for node in nodes
    )
    found = [(antialiased, "Resize with antialias (OpenVINO 2026.4 and OpenCV 5.0 leave it out)")]
    found += [(uneven, "strided with the padding SAME_UPPER (OpenCV 5.0 shifts them by a pixel)")]
    return [f"{count} {text}" for count, text in found if count]
