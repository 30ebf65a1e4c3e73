"""The command and the script of a state give its picture, bit for bit."""

from __future__ import annotations

import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import read_picture, write_picture
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.snippets import command, python
from blurnoise_eval.explorer.state import State

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


def same(state: State, catalogue: Catalogue, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    shown = catalogue.render(state).image
    _, *words = shlex.split(command(catalogue, state))
    assert main(words) == 0
    assert np.array_equal(read_picture(Path("seen.png")), shown)
    Path("seen.png").unlink()
    exec(compile(python(catalogue, state), "script", "exec"), {})
    assert np.array_equal(read_picture(Path("seen.png")), shown)


@pytest.mark.parametrize("name", STATES)
def test_both_give_the_picture(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same(STATES[name], Catalogue(), tmp_path, monkeypatch)


@pytest.mark.parametrize("uploaded", [True, False])
def test_of_files_of_ones_own(uploaded: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Uploaded, they are the files that they were."""
    rng = np.random.default_rng(0)
    picture, camera = tmp_path / "mine.png", tmp_path / "own.yaml"
    write_picture(picture, rng.integers(0, 255, (48, 70, 3), np.uint8))
    Camera.preset("mt9m034").save(camera)
    catalogue = Catalogue() if uploaded else Catalogue(picture, camera=camera, model="none")
    state = catalogue.base.put("illuminance_lux", 7.0)
    if uploaded:
        files = {"picture": picture, "camera": camera}
        names = {kind: catalogue.take(kind, path.name, path.read_bytes()) for kind, path in files.items()}
        state = replace(state, **names)  # type: ignore[arg-type]
    same(state, catalogue, tmp_path, monkeypatch)


@pytest.mark.slow
def test_a_script_runs_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(python(Catalogue(), State()))
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("[0.9")
