"""``blurnoise decide``: its ranges, its help and its errors; a small run, read again by ``report``."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.cli._options import spread
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.asked import asked
from signs_in_memory import matched_detector, sign

Output = pytest.CaptureFixture[str]
SMALL = [
    "--exposure-ms", "8:32", "--lux", "1,2,5,20", "--speed", "0,100,200",
    "--gain", "0", "--most-nodes", "12", "--keep", "0.8",
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1:1000", (1, 3, 10, 30, 100, 300, 1000)),
        ("2:250", (2, 3, 10, 30, 100, 250)),
        ("0:1000", (0, 10, 30, 100, 300, 1000)),
        ("0:700", (0, 10, 30, 100, 300, 700)),
        ("0.5:5", (0.5, 1, 3, 5)),
        ("7,-2", (7, -2)),
        ("0:100:50", (0, 50, 100)),
    ],
)
def test_a_range_is_its_ends_and_round_numbers_between(text: str, values: tuple[float, ...]) -> None:
    assert spread(text) == values


@pytest.mark.parametrize("text", ["5:1", "-5:5", "1:inf", "1:x", "a", "3:3"])
def test_what_is_no_range(text: str) -> None:
    with pytest.raises(ValueError, match=text):
        spread(text)


def test_help_teaches(capsys: Output) -> None:
    assert main(["decide", "--help"]) == 0
    told = capsys.readouterr().out
    for part in (
        "--model",
        "--coco",
        "--lux",
        "--speed",
        "--keep",
        "--regret",
        "--edge-stops",
        "1,30,1000,20000",
    ):
        assert part in told


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--exposure-ms", "5:1"], "must be low:high"),
        (["--lux", "-1"], "--lux = -1"),
        (["--regret", "2"], "regret"),
        (["--most-nodes", "1"], "--most-nodes = 1"),
        (["--keep", "0.9", "--threshold", "0.5"], "keep"),
        (["--gain", "loud"], "loud"),
    ],
)
def test_bad_options_are_one_line(options: list[str], told: str, tmp_path: Path, capsys: Output) -> None:
    try:
        code = main(["decide", "-o", str(tmp_path / "run"), *options])
    except SystemExit as error:
        code = int(error.code or 0)
    assert code == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert said[0].startswith("blurnoise: error: ")
    assert told in said[0]
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_it_decides_and_report_says_the_same(tmp_path: Path, capsys: Output) -> None:
    model, run = matched_detector(tmp_path), str(tmp_path / "run")
    (tmp_path / "pictures").mkdir()
    for index in range(8):
        cv2.imwrite(
            str(tmp_path / "pictures" / f"{index}.png"), (sign() * (0.6 + index / 20)).astype("uint8")
        )
    asked_for = ["--model", str(model.path), "--images", str(tmp_path / "pictures"), *SMALL]
    assert main(["decide", *asked_for, "-o", run]) == 0
    first = capsys.readouterr().out
    with Store(Path(run)) as store:
        n_nodes = sum(len(batch.conditions) for batch in asked(store))
    assert f"{n_nodes} conditions before 8 pictures: {8 * n_nodes} cells" in " ".join(first.split())
    assert (Path(run) / "report.html").stat().st_size > 100_000
    assert len((Path(run) / "answers.csv").read_text().splitlines()) == 1 + 12
    assert main(["report", run, "--keep", "0.8", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["decided"]["nodes"] == n_nodes
    assert summary["answers"] == json.loads((Path(run) / "summary.json").read_text())["answers"]
