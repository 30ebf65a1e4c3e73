"""Workers end with their parent, and leave interrupts to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from blurnoise_models.training import end_with_parent

PARENT = """
import os, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from blurnoise_models.training import end_with_parent

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, get_context("spawn"), end_with_parent)
    print(pool.submit(os.getpid).result(), flush=True)
    BUSY
    time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
@pytest.mark.parametrize("busy", ["", "pool.submit(time.sleep, 60)"], ids=["idle", "busy"])
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_worker_ends_with_its_parent(tmp_path: Path, how: signal.Signals, busy: str) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT.replace("BUSY", busy))
    # The worker holds the pipe's other end for as long as it lives.
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert int(parent.stdout.readline()) != parent.pid
    parent.send_signal(how)
    parent.communicate(timeout=20)
    assert parent.returncode == -how


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
def test_a_worker_leaves_interrupts_to_its_parent() -> None:
    with ProcessPoolExecutor(1, get_context("spawn"), end_with_parent) as pool:
        worker = pool.submit(os.getpid).result()
        os.kill(worker, signal.SIGINT)
        assert pool.submit(os.getpid).result() == worker
