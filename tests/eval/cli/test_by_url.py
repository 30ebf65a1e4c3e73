"""Commands on an S3 server: a sweep whose model, pictures and run are objects is the one of folders."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.system import transport
from blurnoise_eval.system.storage import listing, location
from blurnoise_models import matched_filter
from s3_servers import BUCKET, Wire, at, s3_server, wire_to
from signs_in_memory import BOX, sign

pytestmark = pytest.mark.slow
ROOT = f"s3://{BUCKET}"
NAMES = ("a.png", "sub/b c.png", "größe.png")
CONDITIONS = ("--exposure-ms", "2,10", "--lux", "30", "--dx", "0,300", "--threads", "2")
TIMED = ("simulate_ms", "prepare_ms", "infer_ms", "decode_ms")


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
        patch.setattr(transport, "WAITS_S", (0.01, 0.01, 0.01, 0.01))
        transport.system_of.cache_clear()
        transport.system_of("s3").mkdir(BUCKET)
        for file in folder.rglob("*"):
            if file.is_file():
                (location(ROOT) / file.relative_to(folder).as_posix()).put(file.read_bytes())
        yield folder, wire
    transport.system_of.cache_clear()


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


def rows(results: str) -> list[dict[str, str]]:
    return [
        {name: value for name, value in row.items() if not name.endswith("_ms") or name == "exposure_ms"}
        for row in csv.DictReader(results.splitlines())
    ]


def at_url(name: str) -> str:
    return str(location(f"{ROOT}/{name}").read_fresh().decode())


@pytest.mark.parametrize("engine", ["threads", "processes"])
def test_a_sweep_is_that_of_folders(engine: str, folder: Path, tmp_path: Path, capsys: Any) -> None:
    assert sweep(folder, tmp_path / "run") == 0
    assert sweep(ROOT, f"{ROOT}/run-{engine}", "--engine", engine, "--cache-gb", "0.1") == 0
    told = capsys.readouterr()
    assert told.out.splitlines()[-1] == f"open {ROOT}/run-{engine}/report.html"
    for table in ("results.csv", "targets.csv"):
        assert rows(at_url(f"run-{engine}/{table}")) == rows((tmp_path / "run" / table).read_text())
    here = {
        file.relative_to(tmp_path / "run").as_posix()
        for file in (tmp_path / "run").rglob("*")
        if file.is_file()
    }
    assert set(listing(location(f"{ROOT}/run-{engine}"))) == here
    assert str(tmp_path) not in at_url(f"run-{engine}/summary.json") + at_url(f"run-{engine}/report.html")


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
    assert main(["detections", run]) == 0
    assert any(name.startswith("coco/small/") for name in listing(location(run)))


def test_pictures_that_cannot_be_read_are_skipped(
    folder: Path, wire: Wire, tmp_path: Path, capsys: Any
) -> None:
    """One is always cut off, one is denied; the others are seen."""
    wire.named, wire.cuts = "GET /pictures/a.png", 99
    assert sweep(ROOT, tmp_path / "run") == 0
    told = capsys.readouterr().err
    assert f"skipped: {ROOT}/a.png: cut off" in told
    wire.mend()
    wire.named, wire.refusals, wire.status = "GET /pictures/sub", 99, "403 Forbidden"
    assert sweep(ROOT, tmp_path / "run2") == 0
    assert f"skipped: {ROOT}/sub/b c.png: denied" in capsys.readouterr().err


def test_a_slow_server_with_faults_that_pass(folder: Path, wire: Wire, tmp_path: Path) -> None:
    wire.delay_s, wire.cuts, wire.refusals = 0.05, 4, 4
    assert sweep(ROOT, tmp_path / "run") == 0
    wire.mend()
    assert sweep(folder, tmp_path / "plain") == 0
    plain = (tmp_path / "plain/results.csv").read_text()
    assert rows((tmp_path / "run/results.csv").read_text()) == rows(plain)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--coco", f"{ROOT}/none.json"], f"coco = '{ROOT}/none.json': no such object"),
        (["--images", "s3://no-such-bucket/a"], "images = 's3://no-such-bucket/a': "),
        (["--model", f"{ROOT}/none.onnx"], f"{ROOT}/none.onnx: no such object"),
        (["--model", f"{ROOT}/instances.json"], f"{ROOT}/instances.json: is a text file"),
        (["--images", "s3://key:secret@bucket/a"], "s3://bucket/a: must hold no user or password"),
        (["--images", "ftp://host/a"], "ftp://host/a: must begin with"),
        (["--cache-gb", "0"], "cache-gb = '0.0': must be a number > 0"),
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
    assert f"images = '{ROOT}': denied" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_query_is_not_kept(folder: Path, tmp_path: Path, monkeypatch: Any) -> None:
    """Neither in the run nor on its page."""
    url = f"{ROOT}/small.onnx?versionId=null"
    words = [
        "sweep",
        "--model",
        url,
        "--coco",
        f"{ROOT}/instances.json",
        *CONDITIONS,
        "-o",
        str(tmp_path / "run"),
    ]
    monkeypatch.setattr("sys.argv", ["blurnoise", *words])
    assert main(words) == 0
    assert all(
        b"versionId" not in file.read_bytes() for file in (tmp_path / "run").rglob("*") if file.is_file()
    )


def test_a_cache_that_cannot_be_written(folder: Path, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    """Pictures are read without it; a model has to be a file."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "file"))
    own = ["--model", str(folder / "small.onnx"), "--coco", f"{ROOT}/instances.json"]
    assert main(["sweep", *own, *CONDITIONS, "-o", str(tmp_path / "run")]) == 0
    assert sweep(ROOT, tmp_path / "run2") == 2
    assert "the cache cannot be written" in capsys.readouterr().err


def test_a_model_with_company(folder: Path, tmp_path: Path) -> None:
    """Its weights and contract come along, and only a change of these is another model."""
    import onnx
    from blurnoise_eval.detectors.detector import Detector

    model = onnx.load(folder / "small.onnx")
    onnx.save_model(
        model, tmp_path / "m.onnx", save_as_external_data=True, location="m.onnx.data", size_threshold=0
    )
    for file in ("m.onnx", "m.onnx.data"):
        (location(f"{ROOT}/models") / file).put((tmp_path / file).read_bytes())
    found, here = Detector(f"{ROOT}/models/m.onnx"), Detector(tmp_path / "m.onnx")
    assert (found.sha256, found.name, found.contract) == (here.sha256, here.name, here.contract)
    shutil.rmtree(tmp_path / "cache")
    assert Detector(f"{ROOT}/models/m.onnx").sha256 == here.sha256
