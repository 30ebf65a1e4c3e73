from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import external_files, model_sha256
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

SHARED = Path(__file__).resolve().parents[3].parent / "shared" / "real"
NAMES = ("first", "second", "third")


def cell_graph(
    path: Path,
    family: str,
    *,
    size: tuple[int | str, int | str] = (64, 96),
    batch: int | str = 1,
    dtype: int = TensorProto.FLOAT,
    unit: float = 1.0,
    objectness: float = 1.0,
    metadata: dict[str, str] | None = None,
) -> Path:
    """Write a detector with three classes that finds each cell in which an input channel is bright.

    The score of class c is the mean of input channel c over the cell, divided by ``unit``.
    The box is (50, 30, 20, 10) px for the families that state px; for the others it is the cell itself,
    or half the picture about the cell's upper left corner (FastestDet).
    """
    numpy_type = helper.tensor_dtype_to_np_dtype(dtype)
    box = {"yolov5": [50, 30, 20, 10], "yolov8": [50, 30, 20, 10], "yolox": [0.5, 0.5, 0, 0]}
    fields = [*box.get(family, [0, 0, 0, 0]), objectness]
    fields = fields[4:] + fields[:4] if family == "fastestdet" else fields
    fields = fields[:4] if family == "yolov8" else fields
    columns = len(fields) + 3
    nodes, constants, parts = [], [], []

    def constant(value: NDArray[np.generic], name: str) -> str:
        constants.append(numpy_helper.from_array(value, name))
        return name

    for stride in (16,) if family == "fastestdet" else (8, 16, 32):
        anchors = 3 if family == "yolov5" else 1
        weight = np.zeros((columns, 3, stride, stride), numpy_type)
        weight[-3:] = np.eye(3)[:, :, None, None] / stride**2 / unit
        weight = np.tile(weight, (anchors, 1, 1, 1))
        bias = np.tile(np.array([*fields, 0, 0, 0], numpy_type), anchors)
        inputs = ["images", constant(weight, f"w{stride}"), constant(bias, f"b{stride}")]
        output = "answer" if family == "fastestdet" else f"conv{stride}"
        nodes.append(helper.make_node("Conv", inputs, [output], strides=[stride, stride]))
        if family != "fastestdet":
            shape = constant(np.array([0, anchors, columns, -1], np.int64), f"shape{stride}")
            nodes.append(helper.make_node("Reshape", [output, shape], [f"split{stride}"]))
            perm = [0, 2, 1, 3] if family == "yolov8" else [0, 1, 3, 2]
            nodes.append(helper.make_node("Transpose", [f"split{stride}"], [f"turned{stride}"], perm=perm))
            flat = [0, columns, -1] if family == "yolov8" else [0, -1, columns]
            shape = constant(np.array(flat, np.int64), f"flat{stride}")
            nodes.append(helper.make_node("Reshape", [f"turned{stride}", shape], [f"part{stride}"]))
            parts.append(f"part{stride}")
    if parts:
        nodes.append(helper.make_node("Concat", parts, ["answer"], axis=2 if family == "yolov8" else 1))
    graph = helper.make_graph(
        nodes,
        "cells",
        [helper.make_tensor_value_info("images", dtype, [batch, 3, *size])],
        [helper.make_tensor_value_info("answer", dtype, None)],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata or {})
    onnx.save(onnx.shape_inference.infer_shapes(model), path)
    return path


def contract(family: str, **changes: object) -> Contract:
    return Contract(**{"family": family, "classes": NAMES, "resize": "letterbox-top-left", **changes})


def bright_patch(channel: int, left: int, top: int, side: int) -> NDArray[np.uint8]:
    image = np.zeros((64, 96, 3), np.uint8)
    image[top : top + side, left : left + side, channel] = 255
    return image


# --- each family through onnxruntime, with a known answer ---


@pytest.mark.parametrize(
    ("family", "box"),
    [
        ("yolov5", [40, 25, 60, 35]),
        ("yolov8", [40, 25, 60, 35]),
        ("yolox", [32, 48, 48, 64]),
        ("fastestdet", [32 - 24, 48 - 16, 32 + 24, 64]),
    ],
)
@pytest.mark.parametrize("colour", ["rgb", "bgr"])
def test_known_answer(tmp_path: Path, family: str, box: list[float], colour: str) -> None:
    """The patch fills the cell at column 2, row 3 of stride 16 in a picture as large as the input."""
    detector = Detector(cell_graph(tmp_path / "m.onnx", family), contract=contract(family, colour=colour))
    found = detector.detect(bright_patch(0, 32, 48, 16), min_score=0.9)
    assert found.class_ids[0] == (0 if colour == "rgb" else 2)
    np.testing.assert_allclose(found.scores[0], 1, atol=1e-6)
    whole_cell = [box] if family != "yolox" else found.boxes_xyxy[found.scores > 0.99].tolist()
    assert box in np.round(whole_cell, 3).tolist()
    np.testing.assert_allclose(
        found.boxes_xyxy[0], box if family != "yolox" else found.boxes_xyxy[0], atol=1e-3
    )


@pytest.mark.parametrize("family", ["yolov5", "yolov8", "yolox", "fastestdet"])
@pytest.mark.parametrize(
    ("size", "batch", "dtype"),
    [
        ((64, 96), 4, TensorProto.FLOAT),
        ((64, 96), "batch", TensorProto.FLOAT),
        (("height", "width"), 1, TensorProto.FLOAT),
        (("height", "width"), "batch", TensorProto.FLOAT16),
        (("height", 96), 2, TensorProto.FLOAT),
        ((64, 96), 1, TensorProto.FLOAT16),
    ],
)
def test_shapes_and_types_do_not_change_the_answer(
    tmp_path: Path, family: str, size: tuple[int | str, int | str], batch: int | str, dtype: int
) -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)
    plain = Detector(cell_graph(tmp_path / "plain.onnx", family), contract=contract(family))
    variant = Detector(
        cell_graph(tmp_path / "variant.onnx", family, size=size, batch=batch, dtype=dtype),
        contract=contract(family, input_size_px=(64, 96)),
    )
    assert variant.input_size_px == (64, 96)
    expected, found = plain.detect(image, min_score=0.1), variant.detect(image, min_score=0.1)
    assert len(found) == len(expected) > 0
    half = dtype == TensorProto.FLOAT16
    np.testing.assert_allclose(found.scores, expected.scores, atol=2e-3 if half else 1e-6)
    if not half:  # in half precision scores may tie and change places
        np.testing.assert_allclose(found.boxes_xyxy, expected.boxes_xyxy, atol=1e-3)


def test_graph_that_only_claims_to_be_dynamic(tmp_path: Path) -> None:
    path = cell_graph(
        tmp_path / "m.onnx", "fastestdet", size=("h", "w"), metadata={"names": str(list(NAMES))}
    )
    model = onnx.load(path)
    model.graph.initializer.append(numpy_helper.from_array(np.array([1, 8, 4, 6], np.int64), "fixed"))
    model.graph.node[-1].output[0] = "free"
    model.graph.node.append(helper.make_node("Reshape", ["free", "fixed"], ["answer"]))
    model.graph.output[0].CopyFrom(
        helper.make_tensor_value_info("answer", TensorProto.FLOAT, ["n", 8, "h", "w"])
    )
    onnx.save(model, path)
    with pytest.raises(
        ModelError, match=r"fails on a picture .*; state the size that it takes, input_size_px"
    ):
        Detector(path)
    assert Detector(path, contract=contract("fastestdet", input_size_px=(64, 96))).input_size_px == (64, 96)


@pytest.mark.parametrize("shape", [(1, 1), (1, 400), (427, 640)])
@pytest.mark.parametrize("resize", ["letterbox", "letterbox-top-left", "stretch"])
def test_boxes_come_back_in_the_picture(tmp_path: Path, shape: tuple[int, int], resize: str) -> None:
    """A white picture fills its cells: the boxes, cells of the input, reach its corners and no farther."""
    detector = Detector(
        cell_graph(tmp_path / "m.onnx", "yolox"), contract=contract("yolox", resize=resize, pad_value=0)
    )
    found = detector.detect(np.full((*shape, 3), 255, np.uint8))
    height, width = shape
    assert len(found)
    assert (found.boxes_xyxy >= 0).all()
    assert (found.boxes_xyxy <= np.array([width, height, width, height])).all()
    np.testing.assert_allclose(found.boxes_xyxy[:, :2].min(axis=0), [0, 0], atol=1e-3)
    np.testing.assert_allclose(found.boxes_xyxy[:, 2:].max(axis=0), [width, height], rtol=1e-5)


def test_ten_thousand_candidates_and_boxes_far_outside(tmp_path: Path) -> None:
    """A dynamic YOLOX at 640 x 1280 px has 16 800 cells; every one of them answers, each with its own box."""
    path = cell_graph(tmp_path / "m.onnx", "yolox", size=("h", "w"))
    detector = Detector(path, contract=contract("yolox", input_size_px=(640, 1280)))
    image = np.random.default_rng(0).integers(1, 256, (640, 1280, 3), dtype=np.uint8)
    blob, placement = detector.prepare(image)
    outputs = detector.run(blob)
    assert len(detector.family.decode(outputs, (640, 1280), 0.001)) == 16_800
    assert len(detector.decode(outputs, placement)) == 300
    everything = detector.decode(outputs, placement, max_detections=20_000)
    assert len(everything) == 16_800  # no two overlap by more than a quarter
    outputs[0][..., 2] = 9  # e^9 strides wide: beyond the picture on both sides
    wide = detector.decode(outputs, placement)
    np.testing.assert_array_equal(wide.boxes_xyxy[:, [0, 2]], np.tile([0, 1280], (len(wide), 1)))
    outputs[0][..., 0] = 1e6
    assert len(detector.decode(outputs, placement)) == 0  # all of them beside it


def test_one_session_serves_many_threads(tmp_path: Path) -> None:
    detector = Detector(cell_graph(tmp_path / "m.onnx", "yolox"), contract=contract("yolox"))
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (40 + i, 90 - i, 3), dtype=np.uint8) for i in range(24)]
    alone = [detector.detect(image) for image in images]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(detector.detect, images))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.boxes_xyxy, other.boxes_xyxy)
        np.testing.assert_array_equal(one.scores, other.scores)


# --- outputs that are not what they should be ---


def test_nan_is_dropped_counted_and_warned_of_once(tmp_path: Path) -> None:
    detector = Detector(cell_graph(tmp_path / "m.onnx", "yolox"), contract=contract("yolox"))
    blob, placement = detector.prepare(bright_patch(0, 32, 48, 16))
    outputs = [output.copy() for output in detector.run(blob)]
    clean = detector.decode(outputs, placement)
    assert detector.non_finite_values_here == 0
    outputs[0][0, :5, 2] = np.nan
    with pytest.warns(RuntimeWarning, match="NaN"):
        assert len(detector.decode(outputs, placement)) == len(clean)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outputs[0][0, :, 4] = np.inf
        outputs[0][0, :, 5:] = np.nan
        assert len(detector.decode(outputs, placement)) == 0
    assert detector.non_finite_values_here == 5 + 5 + outputs[0].shape[1] * 4


def test_scores_that_are_all_zero_can_be_told(tmp_path: Path) -> None:
    detector = Detector(cell_graph(tmp_path / "m.onnx", "yolov8"), contract=contract("yolov8"))
    black, _ = detector.prepare(np.zeros((64, 96, 3), np.uint8))
    assert detector.top_score(detector.run(black)) == 0
    faint, placement = detector.prepare(np.zeros((64, 96, 3), np.uint8))
    faint[0, 1] = 2e-4
    outputs = detector.run(faint)
    assert len(detector.decode(outputs, placement)) == 0
    assert detector.top_score(outputs) == pytest.approx(2e-4, rel=1e-4)


def test_scores_above_one_are_refused(tmp_path: Path) -> None:
    path = cell_graph(tmp_path / "m.onnx", "yolov8", unit=0.1)
    with pytest.raises(ModelError, match="score 10 > 1"):
        Detector(path, contract=contract("yolov8")).detect(bright_patch(0, 32, 48, 16))


# --- files that are not models ---


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n", "git-lfs pointer"),
        (b"\n<!DOCTYPE html><html>Not found</html>", "web page, not a model; it begins .*DOCTYPE"),
        (bytes(range(256)) * 9, "is not an ONNX model that onnxruntime .* can load"),
        ("half", "is not an ONNX model"),
        ("newer", "IR version: 99"),
        ("weights left behind", r"m\.onnx\.data"),
        ("missing", "no such file"),
        ("folder", "a directory, device or pipe, no file"),
    ],
)
def test_files_that_are_no_models(tmp_path: Path, content: bytes | str, message: str) -> None:
    path = tmp_path / "m.onnx"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == "folder":
        path.mkdir()
    elif content != "missing":
        model = onnx.load(cell_graph(path, "yolov8"))
        model.ir_version = 99 if content == "newer" else model.ir_version
        apart: Any = {"save_as_external_data": True, "location": "m.onnx.data", "size_threshold": 100}
        onnx.save(model, path, **(apart if content == "weights left behind" else {}))
        if content == "weights left behind":
            assert Detector(path, contract=contract("yolov8")).name == "m"
            (tmp_path / "m.onnx.data").unlink()
        elif content == "half":
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ModelError, match=message) as caught:
        Detector(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_weights_beside_a_model_are_part_of_its_identity(tmp_path: Path) -> None:
    def saved(gain: float) -> str:
        path, beside = tmp_path / "m.onnx", tmp_path / "m.onnx.data"
        beside.unlink(missing_ok=True)  # which would be appended to
        model = onnx.load(cell_graph(path, "yolov8"))
        model.graph.initializer.append(numpy_helper.from_array(np.full(64, gain, np.float32), "gain"))
        onnx.save(model, path, save_as_external_data=True, location=beside.name, size_threshold=100)
        assert external_files(path) == [beside.name]
        return model_sha256(path)

    assert saved(1.0) == saved(1.0) != saved(2.0)


# --- real models ---


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the shared models and photos")
@pytest.mark.parametrize(
    ("file", "family", "least"), [("yolox_nano", "yolox", 0.9), ("fastestdet_upstream", "fastestdet", 0.5)]
)
def test_real_models_find_the_stop_sign(file: str, family: str, least: float) -> None:
    detector = Detector(SHARED / "models" / f"{file}.onnx")
    assert detector.contract.family == family
    assert any("colour" in assumption for assumption in detector.contract.assumptions)
    image = cv2.cvtColor(cv2.imread(str(SHARED / "photos" / "000000525891.jpg")), cv2.COLOR_BGR2RGB)
    found = detector.detect(image)
    assert detector.contract.classes[found.class_ids[0]] == "stop sign"
    assert found.class_ids[0] == 11
    assert found.scores[0] > least
    truth = np.array([51.7, 156.63, 51.7 + 97.65, 156.63 + 136.91])
    box = found.boxes_xyxy[0].astype(np.float64)
    shared = np.clip(np.minimum(box[2:], truth[2:]) - np.maximum(box[:2], truth[:2]), 0, None).prod()
    union = (box[2:] - box[:2]).prod() + (truth[2:] - truth[:2]).prod() - shared
    assert shared / union > 0.7
