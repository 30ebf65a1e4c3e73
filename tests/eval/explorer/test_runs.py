"""A run explored: its cells computed anew are the cells that it kept, bit for bit."""

from __future__ import annotations

import builtins
import io
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import PictureSet, image_folder, read_picture, rendered_signs, write_picture
from blurnoise_eval.deciding.decision import Decision
from blurnoise_eval.explorer.looking import seen
from blurnoise_eval.explorer.run_answer import answer_of
from blurnoise_eval.explorer.runs import Run
from blurnoise_eval.explorer.shelf import Shelf, cell_state
from blurnoise_eval.explorer.state import State
from blurnoise_eval.explorer.told import command, python
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_models.detector import STOP_SIGN
from commands import Output

GRID = {
    "exposure_s": (0.02, 0.06),
    "illuminance_lux": (1.0, 50.0),
    "velocity_x_px_s": (0.0, 800.0),
    "gain_db": (float("inf"),),
}


def swept(folder: Path, pictures: PictureSet, grid: Any = GRID, **more: Any) -> Path:
    evaluate(pictures=pictures, plan=SweepPlan(grid, **more), output=folder, threads=1, progress=False)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    signs = rendered_signs((50, 32), count=2)
    return Run(swept(tmp_path_factory.mktemp("explored") / "run", signs, seed=3, grey_anchor="mean"))


def rows(run: Run) -> list[dict[str, object]]:
    with Store(run.folder, shared=True) as store:
        return list(store.cells())


def test_a_picture_and_the_answer_are_held_to_what_the_run_was_asked(tmp_path: Path) -> None:
    """Not to what is usual: a run with --keep 0.8 has its windows at 0.8 in the explorer, too."""
    plan = SweepPlan({"exposure_s": (0.02,), "illuminance_lux": (50.0,), "gain_db": (float("inf"),)})
    signs = rendered_signs((32,), count=1)
    evaluate(pictures=signs, plan=plan, output=tmp_path / "run", keep=0.8, threads=1, progress=False)
    assert Run(tmp_path / "run").criterion == Criterion(0.8, kept=True)
    assert "of its confidence" in answer_of(tmp_path / "run")[0]


def test_every_kept_picture_is_computed_anew(run: Run) -> None:
    kept = [row for row in rows(run) if row["example"]]
    assert len(kept) > 4
    for row in kept:
        assert np.array_equal(
            run.frame(str(row["cell_id"])).image, read_picture(run.folder / str(row["example"]))
        )


def test_a_cell_explored_has_the_picture_and_confidences_of_the_run(run: Run) -> None:
    shelf = Shelf(STOP_SIGN, run=run)
    row = next(
        row for row in rows(run) if row["example"] and row["exposure_s"] == 0.06 and row["velocity_x_px_s"]
    )
    state = cell_state(shelf, str(row["cell_id"]), State(model=f"run/{row['model']}"))
    model = shelf.model(state)
    criterion = shelf.criterion(state, model)
    assert criterion == Decision(run.folder, progress=False).data.criterion
    shown = seen(state, shelf.subject(state), shelf.camera(state), model, criterion=criterion)
    assert shown.standard is not None
    assert shown.standard.enough == criterion.level == 0.6  # rendered signs: a confidence of their own
    assert np.array_equal(shown.image, read_picture(run.folder / str(row["example"])))
    assert shown.confidence == row["target_confidence"]
    stored = run.stored(str(row["cell_id"]), str(row["model"]))
    assert shown.sight is not None
    assert [each["confidence"] for each in shown.sight.targets] == [
        each["confidence"] for each in stored["targets"]
    ]
    assert np.array_equal(shown.sight.detections.boxes_xyxy, stored["detections"].boxes_xyxy)


def test_command_and_script_give_the_cell_and_what_it_was_moved_to(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    shelf = Shelf(STOP_SIGN, run=run)
    first = next(str(row["cell_id"]) for row in rows(run) if row["velocity_x_px_s"])
    cell = cell_state(shelf, first, State(model=f"run/{run.models[0]}"))
    for state in (cell, cell.put("illuminance_lux", 7.0)):
        shown = seen(state, shelf.subject(state), shelf.camera(state)).image
        assert main(command(state, shelf.files(state)).split()[1:]) == 0
        assert np.array_equal(read_picture(Path("seen.png")), shown)
        Path("seen.png").unlink()
        exec(compile(python(state, shelf.files(state)), "script", "exec"), {})
        assert np.array_equal(read_picture(Path("seen.png")), shown)
    capsys.readouterr()


def test_the_map_has_the_runs_means(run: Run) -> None:
    found = run.heat_map(run.models[0], {"velocity_x_px_s": 800.0})
    assert (found.across.name, found.down and found.down.name) == ("exposure_s", "illuminance_lux")
    assert [(each.name, value) for each, value in found.fixed] == [("velocity_x_px_s", 800.0)]
    for row, lux in enumerate(found.rows):
        for column, exposure_s in enumerate(found.columns):
            own = [
                each["target_confidence"]
                for each in rows(run)
                if (each["exposure_s"], each["illuminance_lux"], each["velocity_x_px_s"])
                == (exposure_s, lux, 800.0)
            ]
            assert found.values[row][column] == pytest.approx(np.mean(own))  # type: ignore[arg-type]  # as many targets in each
    at = {"exposure_s": 0.02, "illuminance_lux": 50.0, "velocity_x_px_s": 800.0}
    cell = run.cell(run.cell_at(at, run.pictures[1]))
    assert cell.conditions is not None
    assert {name: cell.conditions[name] for name in at} == at
    assert cell.image == run.pictures[1]


def test_pictures_of_a_folder_are_found_again_or_refused(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    (picture,) = rendered_signs((50,), count=1).pictures
    write_picture(folder / "a.png", picture.load())
    run = Run(
        swept(tmp_path / "run", image_folder(folder), {"exposure_s": (0.02,), "illuminance_lux": (5.0,)})
    )
    row = next(row for row in rows(run) if row["example"] and not row["clean"])
    kept = read_picture(run.folder / str(row["example"]))
    with pytest.raises(ValueError, match=r"outside the run's folder; --trust .* --images"):
        run.frame(str(row["cell_id"]))
    assert np.array_equal(Run(run.folder, trusted=True).frame(str(row["cell_id"])).image, kept)
    moved = folder.rename(tmp_path / "moved")
    with pytest.raises(ValueError, match="pictures"):
        Run(run.folder, trusted=True).frame(str(row["cell_id"]))
    assert np.array_equal(Run(run.folder, moved).frame(str(row["cell_id"])).image, kept)
    write_picture(moved / "a.png", 255 - picture.load())
    with pytest.raises(ValueError, match="is not what it was"):
        Run(run.folder, moved).frame(str(row["cell_id"]))


@pytest.mark.parametrize("what", ["images", "labels", "plates", "model", "trajectory"])
def test_files_outside_a_foreign_run_are_not_opened(
    what: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does a pipe hold up a run that is trusted."""
    folder = shutil.copytree(run.folder, tmp_path / "run")
    os.mkfifo(pipe := tmp_path / "pipe")
    with Store(folder) as store:
        manifest, identity = store.about("manifest"), store.about("identity")
        if what in ("images", "labels", "plates"):
            manifest["images"] |= {"kind": "coco" if what == "labels" else "folder", "source": str(pipe)}
            name = run.pictures[0]
            store.note_picture(name, f"{name} 1 2 3 4", store.pictures()[name][1])
        if what == "plates":
            identity["plan"]["objects"] = {"plates": str(pipe)}
        if what == "model":
            manifest["models"][0] |= {"file": str(pipe), "sha256": "0"}
        if what == "trajectory":
            identity["plan"]["trajectory"] = str(pipe)
        store.set_about("manifest", manifest)
        store.set_about("identity", identity)
    opened: list[str] = []
    for holder, name in ((builtins, "open"), (io, "open"), (os, "stat")):
        honest = getattr(holder, name)

        def recorded(path: Any, *args: Any, honest: Any = honest, name: str = name, **named: Any) -> Any:
            if str(path) == str(pipe):
                opened.append(name)
                assert name == "stat"
            return honest(path, *args, **named)

        monkeypatch.setattr(holder, name, recorded)
    for trusted, told in ((False, "--trust" if what != "trajectory" else "moved along"), (True, str(pipe))):
        assert opened == []
        found = Run(folder, trusted=trusted)
        looked = {
            "trajectory": lambda found=found: found._path,
            "model": lambda found=found: found.model(run.models[0]),
        }.get(what, lambda found=found: found.picture(run.pictures[0]))
        with pytest.raises((ValueError, OSError), match=told):
            looked()


def test_what_is_no_cell_is_refused(run: Run, tmp_path: Path) -> None:
    clean = next(str(row["cell_id"]) for row in rows(run) if row["clean"])
    with pytest.raises(ValueError, match="none of the run's"):
        run.cell("nonsense")
    with pytest.raises(ValueError, match="untouched"):
        cell_state(Shelf(STOP_SIGN, run=run), clean, State())
    with pytest.raises(StoreError):
        Run(tmp_path)


def test_the_run_without_a_page(run: Run, tmp_path: Path, capsys: Output) -> None:
    assert main(["explore", str(run.folder), "-o", str(tmp_path / "seen.png"), "--json"]) == 0
    assert 0 < json.loads(capsys.readouterr().out)["confidence"] < 1
