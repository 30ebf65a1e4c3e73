"""Progress: on a pipe a line now and then, on a terminal one that changes; how far, how fast, when it ends."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

import pytest
from blurnoise_eval.system import progress
from blurnoise_eval.system.progress import ProgressBar, duration_text

Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def nothing_before() -> None:
    ProgressBar.command_begins()


def told(monkeypatch: pytest.MonkeyPatch, capsys: Output, steps: int, each_s: float) -> list[str]:
    """What work of that many steps, each so long, says on a pipe."""
    now = [100.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with ProgressBar("draw \x1b", steps) as advance:
        for step in range(steps):
            now[0] += each_s
            if step == steps // 2:
                advance.note("1 worker died")
            advance(1)
    return capsys.readouterr().err.splitlines()


def test_short_work_says_nothing(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    assert told(monkeypatch, capsys, 9, 1.0) == []


def test_long_work_says_how_far_it_is_and_when_it_ends(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    lines = told(monkeypatch, capsys, 100, 4.0)
    assert lines[0] == "draw ?: 3 of 100, 3 %, 0.25/s, 6 min left"
    assert lines[-2].endswith("left; 1 worker died")
    assert lines[-1] == "draw ?: 100 of 100, took 7 min; 1 worker died"
    assert len(lines) < 16


def test_short_works_one_after_the_other_are_told_as_one(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    now = [1000.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    for label in ("sweep", "score", "draw"):
        with ProgressBar(label, 10) as advance:
            for _ in range(10):
                now[0] += 0.7
                advance(1)
        now[0] += 1.0
    assert capsys.readouterr().err.splitlines() == [
        "score: 3 of 10, 30 %, 1.43/s, 5 s left",
        "draw: 6 of 10, 60 %, 1.43/s, 3 s left",
    ]
    ProgressBar.command_begins()
    with ProgressBar("draw", 10) as advance:
        now[0] += 9.0
        advance(1)
    assert not capsys.readouterr().err


def test_what_was_done_before_is_no_speed(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    """900 of 1000 steps were done before; the others take 2 s each."""
    now = [100.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with ProgressBar("sweep", 1000) as advance:
        now[0] += 11.0
        advance.already(900)
        for _ in range(10):
            now[0] += 2.0
            advance(1)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "sweep: 900 of 1000, 90 %"
    assert lines[1] == "sweep: 905 of 1000, 90 %, 0.238/s, 7 min left"


def test_a_night_is_told_once_a_minute(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    assert 470 < len(told(monkeypatch, capsys, 8 * 3600, 1.0)) < 490


def test_what_is_interrupted_says_where(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])

    def work() -> None:
        with ProgressBar("sweep", 10) as advance:
            advance(4)
            now[0] = 30.0
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert capsys.readouterr().err == "sweep: 4 of 10, stopped after 30 s\n"


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0 s"), (89, "89 s"), (720, "12 min"), (12_000, "3 h 20 min")]
)
def test_durations_have_the_unit_that_fits(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


@pytest.mark.parametrize("columns", [40, 120])
def test_a_terminal_has_a_line_that_breaks_no_number(columns: int) -> None:
    code = (
        "from blurnoise_eval.system.progress import ProgressBar\n"
        "with ProgressBar('train 9 networks', 12345) as advance:\n"
        "    advance(12000)\n    advance.note('2 workers died')\n"
    )
    seen, own = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", code],
        stderr=own,
        stdout=own,
        check=True,
        env={**os.environ, "COLUMNS": str(columns)},
    )
    os.close(own)
    assert done.returncode == 0
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", os.read(seen, 65536).decode())
    os.close(seen)
    lines = [line.rstrip() for line in re.split(r"[\r\n]+", shown)]
    assert max(map(len, lines)) <= columns
    assert "…" not in shown
    assert "12000 of 12345, 97 %," in shown
    assert "2 workers died" in shown
    assert ("[===================" in shown) == (columns > 100)
