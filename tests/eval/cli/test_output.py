"""Standard output that is closed, full or no longer read: a line at most, no traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from blurnoise_eval.cli import main


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="has no full device")
@pytest.mark.parametrize(
    ("output", "code", "told"), [(">/dev/full", 2, "No space left on device"), (">&-", 0, "")]
)
def test_output_that_cannot_be_written_is_a_line(output: str, code: int, told: str) -> None:
    run = f'"{sys.executable}" -c "from blurnoise_eval.cli import main; raise SystemExit(main())" --help {output}'
    done = subprocess.run(run, shell=True, capture_output=True, text=True)
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert told in done.stderr
    assert done.stderr.count("\n") <= 1


def test_errors_after_two_dashes_name_their_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--", "sweep", "--limit", "0", "-o", "run"]) == 2
    assert capsys.readouterr().err == "blurnoise: error: --limit = 0: must be >= 1\n"
