"""The catalogue: uploads, what is named but not there, and commands and scripts that give the same picture."""

from __future__ import annotations

import shlex
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from band_readers import band_reader
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode, read_picture, write_picture
from blurnoise_eval.explorer import catalogue as catalogues
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import State

from blurnoise import Camera

PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture
def catalogue() -> Catalogue:
    return Catalogue()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [("text.png", b"hello, I am no picture", "text.png: not an 8- or 16-bit picture"), ("empty.png", b"", "empty"),
     ("huge.png", PNG, "huge.png: 52 x 40 px"), ("../../etc/passwd", b"root", "passwd: not an 8")],
)  # fmt: skip
def test_what_is_no_picture_or_too_large_is_refused_with_a_line(
    name: str, content: bytes, told: str, catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogues, "MOST_MEGAPIXELS", 0.001)
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        catalogue.take(name, content)
    assert told in str(error.value)
    assert "/tmp" not in str(error.value)


def test_uploads_are_listed_for_who_can_name_them_and_leave_no_file(
    catalogue: Catalogue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    name = catalogue.take("C:\\photos\\a b.png", PNG)
    assert list(tmp_path.iterdir()) == []
    assert name != catalogue.take("a b.png", PNG), "nobody can guess it"
    assert name not in catalogue.titles("picture", "sign-1")
    assert catalogue.titles("picture", name)[name] == "a b.png"
    state = State(picture=name, model="none")
    assert catalogue.start(state.query(catalogue.base)) == state
    assert catalogue.subject(state) is catalogue.subject(state)
    assert catalogue.subject(state).size == (40, 52)


@pytest.mark.parametrize("name", ["/etc/passwd", "run/a.png", "sign-999", "0f", "given"])
@pytest.mark.parametrize("kind", ["picture", "camera", "model"])
def test_a_url_names_no_files(kind: str, name: str, catalogue: Catalogue) -> None:
    with pytest.raises(ValueError, match=f"{kind} = '{name}': is not here"):
        catalogue.start(f"lux=7&{kind}={name}")


def test_files_that_the_command_names_are_given(tmp_path: Path) -> None:
    write_picture(tmp_path / "grey.png", np.full((40, 50, 3), 90, np.uint8))
    catalogue = Catalogue(tmp_path / "grey.png", model="none")
    assert (catalogue.base.picture, catalogue.base.model, catalogue.base.camera) == (
        "given",
        "none",
        "imx250m",
    )
    assert catalogue.titles("picture", "given")["given"] == "grey.png"
    with pytest.raises(ValueError, match="trust: goes with a run"):
        Catalogue(tmp_path / "grey.png", trust=True)
    with pytest.raises(ValueError, match="gone"):
        Catalogue(tmp_path / "gone.png", model="none")
    with pytest.raises(ValueError, match="reads text; the explorer shows detectors"):
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


def same(state: State, catalogue: Catalogue, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    shown = catalogue.render(state).frame.image
    _, *words = shlex.split(catalogue.command(state))
    assert main(words) == 0
    assert np.array_equal(read_picture(Path("seen.png")), shown)
    Path("seen.png").unlink()
    exec(compile(catalogue.script(state), "script", "exec"), {})
    assert np.array_equal(read_picture(Path("seen.png")), shown)


@pytest.mark.parametrize("name", STATES)
def test_command_and_script_give_the_picture(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    same(STATES[name], Catalogue(), tmp_path, monkeypatch)


def test_of_files_of_ones_own_and_not_of_an_upload(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture, camera = tmp_path / "mine.png", tmp_path / "own.yaml"
    write_picture(picture, np.random.default_rng(0).integers(0, 255, (48, 70, 3), np.uint8))
    Camera.preset("mt9m034").save(camera)
    catalogue = Catalogue(picture, camera=camera, model="none")
    state = catalogue.base.put("illuminance_lux", 7.0)
    same(state, catalogue, tmp_path, monkeypatch)
    with pytest.raises(ValueError, match="an uploaded one has no command"):
        catalogue.command(replace(state, picture=catalogue.take("a.png", PNG)))
