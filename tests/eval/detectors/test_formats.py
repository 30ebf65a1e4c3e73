from __future__ import annotations

import math

import numpy as np
import pytest
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.contract_files import preset
from blurnoise_eval.detectors.formats.boxes import Candidates, lay_in, suppress
from blurnoise_eval.detectors.formats.end_to_end import TFOD, YOLOV6E2E
from blurnoise_eval.detectors.formats.family import cells
from blurnoise_eval.detectors.formats.grids import (
    FASTESTDET,
    NANODET,
    NANODETPLUS,
    YOLOV5,
    YOLOV8,
    YOLOX,
)
from numpy.typing import NDArray

# --- decoding: answers worked out by hand ---


def test_yolov5_score_is_objectness_times_class() -> None:
    rows = np.zeros((1, 9, 7), np.float32)
    rows[0, 4] = [100, 50, 20, 10, 0.5, 0.25, 0.75]
    found = YOLOV5.decode([rows], (64, 96), 0.001)
    np.testing.assert_allclose(found.boxes_xyxy, [[90, 45, 110, 55]])
    np.testing.assert_allclose(found.scores, [0.375])
    assert found.class_ids.tolist() == [1]


def test_yolov8_has_no_objectness() -> None:
    columns = np.zeros((1, 6, 21), np.float32)
    columns[0, :, 7] = [100, 50, 20, 10, 0.25, 0.75]
    found = YOLOV8.decode([columns], (32, 32), 0.001)
    np.testing.assert_allclose(found.boxes_xyxy, [[90, 45, 110, 55]])
    np.testing.assert_allclose(found.scores, [0.75])
    assert found.class_ids.tolist() == [1]


@pytest.mark.parametrize(("row", "column", "stride", "first"), [(1, 3, 8, 0), (2, 5, 16, 8 * 12)])
def test_yolox_adds_the_cell_and_scales_by_the_stride(row: int, column: int, stride: int, first: int) -> None:
    """Input 64 x 96 px: rows and columns differ, so that a swap shows."""
    rows = np.zeros((1, cells((64, 96)), 7), np.float32)
    rows[0, first + row * (96 // stride) + column] = [0.5, 0.25, math.log(2), 0, 0.5, 0.25, 0.75]
    found = YOLOX.decode([rows], (64, 96), 0.001)
    x, y = (column + 0.5) * stride, (row + 0.25) * stride
    expected = [[x - stride, y - stride / 2, x + stride, y + stride / 2]]
    np.testing.assert_allclose(found.boxes_xyxy, expected, rtol=1e-6)
    np.testing.assert_allclose(found.scores, [0.375])
    assert found.class_ids.tolist() == [1]


def test_fastestdet_on_its_single_grid() -> None:
    """Input 64 x 96 px, grid 4 x 6: tanh(0.5493) = 0.5; sigmoid(0) = 1/2, sigmoid(log 3) = 3/4."""
    grid = np.zeros((1, 7, 4, 6), np.float32)
    grid[0, :, 2, 5] = [0.5, math.atanh(0.5), 0, 0, math.log(3), 0.25, 0.75]
    found = FASTESTDET.decode([grid], (64, 96), 0.001)
    x, y, width, height = (5 + 0.5) * 16, 2 * 16, 96 / 2, 64 * 3 / 4
    expected = [[x - width / 2, y - height / 2, x + width / 2, y + height / 2]]
    np.testing.assert_allclose(found.boxes_xyxy, expected, rtol=1e-5)
    np.testing.assert_allclose(found.scores, [0.5**0.6 * 0.75**0.4], rtol=1e-6)
    assert found.class_ids.tolist() == [1]


def sides(*distances: float) -> NDArray[np.float32]:
    """Logits of eight bins for each side whose softmax has these means, in strides."""
    made = np.full((len(distances), 8), -50.0)
    for row, distance in zip(made, distances, strict=True):
        low, rest = int(distance), distance % 1
        row[low] = math.log(1 - rest)
        if rest:
            row[low + 1] = math.log(rest)
    return made.ravel().astype(np.float32)


def test_nanodet_before_plus_measures_from_the_cells_middle_pixel() -> None:
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


@pytest.mark.parametrize(
    ("row", "column", "stride", "first"),
    [(1, 3, 8, 0), (0, 1, 64, 8 * 12 + 4 * 6 + 6)],
)
def test_nanodet_plus_measures_from_the_cells_corner(row: int, column: int, stride: int, first: int) -> None:
    rows = np.zeros((1, 8 * 12 + 4 * 6 + 2 * 3 + 2, 3 + 32), np.float32)
    rows[0, first + row * math.ceil(96 / stride) + column] = [0.25, 0.75, 0.5, *sides(1, 0.5, 0.25, 1.5)]
    found = NANODETPLUS.decode([rows], (64, 96), 0.001)
    x, y = column * stride, row * stride
    box = [x - stride, y - stride / 2, x + stride / 4, y + 1.5 * stride]
    np.testing.assert_allclose(found.boxes_xyxy, [np.clip(box, 0, [96, 64, 96, 64])], rtol=1e-5)
    assert (found.scores.tolist(), found.class_ids.tolist()) == ([0.75], [1])


def test_answers_beyond_the_count_and_classes_that_are_no_numbers_are_dropped() -> None:
    boxes = np.tile(np.array([0.25, 0.5, 0.75, 1], np.float32), (1, 5, 1))  # top, left, bottom, right
    scores = np.array([[0.9, 0.8, 0.7, 0.65, 0.6]], np.float32)
    classes = np.array([[1, np.nan, 90, -1, 2]], np.float32)
    found = TFOD.decode([np.array([4], np.float32), boxes, scores, classes], (64, 96), 0.001)
    np.testing.assert_allclose(found.boxes_xyxy, [[48, 16, 96, 48]] * 2)
    np.testing.assert_allclose(found.scores, [0.9, 0.7])
    assert found.class_ids.tolist() == [1, 90]
    found = YOLOV6E2E.decode([np.array([[4]], np.float32), boxes, scores, classes], (64, 96), 0.75)
    np.testing.assert_allclose(found.boxes_xyxy, [[0.25, 0.5, 0.75, 1]])


@pytest.mark.parametrize("position", [0, 3, 4, 6])
def test_rows_with_nan_or_infinity_are_dropped(position: int) -> None:
    good, bad = [0, 0, 0, 0, 0.5, 0.25, 0.75], [0, 0, 0, 0, 0.5, 0.25, 0.75]
    bad[position] = math.nan
    for poison in (math.nan, math.inf):
        bad[position] = poison if position < 4 else math.nan
        rows = np.zeros((1, 21, 7), np.float32)
        rows[0, 2], rows[0, 5] = good, bad
        assert len(YOLOX.decode([rows], (32, 32), 0.001)) == 1
        assert len(YOLOV5.decode([rows], (32, 32), 0.001)) == 1
        columns = np.delete(rows, 4, axis=2).transpose(0, 2, 1)
        assert len(YOLOV8.decode([columns], (32, 32), 0.001)) == (2 if position == 4 else 1)
    overflowing = np.zeros((1, 21, 6), np.float32)
    overflowing[0, 3] = [0, 0, 1000, 0, 1, 1]
    assert len(YOLOX.decode([overflowing], (32, 32), 0.001)) == 0


# --- suppression ---


def greedy_reference(candidates: Candidates, nms_iou: float, most: int) -> set[int]:
    kept: list[int] = []
    for i in np.argsort(-candidates.scores, kind="stable"):
        box = candidates.boxes_xyxy[i].astype(np.float64)
        for j in kept:
            if candidates.class_ids[i] != candidates.class_ids[j]:
                continue
            other = candidates.boxes_xyxy[j].astype(np.float64)
            sides = np.clip(np.minimum(box[2:], other[2:]) - np.maximum(box[:2], other[:2]), 0, None)
            union = (box[2:] - box[:2]).prod() + (other[2:] - other[:2]).prod() - sides.prod()
            if sides.prod() / union > nms_iou:
                break
        else:
            kept.append(int(i))
    return set(kept[:most])


def random_candidates(count: int, classes: int, seed: int) -> Candidates:
    rng = np.random.default_rng(seed)
    corner = rng.uniform(-80, 120, (count, 2))  # beyond the input on both sides
    boxes = np.concatenate([corner, corner + rng.uniform(20, 90, (count, 2))], axis=1).astype(np.float32)
    return Candidates(boxes, rng.uniform(0, 1, count).astype(np.float32), rng.integers(0, classes, count))


@pytest.mark.parametrize(
    ("count", "classes", "most"),
    [(0, 1, 300), (1, 1, 300), (300, 5, 300), (300, 5, 20), (400, 1, 30)],
)
def test_suppression_equals_the_plain_reference(count: int, classes: int, most: int) -> None:
    candidates = random_candidates(count, classes, seed=count + classes)
    kept = suppress(candidates, 0.5, most)
    expected = greedy_reference(candidates, 0.5, most)
    assert set(kept.scores.tolist()) == {float(candidates.scores[i]) for i in expected}
    assert (np.diff(kept.scores) <= 0).all()


def test_suppression_looks_for_the_last_one_past_a_crowd() -> None:
    """Nine apart, enough copies of the first to fill the first look, and a tenth: all ten are kept."""
    corners = np.stack([20.0 * np.arange(10), np.zeros(10)], axis=1)
    apart = np.hstack([corners, corners + 10]).astype(np.float32)
    boxes = np.concatenate([apart[:9], np.tile(apart[:1], (60, 1)), apart[9:]])
    scores = np.linspace(0.9, 0.1, len(boxes), dtype=np.float32)
    kept = suppress(Candidates(boxes, scores, np.zeros(len(boxes), np.int64)), 0.5, 10)
    np.testing.assert_array_equal(kept.boxes_xyxy, apart)


def test_of_equal_scores_the_first_are_kept() -> None:
    corners = np.stack([20.0 * np.arange(60), np.zeros(60)], axis=1)
    boxes = np.hstack([corners, corners + 10]).astype(np.float32)
    kept = suppress(Candidates(boxes, np.full(60, 0.5, np.float32), np.zeros(60, np.int64)), 0.5, 10)
    np.testing.assert_array_equal(kept.boxes_xyxy, boxes[:10])


# --- pictures into the network, boxes back ---


def test_an_odd_border_has_its_smaller_half_first() -> None:
    """As YOLOv5's and Ultralytics' letterboxes: 3 rows beside a picture, 1 above and 2 below."""
    contract = Contract("yolov8", ("a",), resize="letterbox", value_range="0-255", pad_value=0)
    blob, _ = lay_in(np.full((5, 8, 3), 200, np.uint8), contract, (8, 8))
    np.testing.assert_array_equal(blob[0, 0, :, 0] > 0, [False, True, True, True, True, True, False, False])


def corner_marks(height: int, width: int) -> NDArray[np.uint8]:
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0], image[..., 1], image[..., 2] = 200, 100, 50
    return image


@pytest.mark.parametrize(
    ("resize", "window"),
    [
        ("letterbox", (slice(16, 48), slice(0, 96))),
        ("letterbox-top-left", (slice(0, 32), slice(0, 96))),
        ("stretch", (slice(0, 64), slice(0, 96))),
    ],
)
@pytest.mark.parametrize(
    ("colour", "order", "value_range", "full_scale"),
    [("rgb", [200, 100, 50], "0-255", 1), ("bgr", [50, 100, 200], "0-1", 255)],
)
def test_pictures_are_laid_in_as_the_contract_says(
    resize: str,
    window: tuple[slice, slice],
    colour: str,
    order: list[int],
    value_range: str,
    full_scale: int,
) -> None:
    """A picture of 16 x 48 px into 64 x 96: letterboxed it is 32 x 96."""
    mean, std = (0.1, 0.2, 0.3), (2.0, 4.0, 8.0)
    contract = Contract(
        "yolov8", ("a",), colour=colour, value_range=value_range, mean=mean, std=std, resize=resize
    )
    blob, placement = lay_in(corner_marks(16, 48), contract, (64, 96))
    assert blob.shape == (1, 3, 64, 96)
    assert blob.dtype == np.float32
    expected = np.full((64, 96, 3), 114.0)
    expected[window] = order
    expected = (expected / full_scale - mean) / std
    np.testing.assert_allclose(blob[0], expected.transpose(2, 0, 1), rtol=1e-5)
    box = np.array([[window[1].start, window[0].start, window[1].stop, window[0].stop]], np.float32)
    np.testing.assert_allclose(placement.to_picture(box), [[0, 0, 48, 16]], atol=1e-5)
    np.testing.assert_allclose(placement.to_picture(box + np.float32([-99, -99, 99, 99])), [[0, 0, 48, 16]])


@pytest.mark.parametrize(("resize", "colour"), [("letterbox", "rgb"), ("stretch", "bgr"), ("none", "rgb")])
def test_every_form_of_input_holds_the_same_picture(resize: str, colour: str) -> None:
    image = np.random.default_rng(0).integers(0, 256, (50, 90, 3), dtype=np.uint8)
    contract = Contract("tfod", ("a",), colour=colour, value_range="0-255", resize=resize)
    plain, placement = lay_in(image, contract, (64, 96))
    size_px = (50, 90) if resize == "none" else (64, 96)
    assert plain.shape == (1, 3, *size_px)
    for axes, shape, turned in (
        ("nhwc", (1, *size_px, 3), plain.transpose(0, 2, 3, 1)),
        ("chw", (3, *size_px), plain[0]),
    ):
        for dtype in (np.float32, np.uint8):
            out = np.full(shape, 7, dtype)
            blob, same = lay_in(image, contract, (64, 96), out, axes=axes, dtype=dtype)
            assert blob is out
            assert (blob.dtype, same) == (dtype, placement)
            np.testing.assert_array_equal(blob, turned)
    other = np.empty((1, 3, 5, 5), np.float32)
    assert lay_in(image, contract, (64, 96), other)[0] is not other


@pytest.mark.parametrize(
    ("image", "error"),
    [
        (np.zeros((8, 8, 3), np.float32), TypeError),
        ("picture.png", TypeError),
        (np.zeros((8, 8), np.uint8), ValueError),
        (np.zeros((3, 8, 8), np.uint8), ValueError),
        (np.zeros((0, 8, 3), np.uint8), ValueError),
    ],
)
def test_other_things_are_no_pictures(image, error: type[Exception]) -> None:
    with pytest.raises(error, match="image: "):
        lay_in(image, preset("yolov8"), (64, 96))
