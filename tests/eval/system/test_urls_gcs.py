"""Objects of Google Cloud Storage, by a server that answers as its JSON API does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from gcs_servers import BUCKET, gcs_server

pytest.importorskip("gcsfs")
pytestmark = pytest.mark.slow  # the package takes its endpoint from the environment as it is imported

_USE = f"""
import pytest
from blurnoise_eval.system.urls import listing, local_file, location, version, versions
from blurnoise_eval.system.working_folder import read_run, written_run
root = location("gs://{BUCKET}")
large = root / "sub/größe b.bin"
assert local_file(large, known=version(large)).read_bytes() == b"first"
assert list(listing(root)) == ["a.bin", "c.bin", "sub/größe b.bin"]
assert list(listing(location("gs://{BUCKET}/sub/"))) == ["größe b.bin"]
assert (root / "sub").is_dir() and (root / "a.bin").is_file() and not (root / "none").exists()
assert versions(root, ["a.bin", "none"]) == {{"a.bin": listing(root)["a.bin"]}}
for missing in (root / "none", location("gs://other/a.bin")):
    with pytest.raises(FileNotFoundError, match="no such object"):
        local_file(missing)
before = version(root / "a.bin")
root.fs.pipe_file((root / "a.bin").path, b"other")
with pytest.raises(OSError, match="has changed"):
    local_file(root / "a.bin", known=before)
assert local_file(root / "a.bin").read_bytes() == b"other"
with written_run(root / "run") as folder:
    (folder.path / "results.sqlite").write_text("rows")
with read_run(root / "run") as folder:
    assert (folder.path / "results.sqlite").read_text() == "rows"
"""


def test_a_bucket(tmp_path: Path) -> None:
    """Listed in pages; an object that changes with as many bytes, a run that is put."""
    objects = {"a.bin": b"third", "c.bin": b"", "sub/größe b.bin": b"first"}
    with gcs_server(objects) as address:
        here = {"STORAGE_EMULATOR_HOST": address, "BLURNOISE_CACHE": str(tmp_path)}
        done = subprocess.run(
            [sys.executable, "-c", _USE],
            env={**os.environ, **here},
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert objects == {
        "a.bin": b"other",
        "c.bin": b"",
        "sub/größe b.bin": b"first",
        "run/results.sqlite": b"rows",
    }
