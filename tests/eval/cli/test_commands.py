"""Commands that have no file of their own here: what each prints and leaves."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pandas
import pytest
from blurnoise_eval.cli.chart import CHARTS
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.program.optimise import Stages
from blurnoise_eval.run.run import Run
from commands import main, told
from signs_in_memory import matched_detector, sign

from blurnoise.camera import PRESETS, Camera

CROSSING = "motion --speed-kmh 100 --distance-m 50 --target-width-m 4.9 --exposure-ms 15"
DECIDED = "--exposure-ms 8:32 --lux 1,2,5,20 --dx 0,100,200 --gain 0 --keep 0.8"
SWEPT = "--exposure-ms 0.5,4,32 --lux 2,40 --dx 0,800 --limit 1"


@pytest.mark.parametrize("kind", CHARTS)
def test_chart(tmp_path, kind):
    """Of 8 and of 16 bits, and turned."""
    pictures = []
    for name, more in (("8.png", []), ("16.png", ["--bit-depth", "16"]), ("turned.png", ["--angle", "33"])):
        size = ["--width", "71", "--height", "52", "--size", "40"]
        assert main(["chart", kind, "-o", tmp_path / name, *size, *more]) == 0
        pictures.append(cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED))
    eight, sixteen, turned = pictures
    assert (eight.shape[:2], eight.dtype, sixteen.dtype) == ((52, 71), np.uint8, np.uint16)
    np.testing.assert_allclose(sixteen / 257, eight, atol=0.51)
    assert (eight.std() == 0) == np.array_equal(turned, eight) == (kind == "flat-patch")


def test_cameras_has_a_line_for_each_preset(capsys):
    assert main(["cameras"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = {line.split()[0]: line.split()[1:] for line in lines if line and line.split()[0] in PRESETS}
    assert list(rows) == list(PRESETS)
    figures = ["3.45", "10715", "2.45", "0.3598", "12", "2464x2056", "10715", "40.3", "70.7"]
    assert rows["imx250"] == figures


def test_a_camera_is_shown_with_sources_saved_edited_and_used(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    assert main(["cameras", "imx250", "--save", path]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert all(name in words for name in PRESETS["imx250"].to_dict() if name != "sources")
    for text in ("0.6 at 525 nm", "quoted: manual", "chosen: the full well is full scale", str(path)):
        assert text in words
    assert Camera.load(path) == PRESETS["imx250"]
    path.write_text(path.read_text().replace("f_number: 1.4", "f_number: 2.8"))
    write_picture(tmp_path / "scene.png", np.full((8, 9), 200, np.uint8))
    command = ("simulate", tmp_path / "scene.png", "-o", tmp_path / "out.png", "--camera")
    mine, preset = (told(capsys, *command, camera)["white_electrons"] for camera in (path, "imx250"))
    assert preset == pytest.approx(4 * mine)


def test_motion_gives_table_2(capsys):
    """Lin et al. 2024: a truck of 4.9 m at 50 m and 100 km/h, 15 ms; lin2024 is 4096 px over 99.32 degrees."""
    view = ["--width-px", "4096", "--hfov-deg", "99.32"]
    facts = told(capsys, *CROSSING.split(), *view)
    assert facts["blur_px"] == pytest.approx(19.67512, abs=1e-4)
    assert facts["velocity_px_s"] == pytest.approx(facts["blur_px"] / 0.015)
    assert told(capsys, *CROSSING.split(), "--camera", "lin2024") == facts
    assert told(capsys, *CROSSING.split(), *view, "--lens", "rectilinear")["blur_px"] < facts["blur_px"]
    narrow = told(capsys, *CROSSING.split(), "--camera", "lin2024", "--hfov-deg", 60)
    assert narrow["blur_px"] == pytest.approx(facts["blur_px"] * 99.32 / 60)


@pytest.mark.slow
def test_train_writes_a_detector_that_says_how_it_was_made(tmp_path, capsys):
    small = ["--pictures", "320", "--size", "96", "--threads", "1"]
    facts = told(capsys, "train", "-o", tmp_path, *small)
    assert (facts["seed"], facts["pictures"]) == (0, 320)
    assert Detector(facts["model"]).input_size_px == (96, 96)
    table = pandas.read_csv(tmp_path / "training.csv")
    assert table.pictures.tolist() == list(range(16, 321, 16))
    assert table.loss.iloc[-1] == pytest.approx(facts["loss"], rel=1e-5)
    assert not (tmp_path / "training.checkpoint").exists()


@pytest.mark.slow
def test_decide_answers_and_report_says_the_same(tmp_path, capsys):
    run = tmp_path / "run"
    (tmp_path / "pictures").mkdir()
    for index in range(8):
        picture = (sign() * (0.6 + index / 20)).astype("uint8")
        cv2.imwrite(str(tmp_path / "pictures" / f"{index}.png"), picture)
    words = ["--model", matched_detector(tmp_path).path, "--images", tmp_path / "pictures", "-o", run]
    assert main(["decide", *words, *DECIDED.split()]) == 0
    first = " ".join(capsys.readouterr().out.split())
    n_nodes = sum(len(batch.conditions) for batch in Run.open(run).setup.batches)
    assert f"{n_nodes} conditions with 8 pictures: {8 * n_nodes} cells" in first
    assert (run / "report.html").stat().st_size > 100_000
    assert len((run / "answers.csv").read_text().splitlines()) == 1 + 12
    summary = told(capsys, "report", run, "--keep", "0.8")
    assert summary["decided"]["nodes"] == n_nodes
    assert summary["answers"] == json.loads((run / "summary.json").read_text())["answers"]


@pytest.mark.slow
def test_program_of_a_sweep(tmp_path, capsys):
    """Its best fixed time is what the report recommends; libcamera's stages are sound."""
    run, out = tmp_path / "run", tmp_path / "out"
    assert main(["sweep", "-o", run, *SWEPT.split()]) == 0
    capsys.readouterr()
    assert main(["program", run, "-o", out, "--speeds", "0:0.7,800:0.3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("From 2 to 40 lux this program reaches mean confidence 0.")
    assert max(map(len, lines[:-1])) <= 80
    written = {"program.csv", "program.json", "program.png", "libcamera.json", ".blurnoise"}
    assert {path.name for path in out.iterdir()} == written
    rows = pandas.read_csv(out / "program.csv")
    assert len(rows) == 10  # half stops, or a little less, from 2 to 40 lux
    assert rows.exposure_s.between(0.0005 * 0.8, 1 / 30).all()
    agc = json.loads((out / "libcamera.json").read_text())["rpi.agc"]
    mode = agc["exposure_modes"]["custom"]
    assert mode["shutter"][0] == 20
    Stages(tuple(time / 1e6 for time in mode["shutter"]), tuple(mode["gain"]))
    assert main(["program", run, "-o", tmp_path]) == 0
    whole = pandas.read_csv(run / "recommendations.csv").query("scope == 'all'")
    found = json.loads((tmp_path / "program.json").read_text())
    assert [found["best_fixed_s"]] == whole.exposure_s.tolist()
    capsys.readouterr()
    assert main(["program", run, "-o", tmp_path / "limit", "--limit"]) == 0
    assert capsys.readouterr().out.startswith(("Cap the exposure time at ", "No cap below "))
    assert {path.name for path in (tmp_path / "limit").iterdir()} == {"limit.json", "limit.txt", ".blurnoise"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="has no full device")
@pytest.mark.parametrize(("output", "code", "said"), [(">/dev/full", 2, "No space left"), (">&-", 0, "")])
def test_output_that_cannot_be_written_is_a_line(output, code, said):
    run = f'"{sys.executable}" -c "from blurnoise_eval.cli import main; raise SystemExit(main())" --help {output}'
    done = subprocess.run(run, shell=True, capture_output=True, text=True)
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert said in done.stderr
    assert done.stderr.count("\n") <= 1


@pytest.mark.slow
def test_a_run_whose_output_nobody_reads_is_written(tmp_path):
    """As 'head -1' does, 'true' closes the pipe while answers are printed."""
    words = "sweep --limit 1 --exposure-ms 10 --lux 100 --dx 0 -o run"
    done = subprocess.run(
        [
            "bash",
            "-o",
            "pipefail",
            "-c",
            f"{sys.executable} -m blurnoise_eval.cli {words} 2>/dev/null | true",
        ],
        cwd=tmp_path,
    )
    assert done.returncode == 0
    assert (tmp_path / "run" / "report.html").is_file()
