"""A sweep computes what ``simulate`` and the models give, whoever computes it, and keeps what it says."""

import json
from dataclasses import replace
from functools import partial

import cv2
import matched_filter
import numpy as np
import pytest
import torch
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, PictureSet, Target
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.plan.conditions import cell_seed
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run import identity, latency
from blurnoise_eval.run.coco_export import write_detections
from blurnoise_eval.run.computing import compute
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.run.tables import tables_of
from blurnoise_eval.run.work import blocks, count_cells
from blurnoise_eval.store.store import Store
from coco_oracle import stats_of_cocos_tools, target_confidence
from plans import plan as swept
from signs_in_memory import BOX, CAMERA, PLAN, TWO, everything, noise, picture, picture_set, rows_of, sign

from blurnoise import simulate
from blurnoise.picture.develop import develop_8bit
from blurnoise.scene import take as taking
from blurnoise.sensor import readout as sensor

EVERY_EFFECT = CAMERA.with_figures(
    name="every effect", prnu=0.02, dsnu_e=3.0, dark_current_e_s=400.0, dark_reference_c=20.0,
    read_noise_e=0.6,  # below 1 e- counts are drawn one by one
    dark_doubling_c=7.0, defocus_radius_px=1.2,
)  # fmt: skip
SMALL = swept((0.002, 0.02), (3.0, 333.3), (0.0, 333.3))
SIGN = Target("stop sign", "signs", BOX, area_px2=400.0, annotation={"id": 900, "segmentation": [[1, 2, 3]]})


@pytest.mark.parametrize("camera", [CAMERA, EVERY_EFFECT], ids=lambda camera: camera.name)
def test_cell_is_what_simulate_and_the_detector_give(detector, tmp_path, monkeypatch, camera):
    """One of the sweep's pictures, number for number: conditions differ in far more than rounding."""
    image = noise(127, 161)
    plan = SweepPlan({**PLAN.grid, "illuminance_lux": (333.3,), "temperature_c": (40.0,)}, seed=11)
    developed = []
    digitised = sensor.digitised

    def watched(light, at, options):
        developed.extend(digitised(light, at, replace(options, tones=None, out=None)))
        return digitised(light, at, options)

    with Store(tmp_path, create=True) as store:
        with monkeypatch.context() as patch:
            patch.setattr(taking, "digitised", watched)
            compute([detector], camera, picture_set(picture("p", lambda: image)), plan, store)
        cells = [cell for cell in store.cells() if not cell.conditions.original]
        assert len(cells) == len(developed) == sum(bool(cell.example) for cell in cells) == 12
        batch = torch.from_numpy(image).permute(2, 0, 1)[None] / 255
        for cell in cells:
            at = cell.conditions
            given = {name: at[name] for name in ("exposure_s", "illuminance_lux", "temperature_c")}
            dn = simulate(batch, camera, **given, velocity_px_s=at.velocity_px_s, generator=[cell.seed])
            assert min(int((dn != each).sum()) for each in developed) == 0
            rgb = np.ascontiguousarray(develop_8bit(dn, camera)[0].permute(1, 2, 0).numpy())
            direct, stored = detector.detect(rgb), store.detections(cell.cell_id, cell.model)
            for name in ("boxes_xyxy", "scores", "class_ids"):
                np.testing.assert_array_equal(getattr(stored, name), getattr(direct, name))
            assert cell.target_confidence == target_confidence(direct, BOX, 0)
            assert cell.blur_px == pytest.approx(at.exposure_s * np.hypot(*at.velocity_px_s))
            np.testing.assert_array_equal(cv2.imread(str(tmp_path / cell.example))[..., ::-1], rgb)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_clean_row_is_the_detection_in_the_untouched_picture(detector, tmp_path, dtype):
    direct = detector.detect(sign())
    with Store(tmp_path, create=True) as store:
        compute([detector], CAMERA, picture_set(picture("p", partial(sign, dtype))), SMALL, store)
        (clean,) = (cell for cell in store.cells() if cell.conditions.original)
        found = store.detections(clean.cell_id, clean.model)
    np.testing.assert_array_equal(found.scores, direct.scores)
    np.testing.assert_array_equal(found.boxes_xyxy, direct.boxes_xyxy)
    assert clean.target_confidence == target_confidence(direct, BOX, 0) > 0.8
    assert {*clean.conditions.numbers, clean.blur_px} == {None}
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / clean.example))[..., ::-1], sign())


def test_rows_depend_neither_on_the_other_pictures_nor_on_their_order(detector, tmp_path):
    """And all conditions of a picture and repeat share a seed, which nothing else has."""
    alone = rows_of(tmp_path / "alone", [detector], CAMERA, TWO, PLAN)
    others = picture_set(picture("c", partial(noise, 21, 30)), *reversed(TWO.pictures))
    cells, targets, *_ = rows_of(tmp_path / "more", [detector], CAMERA, others, PLAN, engine=ThreadEngine(2))
    assert [cell for cell in cells if cell["image"] in "ab"] == alone[0]
    assert [target for target in targets if target["image"] in "ab"] == alone[1]
    seeds = {}
    for cell in alone[0]:
        seeds.setdefault((cell["image"], cell["repeat"]), set()).add(cell["seed"])
    assert [len(shared) for shared in seeds.values()] == [1] * 4
    assert len(set.union(*seeds.values())) == 4
    assert all(0 <= min(shared) < 2**63 for shared in seeds.values())
    assert cell_seed(0, "a", 0) != cell_seed(1, "a", 0)


def run(folder, models, shown, plan=SMALL):
    with Store(folder, create=True) as store:
        identity.open_run(store, models, CAMERA, shown, plan, {"command": "c", "threads": 1})
        compute(models, CAMERA, shown, plan, store)
        return tables_of(store, Setup.read(store), Criterion(0.6, kept=False)), everything(store)[0]


def test_examples_are_of_the_pictures_with_the_largest_targets():
    """By area: a long thin target is small. Of three pictures at most."""
    sizes = {"thin": (180.0, 2.0), "large": (40.0, 40.0), "medium": (30.0, 30.0), "small": (20.0, 20.0)}
    targets = {name: Target("sign", "signs", (5.0, 5.0, 5.0 + w, 5.0 + h)) for name, (w, h) in sizes.items()}
    shown = picture_set(*(replace(picture(name), targets=(target,)) for name, target in targets.items()))
    kept = {block.picture.name for block in blocks(shown, swept((0.01, 0.02), (50.0,))) if block.examples}
    assert kept == {"large", "medium", "small"}


# --- several models, failures, readers ---


def pictures(*targets, count=3):
    shown = []
    for i in range(count):
        own = [replace(each, annotation={**each.annotation, "id": 900 + i}) for each in targets]
        shown.append(Picture(f"p{i}.png", tuple(own) or None, partial(sign, right_px=i), f"p{i}", 40 + i))
    return PictureSet("coco", "memory", tuple(shown), {"stop sign": 13, "dog": 18, "text": 19})


LABELLED = pictures(SIGN)


class Failing:
    def __init__(self, detector, fails):
        self._detect, self._fails, self._calls = detector.detect_all, set(fails), 0

    def __call__(self, image, *asked):
        self._calls += 1
        if self._calls - 1 in self._fails:
            raise ModelError("m.onnx: fails on a picture (bad shape)")
        return self._detect(image, *asked)


@pytest.fixture(scope="module")
def second(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "second.onnx"
    return Detector(matched_filter.build(path, sizes_px=(22, 16, 10), input_px=64))


def test_models_of_one_sweep_are_as_each_alone(detector, second, tmp_path):
    both, cells = run(tmp_path / "both", [detector, second], LABELLED)
    for model in (detector, second):
        alone, own = run(tmp_path / model.name, [model], LABELLED)
        assert [cell for cell in cells if cell["model"] == model.name] == own
        assert [row for row in both.scores if row.model == model.name] == alone.scores
        assert [a for a in both.answers if a.model == model.name] == alone.answers
    assert [row.model for row in both.models] == ["small", "second"]
    assert both.models[0].p != both.models[1].p
    assert both.manifest["n_cells"] == len(cells) / 2 == count_cells(LABELLED, SMALL)


def test_a_model_that_throws_on_a_picture_is_noted_and_the_others_go_on(
    detector, second, tmp_path, monkeypatch
):
    monkeypatch.setattr(detector, "detect_all", Failing(detector, [1, 4, 5]))
    data, cells = run(tmp_path / "some", [detector, second], LABELLED)
    failed = [cell for cell in cells if cell["error"]]
    assert [(cell["model"], cell["target_confidence"]) for cell in failed] == [("small", None)] * 3
    error = {"model": "small", "error": "m.onnx: fails on a picture (bad shape)", "cells": 3}
    assert data.manifest["errors"] == [error]
    assert sum(row.errors for row in data.scores) == 3
    monkeypatch.setattr(detector, "detect_all", Failing(detector, range(10_000)))
    with pytest.raises(ModelError, match=r"bad shape.*every one of 8"):
        run(tmp_path / "all", [second, detector], LABELLED)


@pytest.mark.parametrize("shown", [LABELLED, pictures()], ids=["labelled", "found when clean"])
def test_detections_are_results_that_pycocotools_judges_alike(detector, tmp_path, shown):
    data, cells = run(tmp_path, [detector], shown)
    with Store(tmp_path) as store:
        assert write_detections(store, Setup.read(store), tmp_path / "coco") == [
            tmp_path / "coco" / "small.json"
        ]
    found = json.loads((tmp_path / "coco" / "small.json").read_text())
    for row in data.scores:
        at = row.conditions
        of = {each["cell_id"] for each in cells if all(each[name] == at[name] for name in NAMES)}
        results = [each for each in found if each["cell_id"] in of]
        stats = stats_of_cocos_tools(tmp_path / "coco" / "small-instances.json", results)
        own = [row.scores[name].value for name in ("ap", "ap50", "ar100")]
        assert own == pytest.approx(stats[[0, 1, 8]], abs=1e-9)
        assert not at.original or row.scores["ap"].value > 0.5


class Clock:
    """Of the processor; a model's calls move it, the first with each picture by much more."""

    def __init__(self):
        self.now_s, self.seen = 2.0, set[int]()

    def process_time(self):
        return self.now_s

    def detect(self, image):
        slower = 1 if hash(image.tobytes()) in self.seen else 50
        self.seen.add(hash(image.tobytes()))
        self.now_s += slower * 0.02


def test_latency_is_cpu_time_without_warm_up(detector, monkeypatch):
    clock = Clock()
    monkeypatch.setattr(latency, "time", clock)
    monkeypatch.setattr(detector, "detect", clock.detect)
    measured = latency.latency(detector, pictures(SIGN, count=6))
    assert measured["pictures"] == 6
    assert [measured["median_ms"], measured["p95_ms"]] == pytest.approx([20, 20])
    assert 10 <= measured["runs"] <= 60
    monkeypatch.setattr(detector, "detect", Failing(detector, range(100)))
    assert latency.latency(detector, LABELLED) == {}
