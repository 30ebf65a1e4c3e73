"""A run folder says what it holds: what is missing, what every sweep of it learnt; and it can be read anywhere."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import onnx
import pytest
from blurnoise_eval import datasets, evaluate
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.report.run import read_run
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.run_folder import open_run
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.optics.colour import srgb_from_linear

CAMERA = Camera.preset("imx250")
PLAN = swept((0.002, 0.01, 0.02), (50.0,), (0.0, 400.0), repeats=2)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64)


@pytest.fixture(scope="module")
def infinite(model: Path) -> Path:
    """The same model, but that all its answers are infinite."""
    graph = onnx.load(model)
    named = graph.graph.output[0].name
    for node in graph.graph.node:
        node.output[:] = [f"{name} before" if name == named else name for name in node.output]
    graph.graph.initializer.append(onnx.numpy_helper.from_array(np.float32(np.inf), "infinity"))
    graph.graph.node.append(onnx.helper.make_node("Add", [f"{named} before", "infinity"], [named]))
    path = model.with_name("infinite.onnx")
    onnx.save(graph, path)
    return path


def sign() -> np.ndarray[Any, np.dtype[np.uint8]]:
    linear = charts.stop_sign(24, height_px=54, width_px=64)
    return srgb_from_linear(linear)[0].mul(255).round().byte().permute(1, 2, 0).numpy()


def photos(folder: Path, *names: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for moved, name in enumerate(names):
        datasets.write_picture(folder / name, np.roll(sign(), 3 * moved, axis=1))
    return folder


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, model: Path) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    evaluate(model, datasets.image_folder(photos(folder / "photos", "a.png", "b.png")), plan=PLAN,
             output=folder / "run", threads=1, refine=False)  # fmt: skip
    return folder / "run"


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    return shutil.copytree(finished, tmp_path / "run")


# --- what every sweep learnt ---


def test_a_stopped_run_keeps_what_it_learnt(infinite: Path, finished: Path, tmp_path: Path) -> None:
    """Non-finite values of both halves, as of a run in one go; the first half's seconds; no latency lost."""
    pictures = datasets.image_folder(finished.parent / "photos")
    detector = Detector(infinite)

    def stop(cells: int) -> None:
        settled.append(cells)
        if len(settled) > 3:
            raise KeyboardInterrupt

    def found(folder: Path, **options: Any) -> dict[str, Any]:
        with Store(folder, create=True) as store:
            open_run(store, [detector], CAMERA, pictures, PLAN, {})
            try:
                sweep.run([detector], CAMERA, pictures, PLAN, store, **options)
            except KeyboardInterrupt:
                manifest = store.about("manifest")
                manifest["models"][0]["latency"] = {"median_ms": 1.0}
                store.set_about("manifest", manifest)
            return read_run(store, Criterion(0.6, kept=False)).manifest

    settled: list[int] = []
    with pytest.warns(RuntimeWarning, match="NaN or Inf"):
        whole = found(tmp_path / "whole")
    half = found(tmp_path / "halves", progress=stop)
    rest = found(tmp_path / "halves")
    of = [each["models"][0]["non_finite_values"] for each in (whole, half, rest)]
    assert 0 < of[1] < of[2] == of[0]
    assert 0 < half["wall_s"] < rest["wall_s"]
    assert rest["models"][0]["latency"] == {"median_ms": 1.0}


def test_a_picture_that_became_readable_is_skipped_no_more(model: Path, tmp_path: Path) -> None:
    detector, mended = Detector(model), False

    def load(name: str) -> Any:
        if name == "z" or (name == "b" and not mended):
            raise UnreadablePicture(f"{name}: on a disk that is not there")
        return sign()

    pictures = [Picture(name, None, partial(load, name), name) for name in "abz"]
    for skipped in (["b", "z"], ["z"]):
        with Store(tmp_path, create=True) as store:
            sweep.run([detector], CAMERA, PictureSet("folder", "memory", tuple(pictures)), PLAN, store)
            assert [row["image"] for row in store.skipped()] == skipped
        mended = True


# --- which folder is whose ---


def test_a_first_attempt_without_an_answer_claims_no_folder(
    model: Path, infinite: Path, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wrong pictures, then a model that only fails: the right command then has the folder."""
    good = datasets.image_folder(finished.parent / "photos")
    (tmp_path / "wrong").mkdir()
    (tmp_path / "wrong" / "x.png").write_bytes(b"")
    folder = tmp_path / "run"
    with pytest.raises(ValueError, match="none could be read"):
        evaluate(model, datasets.image_folder(tmp_path / "wrong"), plan=PLAN, output=folder)
    with monkeypatch.context() as broken:

        def look(*_: Any) -> Any:
            raise ModelError("no kernel for this")

        broken.setattr(Detector, "look", look)
        with pytest.raises(ModelError, match="no kernel"):
            evaluate(infinite, good, plan=PLAN, output=folder, threads=1)
        with Store(folder) as store:
            assert list(store.cells()), "the failures are rows"
    done = evaluate(model, good, plan=PLAN, output=folder, threads=1)
    assert done.skipped == []
    assert {cell["error"] for cell in done.cells} == {None}
    assert done.summary["missing_cells"] == 0
    with pytest.raises(StoreError, match="another plan"):
        evaluate(model, good, plan=replace(PLAN, seed=1), output=folder)
