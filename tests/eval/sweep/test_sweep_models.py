"""Several models before the same pictures: detectors that fail, readers, and what a run keeps of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, PictureSet, Target
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Reading
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.report.run import read_run
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep import run_folder as model_notes
from blurnoise_eval.sweep import run_folder as results
from blurnoise_eval.sweep.coco_export import INSTANCES, write_detections
from blurnoise_eval.sweep.work import count_cells
from numpy.typing import NDArray
from plans import plan as swept
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from blurnoise import Camera, charts
from blurnoise.optics.colour import srgb_from_linear

CAMERA = Camera.preset("imx250")
SIZE_PX, HEIGHT_PX, WIDTH_PX = 24, 54, 64
BOX = tuple(float(e) for e in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))
PLAN = swept((0.002, 0.02), (3.0, 333.3), (0.0, 333.3))


def sign() -> NDArray[np.uint8]:
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    coded: Any = srgb_from_linear(linear)[0].permute(1, 2, 0).mul(255).round().byte().numpy()
    return np.ascontiguousarray(coded)


def pictures(*targets: Target, count: int = 3) -> PictureSet:
    def own(target: Target, i: int) -> Target:
        return replace(
            target, annotation={**target.annotation, **({"id": 900 + i} if target.annotation else {})}
        )

    shown = tuple(
        Picture(
            f"p{i}.png",
            tuple(own(target, i) for target in targets) or None,
            lambda i=i: np.roll(sign(), i, axis=1),
            f"p{i}",
            40 + i,
        )
        for i in range(count)
    )
    return PictureSet("coco", "memory", shown, {"stop sign": 13, "dog": 18, "text": 19})


SIGN = Target("stop sign", "signs", BOX, area_px2=400.0, annotation={"id": 900, "segmentation": [[1, 2, 3]]})
LABELLED = pictures(SIGN)


class Failing:
    """A detector that throws on some pictures."""

    def __init__(self, detector: Detector, fails: Sequence[int]) -> None:
        self._look, self._fails, self._calls = detector.look, set(fails), 0

    def __call__(self, image: NDArray[np.uint8], *asked: Any) -> Any:
        self._calls += 1
        if self._calls - 1 in self._fails:
            raise ModelError("m.onnx: fails on a picture (bad shape)")
        return self._look(image, *asked)


class StubReader:
    """Reads STOP while the picture is bright, with a slip where it is dark."""

    name, sha256, non_finite_values_here = "reader", "0" * 64, 0
    path = Path("reader.onnx")

    class Contract:
        def to_dict(self) -> dict[str, Any]:
            return {"height_px": 48, "sources": {"height_px": "given"}}

    contract = Contract()

    def read(self, image: NDArray[np.uint8], boxes_xyxy: Any) -> list[Reading]:
        bright = float(image.mean()) > 40
        return [Reading("STOP" if bright else "STOO", 0.9 if bright else 0.7) for _ in boxes_xyxy]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "first.onnx"
    return Detector(matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64))


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "second.onnx"
    return Detector(matched_filter.build(path, sizes_px=(22, 16, 10), input_px=64))


def run(folder: Path, models: list[Any], shown: PictureSet = LABELLED, plan: SweepPlan = PLAN) -> Any:
    """A whole run; what a report gets of it, and its rows of cells."""
    with Store(folder, create=True) as store:
        results.open_run(store, models, CAMERA, shown, plan, {"command": "c", "threads": 1})
        sweep.run(models, CAMERA, shown, plan, store)
        return read_run(store, Criterion(0.6, kept=False)), list(store.cells())


def test_models_of_one_sweep_are_as_each_alone(first: Detector, second: Detector, tmp_path: Path) -> None:
    def timeless(cells: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [{k: v for k, v in cell.items() if not k.endswith("_ms")} for cell in cells]

    both, cells = run(tmp_path / "both", [first, second])
    for model in (first, second):
        alone, own = run(tmp_path / model.name, [model])
        assert timeless([cell for cell in cells if cell["model"] == model.name]) == timeless(own)
        assert [row for row in both.scores if row["model"] == model.name] == alone.scores
        assert [a for a in both.answers if a["model"] == model.name] == alone.answers
    assert [row["model"] for row in both.models] == ["first", "second"]
    assert both.models[0]["p"] != both.models[1]["p"]
    assert both.manifest["n_cells"] == len(cells) / 2 == count_cells(LABELLED, PLAN)


def test_a_model_that_throws_on_a_picture_is_noted_and_the_others_go_on(
    first: Detector, second: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first, "look", Failing(first, [1, 4, 5]))
    data, cells = run(tmp_path, [first, second])
    failed = [cell for cell in cells if cell["error"]]
    assert len(failed) == 3
    assert {cell["model"] for cell in failed} == {"first"}
    assert all(cell["target_confidence"] is None for cell in failed)
    assert data.manifest["errors"] == [
        {"model": "first", "error": "m.onnx: fails on a picture (bad shape)", "cells": 3}
    ]
    assert sum(row["errors"] for row in data.scores) == 3
    again, _ = run(tmp_path, [first, second])  # nothing is left to compute
    assert again.scores == data.scores


def test_a_model_that_does_nothing_but_fail_ends_the_sweep(
    first: Detector, second: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first, "look", Failing(first, range(10_000)))
    with pytest.raises(ModelError, match=r"bad shape.*every one of 8"):
        run(tmp_path, [second, first])


def test_a_reader_is_judged_by_its_text(tmp_path: Path) -> None:
    shown = pictures(Target("text", "STOP, 24 px", BOX, text="STOP"), Target("dog", "dogs", BOX))
    data, cells = run(tmp_path, [StubReader()], shown)
    assert {cell["n_targets"] for cell in cells} == {1}
    (clean,) = (row for row in data.scores if row["clean"])
    assert (clean["exact_match"], clean["read_confidence"]) == pytest.approx((1, 0.9))
    dark = next(row for row in data.scores if (row["exposure_s"], row["illuminance_lux"]) == (0.002, 3.0))
    assert (dark["exact_match"], dark["character_error_rate"]) == (0, 0.25)
    assert dark["target_confidence"] == 0  # sure of a wrong text is not sure of the text
    assert dark["read_confidence"] == pytest.approx(0.7)
    (model,) = data.models
    assert (model["kind"], model["measure"], model["p"]) == ("reader", "exact match", 1)
    assert 0 < model["rpc"] < 1
    assert data.examples[0]["targets"][0]["text"] in ("STOP", "STOO")


def test_truth_is_kept_as_coco_has_it(first: Detector, tmp_path: Path) -> None:
    crowd = replace(SIGN, crowd=True, area_px2=None, annotation={})
    shown = pictures(SIGN, crowd, Target("dog", "dogs", BOX))
    shown = replace(shown, pictures=shown.pictures[:1])
    run(tmp_path, [first], shown)
    truth = json.loads((tmp_path / INSTANCES).read_text(encoding="utf-8"))
    assert truth["images"] == [{"id": 40, "file_name": "p0.png"}]
    assert truth["categories"][:2] == [{"id": 13, "name": "stop sign"}, {"id": 18, "name": "dog"}]
    x0, y0, x1, y1 = BOX
    stated, of_many, dog = truth["annotations"]
    box = [x0, y0, x1 - x0, y1 - y0]
    assert stated == {
        "id": 900, "segmentation": [[1, 2, 3]], "image_id": 40, "category_id": 13, "bbox": box, "area": 400.0,
        "iscrowd": 0,
    }  # fmt: skip
    assert (of_many["iscrowd"], of_many["area"]) == (1, (x1 - x0) * (y1 - y0))
    assert dog["category_id"] == 18
    assert len({each["id"] for each in truth["annotations"]}) == 3


@pytest.mark.parametrize("shown", [LABELLED, pictures()], ids=["labelled", "found when clean"])
def test_detections_are_results_that_pycocotools_judges_alike(
    first: Detector, tmp_path: Path, shown: PictureSet
) -> None:
    data, _ = run(tmp_path, [first], shown)
    with Store(tmp_path) as store:
        assert write_detections(store, tmp_path / "coco") == [tmp_path / "coco" / "first.json"]
        cells = list(store.cells())
    found = json.loads((tmp_path / "coco" / "first.json").read_text())
    assert {row["cell_id"] for row in found} <= {cell["cell_id"] for cell in cells}
    for row in data.scores:
        of = {each["cell_id"] for each in cells if all(each[name] == row[name] for name in CONDITIONS)}
        with redirect_stdout(StringIO()):
            coco = COCO(str(tmp_path / "coco" / "first-instances.json"))
            results = coco.loadRes([each for each in found if each["cell_id"] in of])
            judge = COCOeval(coco, results, "bbox")
            judge.evaluate()
            judge.accumulate()
            judge.summarize()
        assert (row["ap"], row["ap50"], row["ar100"]) == pytest.approx(judge.stats[[0, 1, 8]], abs=1e-9)
    clean = next(row for row in data.scores if row["clean"])
    assert clean["ap"] > 0.5


class Clock:
    """Of the processor; a model's calls move it, the first with each picture by much more."""

    def __init__(self) -> None:
        self.now_s, self.seen = 2.0, set[int]()

    def process_time(self) -> float:
        return self.now_s

    def detect(self, image: NDArray[np.uint8]) -> None:
        slower = 1 if hash(image.tobytes()) in self.seen else 50
        self.seen.add(hash(image.tobytes()))
        self.now_s += slower * 0.02


def test_latency_is_cpu_time_without_warm_up(first: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(model_notes, "time", clock)
    monkeypatch.setattr(first, "detect", clock.detect)
    measured = model_notes.latency(first, pictures(SIGN, count=6))
    assert measured["pictures"] == 6
    assert (measured["median_ms"], measured["p95_ms"]) == pytest.approx((20.0, 20.0))
    assert 10 <= measured["runs"] <= 60


def test_latency_of_a_failing_model_is_unknown(first: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first, "detect", Failing(first, range(100)))
    assert model_notes.latency(first, LABELLED) == {}
