"""A detector end to end: colours, places, sizes, broken answers, and files that are no models."""

import warnings
from typing import Any

import numpy as np
import onnx
import pytest
from band_readers import band_reader
from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Recogniser
from blurnoise_eval.detectors.opening import open_models
from onnx import TensorProto, helper, numpy_helper
from signs_in_memory import matched_detector

NAMES = ("first", "second", "third")


def cell_graph(path, *, fixed=(), unit=1.0):
    """Write a FastestDet of three classes whose scores in a cell of 16 px are its channels' means over ``unit``.

    Each box is half the picture about the cell's upper left corner. fixed: of a graph that only claims to take
    pictures of every size, the form of its answer.
    """
    weight = np.zeros((8, 3, 16, 16), np.float32)
    weight[-3:] = np.eye(3)[:, :, None, None] / 16**2 / unit
    held = [
        numpy_helper.from_array(weight, "w"),
        numpy_helper.from_array(np.array([1, *[0] * 7], np.float32), "b"),
        numpy_helper.from_array(np.array(fixed or (0, 8, -1, 6), np.int64), "form"),
    ]
    nodes = [
        helper.make_node("Conv", ["images", "w", "b"], ["free"], strides=[16, 16]),
        helper.make_node("Reshape", ["free", "form"], ["answer"]),
    ]
    size = ["h", "w"] if fixed else [64, 96]
    answer = ["n", 8, "rows", "columns"] if fixed else [1, 8, 4, 6]
    graph = helper.make_graph(
        nodes,
        "cells",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, *size])],
        [helper.make_tensor_value_info("answer", TensorProto.FLOAT, answer)],
        held,
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


def contract(**changes):
    return Contract(**{"family": "fastestdet", "classes": NAMES, "resize": "letterbox-top-left", **changes})


def bright_patch(channel):
    """Bright where the cell at column 2, row 3 is."""
    image = np.zeros((64, 96, 3), np.uint8)
    image[48:64, 32:48, channel] = 255
    return image


@pytest.mark.parametrize(("colour", "first"), [("rgb", 0), ("bgr", 2)])
def test_a_patch_is_found_in_its_place_and_colour(tmp_path, colour, first):
    detector = Detector(cell_graph(tmp_path / "m.onnx"), contract=contract(colour=colour))
    found = detector.detect(bright_patch(0), min_score=0.9)
    assert found.class_ids.tolist() == [first]
    np.testing.assert_allclose(found.scores, [1], atol=1e-6)
    np.testing.assert_allclose(found.boxes_xyxy, [[32 - 24, 48 - 16, 32 + 24, 64]], atol=1e-3)


def test_graph_that_only_claims_to_be_dynamic(tmp_path):
    path = cell_graph(tmp_path / "m.onnx", fixed=(1, 8, 4, 6))
    with pytest.raises(ModelError, match=r"failed .*set the size of the input, input_size_px"):
        Detector(path, contract=contract())
    assert Detector(path, contract=contract(input_size_px=(64, 96))).input_size_px == (64, 96)


@pytest.mark.parametrize("shape", [(1, 1), (1, 400), (427, 640)])
@pytest.mark.parametrize("resize", ["letterbox", "letterbox-top-left", "stretch"])
def test_boxes_come_back_in_the_picture(tmp_path, shape, resize):
    """A white picture fills its cells: the boxes reach its corners and no farther."""
    detector = Detector(cell_graph(tmp_path / "m.onnx"), contract=contract(resize=resize, pad_value=0))
    found = detector.detect(np.full((*shape, 3), 255, np.uint8))
    height, width = shape
    assert (found.boxes_xyxy >= 0).all()
    assert (found.boxes_xyxy <= np.array([width, height, width, height])).all()
    np.testing.assert_allclose(found.boxes_xyxy[:, :2].min(axis=0), [0, 0], atol=1e-3)
    np.testing.assert_allclose(found.boxes_xyxy[:, 2:].max(axis=0), [width, height], rtol=1e-5)


def test_nan_is_dropped_counted_and_warned_of_once(tmp_path):
    detector = Detector(cell_graph(tmp_path / "m.onnx"), contract=contract())
    blob, placement = detector.prepare(bright_patch(0))
    outputs = [output.copy() for output in detector.run(blob)]
    clean = detector.decode(outputs, placement)
    assert detector.non_finite_values_here == 0
    outputs[0][0, 1, 0] = np.nan
    with pytest.warns(RuntimeWarning, match="NaN"):
        assert len(detector.decode(outputs, placement)) == len(clean)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outputs[0][0, 5:] = np.nan
        assert len(detector.decode(outputs, placement)) == 0
    assert detector.non_finite_values_here == 6 + 6 + 3 * 24


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n", "git-lfs pointer"),
        (b"\n<!DOCTYPE html><html>Not found</html>", "web page, not a model; it begins .*DOCTYPE"),
        (bytes(range(256)) * 9, "is not an ONNX model that onnxruntime .* can load"),
        ("half", "is not an ONNX model"),
        ("newer", "IR version: 99"),
        ("weights left behind", r"m\.onnx\.data"),
        ("missing", "no such file"),
        ("folder", "is a folder, device or pipe; must be a file"),
    ],
)
def test_files_that_are_no_models(tmp_path, content, message):
    path = tmp_path / "m.onnx"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == "folder":
        path.mkdir()
    elif content != "missing":
        model = onnx.load(cell_graph(path))
        model.ir_version = 99 if content == "newer" else model.ir_version
        apart: Any = {"save_as_external_data": True, "location": "m.onnx.data", "size_threshold": 100}
        onnx.save(model, path, **(apart if content == "weights left behind" else {}))
        if content == "weights left behind":
            assert Detector(path, contract=contract()).name == "m"
            (tmp_path / "m.onnx.data").unlink()
        elif content == "half":
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ModelError, match=message) as caught:
        Detector(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


# --- models from files ---


def test_kinds_are_told_apart_and_names_too(tmp_path):
    detector = matched_detector(tmp_path).path
    reader = band_reader(tmp_path / "rec.onnx")
    assert [type(model) for model in open_models([reader])] == [Recogniser]
    (second := tmp_path / "small-2.onnx").write_bytes(detector.read_bytes())
    names = [model.name for model in open_models([detector, detector, second, detector])]
    assert names == ["small", "small-3", "small-2", "small-4"]
    assert open_models([reader], ["ppocr"])[0].contract.sources["colour"].startswith("preset")
    with pytest.raises(ValueError, match="all detectors or all text recognisers"):
        open_models([detector, reader])
    with pytest.raises(ValueError, match="got 2; must be one, or one for each of the 3"):
        open_models([detector] * 3, ["yolox", "yolov8"])
