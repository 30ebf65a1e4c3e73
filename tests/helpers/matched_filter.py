"""A stop-sign detector that is made in a moment: a matched filter, written as an ONNX graph.

For each sign size the graph compares every patch p of the picture's luma with the drawn sign t (zero mean,
unit norm) by normalised cross-correlation, NCC = <t, p> / |p - mean(p)|. Its confidence is the share of the
patch's energy that the sign explains, max(NCC, 0)².

Domain: sRGB-coded RGB pictures in [0, 1] with an upright sign of one of the filter's sizes, wholly inside the
picture; a sign 10 % larger or smaller is not recognised. Output as YOLOv8's: (1, 4 + 1, A), boxes
(centre x, centre y, width, height) in px, then confidence.
"""

import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from blurnoise.charts import stop_sign
from blurnoise.optics.colour import srgb_from_linear

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709, applied to coded values
STRIDES = (32, 16, 8)  # px, of the output cells that take the largest, middle and smallest sign
# One DN of 255, squared: added to a patch's variance, so that 8-bit rounding of a flat patch is nothing.
VARIANCE_FLOOR = (1 / 255) ** 2
PAD_VALUE = 118  # of 255: the background of the drawn sign, 18 % reflectance, sRGB-coded
_PHASES = 4  # correlations per output pixel and axis; see _Graph.correlate


def build(path, *, sizes_px=(100, 50, 32), input_px=320):
    """Write the detector for square inputs of ``input_px`` and return its path.

    sizes_px: three sign widths, px, largest first; they answer on the strides 32, 16 and 8. Correlation runs at every
    pixel, at every second one for signs of 64 px or more; that grid includes the picture's centre. Each output cell
    reports the best of its positions where that lies, so boxes are not rounded to cells.
    """
    graph = _Graph()
    coded = graph.add("Conv", "images", LUMA.reshape(1, 3, 1, 1), np.array([-0.5], np.float32))
    scales = zip(reversed(sizes_px), reversed(STRIDES), strict=True)
    answers = [_answers(graph, coded, size, stride, input_px) for size, stride in scales]
    graph.add("Concat", *answers, axis=2, output="output0")
    cells = sum((input_px // stride) ** 2 for stride in STRIDES)
    images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, input_px, input_px])
    output = helper.make_tensor_value_info("output0", TensorProto.FLOAT, [1, 5, cells])
    whole = helper.make_graph(graph.nodes, "matched_filter", [images], [output], graph.constants)
    opset = [helper.make_opsetid("", 17)]
    model = helper.make_model(whole, opset_imports=opset, ir_version=8, producer_name="blurnoise")
    contract = {
        "family": "yolov8",
        "classes": ["stop sign"],
        "colour": "rgb",
        "value_range": "0-1",
        "resize": "letterbox",
        "pad_value": PAD_VALUE,
        "input_size_px": [input_px, input_px],
        "nms_iou": 0.5,
    }
    helper.set_model_props(model, {"blurnoise.contract": json.dumps(contract)})
    onnx.save(model, path)
    return Path(path)


def _answers(graph, coded, size_px, stride, input_px):
    """Add one sign size; return its answers (1, 5, (input_px / stride)²)."""
    window = size_px + size_px % 2  # even, as the picture, so that a centred sign is centred in it
    block = 2 if size_px >= 64 else 1  # px, of the blocks that pictures are averaged over before
    start = (input_px - window) // 2 % block  # of the first block, so that a centred sign falls on the grid
    if block > 1:
        coded = graph.slice(coded, start, input_px, input_px)
        coded = graph.add("AveragePool", coded, kernel_shape=[block, block], strides=[block, block])
    side = window // block
    positions = (input_px - start) // block - side + 1

    def mean_of(signal):
        down = graph.correlate(signal, np.full((side, 1), 1 / side), positions, positions + side - 1)
        return graph.correlate(down, np.full((1, side), 1 / side), positions, positions)

    correlation = graph.correlate(coded, _template(size_px, window, block), positions, positions)
    mean, mean_square = mean_of(coded), mean_of(graph.add("Mul", coded, coded))
    variance = graph.add("Sub", mean_square, graph.add("Mul", mean, mean))
    energy = graph.add("Add", variance, np.float32(VARIANCE_FLOOR))
    positive = graph.add("Relu", correlation)
    explained = graph.add("Mul", graph.add("Mul", positive, positive), np.float32(1 / side**2))
    confidence = graph.add("Div", explained, energy)

    # Index m of the padded map stands for the centre (m + offset) · block; cells of the output tile that map.
    before = (start + window // 2) // block
    grid, cell = input_px // block, stride // block
    after = grid - before - positions
    padded = graph.add("Pad", confidence, np.array([0, 0, before, before, 0, 0, after, after], np.int64))
    best, where = graph.add("MaxPool", padded, outputs=2, kernel_shape=[cell, cell], strides=[cell, cell])
    offset, count = (start + window // 2) / block - before, (input_px // stride) ** 2
    flat = np.array([1, 1, count], np.int64)
    row = graph.add("Div", where, np.int64(grid))
    column = graph.add("Sub", where, graph.add("Mul", row, np.int64(grid)))
    centres = []
    for index in (column, row):
        steps = graph.add("Cast", graph.add("Reshape", index, flat), to=TensorProto.FLOAT)
        centres.append(graph.add("Mul", graph.add("Add", steps, np.float32(offset)), np.float32(block)))
    size = np.full((1, 2, count), size_px, np.float32)
    return graph.add("Concat", *centres, size, graph.add("Reshape", best, flat), axis=1)


class _Graph:
    """Collects the nodes and constants of one ONNX graph."""

    def __init__(self):
        self.nodes, self.constants = [], []

    def add(self, operator, *inputs, output=None, outputs=1, **attributes):
        """Append a node, its inputs names or arrays; returns the name of its output, or their names."""
        given = [each if isinstance(each, str) else self._constant(each) for each in inputs]
        name = output or f"{operator.lower()}_{len(self.nodes)}"
        names = [name] if outputs == 1 else [f"{name}_{each}" for each in range(outputs)]
        self.nodes.append(helper.make_node(operator, given, names, **attributes))
        return name if outputs == 1 else names

    def _constant(self, value):
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def slice(self, tensor, start, *ends):
        """Rows and columns of (N, C, H, W)."""
        bounds = ([start, start], ends, [2, 3])
        return self.add("Slice", tensor, *(np.array(each, np.int64) for each in bounds))

    def correlate(self, tensor, kernel, rows, columns):
        """Correlation of (1, 1, H, H) with a kernel at every pixel where it fits, (1, 1, rows, columns).

        A convolution with one output channel runs about ten times slower than its arithmetic. So this one
        steps by _PHASES pixels, with one channel for each shift in between; DepthToSpace interleaves them.
        """
        height, width = kernel.shape
        spread = _PHASES - 1
        bank = np.zeros((_PHASES, _PHASES, height + spread, width + spread), np.float32)
        for y in range(_PHASES):
            for x in range(_PHASES):
                bank[y, x, y : y + height, x : x + width] = kernel
        weights = bank.reshape(_PHASES**2, 1, height + spread, width + spread)
        phases = self.add("Conv", tensor, weights, strides=[_PHASES] * 2, pads=[0, 0, spread, spread])
        return self.slice(self.add("DepthToSpace", phases, blocksize=_PHASES), 0, rows, columns)


def _template(size_px, window, block):
    """The drawn sign's luma in the filter's blocks: zero mean, unit norm."""
    coded = srgb_from_linear(stop_sign(size_px, height_px=window, width_px=window))[0].numpy()
    side = window // block
    luma = np.tensordot(LUMA, coded, 1).reshape(side, block, side, block).mean(axis=(1, 3)).astype(np.float64)
    luma -= luma.mean()
    return luma / np.linalg.norm(luma)
