"""Google Cloud Storage and the Hugging Face Hub, by servers that answer as they do."""

import os
import subprocess
import sys
from typing import Any

import pytest
from cloud_servers import BUCKET, REPOSITORY, gcs_server, hub_server

pytestmark = pytest.mark.slow  # the packages take their endpoints from the environment as they are imported
READ = """
import sys
import pytest
from blurnoise_eval.system.urls import listing, local_file, location, version, versions
from blurnoise_eval.system.working_folder import read_run, written_run
root, elsewhere = location(sys.argv[1]), location(sys.argv[2])
known = version(root / "größe.bin")
assert local_file(root / "größe.bin", known=known).read_bytes() == b"first"
assert listing(root) == {"größe.bin": known, "b.bin": version(root / "b.bin")}
assert versions(root, ["b.bin", "none"]) == {"b.bin": version(root / "b.bin")}
assert (root / "b.bin").is_file() and not (root / "none").exists()
for missing in (root / "none", elsewhere):
    with pytest.raises(FileNotFoundError, match="no such object"):
        local_file(missing)
before = version(root / "b.bin")
print("now", flush=True)
sys.stdin.readline()
with pytest.raises(OSError, match="has changed"):
    local_file(root / "b.bin", known=before)
assert local_file(root / "b.bin").read_bytes() == b"other"
if sys.argv[1].startswith("gs:"):
    with written_run(root / "run") as folder:
        (folder.path / "results.sqlite").write_text("rows")
    with read_run(root / "run") as folder:
        assert (folder.path / "results.sqlite").read_text() == "rows"
"""


@pytest.mark.parametrize(
    ("package", "serve", "endpoint", "urls"),
    [
        ("gcsfs", gcs_server, "STORAGE_EMULATOR_HOST", (f"gs://{BUCKET}", "gs://other/a.bin")),
        ("huggingface_hub", hub_server, "HF_ENDPOINT", (f"hf://{REPOSITORY}", "hf://datasets/user/none/a")),
    ],
)
def test_objects_are_read_and_their_changes_noticed(package, serve, endpoint, urls, tmp_path):
    """One changes under way, with as many bytes; a run is put into the bucket."""
    pytest.importorskip(package)
    files = {"größe.bin": b"first", "b.bin": b"third"}
    pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with serve(files) as address:
        here = {endpoint: address, "HF_HOME": str(tmp_path), "BLURNOISE_CACHE": str(tmp_path / "cache")}
        command = [sys.executable, "-c", READ, *urls]
        process = subprocess.Popen(command, env={**os.environ, **here}, text=True, **pipes)
        assert process.stdout is not None
        if process.stdout.readline() == "now\n":
            files["b.bin"] = b"other"
        _, told = process.communicate("\n", timeout=300)
    assert process.returncode == 0, told
    assert package != "gcsfs" or files["run/results.sqlite"] == b"rows"
