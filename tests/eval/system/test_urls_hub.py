"""Objects of the Hugging Face Hub, by a server that answers as it does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hub_servers import REPOSITORY, hub_server

pytest.importorskip("huggingface_hub")
pytestmark = pytest.mark.slow  # the package takes its endpoint from the environment as it is imported

_READ = f"""
import sys
import pytest
from blurnoise_eval.system.urls import listing, local_file, location, version
root = location("hf://{REPOSITORY}")
known = version(root / "größe.bin")
assert local_file(root / "größe.bin", known=known).read_bytes() == b"first"
assert listing(root) == {{"größe.bin": known, "b.bin": version(root / "b.bin")}}
assert not (root / "none").exists()
with pytest.raises(FileNotFoundError, match="no such object"):
    local_file(location("hf://datasets/user/none/a"))
before = version(root / "b.bin")
print("now", flush=True)
sys.stdin.readline()
with pytest.raises(OSError, match="has changed"):
    local_file(root / "b.bin", known=before)
assert local_file(root / "b.bin").read_bytes() == b"other"
"""


def test_a_data_set_of_the_hub(tmp_path: Path) -> None:
    """A file that changes under way, with as many bytes, is noticed by a process that has seen it before."""
    files = {"größe.bin": b"first", "b.bin": b"third"}
    with hub_server(files) as address:
        set_here = {
            "HF_ENDPOINT": address,
            "HF_HOME": str(tmp_path),
            "BLURNOISE_CACHE": str(tmp_path / "cache"),
        }
        pipes: dict[str, Any] = {
            "stdin": subprocess.PIPE,
            "stdout": subprocess.PIPE,
            "stderr": subprocess.PIPE,
        }
        process = subprocess.Popen(
            [sys.executable, "-c", _READ], env={**os.environ, **set_here}, text=True, **pipes
        )
        assert process.stdout is not None
        if process.stdout.readline() == "now\n":
            files["b.bin"] = b"other"
        _, told = process.communicate("\n", timeout=300)
    assert process.returncode == 0, told
