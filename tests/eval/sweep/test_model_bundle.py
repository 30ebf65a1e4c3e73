"""Work that travels with the files of its models: it opens alike where none of them stands."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from band_readers import constant_reader
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Recogniser
from blurnoise_eval.sweep.engines.model_bundle import ModelBundle
from blurnoise_eval.sweep.work import Work
from small_sweeps import CAMERA, small_detector


@pytest.mark.parametrize("kind", [str, Path])
def test_models_open_from_what_was_sent(tmp_path: Path, kind: type) -> None:
    detector = Detector(kind(small_detector(tmp_path).path))
    detector.name = "renamed"
    bundle = ModelBundle.of(Work((detector,), CAMERA, "mean"))
    assert len(bundle.pickled) < 10_000  # the model is not in it
    blob = np.random.default_rng(0).random((1, 3, 64, 64), np.float32)
    expected = detector.run(blob)
    shutil.rmtree(tmp_path)
    work = bundle.open()
    assert (work.camera, work.grey_anchor) == (CAMERA, "mean")
    (copy,) = work.models
    assert isinstance(copy, Detector)
    assert (copy.name, copy.sha256, copy.contract) == ("renamed", detector.sha256, detector.contract)
    assert not copy.path.exists()  # it was here only to be opened
    for ours, theirs in zip(copy.run(blob), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_contract_travels_with_its_model(tmp_path: Path) -> None:
    """The one beside the file when it was sent, and none that is written there afterwards."""
    path = small_detector(tmp_path).path
    usual = Detector(path).contract
    plain = ModelBundle.of(Work((Detector(path),), CAMERA))
    stated = replace(usual, classes=("sign",)).to_dict()
    beside = path.with_name(f"{path.stem}.contract.json")
    beside.write_text(json.dumps({key: value for key, value in stated.items() if key != "sources"}))
    bundle = ModelBundle.of(Work((Detector(path),), CAMERA))
    assert bundle.key != plain.key
    assert bundle.open().models[0].contract.classes == ("sign",)  # type: ignore[union-attr]
    assert plain.open().models[0].contract.classes == usual.classes  # type: ignore[union-attr]


def test_weights_beside_a_model_travel(tmp_path: Path) -> None:
    path = small_detector(tmp_path).path
    model = onnx.load(str(path))
    onnx.save(model, str(path), save_as_external_data=True, location="small.weights", size_threshold=256)
    detector = Detector(path)
    bundle = ModelBundle.of(Work((detector,), CAMERA))
    (tmp_path / "small.weights").unlink()
    (copy,) = bundle.open().models
    assert copy.sha256 == detector.sha256


def test_a_dictionary_travels(tmp_path: Path) -> None:
    reader = constant_reader(tmp_path / "reader.onnx", np.full((1, 3, 5), 0.2, np.float32))
    model = onnx.load(str(reader))
    del model.metadata_props[:]
    onnx.save(model, str(reader))
    (tmp_path / "letters.txt").write_text("A\nB\nC\n")
    recogniser = Recogniser(reader, dictionary=tmp_path / "letters.txt")
    bundle = ModelBundle.of(Work((recogniser,), CAMERA))
    shutil.rmtree(tmp_path)
    (copy,) = bundle.open().models
    assert isinstance(copy, Recogniser)
    assert copy.sha256 == recogniser.sha256
