"""Models from files, and models that travel: a copy elsewhere answers alike."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import pytest
from band_readers import band_reader
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Recogniser, TextSpotter
from blurnoise_eval.detectors.opening import open_models
from constant_graphs import answering_graph


@pytest.fixture
def detector(tmp_path: Path) -> Path:
    return matched_filter.build(tmp_path / "small.onnx", sizes_px=(24, 16, 10), input_px=64)


def finder(path: Path) -> Path:
    """A text detector that finds text everywhere."""
    return answering_graph(path, {"map": (np.full((1, 1, 32, 64), 0.9), None)}, [1, 3, "H", "W"])


def travelled(model: Any) -> Any:
    return pickle.loads(pickle.dumps(model))


@pytest.mark.parametrize("how", ["as it is", "file", "contract"])
def test_a_detector_travels_with_its_contract_and_name(detector: Path, tmp_path: Path, how: str) -> None:
    own = Contract(Detector(detector).family.name, ("stop sign",), nms_iou=0.3)
    (tmp_path / "own.json").write_text(json.dumps(own.to_dict()))
    contract = {"as it is": None, "file": tmp_path / "own.json", "contract": own}[how]
    model = Detector(detector, contract=contract)
    model.name = "renamed"
    copy = travelled(model)
    assert (copy.name, copy.path, copy.sha256) == (model.name, model.path, model.sha256)
    assert copy.contract.to_dict() == model.contract.to_dict()
    image = np.random.default_rng(0).integers(0, 256, (50, 70, 3), np.uint8)
    ours, theirs = model.detect(image), copy.detect(image)
    assert len(ours) > 0
    np.testing.assert_array_equal(theirs.boxes_xyxy, ours.boxes_xyxy)
    np.testing.assert_array_equal(theirs.scores, ours.scores)


def test_readers_travel_with_their_dictionary(tmp_path: Path) -> None:
    dictionary = tmp_path / "keys.txt"
    dictionary.write_text("x\ny\nz")
    reader = Recogniser(band_reader(tmp_path / "rec.onnx", metadata={}), dictionary=dictionary)
    spotter = TextSpotter(finder(tmp_path / "det.onnx"), reader, contract={"min_side_px": 32})
    bands = np.zeros((48, 96, 3), np.uint8)
    bands[:, :48], bands[:, 48:] = (255, 0, 0), (0, 255, 0)
    for model in (reader, spotter):
        copy = travelled(model)
        assert (copy.name, copy.sha256) == (model.name, model.sha256)
        assert copy.contract.to_dict() == model.contract.to_dict()
        assert copy.read(bands, [(0, 0, 96, 48)]) == model.read(bands, [(0, 0, 96, 48)])
    assert travelled(reader).read_crop(bands).text == reader.read_crop(bands).text == "zy"


def test_kinds_are_told_apart_and_names_too(detector: Path, tmp_path: Path) -> None:
    reader = band_reader(tmp_path / "rec.onnx")
    assert [type(model) for model in open_models([reader])] == [Recogniser]
    (second := tmp_path / "small-2.onnx").write_bytes(detector.read_bytes())
    names = [model.name for model in open_models([detector, detector, second, detector])]
    assert names == ["small", "small-3", "small-2", "small-4"]
    assert open_models([reader], ["ppocr"])[0].contract.sources["colour"].startswith("preset")
    with pytest.raises(ValueError, match="detectors or text recognisers, not both"):
        open_models([detector, reader])
    with pytest.raises(ValueError, match="2 are given; must be one, or one for each of 3"):
        open_models([detector] * 3, ["yolox", "yolov8"])
    with pytest.raises(ValueError, match="dictionary, text-detector: go with text recognisers"):
        open_models([detector], text_detector=tmp_path / "det.onnx")
