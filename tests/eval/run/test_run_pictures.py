"""Pictures and models of a run, opened again: any cell is computed anew, and no file of a foreign run is opened."""

import builtins
import io
import os
import shutil

import numpy as np
import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.datasets import image_folder, read_picture, rendered_signs, write_picture
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.store import Store

GRID = {
    "exposure_s": (0.02, 0.06),
    "illuminance_lux": (1.0, 50.0),
    "velocity_x_px_s": (0.0, 800.0),
    "gain_db": (float("inf"),),
}


def swept(folder, pictures, grid=GRID, **more):
    evaluate(pictures=pictures, plan=SweepPlan(grid, **more), output=folder, progress=False)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    signs = rendered_signs((50, 32), count=2)
    return Run.open(swept(tmp_path_factory.mktemp("explored") / "run", signs, seed=3, grey_anchor="mean"))


def frame(run, row):
    """The picture of a row's cell, computed anew."""
    return run.simulate(row["cell_id"])


def test_every_kept_picture_is_computed_anew(run):
    kept = [row for row in run.cells if row["example"]]
    assert len(kept) > 4
    for row in kept:
        assert np.array_equal(frame(run, row), read_picture(run.folder / row["example"]))
    with pytest.raises(ValueError, match="cell_id = 'none': must be one of the run"):
        run.simulate("none")


def test_pictures_of_a_folder_are_found_again_or_refused(tmp_path, monkeypatch):
    """Of a run of one's own without a word, of another account's if it is trusted."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    (picture,) = rendered_signs((50,), count=1).pictures
    write_picture(folder / "a.png", picture.load())
    run = Run.open(
        swept(tmp_path / "run", image_folder(folder), {"exposure_s": (0.02,), "illuminance_lux": (5.0,)})
    )
    row = next(row for row in run.cells if row["example"] and not row["clean"])
    kept = read_picture(run.folder / row["example"])
    assert np.array_equal(frame(run, row), kept)
    monkeypatch.setenv("BLURNOISE_STATE", str(tmp_path / "another"))
    with pytest.raises(ValueError, match=r"is outside the folder of the run; --trust .* --images"):
        frame(Run.open(run.folder), row)
    assert np.array_equal(frame(Run.open(run.folder, trust=True), row), kept)
    moved = folder.rename(tmp_path / "moved")
    with pytest.raises(ValueError, match="pictures"):
        frame(Run.open(run.folder, trust=True), row)
    assert np.array_equal(frame(Run.open(run.folder, images=moved), row), kept)
    write_picture(moved / "a.png", 255 - picture.load())
    with pytest.raises(ValueError, match="has changed since"):
        frame(Run.open(run.folder, images=moved), row)


@pytest.mark.parametrize("what", ["folder", "coco", "model"])
def test_files_outside_a_foreign_run_are_not_opened(what, run, tmp_path, monkeypatch):
    """Nor does a pipe hold up a run that is trusted."""
    folder = shutil.copytree(run.folder, tmp_path / "run")
    os.mkfifo(pipe := tmp_path / "pipe")
    with Store(folder, create=True, own=False) as store:
        manifest, identity, name = store.about("manifest"), store.about("identity"), run.pictures[0]
        if what == "model":
            manifest["models"][0] |= {"file": str(pipe), "sha256": "0"}
        else:
            manifest["images"] |= {"kind": what, "source": str(pipe)}
            store.note_picture(name, store.pictures()[name]._replace(identity=f"{name} 1 2 3 4"))
        store.set_about("manifest", manifest)
        store.set_about("identity", identity)
    asked: list[str] = []
    for holder, name in ((builtins, "open"), (io, "open"), (os, "stat")):
        own = getattr(holder, name)

        def recorded(path, *args, honest=own, of=name, **named):
            if str(path) == str(pipe):
                asked.append(of)
            return honest(path, *args, **named)

        monkeypatch.setattr(holder, name, recorded)
    for trusted, told in ((False, "--trust"), (True, str(pipe))):
        assert asked == []
        found = Run.open(folder, trust=trusted)
        with pytest.raises((ValueError, OSError), match=told):
            found.model(run.models[0]["model"]) if what == "model" else found.picture(run.pictures[0])
    assert set(asked) <= {"stat"}
