"""An interrupt while processes begin."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest
from blurnoise_eval.sweep.engines.processes import _interrupts_held


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signal masks are POSIX")
@pytest.mark.parametrize("threads", [0, 3])
def test_an_interrupt_meanwhile_comes_afterwards(threads: int) -> None:
    """Whichever thread it reaches."""
    done = threading.Event()
    for _ in range(threads):
        threading.Thread(target=done.wait).start()
    passed: list[str] = []

    def interrupted() -> None:
        with _interrupts_held():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
            passed.append("the end of the block")

    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
    finally:
        done.set()
    assert passed
