"""Names that files bring, of classes, models, cameras and pictures, are printed and drawn as they stand."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import matched_filter
import pytest
import yaml
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.recognition import drawn_picture
from commands import main

Output = pytest.CaptureFixture[str]
FEW = ("--exposure-ms", "2,10", "--lux", "50", "--dx", "0", "--repeats", "1", "--threads", "1")
NAMES = ("[/]", "sign [occluded]", r"$\frac{1}{", "止まれ", "red \x1b[31m", ":cat:")


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A picture with a target of each of ``NAMES``, and one of 0 bytes whose name steers a terminal."""
    folder = tmp_path_factory.mktemp("pictures")
    write_picture(folder / "a.png", drawn_picture()[:96, :128])
    (folder / "b\x1b[31m[b].png").write_bytes(b"")
    data = {
        "images": [{"id": 0, "file_name": "a.png"}, {"id": 1, "file_name": "b\x1b[31m[b].png"}],
        "categories": [{"id": number, "name": name} for number, name in enumerate(NAMES)],
        "annotations": [
            {"image_id": image, "category_id": number, "bbox": [2, 2, 40, 40]}
            for number in range(len(NAMES)) for image in (0, 1)
        ],
    }  # fmt: skip
    (folder / "instances.json").write_text(json.dumps(data))
    return folder


@pytest.mark.slow
def test_a_sweep_tells_names_as_they_stand(
    pictures: Path, tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    models = [tmp_path / f"yolo[{number}].onnx" for number in range(len(NAMES))]
    for model, name in zip(models, NAMES, strict=True):
        matched_filter.build(model, sizes_px=(24, 16, 10), input_px=64)
        stated = {**Detector(model).contract.to_dict(), "classes": [name]}
        model.with_suffix(".contract.json").write_text(json.dumps(stated))
    named = [word for model in models for word in ("--model", str(model))]
    coco = [
        "--coco",
        str(pictures / "instances.json"),
        *(word for name in NAMES for word in ("--target", name)),
    ]
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(tmp_path)
        assert main(["sweep", *named, *coco, *FEW, "-o", "run"]) == 0
    told, warned = capsys.readouterr()
    for name in (model.stem for model in models):
        assert name.replace("\x1b", "?") in told, name
    assert "b?[31m[b].png" in warned or r"b\x1b[31m[b].png" in warned
    assert "\x1b" not in told + warned
    assert "Glyph" not in warned
    assert "Warning" not in warned


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    path = tmp_path / "camera[b].yaml"
    text = {"base": "imx250", "name": "cam[/]\x1b[31m$\\frac{1}{", "sources": {"full_well_e": "see [/1]"}}
    path.write_text(yaml.safe_dump(text))
    return path


def test_a_camera_shows_its_sources_as_they_are(camera: Path, capsys: Output) -> None:
    saved = camera.with_name("[b].yaml")
    assert main(["cameras", str(camera), "--save", str(saved)]) == 0
    shown = capsys.readouterr().out
    assert "see [/1]" in shown
    assert "cam[/]?[31m" in shown
    assert "[b].yaml" in shown


@pytest.mark.slow
def test_quality_draws_a_camera_by_its_name(camera: Path, capsys: Output) -> None:
    folder = camera.parent
    few = ["--exposure-ms", "10", "--lux", "50", "--dx", "0", "--repeats", "1", "--threads", "1"]
    assert main(["quality", "-o", str(folder / "quality"), "--camera", str(camera), *few]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_an_error_is_one_plain_line(tmp_path: Path, capsys: Output) -> None:
    assert main(["measure", str(tmp_path / "a\x1b[31m\nblurnoise: all is well\u202e.png")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert not {"\x1b", "\u202e"} & set(told)
    with pytest.raises(SystemExit):
        main(["sweep", "--lu\x1b[31m\nx"])
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "\x1b" not in told


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_any_encoding_of_the_terminal_will_do(encoding: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "blurnoise_eval.cli", "cameras"],
        env={"PYTHONPATH": ":".join(sys.path), "PYTHONIOENCODING": encoding}, capture_output=True, check=True,
    )  # fmt: skip
    assert b"imx250" in done.stdout
    assert not done.stderr


@pytest.mark.slow
def test_a_damaged_picture_is_one_line_in_a_process_of_its_own(pictures: Path, tmp_path: Path) -> None:
    """OpenCV tells its own story on standard error unless told not to."""
    whole = (pictures / "a.png").read_bytes()
    (tmp_path / "half.png").write_bytes(whole[: len(whole) // 2])
    done = subprocess.run(
        [sys.executable, "-m", "blurnoise_eval.cli", "measure", "half.png"],
        cwd=tmp_path, env={"PYTHONPATH": ":".join(sys.path)}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("blurnoise: error: half.png: ")
    assert done.stderr.count("\n") == 1
