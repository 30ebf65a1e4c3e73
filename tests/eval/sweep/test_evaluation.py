"""One door: what Python evaluates and what ``blurnoise sweep`` writes are the same."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import commands
import numpy as np
import pandas as pd
import pytest
from band_readers import band_reader
from blurnoise_eval import AXES, Detector, Evaluation, datasets, evaluate
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.evaluation import usual_pictures, usual_plan
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.report.run import TABLES
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import latency, model_notes
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.sweep.exposing import Scene, frames
from blurnoise_models import matched_filter
from blurnoise_models.detector import STOP_SIGN
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.optics.colour import srgb_from_linear

PLAN = swept((0.002, 0.01), (50.0,), (0.0, 400.0), gain_db=(0.0,))
OPTIONS = ("--exposure-ms", "2,10", "--lux", "50", "--dx", "0,400", "--gain", "0")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> PictureSet:
    folder = tmp_path_factory.mktemp("pictures")
    linear = charts.stop_sign(24, height_px=54, width_px=64)
    sign = srgb_from_linear(linear)[0].mul(255).round().byte().permute(1, 2, 0).numpy()
    for moved, name in enumerate(("a.png", "b.png")):
        datasets.write_picture(folder / name, np.roll(sign, 3 * moved, axis=1))
    (folder / "c.png").write_bytes(b"")
    return datasets.image_folder(folder)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, model: Path, pictures: PictureSet) -> Evaluation:
    return evaluate(
        model, pictures, "imx250", PLAN, output=tmp_path_factory.mktemp("run"), threads=2, refine=False
    )


def timeless(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{k: v for k, v in row.items() if not k.endswith("_ms") and "latency" not in k} for row in rows]


@pytest.mark.slow
def test_python_and_the_command_find_the_same(
    done: Evaluation, model: Path, pictures: PictureSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "sweep",
        "--model",
        str(model),
        "--images",
        pictures.source,
        *OPTIONS,
        "--camera",
        "imx250",
        "--no-refine",
        "--threads",
        "1",
        "--json",
    ]
    assert commands.main([*command, "-o", str(tmp_path)]) == 0
    told = json.loads(capsys.readouterr().out)
    by_command = Evaluation(tmp_path)
    for name in ("cells", "targets", "scores", "curves", "models", "answers"):
        ours, theirs = getattr(done, name), getattr(by_command, name)
        assert len(ours) > 0, name
        assert timeless(ours) == timeless(theirs), name
        assert len(pd.DataFrame(ours)) == len(ours)
    assert told["answers"] == json.loads(json.dumps(done.answers))
    assert [entry["image"] for entry in done.skipped] == ["c.png"]
    page = done.report()
    assert page == done.folder / "report.html"
    assert {path.name for path in tmp_path.rglob("*")} == {path.name for path in done.folder.rglob("*")}
    assert done.figures == sorted((done.folder / "figures").iterdir())
    assert all((done.folder / name).is_file() for name in TABLES)
    cells = pd.read_csv(done.folder / "results.csv")
    assert list(cells["cell_id"]) == [cell["cell_id"] for cell in done.cells]
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (done.folder, tmp_path)]
    assert summaries[0].keys() == summaries[1].keys()


def test_latency_is_measured_once_and_a_busy_machine_named(
    model: Path, pictures: PictureSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = [{"median_ms": 1.5, "p95_ms": 2.0, "clock_ratio": 2.0, "threads": 1}]
    monkeypatch.setattr(latency, "measure", lambda *_: measured.pop())
    plan = swept((0.002,), (50.0,), (0.0,), gain_db=(0.0,))
    with pytest.warns(RuntimeWarning, match="small: the machine was busy while latency.* 2.0 times"):
        evaluate(model, pictures, plan=plan, output=tmp_path, threads=1)
    again = evaluate(model, pictures, plan=plan, output=tmp_path, threads=1)
    assert again.models[0]["latency_ms"] == 1.5


def test_a_finished_run_keeps_what_is_noted_of_its_models(
    model: Path, pictures: PictureSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[str] = []
    monkeypatch.setattr(latency, "measure", lambda model, _: measured.append(model.name) or {})
    monkeypatch.setattr(model_notes, "baked", lambda *_: measured.append("baked"))
    plan = swept((0.002,), (50.0,), (0.0,), gain_db=(0.0,))
    for _ in range(2):
        evaluate(model, pictures, plan=plan, output=tmp_path, threads=1)
    assert measured == ["small", "baked"]


def test_a_run_opens_again_and_goes_on(done: Evaluation, model: Path, pictures: PictureSet) -> None:
    again = evaluate([Detector(model)], pictures, "imx250", PLAN, done.folder, threshold=0.2, refine=False)
    assert again.outcome is not None
    assert (again.outcome.computed, again.outcome.resumed) == (0, 10)
    opened = Evaluation(done.folder, 0.2)
    assert opened.outcome is None
    assert "wall_s" not in opened.summary
    assert opened.answers == again.answers
    with pytest.raises(StoreError, match="another plan"):
        evaluate(model, pictures, "imx250", replace(PLAN, seed=1), output=done.folder)
    with pytest.raises(StoreError, match="holds no"):
        Evaluation(done.folder / "nowhere")


def test_photographs_of_another_exposure_give_the_same_cells_when_anchored(
    model: Path, tmp_path: Path
) -> None:
    """16-bit codes of one scene, 1 and 2 EV apart: the same pictures, but for a code of 8 bits here and there."""
    light = charts.stop_sign(24, height_px=64, width_px=64)
    codes = [
        (srgb_from_linear(light / 2**stops)[0].permute(1, 2, 0).numpy() * 65535).round().astype(np.uint16)
        for stops in range(3)
    ]
    camera = Camera.preset("imx250")
    cell = Cell("a", 0, Conditions(exposure_s=0.01, illuminance_lux=20.0, velocity_x_px_s=300.0), 7)
    anchored, plain = (
        [next(frames(Scene(each, anchor), [cell], camera)).image.astype(int) for each in codes]
        for anchor in ("mean", None)
    )
    for darker in (1, 2):
        assert (
            np.abs(anchored[darker] - anchored[0]).max() <= 2
        )  # a digital number in deep shadow is two codes
        assert (anchored[darker] != anchored[0]).mean() < 0.02
        assert np.abs(plain[darker] - plain[0]).mean() > 5
    assert anchored[0].mean() > 10
    black = Picture("black.png", (), lambda: np.zeros((40, 50, 3), np.uint8), "black")
    both = PictureSet("folder", "here", (black, Picture("a", (), lambda: codes[0], "a")))
    found = evaluate(model, both, plan=replace(PLAN, grey_anchor="mean"), output=tmp_path)
    assert [row["reason"] for row in found.skipped] == [
        "black.png: grey_anchor = mean: is black here; must have some light to be 18 % grey"
    ]


def test_not_told_it_is_the_default_sweep(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The defaults of the command's options and of Python, without running them."""
    seen: list[Any] = []

    def watched(*arguments: Any, **_: Any) -> None:
        seen.append((*arguments, arguments[4].about("identity")))  # in the store, of which nothing stays
        raise KeyboardInterrupt

    monkeypatch.setattr("blurnoise_eval.sweep.run.run", watched)
    assert commands.main(["sweep", "-o", str(tmp_path / "command")]) == 130
    with pytest.raises(KeyboardInterrupt):
        evaluate(output=tmp_path / "python")
    by_command, by_python = seen
    assert [each.path for each in by_command[0]] == [each.path for each in by_python[0]] == [STOP_SIGN]
    assert by_command[1] == by_python[1] == Camera.preset("imx250")
    assert [each.identity for each in by_command[2]] == [each.identity for each in by_python[2]]
    assert by_command[3] == by_python[3] == usual_plan()
    assert by_command[-1] == by_python[-1]
    assert by_command[-1]["plan"]


def test_engine_workers_and_models_are_as_given(
    model: Path, pictures: PictureSet, tmp_path: Path, done: Evaluation
) -> None:
    live = Detector(model)
    live.name = "mine"
    both = evaluate([model, live], pictures, "imx250", PLAN, tmp_path, engine=ThreadEngine(3), refine=False)
    assert [row["model"] for row in both.models] == ["small", "mine"]
    own = [{**cell, "model": "small"} for cell in both.cells if cell["model"] == "mine"]
    assert timeless(own) == timeless(done.cells)
    with Store(tmp_path) as store:
        assert store.about("manifest")["engine"] == "ThreadEngine(threads=3)"


@pytest.mark.parametrize(
    ("changes", "error", "named"),
    [
        ({"models": []}, ValueError, "at least one"),
        ({"models": "missing.onnx"}, ModelError, "no such file"),
        ({"camera": "pinhole"}, ValueError, "presets are"),
        ({"threshold": 1.5}, ValueError, "threshold"),
        ({"engine": "rays"}, ValueError, "'threads', 'processes'"),
        ({"threads": 0}, ValueError, "threads = 0"),
    ],
)
def test_bad_input_leaves_no_folder(
    changes: dict[str, Any], error: type[Exception], named: str, pictures: PictureSet, tmp_path: Path
) -> None:
    given = {"models": None, "pictures": pictures, "plan": PLAN, "output": tmp_path / "run", **changes}
    with pytest.raises(error, match=named):
        evaluate(**given)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("changes", [{"models": [7]}, {"pictures": "photos"}, {"camera": 5}, {"plan": {}}])
def test_wrong_kinds_are_named(changes: dict[str, Any], model: Path, tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=f"{next(iter(changes))}.*must be"):
        evaluate(**{"models": model, "output": tmp_path / "run", **changes})
    assert not (tmp_path / "run").exists()


def test_readers_get_texts_and_no_detectors_beside_them(model: Path, tmp_path: Path) -> None:
    reader = band_reader(tmp_path / "rec.onnx")
    with pytest.raises(ValueError, match="not both"):
        evaluate([reader, Detector(model)], output=tmp_path / "run")
    done = evaluate(reader, plan=swept((0.01,), (50.0,)), output=tmp_path / "read")
    assert {row["truth"] for row in done.targets} == {"STOP"}
    assert usual_pictures([Detector(model)]).source.startswith("stop signs")


def test_the_package_is_light_until_it_is_used() -> None:
    """The names are there, but nothing heavy is imported before one is used."""
    code = """
import sys, blurnoise_eval
heavy = {"torch", "cv2", "onnxruntime", "matplotlib", "plotly", "numpy"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
assert {"evaluate", "Detector", "AXES", "datasets"} <= set(dir(blurnoise_eval))
try:
    blurnoise_eval.nothing
except AttributeError as error:
    assert "nothing" in str(error)
else:
    raise SystemExit(1)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert AXES[0].name == "exposure_s"


def test_pictures_of_one_name_part_count_as_one(done: Evaluation, tmp_path: Path) -> None:
    """Both pictures are "?.png": alone they are two, by the pattern on what follows the dot they are one."""
    assert {answer["n_pictures"] for answer in done.answers} == {2}
    together = Evaluation(done.folder, cluster=r"\.(png)", output=tmp_path)
    assert {answer["n_pictures"] for answer in together.answers} == {1}
    assert {curve["n_pictures"] for curve in together.curves} == {1}
    assert together.summary["cluster"] == r"\.(png)"
    assert done.summary["cluster"] is None


@pytest.mark.slow
def test_answers_are_a_table_too(done: Evaluation) -> None:
    done.report()
    table = pd.read_csv(done.output / "answers.csv")
    assert len(table) == len(done.answers)
    assert set(table["verdict"]) == {"cannot tell"}
    assert table["window_from_low_s"].isna().all()
    models = pd.read_csv(done.output / "models.csv")
    assert 0 <= models["mpc"][0] <= 1
    exposed = pd.read_csv(done.folder / "results.csv").query("clean == 0")
    assert exposed["saturated"].between(0, 1).all()


def test_a_pattern_that_is_none_is_refused_before_anything_is_done(
    model: Path, pictures: PictureSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ValueError, match=r"cluster = '\('"):
        evaluate(model, pictures, plan=PLAN, output=tmp_path / "run", cluster="(")
    command = ["sweep", "--model", str(model), "--images", pictures.source, *OPTIONS, "--cluster", "("]
    assert commands.main([*command, "-o", str(tmp_path / "run")]) == 2
    assert "cluster = '('" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
