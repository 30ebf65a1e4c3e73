"""Models that never answer: a time limit for loading and the first answer, and interrupts that reach native code."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.detectors.model import OnnxModel
from commands import main
from endless_graphs import SIZE_PX, endless_below

DARK = np.zeros((1, 3, SIZE_PX, SIZE_PX), np.float32)
BRIGHT = np.ones((1, 3, SIZE_PX, SIZE_PX), np.float32)


def test_a_later_answer_has_none_but_can_be_interrupted(tmp_path):
    model = OnnxModel(endless_below(tmp_path / "dark.onnx", 0.5), timeout_s=0.3)
    model.infer(BRIGHT)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(model.infer, DARK)
        time.sleep(0.6)
        assert not asked.done()
        model.interrupt()
        with pytest.raises(InterruptedError, match=r"dark.onnx"):
            asked.result()
        assert pool.submit(model.infer, BRIGHT).result()[0].shape == (1, 84, 8400)


@pytest.mark.parametrize("command", ["inspect", "explore -o seen.png --model"])
def test_commands_name_model_limit_and_option(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    endless = endless_below(Path("endless.onnx"), 2.0)
    endless.with_suffix(".contract.json").write_text('{"base": "yolov8"}')
    assert main([*command.split(), str(endless), "--model-timeout-s", "0.3"]) == 2
    told = "blurnoise: error: endless.onnx: did not finish an inference within 0.3 s; --model-timeout-s allows more"
    assert capsys.readouterr().err.splitlines() == [told]
    assert not Path("seen.png").exists()


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
@pytest.mark.parametrize("engine", ["threads", "processes"])
def test_an_interrupt_ends_a_sweep_in_the_middle_of_a_later_answer(tmp_path, engine):
    model = endless_below(tmp_path / "dark.onnx", 0.25)
    options = f"--contract yolov8 --lux 50 --exposure-ms 0.01 --dx 0 --gain 0 --limit 2 --threads 2 --engine {engine}"
    where = ["--model", str(model), "-o", str(tmp_path / "run")]
    asked = [sys.executable, "-m", "blurnoise_eval.cli", "sweep", *where, *options.split()]
    process = subprocess.Popen(asked, stderr=subprocess.PIPE, start_new_session=True, text=True)
    try:
        with pytest.raises(subprocess.TimeoutExpired):  # until then workers have begun, and answer no more
            process.wait(timeout=40)
        os.killpg(process.pid, signal.SIGINT)
        _, told = process.communicate(timeout=30)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == -signal.SIGINT
    assert told.splitlines()[-1].startswith("blurnoise: interrupted")
