"""The commands that make the detector, and the bench of what an augmentation costs a training step."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas
import pytest
from blurnoise_eval.datasets import coco
from blurnoise_eval.detectors.detector import Detector
from commands import main

from blurnoise import charts


@pytest.mark.slow
def test_scenes_are_coco(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "-o", str(tmp_path), "--count", "4", "--size", "96", "--seed", "7"]) == 0
    listing = Path(capsys.readouterr().out.strip())
    pictures = coco(listing, labels=["stop sign"], keep_empty=True)
    assert len(pictures) == 4
    assert next(iter(pictures)).load().shape == (96, 96, 3)


@pytest.mark.slow
def test_train_writes_a_detector_that_says_how_it_was_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--pictures", "320", "--scenes", "16", "--size", "96", "--threads", "1"]
    assert main(["train", "-o", str(tmp_path), *small, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert {name: facts[name] for name in ("arm", "seed", "scenes", "pictures")} == {
        "arm": "exposure",
        "seed": 0,
        "scenes": 16,
        "pictures": 320,
    }
    assert Detector(facts["model"]).input_size_px == (96, 96)
    told = pandas.read_csv(tmp_path / "training.csv")
    assert told.pictures.tolist() == list(range(16, 321, 16))
    assert told.loss.iloc[-1] == pytest.approx(facts["loss"], rel=1e-5)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL, signal.SIGINT])
def test_no_process_outlives_a_training_that_draws_scenes(tmp_path: Path, how: signal.Signals) -> None:
    """SIGINT goes to the terminal's group, the others to the first process alone."""
    started = [sys.executable, "-m", "blurnoise_eval.cli", "train", "-o", str(tmp_path), "--scenes", "16000"]
    process = subprocess.Popen(started, stderr=subprocess.PIPE, start_new_session=True, text=True)
    deadline = time.monotonic() + 400
    drawn = tmp_path / "pool"
    try:
        while not any(
            each.stat().st_blocks >= 9_000 for each in drawn.glob(".*.partial")
        ):  # 64 scenes: 36 864
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how)
        _, told = process.communicate(timeout=200)  # workers hold the pipe's other end
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert "Traceback" not in told
    if how == signal.SIGINT:
        assert process.returncode == 130
        *progress, last = told.splitlines()  # how far it was, where it took long to come this far
        assert last == "blurnoise: interrupted; what was finished is kept"
        assert all(line.startswith("draw scenes: ") for line in progress)
    else:
        assert process.returncode == -how
    assert not list(drawn.glob("*.npy"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--pictures", "10"], "pictures = 10"),
        (["--scenes", "0"], "'--scenes'"),
        (["--size", "33"], "size_px = 33"),
        (["--seed", "-1"], "seed = -1"),
        (["--seed", "9" * 400], "seed = 999"),
        (["--scenes", "1" + "0" * 15], "scenes take 3.07e+11 GB"),
    ],
)
def test_bad_sizes_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    try:
        code = main(["train", "-o", str(tmp_path / "out"), *options])
    except SystemExit as exit:
        code = exit.code  # type: ignore[assignment]
    assert code == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "wrong", [["--count", "0"], ["--seed", "-1"], ["--size", "5"], ["--size", "100000000"]]
)
def test_wrong_scenes_leave_earlier_ones_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: list[str]
) -> None:
    earlier = tmp_path / "instances.json"
    earlier.write_text("{}")
    assert main(["scenes", "-o", str(tmp_path), *wrong]) == 2
    assert wrong[0].strip("-") in capsys.readouterr().err
    assert earlier.read_text() == "{}"
    assert main(["scenes", "-o", str(tmp_path / "new"), *wrong]) == 2
    assert not (tmp_path / "new").exists()


def test_a_picture_too_large_for_the_memory_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def allocate(*_: object, **__: object) -> object:
        return np.empty((1 << 28, 1 << 28))

    monkeypatch.setattr(charts, "flat_patch", allocate)
    assert main(["chart", "flat-patch", "-o", str(tmp_path / "flat.png")]) == 2
    assert capsys.readouterr().err.startswith("blurnoise: error: out of memory")
    assert not list(tmp_path.iterdir())
