"""A run of somebody else costs no time, memory or file of whoever opens it; what is wrong is one line."""

import os
import resource
import signal
import sys
from contextlib import suppress

import pytest
from blurnoise_eval.store.store import StoreError
from blurnoise_eval.sweep.open import Run
from commands import main
from hostile_runs import READ, REFUSED, SENTINEL, changed, small_run
from processes import limited

SECONDS, MEGABYTES = 20, 2000
COMMANDS = {
    "report": "report {run} -o {out}/report",
    "fiftyone": "report {run} -o {out}/other --coco --fiftyone {out}/fiftyone",
    "program": "program {run} -o {out}/program",
    "merge": "merge {run} -o {out}/merged",
    "explore": "explore {run} -o {out}/seen.png --model none",
    "maps": "maps {run} -o {out}/maps",
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
    with limited(SECONDS):
        code = main(words)
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    assert "\x1b" not in said.out + said.err
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000 < MEGABYTES
    return code, said


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
@pytest.mark.parametrize("what", ["an endless tree", "a pattern that backtracks"])
def test_ctrl_c_ends_it(what, run, tmp_path, capsys):
    folder = changed(run, tmp_path, (READ | REFUSED)[what])
    signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, 1.0)
    with suppress(KeyboardInterrupt):
        assert main(["report", folder, "-o", tmp_path / "out", "--trust"]) in (2, 130)
