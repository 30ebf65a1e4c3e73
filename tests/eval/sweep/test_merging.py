"""Merging: the runs of parts are the run of the whole, every cell once; what cannot be one run is refused."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from blurnoise_eval import datasets
from blurnoise_eval.cli import main
from blurnoise_eval.evaluation import Evaluation, evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.report.run import write_tables
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.coco_export import INSTANCES, write_truth
from blurnoise_eval.sweep.merging import merge
from blurnoise_eval.system.files import RUN_FILE
from blurnoise_eval.system.urls import location
from blurnoise_eval.system.working_folder import read_run
from signs_in_memory import picture, picture_set

PLAN = SweepPlan({"exposure_s": (0.005, 0.05), "illuminance_lux": (50.0,), "velocity_x_px_s": (0.0, 400.0)})
TIMES = {"simulate_ms", "infer_ms", "example", "latency_ms", "latency_p95_ms"}


def signs(count: int = 6) -> datasets.PictureSet:
    every = datasets.rendered_signs()
    return replace(every, pictures=every.pictures[:count])


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    tables(evaluate(pictures=signs(), plan=PLAN, output=folder / "whole", threads=1, refine=False))
    for part in ("1/2", "2/2"):
        evaluate(pictures=signs(), plan=PLAN, output=folder / part[0], threads=1, part=part, refine=False)
    return folder


def tables(run: Evaluation) -> None:
    with Store(run.folder) as store:
        write_exports(store)
    write_tables(run.data, run.output)


def table(folder: Path, name: str) -> pd.DataFrame:
    read = pd.read_csv(folder / name)
    return read[[column for column in read if column not in TIMES]]


@pytest.mark.parametrize(
    "order", ["12", pytest.param("21", marks=pytest.mark.slow), pytest.param("1212", marks=pytest.mark.slow)]
)
def test_run_of_parts_is_that_of_the_whole(runs: Path, order: str, tmp_path: Path) -> None:
    """Rows, scores, curves and answers, in whatever order and however often they are given."""
    done = merge([runs / part for part in order], tmp_path / "run")
    assert done == (30, 6)
    tables(Evaluation(tmp_path / "run"))
    for name in ("results.csv", "targets.csv", "scores.csv", "answers.csv", "curves.csv", "models.csv"):
        found, expected = table(tmp_path / "run", name), table(runs / "whole", name)
        pd.testing.assert_frame_equal(found, expected, check_exact=False, rtol=1e-12)
    with Store(tmp_path / "run") as merged, Store(runs / "whole") as whole:
        assert merged.about("identity") == whole.about("identity")
        shown = [cell["example"] for cell in merged.cells() if cell["example"]]
    assert shown
    assert all((tmp_path / "run" / name).is_file() for name in shown)


def test_rows_that_several_runs_hold_come_once(runs: Path, tmp_path: Path) -> None:
    shutil.copytree(runs / "1", tmp_path / "again")
    assert merge([runs / "1", tmp_path / "again", runs / "2"], tmp_path / "run") == (30, 6)


def test_runs_at_urls(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """Fetched, joined here and put; what is wrong is told of the URL."""
    pytest.importorskip("upath")
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    there = location("memory://bucket/merged")
    for name in (RUN_FILE, INSTANCES):
        (there / "1" / name).write_bytes((runs / "1" / name).read_bytes())
    command = ["merge", str(there / "1"), str(runs / "2"), "-o", str(there / "run")]
    assert main(command) == 0
    with read_run(there / "run") as folder, Store(folder.path) as joined:
        assert len(list(joined.cells())) == 30
        assert str(tmp_path) not in joined.about("manifest")["command"]
    capsys.readouterr()
    assert main(command) == 2
    assert "output = 'memory://bucket/merged/run': is not empty" in capsys.readouterr().err
    assert main(["merge", str(there / "none"), "-o", str(tmp_path / "run")]) == 2
    assert "memory://bucket/merged/none" in capsys.readouterr().err
    there.fs.store.clear()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"plan": replace(PLAN, seed=1)}, "differs from .* in plan.seed"),
        ({"plan": replace(PLAN, repeats=2)}, "in plan.repeats"),
        ({"camera": "ar0237"}, "in camera"),
        ({"pictures": signs(5)}, "in pictures"),
        ({"part": "3/3"}, "in number of parts"),
        ({"part": None}, "in number of parts"),
    ],
)
def test_runs_that_are_no_parts_of_one_sweep_are_refused(
    runs: Path, changes: dict[str, Any], named: str, tmp_path: Path
) -> None:
    usual: dict[str, Any] = {"pictures": signs(), "plan": PLAN, "threads": 1, "part": "2/2", "refine": False}
    evaluate(**{**usual, "output": tmp_path / "other", **changes})
    with pytest.raises(StoreError, match=f"{named}.*only parts of one sweep can be merged"):
        merge([runs / "1", tmp_path / "other"], tmp_path / "run")
    assert not (tmp_path / "run").exists()
    assert not list(tmp_path.glob(".*"))


def test_another_picture_under_a_name_is_refused(tmp_path: Path) -> None:
    for number in (0, 1):
        (tmp_path / f"photos{number}").mkdir()
        image = np.random.default_rng(number).integers(0, 255, (80, 90, 3), np.uint8)
        cv2.imwrite(str(tmp_path / f"photos{number}" / "a.png"), image)
        photos = datasets.image_folder(tmp_path / f"photos{number}")
        evaluate(pictures=photos, plan=PLAN, output=tmp_path / f"{number}", threads=1, refine=False)
    with pytest.raises(StoreError, match=r"picture 'a\.png' is not what it is in"):
        merge([tmp_path / "0", tmp_path / "1"], tmp_path / "run")


def test_boxes_without_numbers_are_numbered_as_in_the_whole(tmp_path: Path) -> None:
    """As of data sets that give none: each part's are another number."""
    pictures = [picture(name) for name in "abcd"]
    whole = picture_set(*pictures)
    write_truth(whole, tmp_path)
    expected = json.loads((tmp_path / INSTANCES).read_text())["annotations"]
    assert len({each["id"] for each in expected}) == len(expected) == 4
    found = []
    for some in (pictures[1:3], pictures[3:], pictures[:1]):
        write_truth(replace(whole, pictures=tuple(some)), tmp_path, whole)
        found += json.loads((tmp_path / INSTANCES).read_text())["annotations"]
    assert sorted(found, key=lambda each: each["id"]) == expected
