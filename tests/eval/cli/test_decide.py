"""``blurnoise decide``: its ranges, its help and its errors; a small run, read again by ``report``."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest
from blurnoise_eval.deciding import decision
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.open import asked
from commands import main
from signs_in_memory import matched_detector, sign

Output = pytest.CaptureFixture[str]
SMALL = [
    "--exposure-ms", "8:32", "--lux", "1,2,5,20", "--dx", "0,100,200",
    "--gain", "0", "--keep", "0.8",
]  # fmt: skip


@pytest.mark.slow
def test_it_decides_and_report_says_the_same(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decision, "MOST_NODES", 12)
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
