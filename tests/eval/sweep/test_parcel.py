"""Work in a parcel: opened from the files that stand where it arrives, or from those of the machine it came from."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from band_readers import constant_reader
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Recogniser
from blurnoise_eval.sweep.parcel import Contents, Parcel
from blurnoise_eval.sweep.work import Work
from small_sweeps import CAMERA, small_detector


def opened(parcel: Parcel, contents: Callable[[], Contents]) -> Work:
    with parcel.opened(contents) as work:
        return work


def never() -> Contents:
    raise AssertionError("the files are here")


def test_files_that_stand_there_are_taken(tmp_path: Path) -> None:
    detector = small_detector(tmp_path)
    parcel = Parcel.of(Work((detector,), CAMERA, "mean"))
    work = opened(parcel, never)
    assert (work.camera, work.grey_anchor) == (CAMERA, "mean")
    assert isinstance(work.models[0], Detector)
    assert work.models[0].path == detector.path
    assert len(parcel.pickled) < 10_000  # the model is not in it


@pytest.mark.parametrize("text", [True, False])
@pytest.mark.parametrize("there", ["missing", "another"])
def test_files_that_do_not_are_sent(tmp_path: Path, there: str, text: bool) -> None:
    made = small_detector(tmp_path)
    detector = Detector(str(made.path) if text else made.path)
    detector.name = "renamed"
    parcel = Parcel.of(Work((detector,), CAMERA))
    contents = parcel.contents()
    blob = np.random.default_rng(0).random((1, 3, 64, 64), np.float32)
    expected = detector.run(blob)
    if there == "missing":
        shutil.rmtree(tmp_path)
    else:
        model = onnx.load(str(made.path))
        model.doc_string = "another"
        onnx.save(model, str(made.path))
    (copy,) = opened(parcel, lambda: contents).models
    assert isinstance(copy, Detector)
    assert (copy.name, copy.sha256, copy.contract) == ("renamed", detector.sha256, detector.contract)
    assert not copy.path.exists()  # it was here only to be opened
    for ours, theirs in zip(copy.run(blob), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_contract_travels_with_its_model(tmp_path: Path) -> None:
    """A model is read otherwise where the file beside it is missing, or where one stands that here does not."""
    path = small_detector(tmp_path).path
    beside = path.with_name(f"{path.stem}.contract.json")
    plain = Parcel.of(Work((Detector(path),), CAMERA))
    usual = Detector(path).contract
    stated = replace(usual, classes=("sign",)).to_dict()
    beside.write_text(json.dumps({key: value for key, value in stated.items() if key != "sources"}))
    parcel = Parcel.of(Work((Detector(path),), CAMERA))
    contents, plain_contents = parcel.contents(), plain.contents()
    assert set(contents[str(path)]) == {path.name, beside.name}
    assert opened(parcel, never).models[0].contract.classes == ("sign",)  # type: ignore[union-attr]
    assert opened(plain, lambda: plain_contents).models[0].contract.classes == usual.classes  # type: ignore[union-attr]
    beside.unlink()
    assert opened(parcel, lambda: contents).models[0].contract.classes == ("sign",)  # type: ignore[union-attr]


def test_weights_beside_a_model_travel(tmp_path: Path) -> None:
    path = small_detector(tmp_path).path
    model = onnx.load(str(path))
    onnx.save(model, str(path), save_as_external_data=True, location="small.weights", size_threshold=256)
    detector = Detector(path)
    parcel = Parcel.of(Work((detector,), CAMERA))
    contents = parcel.contents()
    (tmp_path / "small.weights").unlink()
    (copy,) = opened(parcel, lambda: contents).models
    assert copy.sha256 == detector.sha256


def test_a_dictionary_travels(tmp_path: Path) -> None:
    reader = constant_reader(tmp_path / "reader.onnx", np.full((1, 3, 5), 0.2, np.float32))
    model = onnx.load(str(reader))
    del model.metadata_props[:]
    onnx.save(model, str(reader))
    (tmp_path / "letters.txt").write_text("A\nB\nC\n")
    recogniser = Recogniser(reader, dictionary=tmp_path / "letters.txt")
    parcel = Parcel.of(Work((recogniser,), CAMERA))
    contents = parcel.contents()
    shutil.rmtree(tmp_path)
    (copy,) = opened(parcel, lambda: contents).models
    assert isinstance(copy, Recogniser)
    assert copy.sha256 == recogniser.sha256
