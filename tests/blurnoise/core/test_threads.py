"""Jobs side by side: all done, errors raised, no deadlock in a job or after a fork."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from blurnoise._core import threads
from blurnoise._core.threads import side_by_side


@pytest.mark.parametrize("workers", [1, 3])
def test_every_job_is_done_once(workers: int) -> None:
    done: list[int] = []
    side_by_side(done.append, range(50), workers)
    assert sorted(done) == list(range(50))


def test_jobs_do_run_side_by_side() -> None:
    """Two jobs that wait for each other end only if both run at once."""
    meeting = threading.Barrier(2, timeout=20)
    side_by_side(lambda _: meeting.wait(), range(2), 2)


def test_a_jobs_jobs_run_in_turn() -> None:
    done: list[tuple[int, int]] = []
    side_by_side(lambda i: side_by_side(lambda j: done.append((i, j)), range(4), 2), range(4), 2)
    assert sorted(done) == [(i, j) for i in range(4) for j in range(4)]


def test_the_first_error_is_raised_after_all_have_ended() -> None:
    done: list[int] = []

    def work(job: int) -> None:
        if job == 1:
            raise ValueError("job 1")
        done.append(job)

    with pytest.raises(ValueError, match="job 1"):
        side_by_side(work, range(6), 2)
    assert sorted(done) == [0, 2, 3, 4, 5]


def test_threads_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []

    def executor(count: int, **options: Any) -> ThreadPoolExecutor:
        made.append(count)
        return ThreadPoolExecutor(count, **options)

    monkeypatch.setattr(threads, "ThreadPoolExecutor", executor)
    monkeypatch.setattr(threads, "_pools", {})
    for _ in range(3):
        side_by_side(lambda _: None, range(4), 2)
    assert made == [2]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_a_forked_process_has_threads_of_its_own() -> None:
    code = (
        "import os\n"
        "from blurnoise._core.threads import side_by_side\n"
        "side_by_side(lambda job: None, range(4), 2)\n"
        "if os.fork() == 0:\n"
        "    side_by_side(lambda job: None, range(4), 2)\n"
        "    os._exit(7)\n"
        "print(os.waitstatus_to_exitcode(os.wait()[1]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "7"
