"""What is said of this machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from blurnoise_eval.system import machine
from blurnoise_eval.system.machine import usable_cores


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="affinity is Linux's")
def test_only_cores_that_may_be_used_count() -> None:
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert usable_cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)


def test_two_commits_of_one_version_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "files", lambda package: tmp_path)
    (tmp_path / "below").mkdir()
    found = []
    for text in (b"a = 1\n", b"a = 1\r\n", b"a = 2\n"):
        (tmp_path / "below" / "code.py").write_bytes(text)
        found.append(machine.sources.__wrapped__())
    assert found[0] == found[1] != found[2]
    assert found[0] != machine.versions()["sources"]
