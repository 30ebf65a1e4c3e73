"""A made-up axis is one entry of the table: option, column, store, caption, page, decide and explorer follow."""

import subprocess
import sys

import pandas as pd
import pytest

SCRIPT = '''
import importlib.util, sys
from pathlib import Path
spec = importlib.util.find_spec("blurnoise_eval.plan.axes")
source = Path(spec.origin).read_text(encoding="utf-8")
entry = """    Axis(
        "read_noise_e", "camera.read_noise_e", "--read-noise-e", "of the amplifier, e-", "Read noise", "e-",
        1.0, 0.0, 1e6, "read noise {} e-", "read{}e", own=lambda camera: camera.sensor.read_noise_e,
    ),
"""
table, rest = source.split(")  # fmt: skip\\nNAMES")
axes = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = axes
exec(compile(table + entry + ")  # fmt: skip\\nNAMES" + rest, spec.origin, "exec"), vars(axes))

from blurnoise_eval import cli
words = "--lux 2 --exposure-ms 5 --dx 0 --limit 1 --camera imx250 --read-noise-e 2,40 -o run"
assert cli.main(["sweep", *words.split()]) == 0
from blurnoise import Camera
from blurnoise_eval.explorer.state import controls
from blurnoise_eval.run.run import Run
assert controls(Camera.preset("imx250"))["read_noise_e"].axis is axes.axis("read_noise_e")
with Run.open("run") as run:
    assert run.plan.values("read_noise_e") == (2.0, 40.0)
assert "--read-noise-e" in {name for param in cli.command(cli.function("decide")).params for name in param.opts}
assert cli.main(["sweep", "--read-noise-e", "-1", "-o", "other"]) == 2
'''


@pytest.mark.slow
def test_a_new_axis_is_everywhere(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "--read-noise-e = -1.0: must be finite and >= 0" in done.stderr
    cells = pd.read_csv(tmp_path / "run" / "results.csv")
    exposed = cells[~cells["clean"]].set_index("read_noise_e")["target_confidence"]
    assert set(exposed.index) == {2.0, 40.0}
    assert exposed[2.0].mean() > exposed[40.0].mean() + 0.1
    assert "read noise 40 e-" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
