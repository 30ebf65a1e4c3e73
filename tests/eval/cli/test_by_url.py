"""Commands on an S3 server: a sweep whose model, pictures and run are objects is the one of folders."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import matched_filter
import pytest
from blurnoise_eval import datasets
from blurnoise_eval.evaluation import Evaluation, evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.system.urls import listing, location
from commands import main
from s3_servers import BUCKET, Wire, at, s3_server, wire_to
from signs_in_memory import BOX, sign

pytestmark = pytest.mark.slow
ROOT = f"s3://{BUCKET}"
NAMES = ("a.png", "sub/b c.png", "größe.png")
CONDITIONS = ("--exposure-ms", "2,10", "--lux", "30", "--dx", "0", "--threads", "2")
PLAN = SweepPlan({"exposure_s": (0.002, 0.01), "illuminance_lux": (30.0,), "velocity_x_px_s": (0.0, 300.0)})


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Wire]]:
    """A folder with a model, its contract and labelled pictures, and the same in a bucket behind a wire."""
    folder = tmp_path_factory.mktemp("set")
    matched_filter.build(folder / "small.onnx", sizes_px=(24, 16, 10), input_px=64)
    picture = sign()
    x0, y0, x1, y1 = BOX
    for name in NAMES:
        (folder / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / name), picture)
    height, width = picture.shape[:2]
    document: dict[str, Any] = {
        "images": [
            {"id": n, "file_name": name, "width": width, "height": height} for n, name in enumerate(NAMES)
        ],
        "categories": [{"id": 1, "name": "stop sign"}],
        "annotations": [
            {"id": n + 1, "image_id": n, "category_id": 1, "bbox": [x0, y0, x1 - x0, y1 - y0]}
            for n in range(3)
        ],
    }
    (folder / "instances.json").write_text(json.dumps(document))
    with pytest.MonkeyPatch.context() as patch, s3_server() as server, wire_to(server) as (address, wire):
        at(address, patch.setenv)
        location(ROOT).fs.mkdir(BUCKET)
        for file in folder.rglob("*"):
            if file.is_file():
                (location(ROOT) / file.relative_to(folder).as_posix()).write_bytes(file.read_bytes())
        yield folder, wire


@pytest.fixture
def folder(held: tuple[Path, Wire], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    held[1].mend()
    return held[0]


@pytest.fixture
def wire(held: tuple[Path, Wire]) -> Wire:
    return held[1]


def sweep(root: object, run: object, *further: str) -> int:
    model, labels = f"{root}/small.onnx", f"{root}/instances.json"
    return main(["sweep", "--model", model, "--coco", labels, *CONDITIONS, "-o", str(run), *further])


def evaluated(root: object, run: Path, **further: Any) -> Evaluation:
    """The same without a page."""
    pictures = datasets.coco(location(f"{root}/instances.json"))
    return evaluate(f"{root}/small.onnx", pictures, plan=PLAN, output=run, threads=2, refine=False, **further)


def untimed(done: Evaluation) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if not name.endswith("_ms")} for row in done.cells]


def rows(results: str) -> list[dict[str, str]]:
    return [
        {name: value for name, value in row.items() if not name.endswith("_ms") or name == "exposure_ms"}
        for row in csv.DictReader(results.splitlines())
    ]


def at_url(name: str) -> str:
    return str(location(f"{ROOT}/{name}").read_bytes().decode())


def test_a_sweep_is_that_of_folders(folder: Path, tmp_path: Path, capsys: Any) -> None:
    assert sweep(folder, tmp_path / "run") == 0
    assert sweep(ROOT, f"{ROOT}/run") == 0
    assert capsys.readouterr().out.rstrip().endswith(f" Details: {ROOT}/run/report.html")
    for table in ("results.csv", "targets.csv"):
        assert rows(at_url(f"run/{table}")) == rows((tmp_path / "run" / table).read_text())
    here = {
        file.relative_to(tmp_path / "run").as_posix()
        for file in (tmp_path / "run").rglob("*")
        if file.is_file()
    }
    assert set(listing(location(f"{ROOT}/run"))) == here
    assert str(tmp_path) not in at_url("run/summary.json") + at_url("run/report.html")


@pytest.mark.parametrize("engine", ["threads", "processes"])
def test_workers_fetch_what_they_need(engine: str, folder: Path, tmp_path: Path) -> None:
    there = evaluated(ROOT, tmp_path / "run", engine=engine)
    assert untimed(there) == untimed(evaluated(folder, tmp_path / "plain"))
    assert len(there.cells) == 15


def test_goes_on_elsewhere_and_is_read(folder: Path, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    run = f"{ROOT}/run-again"
    assert sweep(ROOT, run) == 0
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "another"))
    capsys.readouterr()
    assert sweep(ROOT, run, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["computed"], summary["run"]) == (0, run)
    before = at_url("run-again/report.html")
    assert main(["report", run, "--keep", "0.5"]) == 0
    assert at_url("run-again/report.html") != before
    assert main(["report", run, "-o", str(tmp_path / "here")]) == 0
    assert (tmp_path / "here/report.html").is_file()
    assert main(["report", run, "--coco"]) == 0
    assert "coco/small.json" in listing(location(run))


def test_pictures_that_cannot_be_read_are_skipped(folder: Path, wire: Wire, tmp_path: Path) -> None:
    """One is always cut off, one is denied; the others are seen."""
    wire.named, wire.cuts, wire.cut_at = "GET /pictures/a.png", 99, 100
    done = evaluated(ROOT, tmp_path / "run")
    assert [each["reason"].partition(": ConnectionClosed")[0] for each in done.skipped] == [
        f"{ROOT}/a.png: failed"
    ]
    wire.mend()
    wire.named, wire.refusals, wire.status = "GET /pictures/sub", 99, "403 Forbidden"
    done = evaluated(ROOT, tmp_path / "run")
    assert not done.skipped, "the cut one is read now, the others are done"
    done = evaluated(ROOT, tmp_path / "run2")
    assert not done.skipped, "nor is it asked for: this machine has it"
    shutil.rmtree(tmp_path / "cache")
    done = evaluated(ROOT, tmp_path / "run3")
    assert [each["reason"].partition(" (")[0] for each in done.skipped] == [f"{ROOT}/sub/b c.png: denied"]


def test_a_slow_server_with_faults_that_pass(folder: Path, wire: Wire, tmp_path: Path) -> None:
    wire.delay_s, wire.cuts, wire.cut_at, wire.refusals = 0.05, 2, 100, 2
    assert untimed(evaluated(ROOT, tmp_path / "run")) == untimed(evaluated(folder, tmp_path / "plain"))
    assert not wire.cuts + wire.refusals


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--coco", f"{ROOT}/none.json"], f"--coco = '{ROOT}/none.json': no such object"),
        (["--images", "s3://no-such-bucket/a"], "images = 's3://no-such-bucket/a': "),
        (["--model", f"{ROOT}/none.onnx"], f"{ROOT}/none.onnx: no such object"),
        (["--model", f"{ROOT}/instances.json"], f"{ROOT}/instances.json: is a text file"),
        (["--images", "s3://key:secret@bucket/a"], "s3://bucket/a: must hold no user, password or query"),
        (["--plan", f"{ROOT}/none.yaml"], f"{ROOT}/none.yaml: no such object"),
        (["--images", "ftp://host/a"], "ftp://host/a: must begin with"),
        (["--images", f"{ROOT}/a?token=secret"], f"{ROOT}/a: must hold no user, password or query"),
    ],
)
def test_errors_are_one_line(
    arguments: list[str], told: str, folder: Path, tmp_path: Path, capsys: Any
) -> None:
    try:
        code = main(["sweep", *arguments, *CONDITIONS, "-o", str(tmp_path / "run")])
    except SystemExit as exit:
        code = exit.code  # type: ignore[assignment]
    said = capsys.readouterr().err
    assert code == 2
    assert said.startswith("blurnoise: error: ")
    assert told in said
    assert said.count("\n") == 1
    assert "secret" not in said
    assert not (tmp_path / "run").exists()


def test_a_bucket_that_is_denied(folder: Path, wire: Wire, tmp_path: Path, capsys: Any) -> None:
    wire.refusals, wire.status = 999, "403 Forbidden"
    assert sweep(ROOT, tmp_path / "run") == 2
    assert f"{ROOT}/small.onnx: denied" in capsys.readouterr().err
    assert main(["sweep", "--images", f"{ROOT}/", *CONDITIONS, "-o", str(tmp_path / "run")]) == 2
    assert f"images = '{ROOT}/': denied" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_model_with_company(folder: Path, tmp_path: Path) -> None:
    """Its weights and contract come along, and only a change of these is another model."""
    import onnx
    from blurnoise_eval.detectors.detector import Detector

    model = onnx.load(folder / "small.onnx")
    onnx.save_model(
        model, tmp_path / "m.onnx", save_as_external_data=True, location="m.onnx.data", size_threshold=1024
    )
    for file in ("m.onnx", "m.onnx.data"):
        (location(f"{ROOT}/models") / file).write_bytes((tmp_path / file).read_bytes())
    found, here = Detector(f"{ROOT}/models/m.onnx"), Detector(tmp_path / "m.onnx")
    assert (found.sha256, found.name, found.contract) == (here.sha256, here.name, here.contract)
    shutil.rmtree(tmp_path / "cache")
    assert Detector(f"{ROOT}/models/m.onnx").sha256 == here.sha256
