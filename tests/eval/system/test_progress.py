"""Progress: on a pipe a line now and then, on a terminal one that changes; how far, how fast, when it ends."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

import pytest
from blurnoise_eval.system import progress
from blurnoise_eval.system.progress import ProgressBar

Output = pytest.CaptureFixture[str]


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The clock, s."""
    clock = [100.0]
    monkeypatch.setattr(progress, "monotonic", lambda: clock[0])
    return clock


def test_a_log_says_how_far_it_is_and_when_it_ends(now: list[float], capsys: Output) -> None:
    with ProgressBar("draw \x1b", 100) as advance:
        for _ in range(100):
            now[0] += 4.0
            advance(1)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "draw ?: 3 of 100, 3 %, 0.25/s, 6 min left"
    assert lines[-1] == "draw ?: 100 of 100, took 7 min"
    assert len(lines) == 2 + 6  # after 12 s, then each minute, and the end


def test_what_is_interrupted_says_where(now: list[float], capsys: Output) -> None:
    def work() -> None:
        with ProgressBar("sweep", 10) as advance:
            advance(4)
            now[0] += 30.0
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert capsys.readouterr().err == "sweep: 4 of 10, stopped after 30 s\n"
    with ProgressBar("short", 9) as advance:
        advance(9)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("columns", [40, 120])
def test_a_terminal_has_a_line_that_breaks_no_number(columns: int) -> None:
    code = (
        "from blurnoise_eval.system.progress import ProgressBar\n"
        "with ProgressBar('[/] [red]', 12345) as advance:\n"
        "    advance(12000)\n"
    )
    seen, own = pty.openpty()
    here = {**os.environ, "COLUMNS": str(columns), "TERM": "xterm"}
    subprocess.run([sys.executable, "-c", code], stderr=own, stdout=own, check=True, env=here)
    os.close(own)
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", os.read(seen, 65536).decode())
    os.close(seen)
    lines = [line.rstrip() for line in re.split(r"[\r\n]+", shown)]
    assert max(map(len, lines)) <= columns
    assert "…" not in shown
    assert "[/] [red]: 12000 of 12345," in shown
    assert "97 %" in shown
