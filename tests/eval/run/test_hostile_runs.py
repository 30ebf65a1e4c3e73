"""A run of somebody else costs no time, memory or file of whoever opens it; what is wrong is one line."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.store import Store, StoreError
from commands import main
from hostile_runs import ENDLESS, READ, REFUSED, SENTINEL, changed, small_run
from processes import limited

SECONDS, MEGABYTES = 20, 2000
COMMANDS = {
    "report": "report {run} -o {out}/report",
    "coco": "report {run} -o {out}/other --coco",
    "program": "program {run} -o {out}/program",
    "merge": "merge {run} -o {out}/merged",
    "explore": "explore {run} -o {out}/seen.png --model none",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory, detector):
    return small_run(tmp_path_factory.mktemp("small") / "run", detector)


def names_below(folder):
    return {
        each.relative_to(folder) for each in folder.rglob("*") if "out" not in each.parts[len(folder.parts) :]
    }


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_run_is_refused_at_the_door(what, run, tmp_path):
    folder = changed(run, tmp_path, REFUSED[what])
    before = names_below(tmp_path)
    with limited(SECONDS), pytest.raises(StoreError) as error, Run.open(folder):
        pass
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 1000
    assert str(folder) in str(error.value)
    assert names_below(tmp_path) - before <= {folder.relative_to(tmp_path) / "results.sqlite-shm"}
    assert (tmp_path / SENTINEL).read_text() == "mine"


def outcome(words, capsys):
    """Exit code and what was said; within the budget."""
    with suppress(OSError):  # earlier tests of this process may have had a higher peak
        Path("/proc/self/clear_refs").write_text("5")
    before_kb = peak_kb()
    with limited(SECONDS):
        code = main(words)
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    assert "\x1b" not in said.out + said.err
    assert (peak_kb() - before_kb) / 1000 < MEGABYTES
    return code, said


def peak_kb():
    """The most memory that this process had since the peak was reset."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="measures memory as Linux has it")
@pytest.mark.parametrize(
    "what", [*READ, "a view in place of a table", "an id that leaves the folder", "an endless tree"]
)
def test_commands_survive_it(what, run, tmp_path, capsys):
    folder = changed(run, tmp_path, (READ | REFUSED)[what])
    before = names_below(tmp_path)
    (out := tmp_path / "out").mkdir()
    for name, words in COMMANDS.items():
        code, said = outcome(words.format(run=folder, out=out).split(), capsys)
        assert code in (0, 2), (name, said.err)
        if code == 2:
            assert said.err.splitlines()[-1].startswith("blurnoise: error: "), (name, said.err)
        if what == "nothing":
            assert code == 0 or name == "program", said.err
        if what in REFUSED:
            assert code == 2, name
    assert names_below(tmp_path) == before
    assert (tmp_path / SENTINEL).read_text() == "mine"


@pytest.mark.slow
def test_ctrl_c_ends_a_search(run, tmp_path):
    """For a pattern that whoever trusts the run has searched for: in a process of its own, within seconds."""
    folder = changed(run, tmp_path, READ["a pattern that backtracks"])
    words = [sys.executable, "-m", "blurnoise_eval.cli", "report", folder, "-o", tmp_path / "out", "--trust"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        with suppress(subprocess.TimeoutExpired):
            process.wait(SECONDS / 2)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=SECONDS)
    assert process.returncode == -signal.SIGINT  # as a shell sees 130
    assert "Traceback" not in said


def test_ctrl_c_ends_a_query_and_none_is_endless(run, monkeypatch):
    with Store(run) as store:
        signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
        signal.setitimer(
            signal.ITIMER_REAL, 0.1, 0.5
        )  # again, if the first falls into a callback of the collector
        with pytest.raises(KeyboardInterrupt):
            list(store.rows(f"{ENDLESS} SELECT COUNT(*) FROM n"))
        signal.setitimer(signal.ITIMER_REAL, 0)
    monkeypatch.setattr("blurnoise_eval.store.reading._STEPS", 1_000_000)
    with Store(run) as store, limited(SECONDS), pytest.raises(StoreError, match="does not end"):
        list(store.rows(f"{ENDLESS} SELECT COUNT(*) FROM n"))
