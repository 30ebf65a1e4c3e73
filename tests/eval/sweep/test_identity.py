"""A run's identity: the content of everything that reaches a pixel or a box, and the software that computed it."""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, PictureSet, Target
from blurnoise_eval.evaluation import Evaluation, evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.grid.plan_file import PlanFile
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import run_folder
from blurnoise_eval.sweep.merging import merge
from blurnoise_eval.system.machine import versions

GRID: Mapping[str, Any] = {"exposure_s": (0.005,), "illuminance_lux": (50.0,), "velocity_x_px_s": (100.0,)}
PLAN = SweepPlan(GRID)
TARGET = Target(
    "stop sign",
    "signs",
    (20.0, 20.0, 60.0, 60.0),
    annotation={"segmentation": [[20.0, 20.0, 60.0, 20.0, 20.0, 60.0]]},
)
CHANGED: Mapping[str, Any] = {
    "label": "car",
    "group": "cars",
    "box_xyxy": (20.0, 20.0, 61.0, 60.0),
    "area_px2": 5.0,
    "crowd": True,
    "text": "STOP",
    "annotation": {"segmentation": [[20.0, 20.0, 60.0, 20.0, 20.0, 59.0]]},
}
IN_IDENTITY = {
    "model", "contract", "dictionary", "text_detector",  # the model's sha256 and contract
    "images", "labels",  # pictures, choice of targets, annotations
    "camera", "objects", "trajectory",  # camera, and the plan
}  # fmt: skip
HARMLESS = {"split", "engine"}  # words of data.yaml; nothing that is computed
NAMES_FILES = re.compile(r"FILE|DIR|PATH|RUN|\.onnx|\bfile\b|\bfolder\b")


def image() -> Any:
    return np.random.default_rng(3).integers(0, 255, (80, 90, 3), np.uint8)


def pictures(*targets: Target, name: str = "a.png") -> PictureSet:
    return PictureSet(
        "coco", "a", (Picture(name, targets or (TARGET,), image, name, 1),), {"stop sign": 1, "car": 2}
    )


def cutting(**how: Any) -> SweepPlan:
    return SweepPlan({**GRID, "moves": ("targets",)}, objects=Objects(**how))


def swept(run: Path, shown: PictureSet, plan: SweepPlan, part: str | None = None) -> None:
    evaluate(pictures=shown, plan=plan, output=run, threads=1, part=part, refine=False)


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("cut") / "run"
    swept(run, pictures(), cutting())
    return run


def test_every_setting_that_names_files_is_in_the_identity() -> None:
    named = {
        each.name
        for each in fields(PlanFile)
        if NAMES_FILES.search(f"{each.metadata['metavar']} {each.metadata['about']}")
    }
    assert named - HARMLESS <= IN_IDENTITY


@pytest.mark.parametrize("name", [field.name for field in fields(Target)])
def test_every_field_of_a_target_is_in_the_identity(cut: Path, name: str) -> None:
    changed = replace(TARGET, **{name: CHANGED[name]})
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise.optics.camera import Camera

    with Store(cut) as store:
        camera = Camera.from_dict(store.about("manifest")["camera"])
        model, plan = Detector(STOP_SIGN), cutting()
        run_folder.open_run(store, [model], camera, pictures(), plan, {})
        with pytest.raises(StoreError, match=r"another (choice of targets|annotations)"):
            run_folder.open_run(store, [model], camera, pictures(changed), plan, {})
        for harmless in run_folder.HARMLESS:
            also = replace(TARGET, annotation={**TARGET.annotation, harmless: 7})
            run_folder.open_run(store, [model], camera, pictures(also), plan, {})


def computed_with(run: Path, **others: str) -> None:
    """Have the run say that other versions computed it."""
    with Store(run) as store:
        store.set_about("manifest", {**store.about("manifest"), "versions": {**versions(), **others}})


@pytest.mark.parametrize("name", ["torch", "blurnoise", "sources"])
def test_other_software_is_named(cut: Path, tmp_path: Path, name: str) -> None:
    run = shutil.copytree(cut, tmp_path / "run")
    computed_with(run, **{name: "0.0.7"})
    with pytest.raises(StoreError, match=rf"another software\.{name} \(0\.0\.7 there, .* here\)"):
        swept(run, pictures(), cutting())
    with pytest.raises(StoreError, match=rf"differs from .* in software\.{name} \(.*0\.0\.7"):
        merge([cut, run], tmp_path / "merged")


def test_rows_state_what_computed_them(cut: Path, tmp_path: Path) -> None:
    """In the store, in its exports and in a merged run."""
    merge([cut], tmp_path / "merged")
    with Store(tmp_path / "merged") as store:
        assert list(store.software().values()) == [versions()]
        (key,) = store.software()
        assert {row["computed_by"] for row in store.cells()} == {key}
    Evaluation(cut, output=tmp_path / "page").report()
    assert json.loads((tmp_path / "page" / "summary.json").read_text())["software"] == {key: versions()}
    with (tmp_path / "page" / "results.csv").open(newline="") as file:
        assert {row["computed_by"] for row in csv.DictReader(file)} == {key}
    page = (tmp_path / "page" / "report.html").read_text()
    assert key in page
    assert versions()["sources"] in page
