"""One door: what Python evaluates and what ``blurnoise sweep`` writes are the same."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import commands
import matched_filter
import numpy as np
import pandas as pd
import pytest
from band_readers import band_reader
from blurnoise_eval import Detector, Evaluation, datasets, evaluate
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.evaluation import usual_pictures, usual_plan
from blurnoise_eval.report.run import TABLES
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import run_folder as model_notes
from blurnoise_eval.sweep.engines import ThreadEngine
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
    command = ["sweep", "--model", str(model), "--images", pictures.source, *OPTIONS]
    command += ["--camera", "imx250", "--no-refine", "--threads", "1", "--json"]
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
    assert list((done.folder / "figures").glob("*.png"))
    assert all((done.folder / name).is_file() for name in TABLES)
    cells = pd.read_csv(done.folder / "results.csv")
    assert list(cells["cell_id"]) == [cell["cell_id"] for cell in done.cells]
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (done.folder, tmp_path)]
    assert summaries[0].keys() == summaries[1].keys()


def test_a_finished_run_keeps_what_is_noted_of_its_models(
    model: Path, pictures: PictureSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[str] = []
    monkeypatch.setattr(model_notes, "latency", lambda model, _: measured.append(model.name) or {})
    plan = swept((0.002,), (50.0,), (0.0,), gain_db=(0.0,))
    for _ in range(2):
        evaluate(model, pictures, plan=plan, output=tmp_path, threads=1)
    assert measured == ["small"]


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


def test_pictures_of_one_name_part_count_as_one(done: Evaluation, tmp_path: Path) -> None:
    """Both pictures are "?.png": alone they are two, by the pattern on what follows the dot they are one."""
    assert {answer["n_pictures"] for answer in done.answers} == {2}
    together = Evaluation(done.folder, cluster=r"\.(png)", output=tmp_path)
    assert {answer["n_pictures"] for answer in together.answers} == {1}
    assert {curve["n_pictures"] for curve in together.curves} == {1}
    assert together.summary["cluster"] == r"\.(png)"
    assert done.summary["cluster"] is None
