"""Decoding against answers worked out by hand, suppression against plain loops, pictures laid into the input."""

import math
from functools import partial

import numpy as np
import pytest
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.formats import columns
from blurnoise_eval.detectors.formats.boxes import Candidates, lay_in, suppress
from blurnoise_eval.detectors.formats.exporters import TFOD, YOLOV5, YOLOV6E2E
from blurnoise_eval.detectors.formats.family import cells
from blurnoise_eval.detectors.formats.grids import FASTESTDET, NANODET, NANODETPLUS, YOLOX
from blurnoise_eval.detectors.outputs import parsed
from constant_graphs import constant_graph

# --- decoding: answers worked out by hand ---


def columns_of(family, classes=91):
    return partial(columns.decode, outputs=parsed(family.preset.outputs), classes=classes)


@pytest.mark.parametrize(("row", "column", "stride", "first"), [(1, 3, 8, 0), (2, 5, 16, 8 * 12)])
def test_yolox_adds_the_cell_and_scales_by_the_stride(row, column, stride, first):
    """Input 64 x 96 px: rows and columns differ, so that a swap shows."""
    rows = np.zeros((1, cells((64, 96)), 7), np.float32)
    rows[0, first + row * (96 // stride) + column] = [0.5, 0.25, math.log(2), 0, 0.5, 0.25, 0.75]
    found = YOLOX.decode([rows], (64, 96), 0.001)
    x, y = (column + 0.5) * stride, (row + 0.25) * stride
    expected = [[x - stride, y - stride / 2, x + stride, y + stride / 2]]
    np.testing.assert_allclose(found.boxes_xyxy, expected, rtol=1e-6)
    np.testing.assert_allclose(found.scores, [0.375])
    assert found.class_ids.tolist() == [1]


def test_fastestdet_on_its_single_grid():
    """Input 64 x 96 px, grid 4 x 6: tanh(0.5493) = 0.5; sigmoid(0) = 1/2, sigmoid(log 3) = 3/4."""
    grid = np.zeros((1, 7, 4, 6), np.float32)
    grid[0, :, 2, 5] = [0.5, math.atanh(0.5), 0, 0, math.log(3), 0.25, 0.75]
    found = FASTESTDET.decode([grid], (64, 96), 0.001)
    x, y, width, height = (5 + 0.5) * 16, 2 * 16, 96 / 2, 64 * 3 / 4
    expected = [[x - width / 2, y - height / 2, x + width / 2, y + height / 2]]
    np.testing.assert_allclose(found.boxes_xyxy, expected, rtol=1e-5)
    np.testing.assert_allclose(found.scores, [0.5**0.6 * 0.75**0.4], rtol=1e-6)
    assert found.class_ids.tolist() == [1]


def sides(*distances):
    """Logits of eight bins for each side whose softmax has these means, in strides."""
    made = np.full((len(distances), 8), -50.0)
    for row, distance in zip(made, distances, strict=True):
        low, rest = int(distance), distance % 1
        row[low] = math.log(1 - rest)
        if rest:
            row[low + 1] = math.log(rest)
    return made.ravel().astype(np.float32)


def test_nanodet_before_plus_measures_from_the_cells_middle_pixel():
    """Input 64 x 96 px, stride 16, row 2, column 3: the centre is (3 * 16 + 7.5, 2 * 16 + 7.5) px."""
    outputs = []
    for stride in (8, 16, 32):
        count = (64 // stride) * (96 // stride)
        outputs += [np.zeros((1, count, 3), np.float32), np.zeros((1, count, 32), np.float32)]
    outputs[2][0, 2 * 6 + 3] = [0.25, 0.75, 0.5]
    outputs[3][0, 2 * 6 + 3] = sides(1, 0.5, 1.25, 1)
    for shaped in (outputs, [output[0] for output in outputs]):  # some exports have no batch
        found = NANODET.decode(shaped, (64, 96), 0.001)
        np.testing.assert_allclose(found.boxes_xyxy, [[55.5 - 16, 39.5 - 8, 55.5 + 20, 39.5 + 16]], rtol=1e-5)
        assert (found.scores.tolist(), found.class_ids.tolist()) == ([0.75], [1])


@pytest.mark.parametrize(("row", "column", "stride", "first"), [(1, 3, 8, 0), (0, 1, 64, 8 * 12 + 4 * 6 + 6)])
def test_nanodet_plus_measures_from_the_cells_corner(row, column, stride, first):
    rows = np.zeros((1, 8 * 12 + 4 * 6 + 2 * 3 + 2, 3 + 32), np.float32)
    rows[0, first + row * math.ceil(96 / stride) + column] = [0.25, 0.75, 0.5, *sides(1, 0.5, 0.25, 1.5)]
    found = NANODETPLUS.decode([rows], (64, 96), 0.001)
    x, y = column * stride, row * stride
    box = [x - stride, y - stride / 2, x + stride / 4, y + 1.5 * stride]
    np.testing.assert_allclose(found.boxes_xyxy, [np.clip(box, 0, [96, 64, 96, 64])], rtol=1e-5)
    assert (found.scores.tolist(), found.class_ids.tolist()) == ([0.75], [1])


def test_answers_beyond_the_count_and_classes_that_are_no_numbers_are_dropped():
    boxes = np.tile(np.array([0.25, 0.5, 0.75, 1], np.float32), (1, 5, 1))  # top, left, bottom, right
    scores = np.array([[0.9, 0.8, 0.7, 0.65, 0.6]], np.float32)
    classes = np.array([[1, np.nan, 90, -1, 2]], np.float32)
    found = columns_of(TFOD)([np.array([4], np.float32), boxes, scores, classes], (64, 96), 0.001)
    np.testing.assert_allclose(found.boxes_xyxy, [[48, 16, 96, 48]] * 2)
    np.testing.assert_allclose(found.scores, [0.9, 0.7])
    assert found.class_ids.tolist() == [1, 90]
    found = columns_of(YOLOV6E2E)([np.array([[4]], np.float32), boxes, scores, classes], (64, 96), 0.75)
    np.testing.assert_allclose(found.boxes_xyxy, [[0.25, 0.5, 0.75, 1]])


@pytest.mark.parametrize("position", [0, 3, 4, 6])
def test_rows_with_nan_or_infinity_are_dropped(position):
    for poison in (math.nan, math.inf) if position < 4 else (math.nan,):
        rows = np.zeros((1, 21, 7), np.float32)
        rows[0, 2] = rows[0, 5] = [0, 0, 0, 0, 0.5, 0.25, 0.75]
        rows[0, 5, position] = poison
        assert (
            len(YOLOX.decode([rows], (32, 32), 0.001))
            == len(columns_of(YOLOV5, 2)([rows], (32, 32), 0.001))
            == 1
        )
    rows[0, 5] = [0, 0, 1000, 0, 1, 1, 1]  # overflows
    assert len(YOLOX.decode([rows], (32, 32), 0.001)) == 1


# --- suppression ---


def test_suppression_looks_for_the_last_one_past_a_crowd():
    """Nine apart, enough copies of the first to fill the first look, and a tenth: all ten are kept."""
    corners = np.stack([20.0 * np.arange(10), np.zeros(10)], axis=1)
    apart = np.hstack([corners, corners + 10]).astype(np.float32)
    boxes = np.concatenate([apart[:9], np.tile(apart[:1], (60, 1)), apart[9:]])
    scores = np.linspace(0.9, 0.1, len(boxes), dtype=np.float32)
    kept = suppress(Candidates(boxes, scores, np.zeros(len(boxes), np.int64)), 0.5, 10)
    np.testing.assert_array_equal(kept.boxes_xyxy, apart)


def test_of_equal_scores_the_first_are_kept():
    corners = np.stack([20.0 * np.arange(60), np.zeros(60)], axis=1)
    boxes = np.hstack([corners, corners + 10]).astype(np.float32)
    kept = suppress(Candidates(boxes, np.full(60, 0.5, np.float32), np.zeros(60, np.int64)), 0.5, 10)
    np.testing.assert_array_equal(kept.boxes_xyxy, boxes[:10])


# --- pictures into the network, boxes back ---


@pytest.mark.parametrize(("resize", "top"), [("letterbox", 15), ("letterbox-top-left", 0), ("stretch", None)])
@pytest.mark.parametrize(
    ("colour", "order", "value_range", "full_scale"),
    [("rgb", [200, 100, 50], "0-255", 1), ("bgr", [50, 100, 200], "0-1", 255)],
)
def test_pictures_are_laid_in_as_the_contract_says(resize, top, colour, order, value_range, full_scale):
    """A picture of 33 x 96 px into 64 x 96: of an odd border the smaller half is first, as in YOLOv5's letterbox."""
    mean, std = (0.1, 0.2, 0.3), (2.0, 4.0, 8.0)
    contract = Contract(
        "yolov8", ("a",), colour=colour, value_range=value_range, mean=mean, std=std, resize=resize
    )
    image = np.broadcast_to(np.array([200, 100, 50], np.uint8), (33, 96, 3)).copy()
    blob, placement = lay_in(image, contract, (64, 96))
    rows = slice(0, 64) if top is None else slice(top, top + 33)
    expected = np.full((64, 96, 3), 114.0)
    expected[rows] = order
    expected = (expected / full_scale - mean) / std
    assert blob.dtype == np.float32
    np.testing.assert_allclose(blob, expected.transpose(2, 0, 1)[None], rtol=1e-5)
    box = np.array([[0, rows.start, 96, rows.stop]], np.float32)
    np.testing.assert_allclose(placement.to_picture(box), [[0, 0, 96, 33]], atol=1e-5)
    np.testing.assert_allclose(placement.to_picture(box + np.float32([-99, -99, 99, 99])), [[0, 0, 96, 33]])


@pytest.mark.parametrize(
    ("resize_filter", "share"),
    [("bilinear", 1.0), ("area", 1 / 9), ("antialiased", 1 / 9)],
    ids=["one_pixel_of_nine", "all_nine", "pil"],
)
def test_what_remains_of_a_hot_pixel_is_the_filter_s(resize_filter, share):
    """In the middle of nine pixels that become one; PIL's triangle gives its middle 1/9, as its neighbours 2/27."""
    contract = Contract("yolov8", ("a",), value_range="0-255", resize="stretch", resize_filter=resize_filter)
    image = np.zeros((27, 27, 3), np.uint8)
    image[13, 13] = 225
    blob, _ = lay_in(image, contract, (9, 9))
    np.testing.assert_allclose(blob[0, :, 4, 4], 225 * share, atol=0.5)


def test_area_enlarges_as_bilinear_does():
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    area, bilinear = (
        lay_in(image, Contract("yolov8", ("a",), resize="stretch", resize_filter=name), (9, 9))[0]
        for name in ("area", "bilinear")
    )
    np.testing.assert_array_equal(area, bilinear)


# --- several classes of one box ---

SIDES_PX, NAMES = (64, 96), ("lorry", "car", "bus")
CELLS = 8 * 12 + 4 * 6 + 2 * 3


def constant_detector(path, family, answer):
    """A graph that answers the same to every picture."""
    constant_graph(path, [answer[None]], SIDES_PX)
    return Detector(path, contract=Contract(family, NAMES, resize="stretch", nms_iou=0.5))


def boxes_with_scores(family, boxes_cxcywh, scores):
    """An answer in the family's layout that holds these boxes (N, 4), px, with class scores (N, 3)."""
    rows = np.zeros((3 * CELLS if family == "yolov5" else CELLS, 8), np.float32)
    count = len(scores)
    rows[:count, :4], rows[:count, 4], rows[:count, 5:] = boxes_cxcywh, 1, scores
    return np.delete(rows, 4, axis=1).T.copy() if family == "yolov8" else rows


def evaluated(boxes, scores, iou, most):
    """Boxes and classes that a plain evaluator with several classes a box keeps: one by one, the best first."""
    pairs = [(scores[b, c], b, c) for b in range(len(boxes)) for c in range(3) if scores[b, c] >= 0.001]
    kept: list[tuple[int, int]] = []
    for _, b, c in sorted(pairs, key=lambda pair: -pair[0]):
        if len(kept) < most and all(c != d or overlap(boxes[b], boxes[a]) <= iou for a, d in kept):
            kept.append((b, c))
    return set(kept)


def overlap(a, b):
    (ax, ay, aw, ah), (bx, by, bw, bh) = a, b
    width = min(ax + aw / 2, bx + bw / 2) - max(ax - aw / 2, bx - bw / 2)
    height = min(ay + ah / 2, by + bh / 2) - max(ay - ah / 2, by - bh / 2)
    shared = max(width, 0) * max(height, 0)
    return float(shared / (aw * ah + bw * bh - shared))


@pytest.mark.parametrize("most", [7, 40, 300])
@pytest.mark.parametrize("family", ["yolov8", "yolov5"])
def test_what_is_kept_is_what_a_plain_evaluator_keeps(family, most, tmp_path):
    rng = np.random.default_rng(most)
    boxes = np.concatenate([rng.uniform((20, 20), (76, 44), (60, 2)), rng.uniform(8, 24, (60, 2))], axis=1)
    boxes = np.round(boxes, 3)
    scores = rng.uniform(0, 1, (60, 3)).astype(np.float32) ** 6  # a third below the threshold
    detector = constant_detector(tmp_path / "m.onnx", family, boxes_with_scores(family, boxes, scores))
    found = detector.detect(np.zeros((*SIDES_PX, 3), np.uint8), max_detections=most)
    expected = evaluated(boxes, scores, 0.5, most)
    assert len(found) == len(expected)
    assert sorted(found.scores.tolist()) == pytest.approx(sorted(float(scores[pair]) for pair in expected))
    leading = {(b, c) for b, c in expected if c == scores[b].argmax()}
    assert sorted(found.leading.scores.tolist()) == pytest.approx(
        sorted(float(scores[pair]) for pair in leading)
    )
