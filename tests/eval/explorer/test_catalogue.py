"""The catalogue: what is dropped, what is named but not there, and commands and scripts of the same picture."""

import builtins
import io
import os
import shlex
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from band_readers import band_reader
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode, image_folder, read_picture, rendered_signs, write_picture
from blurnoise_eval.deciding.decision import Decision
from blurnoise_eval.explorer import catalogue as catalogues
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.rendered import mean_confidence
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import State
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera

PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture
def catalogue():
    return Catalogue()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [("text.png", b"hello, I am no picture", "text.png: must be an 8- or 16-bit"), ("empty.png", b"", "empty"),
     ("huge.png", PNG, "huge.png: 52 x 40 px")],
)  # fmt: skip
def test_what_is_no_picture_or_too_large_is_refused_with_a_line(name, content, told, catalogue, monkeypatch):
    monkeypatch.setattr(catalogues, "MOST_MEGAPIXELS", 0.001)
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        catalogue.take(name, content)
    assert told in str(error.value)
    assert "/tmp" not in str(error.value)


def test_the_last_dropped_pictures_are_listed_each_under_its_own_name_and_leave_no_file(
    catalogue, tmp_path, monkeypatch
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    names = [catalogue.take("a b.png", PNG) for _ in range(6)]
    assert list(tmp_path.iterdir()) == []
    assert [*catalogue.titles("picture")][-4:] == names[2:]
    assert catalogue.titles("picture")[names[5]] == "a b.png"
    state = State(picture=names[5], model="none")
    assert catalogue.start(state.query(catalogue.base)) == state
    assert catalogue.subject(state).size == (40, 52)
    with pytest.raises(ValueError, match="picture = 'dropped-2': is not available"):
        catalogue.start("picture=dropped-2")
    for make in (catalogue.command, catalogue.script):
        with pytest.raises(ValueError, match=r"'a b.png': was dropped.* blurnoise explore FILE"):
            make(state)


@pytest.mark.parametrize("name", ["/etc/passwd", "run/a.png", "sign-999", "0f", "given"])
@pytest.mark.parametrize("kind", ["picture", "camera", "model"])
def test_a_url_names_no_files(kind, name, catalogue):
    with pytest.raises(ValueError, match=f"{kind} = '{name}': is not available"):
        catalogue.start(f"lux=7&{kind}={name}")


def test_files_that_the_command_names_are_given(tmp_path):
    write_picture(tmp_path / "grey.png", np.full((40, 50, 3), 90, np.uint8))
    catalogue = Catalogue(tmp_path / "grey.png", model="none")
    assert (catalogue.base.picture, catalogue.base.model, catalogue.base.camera) == (
        "given",
        "none",
        "imx250m",
    )
    assert catalogue.titles("picture")["given"] == "grey.png"
    with pytest.raises(ValueError, match="trust: needs a run"):
        Catalogue(tmp_path / "grey.png", trust=True)
    with pytest.raises(ValueError, match="gone"):
        Catalogue(tmp_path / "gone.png", model="none")
    with pytest.raises(ValueError, match="must be a detector"):
        Catalogue(model=band_reader(tmp_path / "reader.onnx"))


STATES = {
    "a sign": State(picture="sign-3", seed=11).put("moves", 1.0),
    "auto, of figures": State(camera="imx250c", model="none")
    .put("exposure_s", float("inf"))
    .put("prnu", 0.02)
    .put("row_time_s", 1.7e-5),
    "driven": State(model="none")
    .put("ego_speed_m_s", 50 / 3.6)
    .put("f_number", 8.0)
    .put("defocus_radius_px", 1.3),
}


def same(state, catalogue, folder, monkeypatch):
    monkeypatch.chdir(folder)
    shown = catalogue.render(state).frame.image
    _, *words = shlex.split(catalogue.command(state))
    assert main(words) == 0
    assert np.array_equal(read_picture(Path("seen.png")), shown)
    Path("seen.png").unlink()
    exec(compile(catalogue.script(state), "script", "exec"), {})
    assert np.array_equal(read_picture(Path("seen.png")), shown)


@pytest.mark.parametrize("name", STATES)
def test_command_and_script_give_the_picture(name, tmp_path, monkeypatch):
    same(STATES[name], Catalogue(), tmp_path, monkeypatch)


def test_scripts_open_the_files_that_the_explorer_was_started_with(tmp_path, monkeypatch):
    """In 16 bits, as every bit of them counts; the detector prints the boxes that it finds."""
    picture = rendered_signs((50,), count=1).pictures[0].load()
    write_picture(tmp_path / "it's.png", picture.astype(np.uint16) * 257 + 3)
    Camera.preset("ar0237").save(tmp_path / "mine.yaml")
    shutil.copy(STOP_SIGN, tmp_path / "m.onnx")
    given = {"model": tmp_path / "m.onnx", "camera": tmp_path / "mine.yaml"}
    same(
        State("given", "given", "given", seed=4),
        Catalogue(tmp_path / "it's.png", **given),
        tmp_path,
        monkeypatch,
    )


# --- a run explored ---


GRID = {
    "exposure_s": (0.02, 0.06),
    "illuminance_lux": (1.0, 50.0),
    "velocity_x_px_s": (0.0, 800.0),
    "gain_db": (float("inf"),),
}


def swept(folder, pictures, grid=GRID, **more):
    evaluate(pictures=pictures, plan=SweepPlan(grid, **more), output=folder, threads=1, progress=False)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    signs = rendered_signs((50, 32), count=2)
    return Run(swept(tmp_path_factory.mktemp("explored") / "run", signs, seed=3, grey_anchor="mean"))


def rows(run):
    with Store(run.folder) as store:
        return list(store.cells())


def frame(run, row):
    """The picture of a row's cell, computed anew."""
    cell = run.cell(cell_id=row.cell_id)
    return run.expose(run.scene(run.picture(cell.image)), cell).image


def test_every_kept_picture_is_computed_anew(run):
    kept = [row for row in rows(run) if row.example]
    assert len(kept) > 4
    for row in kept:
        if not row.conditions.original:
            assert np.array_equal(frame(run, row), read_picture(run.folder / row.example))


def test_a_cell_explored_has_the_picture_and_confidences_of_the_run(run):
    catalogue = Catalogue(run.folder)
    row = next(
        row
        for row in rows(run)
        if row.example and row.conditions["exposure_s"] == 0.06 and row.conditions["velocity_x_px_s"]
    )
    shown = catalogue.render(catalogue.start(f"cell={row.cell_id}"))
    criterion = Decision(run.folder, progress=False).data.criterion
    assert shown.standard is not None
    assert shown.standard.required == criterion.level == 0.6  # rendered signs: a confidence of their own
    cell, model = row.cell_id, row.model
    with Store(run.folder) as store:
        targets = [each.target.confidence for each in queries.targets_of(store, cell, model)]
        detections = store.detections(cell, model)
    assert shown.sight is not None
    assert mean_confidence(shown.sight) == row.target_confidence
    assert [each.confidence for each in shown.sight.targets] == targets
    assert np.array_equal(shown.sight.detections.boxes_xyxy, detections.boxes_xyxy)


def test_scripts_of_a_run_take_its_pictures_camera_and_models(run, tmp_path, monkeypatch, capsys):
    """A cell's, and what is seen after a slider has moved or another camera was chosen."""
    catalogue = Catalogue(run.folder)
    state = catalogue.start()
    for other in (state, state.put("f_number", 4.0), replace(state, camera="ar0237", cell="", model="none")):
        same(other, catalogue, tmp_path, monkeypatch)
    assert f"run.model('{run.models[0]}').detect" in catalogue.script(state)
    assert "Detections" in capsys.readouterr().out


def test_pictures_of_a_folder_are_found_again_or_refused(tmp_path, monkeypatch):
    """Of a run of one's own without a word, of another account's if it is trusted."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    (picture,) = rendered_signs((50,), count=1).pictures
    write_picture(folder / "a.png", picture.load())
    run = Run(
        swept(tmp_path / "run", image_folder(folder), {"exposure_s": (0.02,), "illuminance_lux": (5.0,)})
    )
    row = next(row for row in rows(run) if row.example and not row.conditions.original)
    kept = read_picture(run.folder / row.example)
    assert np.array_equal(frame(run, row), kept)
    monkeypatch.setenv("BLURNOISE_STATE", str(tmp_path / "another"))
    with pytest.raises(ValueError, match=r"is outside the folder of the run; --trust .* --images"):
        frame(Run(run.folder), row)
    assert np.array_equal(frame(Run(run.folder, trusted=True), row), kept)
    moved = folder.rename(tmp_path / "moved")
    with pytest.raises(ValueError, match="pictures"):
        frame(Run(run.folder, trusted=True), row)
    assert np.array_equal(frame(Run(run.folder, moved), row), kept)
    write_picture(moved / "a.png", 255 - picture.load())
    with pytest.raises(ValueError, match="has changed since"):
        frame(Run(run.folder, moved), row)


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
        found = Run(folder, trusted=trusted)
        with pytest.raises((ValueError, OSError), match=told):
            found.model(run.models[0]) if what == "model" else found.picture(run.pictures[0])
    assert set(asked) <= {"stat"}
