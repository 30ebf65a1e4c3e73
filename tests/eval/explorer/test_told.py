"""The command and the script of a state give its picture, bit for bit."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import read_picture, write_picture
from blurnoise_eval.detectors.detector import model_sha256
from blurnoise_eval.explorer.looking import seen
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_eval.explorer.told import command, python
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera

STATES = {
    "a sign": State(picture="sign-3", seed=11).put("moves", 1.0),
    "auto, of figures": State(camera="imx250c", model="none")
    .put("exposure_s", float("inf"))
    .put_figure("prnu", 0.02)
    .put_figure("row_time_s", 1.7e-5),
    "driven": State(model="none")
    .put("ego_speed_m_s", 50 / 3.6)
    .put("f_number", 8.0)
    .put("defocus_radius_px", 1.3),
}

MODELS = {"run/a": [], "run/b": ["b.onnx"], "run/c": ["built-in"], "built-in": ["built-in"], "none": ["none"]}
"""Of a run whose first model is the built-in one: names to what is typed."""


def same(state: State, shelf: Shelf, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    shown = seen(state, shelf.subject(state), shelf.camera(state)).image
    _, *words = command(state, shelf.files(state)).split()
    assert main(words) == 0
    assert np.array_equal(read_picture(Path("seen.png")), shown)
    Path("seen.png").unlink()
    exec(compile(python(state, shelf.files(state)), "script", "exec"), {})
    assert np.array_equal(read_picture(Path("seen.png")), shown)


@pytest.mark.parametrize("name", STATES)
def test_both_give_the_picture(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same(STATES[name], Shelf(STOP_SIGN), tmp_path, monkeypatch)


def test_of_files_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Uploaded, they are the files that they were."""
    rng = np.random.default_rng(0)
    write_picture(tmp_path / "mine.png", rng.integers(0, 255, (48, 70, 3), np.uint8))
    Camera.preset("mt9m034").save(tmp_path / "own.yaml")
    shelf = Shelf(STOP_SIGN)
    try:
        own = {"picture": "mine.png", "camera": "own.yaml"}
        names = {kind: shelf.take(kind, name, (tmp_path / name).read_bytes()) for kind, name in own.items()}
        same(State(**names), shelf, tmp_path, monkeypatch)
    finally:
        shelf.close()


def test_before_a_run_its_own_model_and_the_built_in_one_are_no_files(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shelf = Shelf(STOP_SIGN)
    own = model_sha256(STOP_SIGN)
    files = {"a": ("gone.onnx", own), "b": ("b.onnx", "0"), "c": ("moved.onnx", own)}
    models = [{"name": name, "file": file, "sha256": told} for name, (file, told) in files.items()]
    run = SimpleNamespace(
        folder=Path("run"), images=None, trusted=False, models=("a", "b", "c"), manifest={"models": models}
    )
    monkeypatch.setattr(shelf, "run", run)
    state = State(picture="run/p", camera="run")
    states = {name: replace(state, model=name) for name in MODELS}
    lines = {name: command(each, shelf.files(each)) for name, each in states.items()}
    assert {name: re.findall(r"--model (\S+)", line) for name, line in lines.items()} == MODELS
    scripts = {name: python(each, shelf.files(each)) for name, each in states.items()}
    assert "model = run.model(run.models[0])" in scripts["run/a"]
    assert "open_models([STOP_SIGN])" in scripts["built-in"]
    sign = State(model="run/a")
    assert "--model" not in command(sign, shelf.files(sign))


@pytest.mark.slow
def test_a_script_runs_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(python(State(), Shelf(STOP_SIGN).files(State())))
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("[0.9")
