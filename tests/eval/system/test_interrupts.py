"""Signals: one way for a command to end, whichever signal ends it; a second one ends the process at once."""

import os
import signal
import subprocess
import sys

import pytest
from blurnoise_eval.system.interrupts import in_order, keeps, taken_back

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
ALONE = """
import signal, sys, time
from blurnoise_eval.system.interrupts import in_order
{before}
def run():
    print("begun", flush=True)
{body}
sys.exit(in_order(run, own_process=True))
"""


@pytest.fixture(autouse=True)
def no_signal_is_ignored():
    """As at a terminal; under nohup, or behind a shell's &, these tests would see signals that are passed over."""
    ends = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    before = {number: signal.signal(number, end) for number, end in ends.items()}
    yield
    for number, end in before.items():
        signal.signal(number, end)


@pytest.mark.parametrize(
    ("number", "finished", "line"),
    [
        (signal.SIGINT, False, "blurnoise: interrupted\n"),
        (signal.SIGTERM, True, "blurnoise: interrupted; finished work is kept\n"),
        (signal.SIGHUP, False, "blurnoise: interrupted\n"),
    ],
)
def test_a_signal_ends_a_command_with_its_number_and_a_true_line(number, finished, line, capsys):
    undone = []

    def run():
        keeps(lambda: finished)
        try:
            signal.raise_signal(number)
        finally:
            undone.append(True)
        return 0

    before = signal.getsignal(number)
    assert in_order(lambda: in_order(run)) == 128 + number
    assert capsys.readouterr().err == line
    assert undone
    assert signal.getsignal(number) is before


def test_an_interrupt_in_a_destructor_is_not_lost(capsys):
    class Closing:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    def run():
        Closing()
        signal.sigtimedwait([], 10)
        return 0

    assert in_order(run) == 143
    assert capsys.readouterr().err == "blurnoise: interrupted\n"


def test_a_library_cannot_keep_sigterm(capsys):
    def run():
        with taken_back():
            signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
            signal.raise_signal(signal.SIGTERM)
        return 0

    assert in_order(run) == 143


def alone(folder, body, *, before="", signals=(signal.SIGTERM,), wait="begun"):
    """Exit code and both outputs of a process of its own that gets these signals, once it has printed ``wait``."""
    code = ALONE.format(body="\n".join(f"    {line}" for line in body.splitlines()), before=before)
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder
    )
    out = ""
    for number in signals:
        while wait not in out:
            out = process.stdout.readline().strip() or pytest.fail(process.communicate()[1])
        process.send_signal(number)
        wait = "ending"
    rest, err = process.communicate(timeout=60)
    return process.returncode, out + rest, err


def test_a_process_of_its_own_ends_by_the_signal(tmp_path):
    """So that a loop of a shell ends, too; what it reports is 128 + the number."""
    assert alone(tmp_path, "time.sleep(60)") == (-signal.SIGTERM, "begun", "blurnoise: interrupted\n")


def test_a_second_signal_ends_at_once_and_silently(tmp_path):
    body = "try:\n    print('working', flush=True)\n    time.sleep(60)\n"
    body += "finally:\n    print('ending', flush=True)\n    time.sleep(60)"
    code, _, err = alone(tmp_path, body, signals=(signal.SIGINT, signal.SIGINT), wait="working")
    assert (code, err) == (-signal.SIGINT, "")


def test_an_import_is_no_place_for_an_exception(tmp_path):
    (tmp_path / "slow.py").write_text(
        "import time\ntry:\n    print('begun to import', flush=True)\n    time.sleep(60)\n"
        "except BaseException:\n    time.sleep(60)\n"
    )
    code, _, err = alone(tmp_path, "import slow", wait="import", signals=(signal.SIGINT,))
    assert (code, err) == (-signal.SIGINT, "blurnoise: interrupted\n")


def test_what_is_ignored_stays_ignored(tmp_path):
    ignored = "signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    code, out, err = alone(
        tmp_path, "time.sleep(0.3)\nprint('done')\nreturn 0", before=ignored, signals=[signal.SIGHUP]
    )
    assert (code, out.endswith("done\n"), err) == (0, True, "")
