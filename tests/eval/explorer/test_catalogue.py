"""The catalogue: what is dropped, what is not available, cells of a run, and commands that give the same picture."""

import shlex
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from band_readers import band_reader
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode, read_picture, rendered_signs, write_picture
from blurnoise_eval.explorer import catalogue as catalogues
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import State
from blurnoise_eval.explorer.verdict import mean_confidence
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store

PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture
def catalogue():
    return Catalogue()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [("text.png", b"hello, I am no picture", "text.png: must be an 8- or 16-bit"), ("empty.png", b"", "empty"),
     ("huge.png", PNG, "huge.png: 52 x 40 px")],
)  # fmt: skip
def test_what_is_no_picture_or_too_large_is_refused(name, content, message, catalogue, monkeypatch):
    monkeypatch.setattr(catalogues, "MOST_MEGAPIXELS", 0.001)
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        catalogue.take(name, content)
    assert message in str(error.value)
    assert "/tmp" not in str(error.value)


def test_the_last_dropped_pictures_are_listed_and_leave_no_file(catalogue, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    names = [catalogue.take("a b.png", PNG) for _ in range(6)]
    assert list(tmp_path.iterdir()) == []
    assert [*catalogue.titles("picture")][-4:] == names[2:]
    state = State(picture=names[5], model="none")
    assert catalogue.start(state.query(catalogue.base)) == state
    assert catalogue.subject(state).size == (40, 52)
    assert "moves" not in catalogue.controls(state)
    with pytest.raises(ValueError, match="picture = 'dropped-2': is not available"):
        catalogue.start("picture=dropped-2")
    with pytest.raises(ValueError, match=r"'a b.png': was dropped.* blurnoise explore FILE"):
        catalogue.command(state)


@pytest.mark.parametrize("name", ["/etc/passwd", "run/a.png", "sign-999", "0f", "given"])
@pytest.mark.parametrize("kind", ["picture", "camera", "model"])
def test_a_url_names_no_files(kind, name, catalogue):
    with pytest.raises(ValueError, match=f"{kind} = '{name}': is not available"):
        catalogue.start(f"lux=7&{kind}={name}")


def test_files_that_the_command_names_are_given(tmp_path):
    write_picture(tmp_path / "grey.png", np.full((40, 50, 3), 90, np.uint8))
    base = Catalogue(tmp_path / "grey.png", model="none").base
    assert (base.picture, base.camera, base.model) == ("given", "imx250m", "none")
    with pytest.raises(ValueError, match="trust: needs a run"):
        Catalogue(tmp_path / "grey.png", trust=True)
    with pytest.raises(ValueError, match="gone"):
        Catalogue(tmp_path / "gone.png", model="none")
    with pytest.raises(ValueError, match="must be a detector"):
        Catalogue(model=band_reader(tmp_path / "reader.onnx"))


def same(state, catalogue, folder, monkeypatch):
    """The command of a state writes its picture."""
    monkeypatch.chdir(folder)
    assert main(shlex.split(catalogue.command(state))[1:]) == 0
    assert np.array_equal(read_picture(Path("out.png")), catalogue.render(state).frame.image)


@pytest.mark.parametrize(
    "state",
    [
        State(picture="sign-3", seed=11).put("moves", 1.0),
        State(camera="imx250c", model="none").put("exposure_s", float("inf")).put("row_time_s", 1.7e-5),
        State(model="none").put("ego_speed_m_s", 50 / 3.6).put("f_number", 8.0).put("prnu", 0.02),
    ],
    ids=["targets move", "auto, a rolling shutter", "driven"],
)
def test_the_command_gives_the_picture(state, tmp_path, monkeypatch):
    same(state, Catalogue(), tmp_path, monkeypatch)


def test_the_command_names_the_files_of_the_explorer(tmp_path, monkeypatch):
    """In 16 bits, as every bit of them counts."""
    picture = rendered_signs((50,), count=1).pictures[0].load()
    write_picture(tmp_path / "it's.png", picture.astype(np.uint16) * 257 + 3)
    catalogue = Catalogue(tmp_path / "it's.png", camera="ar0237", model="none")
    same(replace(catalogue.base, seed=4), catalogue, tmp_path, monkeypatch)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explored") / "run"
    grid = {
        "exposure_s": (0.02, 0.06), "illuminance_lux": (1.0, 50.0), "velocity_x_px_s": (0.0, 800.0),
        "gain_db": (float("inf"),),
    }  # fmt: skip
    plan = SweepPlan(grid, seed=3, grey_anchor="mean", repeats=2)
    evaluate(pictures=rendered_signs((50, 32), count=2), plan=plan, output=folder, progress=False)
    return folder


def test_a_cell_has_the_picture_and_confidences_of_the_run(run, tmp_path, monkeypatch):
    catalogue = Catalogue(run)
    with Store(run) as store:
        row = next(store.cells("exposure_s = 0.06 AND velocity_x_px_s <> 0 AND repeat = 1"))
        cell, model = row.cell_id, row.model
        targets = [each.target.confidence for each in queries.targets_of(store, cell, model)]
        detections = store.detections(cell, model)
    state = catalogue.start(cell=cell)
    scored = catalogue.render(state).scored
    assert scored is not None
    assert scored.standard.required == 0.6  # rendered signs: a confidence of their own
    assert mean_confidence(scored.counted) == row.target_confidence
    assert [target.confidence for target in scored.counted.targets] == targets
    assert np.array_equal(scored.output.detections.boxes_xyxy, detections.boxes_xyxy)
    assert catalogue.start(state.query(catalogue.base)) == state
    same(state.put("f_number", 4.0), catalogue, tmp_path, monkeypatch)
    with pytest.raises(ValueError, match="cell: needs a run"):
        Catalogue().start(cell=cell)


def test_the_explorer_opens_in_a_state_that_works(run):
    """The usual one for every rendered scene; of a run the fastest and darkest that is nearly the surest."""
    usual = Catalogue()
    for picture in ("sign-1", "sign-2", "sign-3", "sign-4"):
        good, sentence = usual.render(replace(usual.base, picture=picture)).verdict
        assert good, (picture, sentence)
    catalogue = Catalogue(run)
    state = catalogue.start()
    with Store(run) as store:
        rows = [*queries.cells_with(store, clean=0, repeat=0, image=state.picture.removeprefix("run/"))]
    sure = [row for row in rows if row.target_confidence >= 0.95 * max(row.target_confidence for row in rows)]
    expected = max(sure, key=lambda row: (row.conditions["velocity_x_px_s"], -row.conditions.illuminance_lux))
    chosen = state.at["velocity_x_px_s"], state.at["illuminance_lux"]
    assert chosen == (expected.conditions["velocity_x_px_s"], expected.conditions.illuminance_lux)
    assert 0 < len(sure) < len(rows)
    scored = catalogue.render(state).scored
    assert scored is not None
    assert all(row.confidence >= FOUND_SCORE for row in scored.counted.targets)


def test_sliders_of_a_run_have_the_values_that_it_tested(run):
    catalogue = Catalogue(run)
    state = catalogue.start()
    controls = catalogue.controls(state)
    assert controls["exposure_s"].texts == ["20", "60"]
    assert controls["velocity_x_px_s"].values == (0.0, 800.0)
    assert len(controls["velocity_y_px_s"].values) > 100  # one value tested
    assert state.at["exposure_s"] in (0.02, 0.06)
    assert (state.picture, state.repeat) == (next(iter(catalogue.titles("picture"))), 0)
