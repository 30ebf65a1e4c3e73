"""Commands on an S3 server: a sweep whose model, pictures and run are objects is the one of folders."""

import csv
import json

import cv2
import matched_filter
import pytest
from blurnoise_eval.run.run import Run
from blurnoise_eval.system.urls import listing, location
from commands import main
from s3_servers import BUCKET, at, s3_server, wire_to
from signs_in_memory import BOX, sign

pytestmark = pytest.mark.slow
ROOT = f"s3://{BUCKET}"
NAMES = ("a.png", "sub/b c.png", "größe.png")
CONDITIONS = "--exposure-ms 2,10 --lux 30 --dx 0 --threads 2"


def rows(text):
    """Of a table, without what was timed."""
    every = csv.DictReader(text.splitlines())
    return [{name: row[name] for name in row if name == "exposure_ms" or name[-3:] != "_ms"} for row in every]


@pytest.mark.parametrize("engine", ["threads", "processes"])
def test_a_sweep_is_that_of_folders_goes_on_elsewhere_and_is_read(engine, tmp_path, monkeypatch, capsys):
    """Over a wire that is slow, cut and busy now and then."""
    folder, here, there = tmp_path / "set", tmp_path / "run", f"{ROOT}/run"
    folder.mkdir()
    matched_filter.build(folder / "small.onnx", sizes_px=(24, 16, 10), input_px=64)
    bbox = [BOX[0], BOX[1], BOX[2] - BOX[0], BOX[3] - BOX[1]]
    for name in NAMES:
        (folder / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / name), sign())
    document = {
        "images": [{"id": n, "file_name": name} for n, name in enumerate(NAMES)],
        "categories": [{"id": 1, "name": "stop sign"}],
        "annotations": [{"id": n + 1, "image_id": n, "category_id": 1, "bbox": bbox} for n in range(3)],
    }
    (folder / "instances.json").write_text(json.dumps(document))

    def sweep(root, run, *further):
        words = ["sweep", "--model", f"{root}/small.onnx", "--coco", f"{root}/instances.json", "-o", run]
        assert main([*words, *CONDITIONS.split(), "--engine", engine, *further]) == 0

    with s3_server() as server, wire_to(server) as (address, wire):
        at(address, monkeypatch.setenv)
        monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
        location(ROOT).fs.mkdir(BUCKET)
        for file in [each for each in folder.rglob("*") if each.is_file()]:
            (location(ROOT) / file.relative_to(folder).as_posix()).write_bytes(file.read_bytes())
        sweep(folder, here)
        wire.delay_s, wire.cuts, wire.cut_at, wire.refusals = 0.05, 2, 100, 2
        sweep(ROOT, there)
        assert capsys.readouterr().out.rstrip().endswith(f" Details: {there}/report.html")
        assert not wire.cuts + wire.refusals
        found = {
            name: (location(there) / name).read_bytes().decode(errors="replace")
            for name in listing(location(there))
        }
        assert set(found) == {file.relative_to(here).as_posix() for file in here.rglob("*") if file.is_file()}
        for table in ("results.csv", "targets.csv"):
            assert rows(found[table]) == rows((here / table).read_text())
        assert str(tmp_path) not in found["summary.json"] + found["report.html"]
        monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "another"))
        sweep(ROOT, there, "--json")
        assert json.loads(capsys.readouterr().out)["computed"] == 0
        assert main(["report", there, "--coco"]) == 0
        assert "coco/small.json" in listing(location(there))
        run = Run.open(there)
        assert run.answers == Run.open(here).answers
        assert run.summary()["run"] == there
