"""Commands on an S3 server: a sweep whose model, pictures and run are objects is the one of folders."""

from __future__ import annotations

import csv
import json
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
    x0, y0, x1, y1 = BOX
    document: dict[str, Any] = {
        "images": [],
        "categories": [{"id": 1, "name": "stop sign"}],
        "annotations": [],
    }
    for n, name in enumerate(NAMES):
        (folder / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / name), sign())
        document["images"].append({"id": n, "file_name": name})
        box = {"id": n + 1, "image_id": n, "category_id": 1, "bbox": [x0, y0, x1 - x0, y1 - y0]}
        document["annotations"].append(box)
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


def sweep(root: object, run: object, *further: str) -> int:
    model, labels = f"{root}/small.onnx", f"{root}/instances.json"
    return main(["sweep", "--model", model, "--coco", labels, *CONDITIONS, "-o", str(run), *further])


def evaluated(root: object, run: Path, **further: Any) -> Evaluation:
    """The same without a page."""
    pictures = datasets.coco(location(f"{root}/instances.json"))
    return evaluate(f"{root}/small.onnx", pictures, plan=PLAN, output=run, threads=2, refine=False, **further)


def untimed(done: Evaluation) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if not name.endswith("_ms")} for row in done.cells]


def at_url(name: str) -> str:
    return str(location(f"{ROOT}/{name}").read_bytes().decode())


def test_a_sweep_is_that_of_folders_goes_on_elsewhere_and_is_read(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here, there = tmp_path / "run", f"{ROOT}/run"
    assert sweep(folder, here) == 0
    assert sweep(ROOT, there) == 0
    assert capsys.readouterr().out.rstrip().endswith(f" Details: {there}/report.html")
    for table in ("results.csv", "targets.csv"):
        of_url, of_folder = (
            [{name: row[name] for name in row if name == "exposure_ms" or not name.endswith("_ms")} for row in rows]
            for rows in map(csv.DictReader, (at_url(f"run/{table}").splitlines(), (here / table).open(newline="")))
        )  # fmt: skip
        assert of_url == of_folder
    files = {file.relative_to(here).as_posix() for file in here.rglob("*") if file.is_file()}
    assert set(listing(location(there))) == files
    assert str(tmp_path) not in at_url("run/summary.json") + at_url("run/report.html")
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "another"))
    assert sweep(ROOT, there, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["computed"], summary["run"]) == (0, there)
    before = at_url("run/report.html")
    assert main(["report", there, "--keep", "0.5"]) == 0
    assert at_url("run/report.html") != before
    assert main(["report", there, "--coco"]) == 0
    assert "coco/small.json" in listing(location(there))


@pytest.mark.parametrize("engine", ["threads", "processes"])
def test_workers_fetch_what_they_need(
    engine: str, folder: Path, tmp_path: Path, held: tuple[Path, Wire]
) -> None:
    """From a slow server, too, with faults that pass."""
    wire = held[1]
    wire.delay_s, wire.cuts, wire.cut_at, wire.refusals = 0.05, 2, 100, 2
    there = evaluated(ROOT, tmp_path / "run", engine=engine)
    assert untimed(there) == untimed(evaluated(folder, tmp_path / "plain"))
    assert len(there.cells) == 15
    assert not wire.cuts + wire.refusals
