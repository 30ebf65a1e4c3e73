"""Names that files bring, of classes, models, cameras and pictures, are printed and drawn as they stand."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import matched_filter
import pytest
import yaml
from blurnoise_eval.detectors.detector import Detector
from commands import Output, main
from signs_in_memory import sign

FEW = "--exposure-ms 2,10 --lux 50 --dx 0 --threads 1 -o run"
NAMES = ("[/]", "sign [occluded]", r"$\frac{1}{", "止まれ", "red \x1b[31m", ":cat:")


@pytest.mark.slow
def test_a_sweep_tells_names_as_they_stand(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model and a target of each name, and a picture of 0 bytes whose name steers a terminal."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", sign())
    Path("b\x1b[31m[b].png").write_bytes(b"")
    words = ["sweep", "--coco", "instances.json", *FEW.split()]
    data = {
        "images": [{"id": 0, "file_name": "a.png"}, {"id": 1, "file_name": "b\x1b[31m[b].png"}],
        "categories": [{"id": number, "name": name} for number, name in enumerate(NAMES)],
        "annotations": [{"image_id": 0, "category_id": n, "bbox": [2, 2, 40, 40]} for n in range(len(NAMES))],
    }
    Path("instances.json").write_text(json.dumps(data))
    for number, name in enumerate(NAMES):
        model = matched_filter.build(Path(f"yolo[{number}].onnx"), sizes_px=(24, 16, 10), input_px=64)
        contract = {**Detector(model).contract.to_dict(), "classes": [name]}
        model.with_suffix(".contract.json").write_text(json.dumps(contract))
        words += ["--model", str(model), "--target", name]
    assert main(words) == 0
    told, warned = capsys.readouterr()
    assert all(f"yolo[{number}]" in told for number in range(len(NAMES)))
    assert "b?[31m[b].png" in warned or r"b\x1b[31m[b].png" in warned
    assert "\x1b" not in told + warned
    assert "Glyph" not in warned
    assert "Warning" not in warned


def test_a_camera_shows_its_sources_as_they_are(tmp_path: Path, capsys: Output) -> None:
    camera, saved = tmp_path / "camera[b].yaml", tmp_path / "[b].yaml"
    text = {"base": "imx250", "name": "cam[/]\x1b[31m$\\frac{1}{", "sources": {"full_well_e": "see [/1]"}}
    camera.write_text(yaml.safe_dump(text))
    assert main(["cameras", camera, "--save", saved]) == 0
    shown = capsys.readouterr().out
    assert all(words in shown for words in ("see [/1]", "cam[/]?[31m", "[b].yaml"))


def test_an_error_is_one_plain_line(tmp_path: Path, capsys: Output) -> None:
    assert main(["measure", tmp_path / "a\x1b[31m\nblurnoise: all is well\u202e.png"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert not {"\x1b", "\u202e"} & set(told)
    with pytest.raises(SystemExit):
        main(["sweep", "--lu\x1b[31m\nx"])
    told = capsys.readouterr().err
    assert (told.count("\n"), "\x1b" in told) == (1, False)


@pytest.mark.slow
def test_a_damaged_picture_is_one_line_in_a_process_of_its_own(tmp_path: Path) -> None:
    """OpenCV tells its own story on standard error unless told not to."""
    (tmp_path / "half.png").write_bytes(cv2.imencode(".png", sign())[1].tobytes()[:900])
    command = [sys.executable, "-m", "blurnoise_eval.cli", "measure", "half.png"]
    here = {"PYTHONPATH": ":".join(sys.path), "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("blurnoise: error: half.png: ")
