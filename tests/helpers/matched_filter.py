"""A stop-sign detector that is made in a moment: a matched filter, written as an ONNX graph.

For each sign size the graph compares every patch p of the picture's luma with the drawn sign t (zero mean,
unit norm) by normalised cross-correlation, NCC = <t, p> / |p - mean(p)|. Its confidence is the share of the
patch's energy that the sign explains, max(NCC, 0)². Nothing is trained and nothing is downloaded.

Domain: sRGB-coded RGB pictures in [0, 1] with an upright sign of one of the filter's sizes, wholly inside the
picture; a sign 10 % larger or smaller is not recognised. Output as YOLOv8's: (1, 4 + 1, A), boxes
(centre x, centre y, width, height) in px, then confidence.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from blurnoise._core.files import write_whole
from blurnoise.charts import stop_sign
from blurnoise.optics.colour import srgb_from_linear

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709, applied to coded values
STRIDES = (32, 16, 8)  # px, of the output cells that take the largest, middle and smallest sign
# One DN of 255, squared: added to a patch's variance, so that 8-bit rounding of a flat patch is nothing.
VARIANCE_FLOOR = (1 / 255) ** 2
PAD_VALUE = 118  # of 255: the background of the drawn sign, 18 % reflectance, sRGB-coded
_PHASES = 4  # correlations per output pixel and axis; see _Graph.correlate

FloatArray = NDArray[np.float32]


def build(path: str | Path, *, sizes_px: Sequence[int] = (100, 50, 32), input_px: int = 320) -> Path:
    """Write the detector for square inputs of ``input_px`` and return its path.

    ``sizes_px``: three sign widths, px, largest first; they answer on the strides 32, 16 and 8. The contract
    travels in the graph's metadata. Correlation runs at every pixel, at every second one for signs of 64 px
    or more; that grid includes the picture's centre. Each output cell reports the best of its positions
    where that lies, so boxes are not rounded to cells.
    """
    sizes = tuple(sizes_px)
    graph = _Graph()
    coded = graph.add(
        "Conv",
        "images",
        graph.constant(LUMA.reshape(1, 3, 1, 1)),
        graph.constant(np.array([-0.5], np.float32)),
    )
    answers = [
        _answers(graph, coded, size, stride, input_px)
        for size, stride in zip(reversed(sizes), reversed(STRIDES), strict=True)
    ]
    graph.add("Concat", *answers, axis=2, output="output0")
    model = graph.model(input_px, cells=sum((input_px // stride) ** 2 for stride in STRIDES))
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
    onnx.checker.check_model(model)
    path = Path(path)
    write_whole(path, model.SerializeToString())
    return path


def _answers(graph: _Graph, coded: str, size_px: int, stride: int, input_px: int) -> str:
    """Add one sign size; return its answers (1, 5, (input_px / stride)²)."""
    window, block = _window_px(size_px), _block_px(size_px)
    start = (input_px - window) // 2 % block  # of the first block, so that a centred sign falls on the grid
    if block > 1:
        coded = graph.slice(coded, start, input_px)
        coded = graph.add("AveragePool", coded, kernel_shape=[block, block], strides=[block, block])
    side = window // block
    positions = (input_px - start) // block - side + 1

    correlation = graph.correlate(coded, _template(size_px), positions, positions)
    both = graph.add("Concat", coded, graph.add("Mul", coded, coded), axis=0)
    mean_down = graph.correlate(both, np.full((side, 1), 1 / side), positions, positions + side - 1)
    means = graph.correlate(mean_down, np.full((1, side), 1 / side), positions, positions)
    mean, mean_square = graph.take(means, 0), graph.take(means, 1)
    variance = graph.add("Sub", mean_square, graph.add("Mul", mean, mean))
    energy = graph.add("Add", variance, graph.constant(np.float32(VARIANCE_FLOOR)))
    positive = graph.add("Relu", correlation)
    explained = graph.add(
        "Mul", graph.add("Mul", positive, positive), graph.constant(np.float32(1 / side**2))
    )
    confidence = graph.add("Div", explained, energy)

    # Index m of the padded map stands for the centre (m + offset) · block; cells of the output tile that map.
    before = (start + window // 2) // block
    grid = input_px // block
    after = grid - before - positions
    pads = np.array([0, 0, before, before, 0, 0, after, after], np.int64)
    padded = graph.add("Pad", confidence, graph.constant(pads))
    cell = stride // block
    best, where = graph.add_pair("MaxPool", padded, kernel_shape=[cell, cell], strides=[cell, cell])
    offset = (start + window // 2) / block - before
    width = graph.constant(np.int64(grid))
    row = graph.add("Div", where, width)
    column = graph.add("Sub", where, graph.add("Mul", row, width))
    count = (input_px // stride) ** 2
    flat = graph.constant(np.array([1, 1, count], np.int64))
    size = graph.constant(np.full((1, 2, count), size_px, np.float32))
    centres = []
    for index in (column, row):
        steps = graph.add("Cast", graph.add("Reshape", index, flat), to=TensorProto.FLOAT)
        shifted = graph.add("Add", steps, graph.constant(np.float32(offset)))
        centres.append(graph.add("Mul", shifted, graph.constant(np.float32(block))))
    return graph.add("Concat", *centres, size, graph.add("Reshape", best, flat), axis=1)


class _Graph:
    """Collects the nodes and constants of one ONNX graph."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def add(self, operator: str, *inputs: str, output: str | None = None, **attributes: object) -> str:
        """Append a node with one output and return that output's name."""
        name = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def add_pair(self, operator: str, *inputs: str, **attributes: object) -> tuple[str, str]:
        """Append a node with two outputs and return their names."""
        names = (f"{operator.lower()}_{len(self.nodes)}", f"{operator.lower()}_{len(self.nodes)}_second")
        self.nodes.append(helper.make_node(operator, inputs, names, **attributes))
        return names

    def constant(self, value: NDArray[np.generic] | np.generic) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def slice(self, tensor: str, start: int, rows: int, columns: int | None = None) -> str:
        """Rows start:rows and columns start:columns (as many as rows by default) of (N, C, H, W)."""
        ends = [rows, rows if columns is None else columns]
        bounds = (np.array(bound, np.int64) for bound in ([start, start], ends, [2, 3]))
        return self.add("Slice", tensor, *(self.constant(bound) for bound in bounds))

    def take(self, tensor: str, item: int) -> str:
        """Item ``item`` of the batch, as a batch of one."""
        bounds = (np.array([bound], np.int64) for bound in (item, item + 1, 0))
        return self.add("Slice", tensor, *(self.constant(bound) for bound in bounds))

    def correlate(self, tensor: str, kernel: NDArray[np.floating], rows: int, columns: int) -> str:
        """Correlation of (N, 1, H, W) with a kernel at every pixel where it fits, as (N, 1, rows, columns).

        A convolution with one output channel runs about ten times slower than its arithmetic. So this one
        steps by _PHASES pixels, with one channel for each shift in between; DepthToSpace interleaves them.
        """
        height, width = kernel.shape
        spread = _PHASES - 1
        bank = np.zeros((_PHASES, _PHASES, height + spread, width + spread), np.float32)
        for y in range(_PHASES):
            for x in range(_PHASES):
                bank[y, x, y : y + height, x : x + width] = kernel
        weights = self.constant(bank.reshape(_PHASES**2, 1, height + spread, width + spread))
        phases = self.add("Conv", tensor, weights, strides=[_PHASES] * 2, pads=[0, 0, spread, spread])
        return self.slice(self.add("DepthToSpace", phases, blocksize=_PHASES), 0, rows, columns)

    def model(self, input_px: int, cells: int) -> onnx.ModelProto:
        """Return the model: images (1, 3, input_px, input_px) to output0 (1, 5, cells)."""
        images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, input_px, input_px])
        output = helper.make_tensor_value_info("output0", TensorProto.FLOAT, [1, 5, cells])
        graph = helper.make_graph(self.nodes, "matched_filter", [images], [output], self.constants)
        return helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8, producer_name="blurnoise"
        )


def _template(size_px: int) -> NDArray[np.float64]:
    """Return the drawn sign's luma in the filter's blocks: zero mean, unit norm."""
    luma = _block_mean(_sign_luma(size_px, _window_px(size_px)), _block_px(size_px)).astype(np.float64)
    luma -= luma.mean()
    return luma / np.linalg.norm(luma)


def _sign_luma(size_px: int, side_px: int) -> FloatArray:
    """Return the coded luma of a sign in the middle of (side_px, side_px)."""
    coded = srgb_from_linear(stop_sign(size_px, height_px=side_px, width_px=side_px))[0].numpy()
    luma: FloatArray = np.tensordot(LUMA, coded, 1)
    return luma


def _block_mean(picture: NDArray[np.floating], block_px: int) -> NDArray[np.floating]:
    height, width = picture.shape
    blocks = picture.reshape(height // block_px, block_px, width // block_px, block_px)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _window_px(size_px: int) -> int:
    """Side of the patch compared: even, as the picture's, so that a centred sign is centred in it."""
    return size_px + size_px % 2


def _block_px(size_px: int) -> int:
    """Side of the blocks that pictures are averaged over before the comparison."""
    return 2 if size_px >= 64 else 1
