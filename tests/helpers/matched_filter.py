"""A stop-sign detector that is made in a moment: a matched filter, written as an ONNX graph.

For each sign size the graph compares every patch p of the picture's luma with the drawn sign t (zero mean,
unit norm) by normalised cross-correlation, NCC = <t, p> / |p - mean(p)|. Its confidence is the share of the
patch's energy that the sign explains, max(NCC, 0)². Nothing is trained and nothing is downloaded.

Domain: sRGB-coded RGB pictures in [0, 1] with an upright sign of one of the filter's sizes, wholly inside the
picture; a sign 10 % larger or smaller is not recognised. Output as YOLOv8's: (1, 4 + 1, A), boxes
(centre x, centre y, width, height) in px, then confidence.
"""

import json
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper, parser

from blurnoise._core.writing import write_whole
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.charts import stop_sign

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709, applied to coded values
STRIDES = (8, 16, 32)  # px, of the output cells that take the smallest, middle and largest sign
PAD_VALUE = 118  # of 255: the background of the drawn sign, 18 % reflectance, sRGB-coded
# One DN of 255, squared: added to a patch's variance, so that 8-bit rounding of a flat patch is nothing.
VARIANCE_FLOOR = (1 / 255) ** 2
_PHASES = 4
_SIZE = """
  from_K = Slice(coded, first_K, last_K, plane)
  coded_K = AveragePool<kernel_shape = [BLOCK, BLOCK], strides = [BLOCK, BLOCK]>(from_K)
  phases_K = Conv<strides = [4, 4], pads = [0, 0, 3, 3]>(coded_K, bank_K)
  deep_K = DepthToSpace<blocksize = 4>(phases_K)
  explained_K = Slice(deep_K, origin, places_K, plane)
  positive_K = Relu(explained_K)
  energy_K = Mul(positive_K, positive_K)
  squares_K = Mul(coded_K, coded_K)
  columns_K = AveragePool<kernel_shape = [SIDE, 1], strides = [1, 1]>(coded_K)
  mean_K = AveragePool<kernel_shape = [1, SIDE], strides = [1, 1]>(columns_K)
  square_columns_K = AveragePool<kernel_shape = [SIDE, 1], strides = [1, 1]>(squares_K)
  mean_square_K = AveragePool<kernel_shape = [1, SIDE], strides = [1, 1]>(square_columns_K)
  squared_mean_K = Mul(mean_K, mean_K)
  variance_K = Sub(mean_square_K, squared_mean_K)
  held_K = Add(variance_K, floor)
  spread_K = Mul(held_K, pixels_K)
  confidence_K = Div(energy_K, spread_K)
  padded_K = Pad(confidence_K, pads_K)
  best_K, where_K = MaxPool<kernel_shape = [CELL, CELL], strides = [CELL, CELL]>(padded_K)
  row_K = Div(where_K, grid_K)
  passed_K = Mul(row_K, grid_K)
  column_K = Sub(where_K, passed_K)
  both_K = Concat<axis = 1>(column_K, row_K)
  steps_K = Cast<to = 1>(both_K)
  centres_K = Mul(steps_K, block_K)
  moved_K = Add(centres_K, offset_K)
  flat_K = Reshape(moved_K, pair_K)
  scores_K = Reshape(best_K, single_K)
  answers_K = Concat<axis = 1>(flat_K, width_K, scores_K)"""


def build(path, *, sizes_px=(100, 50, 32), input_px=320):
    """Write the detector for square inputs of ``input_px`` and return its path.

    ``sizes_px``: three sign widths, px, largest first; they answer on the strides 32, 16 and 8. The contract
    travels in the graph's metadata. Correlation runs at every pixel, at every second one for signs of 64 px
    or more; that grid includes the picture's centre. Each output cell reports the best of its positions
    where that lies, so boxes are not rounded to cells.
    """
    body = "  coded = Conv(images, luma, middle)"
    held: dict[str, NDArray[np.generic]] = {
        "luma": LUMA.reshape(1, 3, 1, 1), "middle": np.array([-0.5], np.float32),
        "floor": np.array(VARIANCE_FLOOR, np.float32), "origin": np.zeros(2, np.int64), "plane": np.array([2, 3]),
    }  # fmt: skip
    for number, (size, stride) in enumerate(zip(reversed(sizes_px), STRIDES, strict=True)):
        lines, constants = _size(size, stride, input_px)
        body += lines.replace("_K", f"_{number}")
        held |= {name.replace("_K", f"_{number}"): value for name, value in constants.items()}
    count = sum((input_px // stride) ** 2 for stride in STRIDES)
    head = f"matched_filter (float[1,3,{input_px},{input_px}] images) => (float[1,5,{count}] output0)"
    body += "\n  output0 = Concat<axis = 2>(answers_0, answers_1, answers_2)"
    model = parser.parse_model(f'<ir_version: 8, opset_import: ["": 17]>\n{head} {{\n{body}\n}}')
    model.graph.initializer.extend(numpy_helper.from_array(value, name) for name, value in held.items())
    contract = {
        "family": "yolov8", "classes": ["stop sign"], "colour": "rgb", "value_range": "0-1", "resize": "letterbox",
        "pad_value": PAD_VALUE, "input_size_px": [input_px, input_px], "nms_iou": 0.5,
    }  # fmt: skip
    helper.set_model_props(model, {"blurnoise.contract": json.dumps(contract)})
    onnx.checker.check_model(model)
    write_whole(Path(path), model.SerializeToString())
    return Path(path)


def _size(size_px, stride, input_px):
    """The nodes and constants of a sign size, whose answers are (1, 5, (input_px / stride)²)."""
    block = 2 if size_px >= 64 else 1  # px that are averaged before the comparison
    window = size_px + size_px % 2  # even, as the picture's side, so that a centred sign is centred in it
    start = (input_px - window) // 2 % block  # of the first block, so that a centred sign falls on the grid
    side, grid = window // block, input_px // block
    places, before = (input_px - start) // block - side + 1, (start + window // 2) // block
    after, count = grid - before - places, (input_px // stride) ** 2
    sign = srgb_from_linear(stop_sign(size_px, height_px=window, width_px=window))[0].numpy()
    luma = np.tensordot(LUMA, sign, 1).reshape(side, block, side, block).mean((1, 3)).astype(np.float64)
    template = (luma - luma.mean()) / np.linalg.norm(luma - luma.mean())
    # A convolution with one output channel is slow: this one steps by 4 px, with a channel for each shift.
    bank = np.zeros((_PHASES, _PHASES, side + 3, side + 3), np.float32)
    for y, x in np.ndindex(_PHASES, _PHASES):
        bank[y, x, y : y + side, x : x + side] = template
    nodes = (
        _SIZE.replace("BLOCK", str(block)).replace("SIDE", str(side)).replace("CELL", str(stride // block))
    )
    return nodes, {
        "bank_K": bank.reshape(_PHASES**2, 1, side + 3, side + 3), "places_K": np.array([places, places]),
        "first_K": np.array([start, start]), "last_K": np.array([input_px, input_px]),
        "pixels_K": np.array(side**2, np.float32), "grid_K": np.array(grid), "block_K": np.array(block, np.float32),
        "pads_K": np.array([0, 0, before, before, 0, 0, after, after]),
        "offset_K": np.array(start + window // 2 - before * block, np.float32), "pair_K": np.array([1, 2, count]),
        "single_K": np.array([1, 1, count]), "width_K": np.full((1, 2, count), size_px, np.float32),
    }  # fmt: skip
