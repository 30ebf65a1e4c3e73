"""Commands replace what they wrote, and nothing else: not the user's files, not an input, not a device."""

import json
import os
import shutil
import sqlite3
import stat
from contextlib import closing
from pathlib import Path

import matched_filter
import pytest
from blurnoise_eval import SweepPlan, datasets, evaluate
from blurnoise_eval.system.files import RUN_FILES
from commands import main
from signs_in_memory import BOX, sign

from blurnoise._core.manifest import MANIFEST
from blurnoise._core.writing import write_whole

SWEEP = "sweep --model small.onnx --images pics --labels labels.json --exposure-ms 1,10 --lux 50 --dx 0 --threads 1"
THEIRS = "did not write, or that was changed since; --overwrite replaces it"
INPUT = "is an input of this command, which is never replaced"


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A folder with a model, pictures in a folder of their own, labels elsewhere, and a run."""
    folder = tmp_path_factory.mktemp("swept")
    matched_filter.build(folder / "small.onnx", sizes_px=(24, 16, 10), input_px=64)
    (folder / "pics").mkdir()
    for number in range(3):
        datasets.write_picture(folder / "pics" / f"{number}.png", sign(right_px=3 * number))
    bbox = [BOX[0], BOX[1], BOX[2] - BOX[0], BOX[3] - BOX[1]]
    document = {
        "images": [{"id": number, "file_name": f"{number}.png"} for number in range(3)],
        "categories": [{"id": 1, "name": "stop sign"}],
        "annotations": [{"id": n + 1, "image_id": n, "category_id": 1, "bbox": bbox} for n in range(3)],
    }
    (folder / "labels.json").write_text(json.dumps(document))
    for place in (folder, folder / "pics"):
        (place / MANIFEST).unlink()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main([*SWEEP.split(), "-o", "run"]) == 0
    return folder


@pytest.fixture
def here(swept, tmp_path, monkeypatch):
    shutil.copytree(swept, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def held(folder):
    """Every file that is not a list of what was written, links as such."""
    files = (path for path in folder.rglob("*") if path.name != MANIFEST)
    return {
        str(path.relative_to(folder)): path.readlink() if path.is_symlink() else path.read_bytes()
        for path in files
        if not path.is_dir() and not path.is_fifo()
    }


def refused(capsys, words, why, user=()):
    """The command says so in a line, and nothing is another or more than it was."""
    for name, content in dict(user).items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(content)
    before = held(Path())
    assert main(words.split()) == 2
    assert why in capsys.readouterr().err
    assert held(Path()) == before


@pytest.mark.parametrize(
    "name", ["figures/confidence_exposure.png", *(name for name in RUN_FILES if "*" not in name)]
)
def test_a_sweep_does_not_begin_where_it_would_replace_a_file(here, capsys, name):
    refused(capsys, f"{SWEEP} -o new", THEIRS, {f"new/{name}": b"mine"})


def test_a_sweep_writes_what_is_said_of_it(here):
    of_run = {name for name in held(here / "run") if not name.startswith(("examples/", "figures/"))}
    assert of_run == {"results.sqlite", *(name for name in RUN_FILES if not name.startswith("figures/"))}
    assert all(any(path.match(name) for name in RUN_FILES) for path in (here / "run/figures").glob("*.png"))


@pytest.mark.parametrize("further", ["", " --overwrite"])
@pytest.mark.parametrize("link", [shutil.move, os.link, os.symlink])
def test_labels_are_not_written_over_by_those_of_the_run(here, capsys, link, further):
    (here / "new/coco").mkdir(parents=True)
    link(here / "labels.json", here / "new/coco/instances.json")
    words = SWEEP.replace("labels.json", "new/coco/instances.json")
    refused(capsys, f"{words} -o new{further}", INPUT)


@pytest.mark.parametrize("command", [f"{SWEEP} -o new", f"{SWEEP} -o new --overwrite", "report new"])
@pytest.mark.parametrize("journal", ["delete", "wal"])
def test_a_database_of_the_users_stays_as_it_is(here, capsys, command, journal):
    (here / "new").mkdir()
    with closing(sqlite3.connect(here / "new/results.sqlite")) as db:
        db.execute(f"PRAGMA journal_mode = {journal}")
        db.execute("CREATE TABLE mine (a)")
        db.commit()
    refused(capsys, command, "other software; choose another folder")


def test_a_journal_of_the_users_stays_as_it_is(here, capsys):
    refused(capsys, f"{SWEEP} -o new", "is not of a run", {"new/results.sqlite-wal": b"mine"})


def test_a_search_does_not_begin_there_either(here, capsys):
    words = SWEEP.replace("sweep", "decide").replace("--exposure-ms 1,10 ", "")
    refused(capsys, f"{words} -o new", THEIRS, {"new/summary.json": b"mine"})


def test_with_overwrite_only_files_of_those_names_are_replaced(here, capsys):
    theirs = {
        "notes.txt": b"1",
        "figures/mine.png": b"2",
        "coco/labels.json": b"3",
        "results.sqlite.bak": b"4",
    }
    for name, content in {**theirs, "summary.json": b"{}"}.items():
        (here / "new" / name).parent.mkdir(parents=True, exist_ok=True)
        (here / "new" / name).write_bytes(content)
    assert main([*SWEEP.split(), "-o", "new", "--overwrite"]) == 0
    assert {name: (here / "new" / name).read_bytes() for name in theirs} == theirs
    assert json.loads((here / "new/summary.json").read_text())["cells"]
    refused(capsys, "report new --overwrite", "is a file of another kind", {"new/summary.json": b"\0\0"})


@pytest.mark.slow
def test_the_same_commands_go_on_as_before(here):
    for words in (f"{SWEEP} -o run", "report run", "report run --coco") * 2:
        assert main(words.split()) == 0
    for lux in (5, 50, 5):
        assert main(f"simulate pics/0.png -o seen.png --lux {lux}".split()) == 0
    assert main(["cameras", "imx250", "--save", "mine.yaml"]) == main(
        ["cameras", "imx250", "--save", "mine.yaml"]
    )


@pytest.mark.parametrize(
    "words",
    [
        "report run", "report run -o new", "cameras imx250 --save new/a.yaml", "chart stop-sign -o new/a.png",
        "simulate pics/0.png -o new/a.png", "explore pics/0.png --model none -o new/a.png",
        "measure pics/0.png -o new",
        "simulate --save-scene new/a.yaml", "sweep --save-plan new/a.yaml", "program run --save-plan new/a.yaml",
        "report run --coco",
        "inspect small.onnx --probe pics/0.png", "program run -o new", "measure -o new", "train -o new",
        "validate pics -o new", "cameras fit pics -o new/a.yaml", "cameras fit pics -o new/b.yaml",
    ],
)  # fmt: skip
def test_no_command_replaces_a_file_of_the_users(here, capsys, words):
    files = ["run/report.html", "run/coco/small.json", "small-0-probe.png"]
    files += [f"new/{name}" for name in ("a.yaml", "a.png", "b.png", "a.csv", "report.html", "program.csv")]
    files += [f"new/{name}" for name in ("quality.json", "edges.csv", "stop_sign.onnx", "camera.yaml")]
    refused(capsys, words, THEIRS, dict.fromkeys(files, b"mine"))


@pytest.mark.parametrize(
    "words",
    [
        "measure pics/edges.png -o pics",
        "measure link/edges.png -o pics",
        "simulate pics/0.png -o pics/0.png", "explore pics/0.png --model none -o pics/0.png",
        "cameras a.yaml --save a.yaml", "simulate pics/0.png --camera a.yaml -o a.yaml",
        "cameras fit --tone t.csv --base a.yaml -o a.yaml", "measure pics/0.png --oecf edges.csv -o .",
        "sweep --plan a.yaml --save-plan a.yaml", "sweep --save-plan a.yaml --plan a.yaml",
        "simulate pics/0.png --scene scene.yaml -o pics/2.png", "inspect small.onnx --probe probe",
        "validate pics --camera camera.yaml -o .",
    ],
)  # fmt: skip
def test_no_command_replaces_what_it_reads(here, capsys, words):
    shutil.copytree("pics", "probe")
    os.link("probe/0.png", "small-0-probe.png")
    Path("link").symlink_to("pics")
    shutil.copy("pics/0.png", "pics/edges.png")
    Path("scene.yaml").write_text("camera: pics/2.png\n")
    Path("pics/2.png").write_text("base: imx250\n")
    files = dict.fromkeys(("a.yaml", "camera.yaml"), b"base: imx250\n")
    files |= dict.fromkeys(("t.csv", "edges.csv"), b"0,0\n100,0.3\n255,1\n")
    why = "must be one of '.json'" if "scene" in words else INPUT
    refused(capsys, f"{words} --overwrite", why, files)


def test_a_data_set_of_others_stays_theirs(here, capsys):
    (here / "set").mkdir()
    (here / "set/samples.json").write_bytes(b"{}")
    refused(capsys, "merge run run -o set", "is not empty")
    refused(capsys, "scenes -o pics --count 1", "holds files that blurnoise did not write (0.png)")


def test_devices_stay_devices(here, capsys):
    for name in ("null.yaml", "null.png"):
        Path(name).symlink_to("/dev/null")
    for words in (
        "sweep --save-plan null.yaml",
        "sweep --save-plan /dev/null",
        "explore pics/0.png --model none -o null.png",
    ):
        assert main(words.split()) == 0
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    assert Path("null.yaml").is_symlink()
    assert Path("null.png").is_symlink()
    refused(capsys, "cameras imx250 --save run", "is a folder")


@pytest.mark.parametrize("command", ["report run", "program run -o run"])
@pytest.mark.parametrize("to", ["../elsewhere.csv", "../pics/report.csv", "/dev/null", None])
def test_a_folder_of_results_is_not_left_and_nobody_waits_for_a_reader(here, capsys, command, to):
    """Where the link that somebody put there leads to no file, to one that blurnoise wrote, or to a device."""
    write_whole(Path("pics/report.csv"), b"ours, too")
    name = Path("run", "program.csv" if "program" in command else "scores.csv")
    name.unlink(missing_ok=True)
    name.symlink_to(to) if to else os.mkfifo(name)
    refused(capsys, command, "leaves the folder 'run' through a link" if to else "must be a file")


def test_the_run_remembers_where_its_pictures_are(here, monkeypatch):
    """Labels and pictures lay in different folders; and the command is given elsewhere."""
    before = Path("run/failures.html").read_bytes()
    monkeypatch.chdir("/")
    assert main(["report", str(here / "run")]) == 0
    assert (here / "run/failures.html").read_bytes().count(b"/9j/") == before.count(b"/9j/") > 2


@pytest.mark.slow
def test_python_refuses_and_overwrites_as_commands_do(here):
    def run(labels, **further):
        pictures = datasets.coco(labels, images="pics")
        plan = SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (50.0,)})
        return evaluate("small.onnx", pictures, plan=plan, output="new", progress=False, **further)

    Path("new/coco").mkdir(parents=True)
    shutil.copy("labels.json", "new/coco/instances.json")
    before = held(here)
    with pytest.raises(FileExistsError, match=r"did not write.*; overwrite=True replaces it"):
        run("labels.json")
    with pytest.raises(FileExistsError, match=INPUT.removeprefix("is ").replace("this command", ".*")):
        run("new/coco/instances.json", overwrite=True)
    assert held(here) == before
    done = run("labels.json", overwrite=True)
    done.report()
    Path("new/report.html").write_text("mine")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        done.report()
    assert Path("new/report.html").read_text() == "mine"
    done.report(overwrite=True)
    assert Path("new/report.html").read_text() != "mine"


@pytest.mark.parametrize("name", ["run/report.html", "run/coco/small.json"])
def test_a_report_with_coco_files_checks_all_of_them_before_it_writes(here, capsys, name):
    refused(capsys, "report run --coco", THEIRS, {name: b"mine"})


def test_answers_are_printed_once_everything_may_be_written_and_before_it_is(here, monkeypatch, capsys):
    def no_space(*_, **__):
        raise OSError(28, "No space left on device", "report.html")

    monkeypatch.setattr("blurnoise_eval.report.page.write_report", no_space)
    assert main(["report", "run"]) == 2
    printed = capsys.readouterr().out
    assert "Exposure to use" in printed
    assert "Details" not in printed
    (here / "run" / "report.html").write_text("mine")
    assert main(["report", "run"]) == 2
    assert not capsys.readouterr().out
